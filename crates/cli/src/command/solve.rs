//! `palpate solve`.

use std::path::Path;

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
    let samples = if arguments.json { HISTORY } else { 0 };
    let (mut all_solved, mut described) = (true, Vec::new());
    for (file, (problem, start)) in arguments.files.iter().zip(&problems) {
        // Not one of contact, then; some solvers take it all the same.
        if let Err(warning) = problem.validate() {
            eprintln!("warning: {}: {warning}", file.display());
        } else if let Err(warning) = problem.check_semidefinite() {
            eprintln!("warning: {}: {warning}", file.display());
        }
        let runs = run_all_from(problem, start, &solvers, arguments.time_limit, samples);
        all_solved &= runs.iter().any(|run| run.report.is_solved());
        if arguments.json {
            described.push(description(file, problem, arguments.tol, &runs));
        } else {
            let (blocks, rows) = (problem.blocks().len(), problem.rows());
            say(format_args!("{}: {blocks} blocks, {rows} rows", file.display()))?;
            say(solver_table::runs(&runs))?;
            runs.iter().filter_map(solver_table::attempts).try_for_each(say)?;
            if let Some(best) = best(&runs).filter(|_| !runs.iter().any(|run| run.report.is_solved())) {
                say(format_args!("{}: {}", best.solver, best.report.explain(problem)))?;
            }
        }
        if let Some(out) = &arguments.out {
            write(out, problem, &runs)?;
        }
    }
    if arguments.json {
        say(format_args!("{:#}", Value::from(described)))?;
    }
    Ok(if all_solved { 0 } else { exit::NOT_SOLVED })
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

/// The run with the least residual.
fn best(runs: &[SolverRun]) -> Option<&SolverRun> {
    runs.iter().min_by(|a, b| a.judged.total_cmp(&b.judged))
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
