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
use crate::world::World;

/// Relative error of `W` along the forces above which they are refined.
const REFINE_ABOVE: f64 = 5e-3;

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

/// Refines forces whose exact motion is in `ws.correction`, where `W` missed it by more than a little. The free gaps of
/// the rows then are those for which `W` gives the refined forces. Where refinement fails to fit better, all stays.
pub(super) fn refine(
    world: &World,
    factor: &FactorSample,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let m = ws.rows.len();
    // NaN is not above
    let worth = report.error.along_forces > REFINE_ABOVE && report.error.along_forces < 1.0;
    if !worth || report.solve.status == SolveStatus::NotFinite {
        return;
    }
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
    let (inverse, _) = inverse(world, factor, None, None, &ws.rotations);
    compliance::guess(inverse, change, ws.dt, &mut ws.correction, &mut ws.compliance);
    ws.correction.iter_mut().zip(&ws.refinement.motion).for_each(|(motion, old)| *motion += old);
    ws.rigid.correct(&ws.rows, &ws.lambda[..m], ws.dt);
    let exact = exact_motion(world, factor, ws);
    report.error.correction_iterations += exact.iterations as u32;
    let after = misfit(ws);

    let better = after.missed < before.missed && exact.status == PcgStatus::Converged && solve.residual.is_finite();
    if better {
        report.solve = SolveReport { iterations: report.solve.iterations + solve.iterations, ..solve };
        report.error.along_forces = after.along_forces();
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
