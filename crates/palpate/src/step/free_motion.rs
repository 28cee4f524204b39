//! The motion if nothing touched: one linear solve by backward Euler, or an explicit substep.

use palpate_fem::factor::FactorStatus;
use palpate_fem::integrator::explicit::explicit_velocity;
use palpate_fem::pcg::{PcgConfig, PcgStatus, pcg};
use palpate_fem::rotation::nodal_rotations;

use super::first_inverse::turn;
use super::preconditioner::StepPreconditioner;
use super::{StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::World;

/// Factors this step's matrix into the step's own memory.
pub(super) fn refactor(ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(own) = &mut ws.own else { return };
    ws.own_is_current = own.refactor(&ws.fem.system).status == FactorStatus::Ok;
    report.refused = !ws.own_is_current;
}

/// `A dv = b` by conjugate gradients from what the last step predicts, preconditioned by the factor warped with the rotations
/// since it was taken; or from zero by the step's own where the plan makes one first. Then the free velocity `v + dv`.
pub(super) fn free_motion(
    world: &World,
    factor: &FactorSample,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let body = &world.description().bodies[0];
    let plan = world.plan();
    ws.own_is_current = false;
    if plan.refactor == Refactor::Step {
        refactor(ws, report);
    }
    // Where every matrix is the first, its factor knows nothing of rotations.
    if !ws.own_is_current && !plan.constant {
        nodal_rotations(world.model(), &factor.q, &state.fem.q, &mut ws.rotations);
    }
    turn(world, state, ws, report);
    let config = PcgConfig { relative_tolerance: body.tolerance, max_iterations: body.max_iterations };
    let own = ws.own.as_ref().filter(|_| ws.own_is_current).or(plan.constant.then_some(&factor.factor));
    // A factor of this very matrix needs one iteration from wherever it begins.
    match own {
        Some(_) => ws.v_free.fill(0.0),
        None => ws.v_free.copy_from_slice(state.prediction.free()),
    }
    let mut preconditioner = StepPreconditioner::new(own, factor, &ws.rotations, &mut ws.solve);
    report.free_motion = pcg(&ws.fem.system, &ws.fem.rhs, &mut ws.v_free, &mut preconditioner, config, &mut ws.pcg);
    for (dv, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        let v = &state.fem.v[node as usize];
        (0..3).for_each(|c| dv[c] += v[c]);
    }
    // A preconditioner that knows nothing of what is held lets it move by the tolerance.
    for (v, _) in ws.v_free.chunks_exact_mut(3).zip(world.model().held()).filter(|(_, held)| **held) {
        v.fill(0.0);
    }
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
