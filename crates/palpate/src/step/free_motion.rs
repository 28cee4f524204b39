//! The motion if nothing touched: one linear solve by backward Euler, or an explicit substep.

use palpate_fem::factor::FactorStatus;
use palpate_fem::integrator::explicit::explicit_velocity;
use palpate_fem::pcg::{PcgConfig, PcgReport, PcgStatus, pcg};
use palpate_fem::rotation::nodal_rotations;

use super::first_inverse::turn;
use super::preconditioner::StepPreconditioner;
use super::{FactorFit, StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::World;

/// Most iterations with a factor of the very matrix, which leaves rounding to iterate on.
const OWN_ITERATIONS: usize = 10;

/// Factors this step's matrix into the step's own memory.
pub(super) fn refactor(ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(own) = &mut ws.own else { return };
    ws.own_is_current = own.refactor(&ws.fem.system).status == FactorStatus::Ok;
    report.refused = !ws.own_is_current;
}

/// After a solve that ended without convergence, factors this step's matrix where there is memory for it: at most once a
/// step, in less time than the iterations have taken. True where the solve can be gone on with.
pub(super) fn factor_in_need(solve: &PcgReport, ws: &mut StepWorkspace, report: &mut StepReport) -> bool {
    // A matrix that has shown itself indefinite would be refused.
    let spent = matches!(solve.status, PcgStatus::OutOfIterations | PcgStatus::PreconditionerFailed);
    if !spent || ws.own_is_current || report.refused {
        return false;
    }
    refactor(ws, report);
    report.rescued = ws.own_is_current;
    report.rescued
}

/// Bounds of a solve with this step's matrix: what is left of the iterations of the step, or the few that its own factor
/// needs.
pub(super) fn bounds(relative_tolerance: f64, ws: &StepWorkspace) -> PcgConfig {
    let max_iterations = if ws.own_is_current { OWN_ITERATIONS } else { ws.iterations_left };
    PcgConfig { relative_tolerance, max_iterations }
}

/// `A dv = b` by conjugate gradients from what the last step predicts, preconditioned by the factor warped with the rotations
/// since it was taken; or from zero by the step's own where one is made first: where the plan says so, and where no other is
/// one of this body. Then the free velocity `v + dv`.
pub(super) fn free_motion(
    world: &World,
    factor: &FactorSample,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let plan = world.plan();
    let outdated = report.change.factor == FactorFit::Outdated;
    ws.own_is_current = false;
    if plan.refactor == Refactor::Step || outdated {
        refactor(ws, report);
    }
    if outdated && ws.own_is_current {
        report.change.factor = FactorFit::Renewed;
    }
    // Where every matrix is the first, its factor knows nothing of rotations.
    if !ws.own_is_current && !plan.constant {
        nodal_rotations(world.model(), &factor.q, &state.fem.q, &mut ws.rotations);
    }
    turn(world, state, ws, report);
    // A factor of this very matrix needs one iteration from wherever it begins.
    if ws.own_is_current || plan.constant {
        ws.v_free.fill(0.0);
    } else {
        ws.v_free.copy_from_slice(state.prediction.free());
    }
    let first = solve(world, factor, ws);
    report.free_motion = first;
    if factor_in_need(&first, ws, report) {
        let again = solve(world, factor, ws);
        report.free_motion = PcgReport { iterations: first.iterations + again.iterations, ..again };
    }
    for (dv, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        let v = &state.fem.v[node as usize];
        (0..3).for_each(|c| dv[c] += v[c]);
    }
    // A preconditioner that knows nothing of what is held lets it move by the tolerance.
    for (v, _) in ws.v_free.chunks_exact_mut(3).zip(world.model().held()).filter(|(_, held)| **held) {
        v.fill(0.0);
    }
}

/// Iterates on the free motion in `ws.v_free`.
fn solve(world: &World, factor: &FactorSample, ws: &mut StepWorkspace) -> PcgReport {
    let config = bounds(world.description().bodies[0].tolerance, ws);
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let own = own.or(world.plan().constant.then_some(&factor.factor));
    let mut preconditioner = StepPreconditioner::new(own, factor, &ws.rotations, &mut ws.solve);
    let solve = pcg(&ws.fem.system, &ws.fem.rhs, &mut ws.v_free, &mut preconditioner, config, &mut ws.pcg);
    ws.iterations_left = ws.iterations_left.saturating_sub(solve.iterations);
    solve
}

/// The free velocity of one explicit substep.
pub(super) fn explicit_motion(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(stage) = &mut ws.explicit else { return };
    let explicit = explicit_velocity(world.model(), ws.dt, &[], &state.fem, &mut stage.ws);
    report.assembly = report.assembly.worst(explicit.assembly);
    ws.v_free.copy_from_slice(stage.ws.velocity());
    if explicit.non_finite.is_some() {
        report.free_motion.status = PcgStatus::NonFinite;
    }
}
