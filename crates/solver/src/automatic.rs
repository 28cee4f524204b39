//! The choice of a solver, made anew for each problem: the cheapest first, another where it stalls.
//!
//! 1. Block Gauss-Seidel, a few sweeps: settles warm starts and easy problems before anything is factored.
//! 2. Semismooth Newton from there: the fastest to a tight tolerance on the compliances of soft bodies, and it takes
//!    rank-deficient ones.
//! 3. The accelerated gradient, as long as its residual falls: rank-deficient `W` does not disturb it, and an iteration costs a
//!    product with `W`, where a pivot of Lemke's on ten times as many variables may be one of thousands.
//! 4. Lemke, for problems of moderate size: needs neither symmetry nor a definite `W`.
//! 5. Block Gauss-Seidel with many sweeps.
//! 6. Cone programs, for symmetric `W`.
//!
//! Each begins at the best forces so far. The report has their residual, the iterations of all attempts, and how the
//! run ended: a limit of time that was met, else the finding of the last attempt that had one (no solution, stalled),
//! else the status of the attempt with the least residual. [`AutomaticWorkspace::attempts`] tells what was tried and
//! how it ended. Step 6 allocates where it meets a sequence of laws that it has neither met lately nor
//! been prepared for.
//! [`AutomaticConfig::bounded`] leaves steps 4 and 6 out. Steps 4 and 6, whose iterations are long, end after so many
//! as are their own default, or sooner by the limit of each attempt.

use crate::accelerated_gradient::{AcceleratedGradientConfig, AcceleratedGradientWorkspace};
use crate::conic_friction::{ConicFrictionConfig, ConicFrictionWorkspace};
use crate::gauss_seidel::{GaussSeidelConfig, GaussSeidelWorkspace};
use crate::lemke::{LemkeConfig, LemkeWorkspace};
use crate::newton::{NewtonConfig, NewtonWorkspace};
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};

/// Rows up to which Lemke is tried: 60 frictional contacts, a second or so.
const LEMKE_ROWS: usize = 180;

/// Sweeps of the first attempt: a Newton step on 30 contacts costs about as much as ten.
const FIRST_SWEEPS: u32 = 30;

/// Iterations without a fall of the residual by a hundredth after which the accelerated gradient makes way for the next.
const GRADIENT_STALL: u32 = 500;

/// Number of attempts there can be.
const ATTEMPTS: usize = 6;

/// Parameters of the automatic choice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AutomaticConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of iterations of each attempt. Default 5000.
    pub max_iterations: u32,
    /// Leaves out what a thread that must be in time cannot afford: Lemke's method, which may take a second, and the cone
    /// programs, whose interior points take as long. Default false.
    pub bounded: bool,
}

impl Default for AutomaticConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 5000, bounded: false }
    }
}

/// A solver that was tried, and what it answered.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Attempt {
    /// Register name.
    pub solver: &'static str,
    /// Its report.
    pub report: SolveReport,
}

/// Memory of all solvers that may be tried.
#[derive(Clone, Debug)]
pub struct AutomaticWorkspace {
    sweeps: GaussSeidelWorkspace,
    newton: NewtonWorkspace,
    lemke: LemkeWorkspace,
    gradient: AcceleratedGradientWorkspace,
    cones: ConicFrictionWorkspace,
    best: Vec<f64>,
    attempts: Vec<Attempt>,
}

impl AutomaticWorkspace {
    /// What the last solve tried, in order; the last entry is not always the one whose forces were taken.
    #[must_use]
    pub fn attempts(&self) -> &[Attempt] {
        &self.attempts
    }
}

/// The best answer so far.
struct Best<'a> {
    report: Option<SolveReport>,
    lambda: &'a mut Vec<f64>,
    attempts: &'a mut Vec<Attempt>,
}

impl Best<'_> {
    /// Takes an answer; `true` where the search is over. `lambda` becomes the best forces so far.
    fn take(&mut self, solver: &'static str, report: SolveReport, lambda: &mut [f64]) -> bool {
        self.attempts.push(Attempt { solver, report });
        if self.report.is_none_or(|best| report.residual < best.residual) {
            self.report = Some(report);
            self.lambda.clear();
            self.lambda.extend_from_slice(lambda);
        } else if lambda.len() == self.lambda.len() {
            lambda.copy_from_slice(self.lambda);
        }
        let over = [SolveStatus::Solved, SolveStatus::TimeLimit, SolveStatus::Invalid, SolveStatus::CapacityExceeded];
        over.contains(&report.status)
            && (solver == GaussSeidelConfig::NAME || report.status != SolveStatus::CapacityExceeded)
    }
}

