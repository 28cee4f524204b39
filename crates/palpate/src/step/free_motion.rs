//! The motion if nothing touched: one linear solve by backward Euler, or an explicit substep.
//!
//! Where contact is expected, and an exact correction after it, the solve ends early, and the correction finds the rest of it
//! along with the motion of the forces:
//! ```text
//! A dv = b - r              to ‖r‖ <= 1000 tolerance ‖b‖
//! A Δv = h Hᵀ λ + r         exact correction
//! ```
//! The last digits of two motions cost hardly more iterations than those of one. The residual that counts is that of the
//! correction; gaps are those of the shortened solve until forces are refined, whose shift takes up the rest too. Where
//! no force comes about, the free motion is gone on with.

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_fem::factor::FactorStatus;
use palpate_fem::integrator::explicit::explicit_velocity;
use palpate_fem::pcg::{PcgConfig, PcgReport, PcgStatus, pcg};
use palpate_fem::rotation::nodal_rotations;

use super::first_inverse;
use super::preconditioner::StepPreconditioner;
use super::{FactorFit, StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Integration, Rung, World};

/// Most iterations with a factor of the very matrix, which leaves rounding to iterate on.
const OWN_ITERATIONS: usize = 10;

/// Residual at which a free motion ends that the exact correction goes on with, in tolerances.
const EARLY: f64 = 1e3;

/// The greatest such residual: gaps are never rougher than this share of the free motion.
const ROUGHEST: f64 = 1e-3;

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
    first_inverse::choose(ws, report);
    // A factor of this very matrix needs one iteration from wherever it begins.
    if ws.own_is_current || plan.constant {
        ws.v_free.fill(0.0);
    } else {
        ws.v_free.copy_from_slice(state.prediction.free());
    }
    ws.carries = expects_correction(world, state, ws, report);
    solve_and_rescue(world, factor, ws, report);
    ws.carries &= !ws.own_is_current && report.free_motion.status == PcgStatus::Converged;
    if ws.carries {
        ws.carried.copy_from_slice(ws.pcg.residual());
    }
    finish(world, state, ws);
}

/// Goes on with a free motion that ended early to the scene's tolerance, where no exact correction is to find the rest.
pub(super) fn complete(
    world: &World,
    factor: &FactorSample,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    if !std::mem::take(&mut ws.carries) {
        return;
    }
    for (dv, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        let v = &state.fem.v[node as usize];
        (0..3).for_each(|c| dv[c] -= v[c]);
    }
    let before = report.free_motion.iterations;
    solve_and_rescue(world, factor, ws, report);
    report.free_motion.iterations += before;
    finish(world, state, ws);
}

/// Whether an exact correction is expected to come after the free motion: one did after that of the last step, and nothing
/// has been done to the body since.
fn expects_correction(world: &World, state: &StepState, ws: &StepWorkspace, report: &StepReport) -> bool {
    let plan = world.plan();
    let exact = plan.compliance == ComplianceMethod::Exact || report.rung == Some(Rung::Exact) || plan.constant;
    let corrects = plan.correction == MotionCorrection::Exact && *world.integration() == Integration::BackwardEuler;
    let old = corrects && !exact && ws.direct.is_none() && !ws.own_is_current;
    let same = report.change.factor == FactorFit::Own && !report.led && !world.model().held().contains(&true);
    old && same && !state.warm_start.is_empty()
}

/// Iterates on the change of velocity in `ws.v_free`, with the step's own factor where the iterations do not suffice.
fn solve_and_rescue(world: &World, factor: &FactorSample, ws: &mut StepWorkspace, report: &mut StepReport) {
    let first = solve(world, factor, ws);
    report.free_motion = first;
    if factor_in_need(&first, ws, report) {
        let again = solve(world, factor, ws);
        report.free_motion = PcgReport { iterations: first.iterations + again.iterations, ..again };
    }
}

