//! How wrong the compliance of a step is, and what is done about it.
//!
//! `W` of an old factor is that of another matrix, `W ≠ W_A = h² H A⁻¹ Hᵀ`. The contact forces satisfy their laws for
//! `W`; whether the motion that follows obeys the equations of motion is a question of the correction alone.
//! ```text
//! A x = Hᵀ λ,   Δv = h x            exact correction: conjugate gradients from x₀ = R A₀⁻¹ Rᵀ Hᵀ λ
//! h H Δv = W_A λ                    what the forces really open, against W λ
//! ```
//! The correction by the old inverse alone moves inner nodes as another body would move: a pressed fine block gains
//! energy from step to step until it folds. With the exact one every step is the backward Euler step of the body under
//! the forces `λ`, whose error is then only one of accuracy.

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_constraints::law::Law;
use palpate_fem::pcg::{PcgReport, PcgStatus, pcg};

use super::free_motion::{bounds, complete, factor_in_need};
use super::preconditioner::StepPreconditioner;
use super::refinement::{asks_for_refinement, hand_down, refine};
use super::{StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{Integration, World};

/// Relative residual at which the motion of the forces is first looked at: enough to tell whether they are to be refined,
/// after which their motion is another.
const FIRST_LOOK: f64 = 1e-3;

/// The same for forces that are refined, as a share of the square of their error: what refinement leaves is of that order.
const SHARE_OF_SQUARE: f64 = 0.1;

/// Largest share of the load of the forces that what the free motion has left may be for the correction to find it.
const SHARE_OF_LOAD: f64 = 1e-2;

/// Whether the correction by the inverse that gave `W` is only where conjugate gradients begin.
pub(super) fn corrects_exactly(world: &World, ws: &StepWorkspace, report: &StepReport) -> bool {
    // A direct approach brings its motion along.
    let old = report.method != ComplianceMethod::Exact && ws.direct.is_none();
    let exact =
        world.plan().correction == MotionCorrection::Exact && *world.integration() == Integration::BackwardEuler;
    old && exact && report.compliance.usable
}

/// Improves `ws.correction` from the old inverse's to that of this step's matrix, where the plan wants that; measures the
/// error of `W` along the forces, refines these where it is not small, and measures the overlap that remains.
pub(super) fn correct_exactly(
    world: &World,
    factor: &FactorSample,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    if *world.integration() != Integration::BackwardEuler || !report.compliance.usable {
        return;
    }
    let m = ws.rows.len();
    ws.refinement.shift[..m].fill(0.0);
    if corrects_exactly(world, ws, report) {
        if outweighs_forces(ws) {
            complete(world, factor, state, ws, report);
        }
        let mut solve = look(world, factor, FIRST_LOOK, ws, report);
        let second = SHARE_OF_SQUARE * report.error.along_forces.powi(2);
        if asks_for_refinement(world, report) && second < FIRST_LOOK {
            solve = look(world, factor, second, ws, report);
        }
        if solve.status == PcgStatus::Converged && asks_for_refinement(world, report) {
            refine(world, factor, state, ws, report);
        }
        if solve.status == PcgStatus::Converged && !report.error.refined {
            look(world, factor, 0.0, ws, report);
        }
    }
    // Before the free gaps become those of the refined problem.
    measure_overlap(world, true, ws, report);
    hand_down(ws);
}

/// Whether what the free motion has left is no small share of the load of the forces, as where a tool lets go: what it moves
/// would be taken for an error of `W`.
fn outweighs_forces(ws: &mut StepWorkspace) -> bool {
    if !ws.carries {
        return false;
    }
    load_of_forces(ws);
    let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
    square(&ws.carried) > SHARE_OF_LOAD * SHARE_OF_LOAD * square(&ws.load)
}

/// `h Hᵀ λ` in `ws.load`.
fn load_of_forces(ws: &mut StepWorkspace) {
    ws.load.fill(0.0);
    ws.rows.tissue.add_transposed(&ws.lambda, &mut ws.load);
    ws.load.iter_mut().for_each(|b| *b *= ws.dt);
}

/// How deep contacts overlap at the end of the step, where the motion is that in `ws.correction` or, where no force
/// touches the body, the free one: a solver that gave up with no force leaves all of the overlap.
pub(super) fn measure_overlap(world: &World, touched: bool, ws: &StepWorkspace, report: &mut StepReport) {
    if *world.integration() != Integration::BackwardEuler {
        return;
    }
    for (block, problem_block) in ws.rows.blocks.iter().zip(ws.problem.blocks()) {
        let row = block.range().start;
        // Skin that has given way is meant to be passed; the solver's tolerance may leave its force a little short.
        if matches!(problem_block.law, Law::Threshold(threshold) if ws.lambda[row] >= 0.999 * threshold.limit) {
            continue;
        }
        let gap = ws.rows.delta_free[row] + if touched { opening(ws, row) } else { 0.0 };
        report.error.overlap = report.error.overlap.max(-gap);
    }
}

/// [`exact_motion`] to a relative residual, or to the scene's where that is greater, and the error of `W` along the forces.
/// What was solved before in this step is gone on with.
fn look(
    world: &World,
    factor: &FactorSample,
    tolerance: f64,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) -> PcgReport {
    let solve = exact_motion(world, factor, tolerance, ws, report);
    let misfit = misfit(ws);
    if misfit.opened > 0.0 {
        report.error.along_forces = misfit.along_forces();
        report.error.misfit = misfit.missed / misfit.opened;
    }
    solve
}

/// `A Δv = h Hᵀ λ`, and what the free motion has left, by conjugate gradients from what is in `ws.correction`, to a
/// relative residual or to the scene's where that is greater; with the step's own factor where the iterations do not
/// suffice and there is one to be made.
pub(super) fn exact_motion(
    world: &World,
    factor: &FactorSample,
    tolerance: f64,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) -> PcgReport {
    load_of_forces(ws);
    if ws.carries {
        ws.load.iter_mut().zip(&ws.carried).for_each(|(b, rest)| *b += rest);
    }
    let tolerance = world.description().bodies[0].tolerance.max(tolerance);
    let mut solve = iterate(factor, tolerance, ws);
    report.error.corrected(&solve);
    if factor_in_need(&solve, ws, report) {
        solve = iterate(factor, tolerance, ws);
        report.error.corrected(&solve);
    }
    solve
}

fn iterate(factor: &FactorSample, tolerance: f64, ws: &mut StepWorkspace) -> PcgReport {
    let config = bounds(tolerance, ws);
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let mut preconditioner = StepPreconditioner::new(own, factor, &ws.rotations, &mut ws.solve);
    let solve = pcg(&ws.fem.system, &ws.load, &mut ws.correction, &mut preconditioner, config, &mut ws.pcg);
    ws.iterations_left = ws.iterations_left.saturating_sub(solve.iterations);
    solve
}

/// What the motion in `ws.correction` opens row `r` by (m), and what `W λ` says.
pub(super) fn opened(ws: &StepWorkspace, r: usize) -> (f64, f64) {
    // W is symmetric: its column is its row.
    let expected = ws.problem.view().column(r).iter().zip(&ws.lambda).map(|(w, l)| w * l).sum();
    (opening(ws, r), expected)
}

/// Norms over the rows (m).
pub(super) struct Misfit {
    /// Of what the motion opens.
    pub(super) opened: f64,
    /// Of its difference from `W λ`.
    pub(super) along: f64,
    /// The same with the shift of the free gaps by which refined forces were found.
    pub(super) missed: f64,
}

impl Misfit {
    /// The relative error of `W` along the forces.
    pub(super) fn along_forces(&self) -> f64 {
        self.along / self.opened
    }
}

pub(super) fn misfit(ws: &StepWorkspace) -> Misfit {
    let (mut moved_by, mut along, mut missed) = (0.0, 0.0, 0.0);
    for r in 0..ws.rows.len() {
        let (moved, expected) = opened(ws, r);
        let error = moved - expected;
        let rest = error - ws.refinement.shift[r];
        (moved_by, along, missed) = (moved_by + moved * moved, along + error * error, missed + rest * rest);
    }
    Misfit { opened: moved_by.sqrt(), along: along.sqrt(), missed: missed.sqrt() }
}

/// How far the motion under the forces opens the gap of a row (m).
pub(super) fn opening(ws: &StepWorkspace, row: usize) -> f64 {
    ws.dt * (ws.rows.tissue.dot(row, &ws.correction) + ws.rows.rigid.dot(row, &ws.rigid.correction))
}
