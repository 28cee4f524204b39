//! `palpate solve`.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use miette::{IntoDiagnostic, Report, Result, miette};
use palpate::solver::comparison::{SolverRun, run_all_from};
use palpate::solver::gauss_seidel::{GaussSeidelConfig, SweepOrder};
use palpate::solver::problem::ConstraintProblem;
use palpate::solver::problem_file::{self, ProblemFileError};
use palpate::solver::solver::Solver;
use serde_json::{Value, json};

use crate::arguments::SolveArguments;
use crate::exit;
use crate::output::{check_kept, check_writable, say};
use crate::solver_table;
use crate::stop::Stop;

/// Time between two looks at Ctrl-C.
const LOOK: Duration = Duration::from_millis(20);

/// Entries of a residual history in JSON; a run with more iterations shows its begin.
const HISTORY: usize = 10_000;

pub(crate) fn solve(arguments: &SolveArguments) -> Result<u8> {
    if let Some(out) = &arguments.out {
        if arguments.files.len() > 1 {
            let help = "solve the files one at a time, each with its own --out";
            return Err(miette!(help = help, "--out {} is for one FILE", out.display()));
        }
        check_kept("--out", out, &arguments.files)?;
        check_writable("--out", out)?;
    }
    if (arguments.relaxation.is_some() || arguments.sweep_order.is_some())
        && !["gauss_seidel", "all"].contains(&arguments.solver.as_str())
    {
        let help = "add --solver gauss_seidel (or all), or leave them out";
        return Err(miette!(
            help = help,
            "--relaxation and --sweep-order are for Gauss-Seidel, not {}",
            arguments.solver
        ));
    }
    // Every file is read before any is solved: a mistake in the last must not cost the time of the others.
    let problems = arguments.files.iter().map(|file| open(file, arguments.warm)).collect::<Result<Vec<_>>>()?;
    let solvers = solvers(arguments);
    let stop = Stop::watch()?;
    let (problems, answers) = solve_aside(problems, &solvers, arguments);
    let (mut all_solved, mut lost, mut described) = (true, false, Vec::new());
    for (file, (problem, _)) in arguments.files.iter().zip(problems.iter()) {
        // Not one of contact, then; some solvers take it all the same.
        if let Err(warning) = problem.validate() {
            eprintln!("warning: {}: {warning}", file.display());
        } else if let Err(warning) = problem.check_semidefinite() {
            eprintln!("warning: {}: {warning}", file.display());
        }
        let runs: Vec<_> = solvers.iter().map_while(|_| next(&answers, &stop)).collect();
        let ended = runs.len() < solvers.len();
        all_solved &= runs.iter().any(|run| run.report.is_solved());
        if arguments.json && !runs.is_empty() {
            described.push(description(file, problem, arguments.tol, &runs));
        } else if !runs.is_empty() {
            tell(file, problem, &runs)?;
        }
        if let Some(out) = &arguments.out
            && let Err(error) = write(out, problem, &runs)
        {
            eprintln!("warning: {error}");
            lost = true;
        }
        if ended {
            break;
        }
    }
    if arguments.json {
        say(format_args!("{:#}", Value::from(described)))?;
    }
    Ok(match (stop.is_asked(), all_solved, lost) {
        (true, ..) => stop.code(),
        (false, false, _) => exit::NOT_SOLVED,
        (false, true, true) => exit::FILE_LOST,
        (false, true, false) => 0,
    })
}

/// Problems, each with the forces to begin with.
type Problems = Arc<Vec<(ConstraintProblem, Vec<f64>)>>;

/// Solves on a thread of its own, file by file and solver by solver, so that Ctrl-C is heeded in the midst of a run.
fn solve_aside(
    problems: Vec<(ConstraintProblem, Vec<f64>)>,
    solvers: &[Solver],
    arguments: &SolveArguments,
) -> (Problems, Receiver<SolverRun>) {
    let problems = Arc::new(problems);
    let (work, solvers) = (Arc::clone(&problems), solvers.to_vec());
    let (time_limit, samples) = (arguments.time_limit, if arguments.json { HISTORY } else { 0 });
    let (sender, answers) = mpsc::channel();
    thread::spawn(move || {
        for (problem, start) in work.iter() {
            for solver in &solvers {
                let runs = run_all_from(problem, start, std::slice::from_ref(solver), time_limit, samples);
                // Nobody listens any more after Ctrl-C.
                if !runs.into_iter().all(|run| sender.send(run).is_ok()) {
                    return;
                }
            }
        }
    });
    (problems, answers)
}