/// The change of velocity in `ws.v_free` becomes the free velocity.
fn finish(world: &World, state: &StepState, ws: &mut StepWorkspace) {
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
    let tolerance = world.description().bodies[0].tolerance;
    let early = if ws.carries { (EARLY * tolerance).min(ROUGHEST) } else { 0.0 };
    let config = bounds(tolerance.max(early), ws);
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Isometry3;

    use super::*;
    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// A block under a ball, with friction and the factor of its first matrix.
    const PRESS: &str = r#"
        name = "press"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [5, 5, 5] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        rayleigh_stiffness = 0.005
        compliance = "async"
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [contact]
        friction = 0.3
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.06] }]
    "#;

    /// Down by 6 mm in 12 steps, aside in 8, and up in 2 and away.
    fn pose(k: u32) -> Isometry3<f64> {
        let (down, aside, up) = (k.min(12), k.clamp(12, 20) - 12, k.saturating_sub(20));
        Isometry3::translation(
            0.02 + 5e-4 * f64::from(aside),
            0.02,
            0.0525 - 5e-4 * f64::from(down) + 4e-3 * f64::from(up),
        )
    }

    fn norm(x: &[f64]) -> f64 {
        x.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    /// Whatever the free motion has left, `A (v⁺ - v) = b + h Hᵀ λ` holds to the tolerances of the two solves that it would
    /// have been without: in contact, in the step that lets go, and after it.
    #[test]
    fn the_motion_of_a_step_is_balanced_to_the_tolerance_wherever_the_free_motion_ended() {
        for tolerance in [1e-4, 1e-6, 1e-9] {
            let mut scene = Scene::from_toml(PRESS, Path::new("")).unwrap();
            scene.edit(|scene| scene.bodies[0].tolerance = tolerance).unwrap();
            let world = scene.build().unwrap();
            let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
            let (mut early, mut let_go, mut refined, mut touched, mut worst) = (0, 0, 0, false, 0.0_f64);
            for k in 0..30 {
                let before = simulation.state().fem.v.clone();
                let report = simulation.step(&pose(k));
                assert_eq!(report.free_motion.status, PcgStatus::Converged, "step {k}");
                let (ws, after) = (simulation.workspace(), &simulation.state().fem.v);
                let moved =
                    world.model().node_of_free().iter().map(|&node| after[node as usize] - before[node as usize]);
                let moved: Vec<f64> = moved.flat_map(|dv| [dv.x, dv.y, dv.z]).collect();
                let (mut load, mut product) = (vec![0.0; moved.len()], vec![0.0; moved.len()]);
                ws.rows().tissue.add_transposed(simulation.forces(), &mut load);
                load.iter_mut().for_each(|f| *f *= world.dt());
                ws.fem.system.multiply(&moved, &mut product);
                let rest: Vec<f64> = ws.fem.rhs.iter().zip(&load).zip(&product).map(|((b, f), a)| b + f - a).collect();
                // the correction's is relative to its load, which has what the free motion left in it
                let bound = tolerance * (norm(&ws.fem.rhs) + norm(&load)) * (1.0 + ROUGHEST);
                assert!(norm(&rest) <= bound, "{tolerance:e}, step {k}: {:e} of {bound:e}", norm(&rest));
                worst = worst.max(norm(&rest) / bound);

                let forces = simulation.forces().iter().any(|&force| force != 0.0);
                let ended_early = report.free_motion.relative_residual > tolerance;
                assert!(!ended_early || forces && report.error.correction_residual <= tolerance, "step {k}");
                early += u32::from(ended_early);
                let_go += u32::from(touched && !forces);
                refined += u32::from(report.error.refined);
                touched = forces;
            }
            println!(
                "{tolerance:e}: {early} ended early, {refined} refined, {let_go} let go; at most {worst:.2} of the bound"
            );
            assert!(early > 8 && refined > 4 && let_go > 0 && !touched, "{early} {refined} {let_go}");
        }
    }
}
