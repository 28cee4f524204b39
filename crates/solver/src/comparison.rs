//! All solvers on a set of problems, each with its residual against time: what a chart of solvers is drawn from.

use crate::automatic::Attempt;
use crate::problem::ConstraintProblem;
use crate::report::SolveReport;
use crate::residual;
use crate::solver::{Solver, SolverWorkspace};
use crate::watch::{Sample, Watch};
use std::time::Instant;

/// One solver's run on one problem.
#[derive(Clone, Debug, serde::Serialize)]
pub struct SolverRun {
    /// Number of the problem in the set.
    pub problem: usize,
    /// Register name of the solver.
    pub solver: &'static str,
    /// What the solver says.
    pub report: SolveReport,
    /// Residual of its forces, evaluated from nothing but the problem.
    pub judged: f64,
    /// Wall time of the solve, without the making of its memory, s.
    pub seconds: f64,
    /// What the automatic choice tried, in order; empty for other solvers.
    pub attempts: Vec<Attempt>,
    /// Residual after each iteration, up to the number of samples asked for.
    pub history: Vec<Sample>,
    /// The forces, N.
    #[serde(skip)]
    pub lambda: Vec<f64>,
}

/// Runs each solver on each problem from zero forces, problem by problem; at most `samples` entries of history each.
/// `time_limit` in s, for each run.
#[must_use]
pub fn run_all(
    problems: &[ConstraintProblem],
    solvers: &[Solver],
    time_limit: Option<f64>,
    samples: usize,
) -> Vec<SolverRun> {
    let runs = problems.iter().enumerate().flat_map(|(number, problem)| {
        solvers.iter().map(move |solver| run(number, problem, &[], solver, time_limit, samples))
    });
    runs.collect()
}

/// [`run_all`] on one problem from given forces (N), one per row; rows beyond their number start from zero.
#[must_use]
pub fn run_all_from(
    problem: &ConstraintProblem,
    start: &[f64],
    solvers: &[Solver],
    time_limit: Option<f64>,
    samples: usize,
) -> Vec<SolverRun> {
    solvers.iter().map(|solver| run(0, problem, start, solver, time_limit, samples)).collect()
}

fn run(
    number: usize,
    problem: &ConstraintProblem,
    start: &[f64],
    solver: &Solver,
    time_limit: Option<f64>,
    samples: usize,
) -> SolverRun {
    let mut ws = solver.workspace(problem.rows());
    let mut lambda = vec![0.0; problem.rows()];
    lambda.iter_mut().zip(start).for_each(|(lambda, start)| *lambda = *start);
    let mut history = Vec::with_capacity(samples);
    // Before the watch begins: no sample is later than the end of the run.
    let start = Instant::now();
    let mut watch = Watch::none();
    if samples > 0 {
        watch = watch.record(&mut history);
    }
    if let Some(seconds) = time_limit {
        watch = watch.limit(seconds);
    }
    let report = solver.solve_watched(&problem.view(), &mut lambda, &mut ws, &mut watch);
    let seconds = start.elapsed().as_secs_f64();
    let judged = residual::evaluate(&problem.view(), &lambda, &mut vec![0.0; problem.rows()]).relative;
    let attempts = match &ws {
        SolverWorkspace::Automatic(ws) => ws.attempts().to_vec(),
        _ => Vec::new(),
    };
    SolverRun { problem: number, solver: solver.name(), report, judged, seconds, attempts, history, lambda }
}