/// The next answer; none after Ctrl-C.
fn next(answers: &Receiver<SolverRun>, stop: &Stop) -> Option<SolverRun> {
    while !stop.is_asked() {
        match answers.recv_timeout(LOOK) {
            Ok(run) => return Some(run),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return None,
        }
    }
    None
}

/// Prints the runs on one problem.
fn tell(file: &Path, problem: &ConstraintProblem, runs: &[SolverRun]) -> Result<()> {
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let (blocks, rows) = (count(problem.blocks().len(), "block"), count(problem.rows(), "row"));
    say(format_args!("{}: {blocks}, {rows}", file.display()))?;
    say(solver_table::runs(runs))?;
    runs.iter().filter_map(solver_table::attempts).try_for_each(say)?;
    match best(runs).filter(|_| !runs.iter().any(|run| run.report.is_solved())) {
        Some(best) => say(format_args!("{}: {}", best.solver, best.report.explain(problem))),
        None => Ok(()),
    }
}

/// The problem in a file, with numbers that a solver can begin with, and the forces to begin with: none unless `warm`.
fn open(file: &Path, warm: bool) -> Result<(ConstraintProblem, Vec<f64>)> {
    let (problem, forces) = problem_file::open_with_forces(file).map_err(|e| unreadable(file, &e))?;
    problem.validate_symmetric_to(f64::INFINITY).map_err(|e| miette!("{}: {e}", file.display()))?;
    let start = match forces.start {
        Some(start) if warm => start,
        None if warm => {
            let help = "leave --warm out, or solve a file of `palpate run --save-problems`";
            return Err(miette!(help = help, "--warm: {} holds no forces to begin with", file.display()));
        }
        _ => Vec::new(),
    };
    Ok((problem, start))
}

/// What is wrong with a file, and what to hand over instead.
fn unreadable(file: &Path, error: &ProblemFileError) -> Report {
    let name = file.display();
    if file.is_dir() {
        return miette!(help = format!("name the problems in it: {name}/*"), "{name} is a folder");
    }
    let told = match error {
        // An error of the file system names the file itself.
        io @ ProblemFileError::Io { .. } => io.to_string(),
        other => format!("{name}: {other}"),
    };
    miette!(help = "name a problem file: `palpate run SCENE --save-problems DIR` writes some", "{told}")
}

fn solvers(arguments: &SolveArguments) -> Vec<Solver> {
    let wanted = |name: &&&str| arguments.solver == "all" || arguments.solver == ***name;
    let named = Solver::NAMES.iter().filter(wanted).filter_map(|name| Solver::from_name(name));
    named.map(|solver| swept(solver, arguments).limited(arguments.tol, arguments.max_iter)).collect()
}

/// Gauss-Seidel with the relaxation and the order that are asked for; other solvers as they are.
fn swept(solver: Solver, arguments: &SolveArguments) -> Solver {
    let Solver::GaussSeidel(default) = solver else { return solver };
    let named = |name: &String| SweepOrder::ALL.into_iter().find(|order| order.name() == name);
    Solver::GaussSeidel(GaussSeidelConfig {
        relaxation: arguments.relaxation.unwrap_or(default.relaxation),
        order: arguments.sweep_order.as_ref().and_then(named).unwrap_or(default.order),
        ..default
    })
}

fn description(file: &Path, problem: &ConstraintProblem, tolerance: f64, runs: &[SolverRun]) -> Value {
    json!({
        "file": file.display().to_string(),
        "blocks": problem.blocks().len(),
        "rows": problem.rows(),
        "tolerance": tolerance,
        "runs": runs,
    })
}

/// The run with the least residual; of equals one that can tell how far it is from its law.
fn best(runs: &[SolverRun]) -> Option<&SolverRun> {
    runs.iter().min_by(|a, b| a.judged.total_cmp(&b.judged).then(a.report.worst_gap.total_cmp(&b.report.worst_gap)))
}

/// Forces (N) and gaps (m) of the run with the least residual.
fn write(out: &Path, problem: &ConstraintProblem, runs: &[SolverRun]) -> Result<()> {
    let Some(best) = best(runs) else { return Ok(()) };
    let mut delta = vec![0.0; problem.rows()];
    problem.view().gap(&best.lambda, &mut delta);
    let solution = json!({
        "format": "palpate-contact-solution",
        "version": 1,
        "solver": best.solver,
        "report": best.report,
        "residual": best.judged,
        "lambda": best.lambda,
        "delta": delta,
    });
    let text = serde_json::to_string(&solution).into_diagnostic()?;
    std::fs::write(out, text).map_err(|e| miette!("--out {}: cannot be written: {e}", out.display()))
}
