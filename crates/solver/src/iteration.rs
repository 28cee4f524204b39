//! The loop that all solvers share: what an iteration may end with, which iterate is kept, when a run has stalled.
//!
//! A method is the function that advances `lambda` and the gap by one iteration. The loop owns everything else: it makes
//! the start admissible, looks at the residual after each iteration, keeps the best forces, and stops at the tolerance, at
//! a limit, or where the residual has ceased to fall.

use crate::gauss_seidel::{GaussSeidelWorkspace, prepare, residual};
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
use crate::residual::{Residual, scale};
use crate::watch::Watch;

/// Age in iterations from which the running gap is not trusted with accepting an answer. A sweep adds rounding of about
/// `eps |W| |change of lambda|`, so that eight leave it near 1e-14 of the gaps' size; in a warm solve of a few sweeps
/// forming it anew would cost as much as a sweep for nothing.
const REFRESH_AGE: u32 = 8;

/// A fall of the residual below this part of the best makes a new best. Where rows conflict, forces that grow for ever bring
/// the residual down by next to nothing: the smaller ones are kept.
const NOTABLE: f64 = 0.999;

/// What one iteration did to the gap in the workspace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Advance {
    /// It was updated, and gathers rounding.
    Updated,
    /// It was formed anew.
    Formed,
    /// So many iterations were done at once, and the gap formed anew.
    Several(u32),
    /// So many iterations were done at once, and the gap is that of single precision: no end is judged by it.
    Rough(u32),
    /// The method ends itself; forces and gap are as they were.
    Ended(SolveStatus),
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stop {
    /// Residual to reach.
    pub(crate) tolerance: f64,
    /// Limit of iterations.
    pub(crate) max_iterations: u32,
    /// Iterations without a fall of the residual by a hundredth after which a run has stalled.
    pub(crate) stall: u32,
}

/// A residual and the iteration after which it was found.
#[derive(Clone, Copy)]
struct Mark {
    residual: Residual,
    iteration: u32,
}

/// Runs a method from the forces in `lambda` to one of the ends; the best forces are left there, with their gap in `ws`.
///
/// `advance` gets the forces, the workspace with gap and local compliances, and the residual at them.
pub(crate) fn run(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    stop: Stop,
    ws: &mut GaussSeidelWorkspace,
    watch: &mut Watch<'_>,
    advance: impl FnMut(&mut [f64], &mut GaussSeidelWorkspace, f64) -> Advance,
) -> SolveReport {
    if let Err(status) = prepare(view, lambda, ws) {
        return SolveReport::failed(status, 0);
    }
    let Some(scale) = scale(view) else {
        // No block needs a force: none is a solution, whatever the start was.
        lambda.fill(0.0);
        ws.delta.copy_from_slice(view.delta_free);
        return SolveReport { residual: 0.0, worst_gap: 0.0, ..SolveReport::failed(SolveStatus::Solved, 0) };
    };
    let (status, iterations, best) = iterate(view, lambda, scale, stop, ws, watch, advance);
    if status == SolveStatus::NotFinite {
        lambda.fill(0.0);
        ws.delta.clear();
        return SolveReport {
            worst_block: index(best.residual.worst_block),
            ..SolveReport::failed(status, iterations)
        };
    }
    if best.iteration != iterations {
        lambda.copy_from_slice(&ws.best);
        view.gap(lambda, &mut ws.delta);
    }
    SolveReport {
        status,
        iterations,
        residual: best.residual.relative,
        worst_block: index(best.residual.worst_block),
        worst_gap: best.residual.worst_gap,
    }
}

/// Advances until one of the ends; the best forces are in `ws.best`. For [`SolveStatus::NotFinite`] the mark is the last.
fn iterate(
    view: &ProblemView<'_>,
    lambda: &mut [f64],
    scale: f64,
    stop: Stop,
    ws: &mut GaussSeidelWorkspace,
    watch: &mut Watch<'_>,
    mut advance: impl FnMut(&mut [f64], &mut GaussSeidelWorkspace, f64) -> Advance,
) -> (SolveStatus, u32, Mark) {
    let mut now = Mark { residual: residual(view, lambda, scale, ws), iteration: 0 };
    let (mut best, mut milestone, mut age) = (now, now, 0);
    ws.best.clear();
    ws.best.extend_from_slice(lambda);
    loop {
        // The running gap gathers rounding: form it anew now and then, and before an answer is accepted.
        let ending = now.residual.relative <= stop.tolerance || now.iteration >= stop.max_iterations;
        if age >= 4 * REFRESH_AGE || (ending && age >= REFRESH_AGE) {
            view.gap(lambda, &mut ws.delta);
            age = 0;
            now.residual = residual(view, lambda, scale, ws);
        }
        let out_of_time = watch.note(now.iteration, now.residual.relative);
        if !now.residual.relative.is_finite() {
            return (SolveStatus::NotFinite, now.iteration, now);
        }
        let accepted = now.residual.relative <= stop.tolerance;
        if now.residual.relative < NOTABLE * best.residual.relative || accepted {
            best = now;
            ws.best.copy_from_slice(lambda);
        }
        if now.residual.relative < 0.99 * milestone.residual.relative {
            milestone = now;
        }
        if accepted {
            return (SolveStatus::Solved, now.iteration, best);
        }
        if now.iteration >= stop.max_iterations {
            return (SolveStatus::MaxIterations, now.iteration, best);
        }
        if out_of_time {
            return (SolveStatus::TimeLimit, now.iteration, best);
        }
        if now.iteration - milestone.iteration >= stop.stall.max(1) {
            return (SolveStatus::Stalled, now.iteration, best);
        }
        let mut done = 1;
        match advance(lambda, ws, now.residual.relative) {
            Advance::Updated => age += 1,
            Advance::Formed => age = 0,
            Advance::Several(iterations) => (age, done) = (0, iterations),
            Advance::Rough(iterations) => (age, done) = (REFRESH_AGE, iterations),
            Advance::Ended(status) => return (status, now.iteration, best),
        }
        let iteration = now.iteration.saturating_add(done);
        now = Mark { residual: residual(view, lambda, scale, ws), iteration };
    }
}

/// Block numbers in reports are 32 bits wide.
fn index(block: usize) -> u32 {
    u32::try_from(block).unwrap_or(u32::MAX)
}
