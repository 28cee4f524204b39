//! Contact forces for this step's matrix from the compliance of an older one.
//!
//! The forces `λ₀` satisfy their laws for the compliance `W` at hand; the exact correction tells what they open in truth,
//! `W_A λ₀`. With the difference added to the free gap, the same small problem is solved again,
//! ```text
//! δ = W λ + δ_free + (W_A - W) λ₀        in the laws of the rows
//! ```
//! whose solution differs from that for `W_A` by the error of `W` on the change `λ - λ₀` alone: iterative refinement, of
//! the second order in the age of the factor. It costs one more solve of the contacts and, since the motion of `λ₀` is
//! known, a few iterations.

use palpate_constraints::compliance;
use palpate_fem::pcg::PcgStatus;
use palpate_solver::report::{SolveReport, SolveStatus};

use super::accuracy::{exact_motion, misfit, opened};
use super::forces::take_forces;
use super::stages::inverse;
use super::{StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{LOWER_SHARE, World};

/// Relative error of `W` along the forces above which they are refined.
pub(super) const REFINE_ABOVE: f64 = 5e-3;

/// What refinement keeps and compares, one number per row or degree of freedom.
#[derive(Clone, Debug)]
pub(super) struct RefinementWorkspace {
    lambda: Vec<f64>,
    motion: Vec<f64>,
    /// `(W_A - W) λ₀` (m).
    pub(super) shift: Vec<f64>,
}

impl RefinementWorkspace {
    pub(super) fn new(rows: usize, unknowns: usize) -> Self {
        Self { lambda: vec![0.0; rows], motion: vec![0.0; unknowns], shift: vec![0.0; rows] }
    }
}

/// Relative error of forces by a compliance that is wrong by `error`, where the correction is exact: refined, its square.
pub(super) fn expected(error: f64) -> f64 {
    error * error
}

/// Whether `W` misses the motion of the forces by more than a little, or than the scene's accuracy bears, and not by all of it.
pub(super) fn asks_for_refinement(world: &World, report: &StepReport) -> bool {
    let accuracy = world.plan().ladder.map_or(f64::INFINITY, |ladder| ladder.accuracy);
    // NaN is not above
    let worth = report.error.along_forces > REFINE_ABOVE.min(LOWER_SHARE * accuracy) && report.error.along_forces < 1.0;
    worth && report.solve.status != SolveStatus::NotFinite
}

/// Refines forces whose exact motion is in `ws.correction`, to the square of the error of `W`. The free gaps of
/// the rows then are those for which `W` gives the refined forces. Where refinement fails to fit better, all stays.
pub(super) fn refine(
    world: &World,
    factor: &FactorSample,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let m = ws.rows.len();
    ws.refinement.lambda[..m].copy_from_slice(&ws.lambda[..m]);
    ws.refinement.motion.copy_from_slice(&ws.correction);
    let before = misfit(ws);
    for r in 0..m {
        let (moved, expected) = opened(ws, r);
        ws.refinement.shift[r] = moved - expected;
    }
    let lambda = &mut ws.lambda[..m];
    let gaps = ws.problem.delta_free_mut().iter_mut().zip(&ws.rows.delta_free);
    gaps.zip(&ws.refinement.shift).for_each(|((gap, free), shift)| *gap = free + shift);
    let solve = ws.solver.solve(&ws.problem.view(), lambda, &mut ws.solver_workspace);

    // the motion of the old forces, and the old inverse's answer to their change
    let change = &mut ws.lambda_of_sample[..m];
    change.copy_from_slice(lambda);
    change.iter_mut().zip(&ws.refinement.lambda).for_each(|(change, old)| *change -= old);
    let (inverse, _) = inverse(world, factor, None, None, ws.first.as_ref(), &ws.rotations);
    compliance::guess(inverse, change, ws.dt, &mut ws.correction, &mut ws.compliance);
    ws.correction.iter_mut().zip(&ws.refinement.motion).for_each(|(motion, old)| *motion += old);
    ws.rigid.correct(&ws.rows, &ws.lambda[..m], ws.dt);
    let exact = exact_motion(world, factor, 0.0, ws, report);
    let after = misfit(ws);

    let better = after.missed < before.missed && exact.status == PcgStatus::Converged && solve.residual.is_finite();
    if better {
        report.error.refined = true;
        report.solve = SolveReport { iterations: report.solve.iterations + solve.iterations, ..solve };
        report.error.along_forces = after.along_forces();
        report.error.misfit = after.missed / after.opened;
        take_forces(world, state, ws, report);
    } else {
        ws.lambda[..m].copy_from_slice(&ws.refinement.lambda[..m]);
        ws.correction.copy_from_slice(&ws.refinement.motion);
        ws.rigid.correct(&ws.rows, &ws.lambda[..m], ws.dt);
        ws.refinement.shift[..m].fill(0.0);
        ws.problem.delta_free_mut().copy_from_slice(&ws.rows.delta_free);
    }
}

/// Makes the free gaps of the rows those of the refined problem, for whoever solves it again.
pub(super) fn hand_down(ws: &mut StepWorkspace) {
    ws.rows.delta_free.iter_mut().zip(&ws.refinement.shift).for_each(|(free, shift)| *free += shift);
    ws.rigid.tool_delta.iter_mut().zip(&ws.refinement.shift).for_each(|(free, shift)| *free += shift);
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector, Isometry3};
    use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
    use palpate_fem::factor::{Factor, FactorStatus, ReachWorkspace};
    use palpate_solver::problem::ConstraintProblem;
    use std::sync::Arc;

    use super::*;
    use crate::scene::Scene;
    use crate::step::{StepInput, step};

    /// A block that is sheared and pressed by a ball which slides, with friction.
    const PRESS: &str = r#"
        name = "press"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.06, 0.06, 0.04], cells = [5, 5, 4] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.45 }
        rayleigh_stiffness = 0.005
        compliance = "async"
        tolerance = 1e-10
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [contact]
        at = "faces"
        friction = 0.3
        [solver]
        tolerance = 1e-10
        max_sweeps = 20000
        [hand]
        path = [{ time = 0.0, position = [0.025, 0.03, 0.06] }]
    "#;

    fn world(change: impl FnOnce(&mut crate::scene::SceneDescription)) -> World {
        let mut scene = Scene::from_toml(PRESS, std::path::Path::new("")).unwrap();
        scene.edit(change).unwrap();
        scene.build().unwrap()
    }

    /// Down by 8 mm in 16 steps, then aside.
    fn pose(k: u64) -> Isometry3<f64> {
        let (down, aside) = (0.0005 * k.min(16) as f64, 0.0005 * k.saturating_sub(16) as f64);
        Isometry3::translation(0.025 + aside, 0.03, 0.052 - down)
    }

    /// Forces for a compliance and free gaps, solved as tightly as the step does, from the forces at hand.
    fn forces(ws: &mut StepWorkspace, w: &DMatrix<f64>, free: &[f64]) -> DVector<f64> {
        let mut problem = ConstraintProblem::with_capacity(free.len());
        problem.reset(free.len()).unwrap();
        problem.compliance_mut().copy_from(w);
        ws.problem.blocks().iter().for_each(|block| problem.push_block(block.law));
        problem.delta_free_mut().copy_from_slice(free);
        let mut lambda = DVector::from_column_slice(&ws.lambda[..free.len()]);
        let report = ws.solver.solve(&problem.view(), lambda.as_mut_slice(), &mut ws.solver_workspace);
        assert!(report.residual < 1e-8, "{report:?}");
        lambda
    }

    /// With `e = ‖(W_A - W) λ*‖ / ‖W_A λ*‖` the forces of `W` are wrong by about `e`, the refined ones by about `e²`. The
    /// measure is the norm of `W_A`, in which the forces of a contact problem depend on its data with a constant of order 1.
    #[test]
    fn refined_forces_are_those_of_the_own_matrix_to_the_second_order_and_never_worse() {
        let world = world(|_| ());
        let mut ws = StepWorkspace::new(&world);
        let factor = FactorSample::first(&world, &world.model().rest_state(), &mut ws).unwrap();
        let mut state = StepState::new(&world, world.model().rest_state());
        let mut snapshot = world.empty_snapshot();
        let (mut refined, mut worst_ratio, mut worst_constant) = (0, 0.0_f64, 0.0_f64);
        for k in 0..40 {
            let input = StepInput { time: k as f64 * world.dt(), tool: pose(k).into(), factor: &factor };
            let report = step(&world, &input, &mut state, &mut ws, &mut snapshot);
            if !report.error.refined {
                continue;
            }
            refined += 1;
            let m = ws.rows.len();
            let w = ws.problem.compliance().into_owned();
            let free: Vec<f64> = ws.rows.delta_free.iter().zip(&ws.refinement.shift).map(|(d, s)| d - s).collect();
            let mut own = Factor::new(Arc::clone(world.symbolic()));
            assert_eq!(own.refactor(&ws.fem.system).status, FactorStatus::Ok);
            let mut exact = DMatrix::zeros(m, m);
            let mut reach = ReachWorkspace::new(world.symbolic(), m);
            let _ = own.compliance_into(&ws.rows.tissue, ws.dt * ws.dt, &mut exact, &mut reach);
            let found = DVector::from_column_slice(&ws.lambda[..m]);
            let truth = forces(&mut ws, &exact, &free);
            let without = forces(&mut ws, &w, &free);
            let energy = |x: &DVector<f64>| x.dot(&(&exact * x)).max(0.0).sqrt();
            let error = |x: &DVector<f64>| energy(&(x - &truth)) / energy(&truth);
            let e = ((&exact - &w) * &truth).norm() / (&exact * &truth).norm();
            let (with, without) = (error(&found), error(&without));
            if k % 5 == 0 {
                println!("step {k}: W wrong by {e:.4}, forces by {without:.4}, refined by {with:.5}");
            }
            // 1e-6: the solver's tolerance, in forces.
            worst_ratio = worst_ratio.max((with - 1e-6) / without);
            worst_constant = worst_constant.max((with - 1e-6) / (e * e));
        }
        println!("{refined} refined steps: at worst {worst_ratio:.3} of the error without, {worst_constant:.2} e²");
        assert!(refined > 15, "{refined}");
        assert!(worst_ratio < 1.0 && worst_constant < 4.0, "{worst_ratio} {worst_constant}");
    }

    /// Where nothing is to be refined, forces and gaps stay to the bit: a factor of the step's own, forces that move nothing
    /// wrongly, and a correction that the scene wants to match the old inverse.
    #[test]
    fn a_step_whose_compliance_is_right_is_left_alone() {
        for (compliance, correction) in [
            (ComplianceMethod::Exact, MotionCorrection::Exact),
            (ComplianceMethod::Asynchronous, MotionCorrection::Matching),
        ] {
            let world = world(|d| (d.bodies[0].compliance, d.bodies[0].correction) = (compliance, correction));
            let mut ws = StepWorkspace::new(&world);
            let factor = FactorSample::first(&world, &world.model().rest_state(), &mut ws).unwrap();
            let mut state = StepState::new(&world, world.model().rest_state());
            let mut snapshot = world.empty_snapshot();
            let mut active = 0;
            for k in 0..12 {
                let input = StepInput { time: k as f64 * world.dt(), tool: pose(k).into(), factor: &factor };
                let report = step(&world, &input, &mut state, &mut ws, &mut snapshot);
                assert!(!report.error.refined, "step {k}");
                assert_eq!(ws.problem.view().delta_free, &ws.rows.delta_free[..], "step {k}");
                active += report.active;
            }
            assert!(active > 0);
        }
    }
}
