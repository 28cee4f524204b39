//! Runs of solvers on one problem as a table.

use comfy_table::{Cell, CellAlignment, Table};
use palpate::solver::automatic::Attempt;
use palpate::solver::comparison::SolverRun;

use crate::screen;

/// Status, iterations, residual and time of each solver.
pub(crate) fn runs(runs: &[SolverRun]) -> Table {
    let mut table = screen::table();
    table.set_header(["solver", "status", "iterations", "residual", "worst gap [m]", "time [ms]"]);
    for run in runs {
        let right = |text: String| Cell::new(text).set_alignment(CellAlignment::Right);
        table.add_row([
            Cell::new(run.solver),
            Cell::new(run.report.status.in_words()),
            right(run.report.iterations.to_string()),
            right(format!("{:.1e}", run.judged)),
            right(format!("{:.1e} (block {})", run.report.worst_gap, run.report.worst_block)),
            right(format!("{:.3}", run.seconds * 1e3)),
        ]);
    }
    table
}

/// What the automatic choice tried, where that was more than one solver.
pub(crate) fn attempts(run: &SolverRun) -> Option<String> {
    let told = |attempt: &Attempt| format!("{} ({})", attempt.solver, attempt.report.status.in_words());
    let tried: Vec<_> = run.attempts.iter().map(told).collect();
    (tried.len() > 1).then(|| format!("{} tried {}", run.solver, tried.join(", then ")))
}