impl ConstraintSolver for AutomaticConfig {
    const NAME: &'static str = "automatic";
    type Workspace = AutomaticWorkspace;

    fn workspace(&self, rows: usize) -> AutomaticWorkspace {
        AutomaticWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            newton: NewtonConfig::default().workspace(rows),
            lemke: LemkeConfig::default().workspace(if self.bounded { 0 } else { rows.min(LEMKE_ROWS) }),
            gradient: AcceleratedGradientConfig::default().workspace(rows),
            cones: ConicFrictionConfig::default().workspace(if self.bounded { 0 } else { rows }),
            best: Vec::with_capacity(rows),
            attempts: Vec::with_capacity(ATTEMPTS),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn prepare(&self, view: &ProblemView<'_>, ws: &mut AutomaticWorkspace) -> Result<(), SolveStatus> {
        if self.bounded {
            return Ok(());
        }
        if view.rows() <= LEMKE_ROWS {
            LemkeConfig::default().prepare(view, &mut ws.lemke)?;
        }
        ConicFrictionConfig::default().prepare(view, &mut ws.cones)
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut AutomaticWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        ws.attempts.clear();
        let mut best = Best { report: None, lambda: &mut ws.best, attempts: &mut ws.attempts };
        let (tolerance, most) = (self.tolerance, self.max_iterations);
        let rows = view.rows();
        let first = GaussSeidelConfig::default().limited(tolerance, Some(most.min(FIRST_SWEEPS)));
        let sweeps = GaussSeidelConfig::default().limited(tolerance, Some(most));
        let newton = NewtonConfig::default().limited(tolerance, Some(most));
        let own = LemkeConfig::default();
        let lemke = own.limited(tolerance, Some(most.min(own.max_iterations)));
        let gradient =
            AcceleratedGradientConfig { stall_iterations: GRADIENT_STALL, ..AcceleratedGradientConfig::default() }
                .limited(tolerance, Some(most));
        let own = ConicFrictionConfig::default();
        let cones = own.limited(tolerance, Some(most.min(own.max_iterations)));
        // In turn until one ends the search; nothing after that is run.
        let _over = attempt(&first, view, lambda, &mut ws.sweeps, watch, &mut best)
            || attempt(&newton, view, lambda, &mut ws.newton, watch, &mut best)
            || attempt(&gradient, view, lambda, &mut ws.gradient, watch, &mut best)
            || !self.bounded && rows <= LEMKE_ROWS && attempt(&lemke, view, lambda, &mut ws.lemke, watch, &mut best)
            || attempt(&sweeps, view, lambda, &mut ws.sweeps, watch, &mut best)
            || !self.bounded && attempt(&cones, view, lambda, &mut ws.cones, watch, &mut best);
        let Some(report) = best.report else { return SolveReport::failed(SolveStatus::Invalid, 0) };
        let iterations = best.attempts.iter().map(|attempt| attempt.report.iterations).sum();
        SolveReport { status: verdict(report.status, best.attempts), iterations, ..report }
    }
}

/// How the run ended, where `of_best` is the status of the attempt with the least residual: the end of the time before all
/// else, then what the last attempt found that was not cut short by a limit of iterations.
fn verdict(of_best: SolveStatus, attempts: &[Attempt]) -> SolveStatus {
    let ends = || attempts.iter().rev().map(|attempt| attempt.report.status);
    if of_best == SolveStatus::Solved {
        return of_best;
    }
    if let Some(status) = ends().find(|status| *status == SolveStatus::TimeLimit) {
        return status;
    }
    ends().find(|status| matches!(status, SolveStatus::NoSolution | SolveStatus::Stalled)).unwrap_or(of_best)
}

/// Runs one solver from the best forces so far; `true` where the search is over.
fn attempt<S: ConstraintSolver>(
    solver: &S,
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    ws: &mut S::Workspace,
    watch: &mut Watch<'_>,
    best: &mut Best<'_>,
) -> bool {
    let report = solver.solve_watched(view, lambda, ws, watch);
    best.take(S::NAME, report, lambda)
}
