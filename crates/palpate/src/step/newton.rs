//! Newton's method with contact.
//!
//! The free motion by Newton's method alone, corrected once with the compliance of its end, would be wrong by the
//! curvature of the tissue between the free and the corrected place: a tenth of the force in an ordinary press. So the
//! motion is repeated under the contact forces found so far,
//! ```text
//! q_k = argmin Φ(q) - q·Hᵀ λ_k,    A_k its matrix,    W_k = h² H A_k⁻¹ Hᵀ
//! δ = W_k (λ_{k+1} - λ_k) + δ(q_k)  in the law of each contact,
//! ```
//! until the forces stay. The last correction is then small to second order, and motion and forces satisfy the
//! nonlinear balance `M (v⁺ - v)/h = f_int(q⁺) + f_ext + Hᵀ λ` to the tolerance. `H` is that of the begin of the step.

use nalgebra::{Isometry3, Vector3};
use palpate_fem::integrator::backward_euler::newton_step;
use palpate_fem::integrator::newton::{NewtonConfig, NewtonStatus};
use palpate_fem::pcg::{PcgReport, PcgStatus};

use super::workspace::NewtonStage;
use super::{Clock, StepInput, StepReport, StepState, StepWorkspace, stages};
use crate::world::World;

/// Most motions under corrected forces in one step.
const MOST_PASSES: usize = 10;

/// Change of the forces, relative to the largest, at which they stay.
const STAY: f64 = 1e-4;

/// One step: detection, then motion, rows, compliance and forces until the forces stay, then the last correction.
pub(super) fn newton_with_contact(
    world: &World,
    config: &NewtonConfig,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    clock: &mut Clock,
) {
    let tool: &Isometry3<f64> = &input.tool;
    stages::detection(world, tool, state, ws, report);
    report.times.detection = clock.lap();
    if let Some(stage) = &mut ws.newton {
        stage.carried.fill(0.0);
        stage.load.fill(Vector3::zeros());
    }
    for pass in 0..MOST_PASSES {
        motion(world, config, state, ws, report);
        report.times.free_motion += clock.lap();
        stages::rows(world, tool, state, ws, report);
        stages::compliance(world, input.factor, 0, ws, report);
        relieve(ws);
        report.times.compliance += clock.lap();
        (report.active, report.indentation) = (0, 0.0);
        stages::solve(world, input, state, ws, report);
        report.times.solve += clock.lap();
        if ws.rows.is_empty() || !report.compliance.usable || stays(ws) || pass + 1 == MOST_PASSES {
            break;
        }
        carry(world, ws);
    }
    stages::correct(world, input.factor, state, ws, report);
    report.times.correction = clock.lap();
}

/// The motion from the begin of the step under the forces carried so far; adds to the report.
fn motion(world: &World, config: &NewtonConfig, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(stage) = &mut ws.newton else { return };
    stage.free.q.copy_from_slice(&state.fem.q);
    stage.free.v.copy_from_slice(&state.fem.v);
    stage.free.memory.copy_from_slice(&state.fem.memory);
    stage.factored = false;
    let newton = newton_step(world.model(), ws.dt, &stage.load, config, &mut stage.free, &mut stage.ws);
    // The matrix of the step's end belongs to the memory of its begin.
    stage.free.memory.copy_from_slice(&state.fem.memory);
    report.assembly = newton.assembly;
    report.cuts += newton.cuts;
    report.free_motion = PcgReport {
        status: match newton.status {
            NewtonStatus::Converged => PcgStatus::Converged,
            NewtonStatus::OutOfIterations | NewtonStatus::Stalled => PcgStatus::OutOfIterations,
            NewtonStatus::Singular => PcgStatus::Indefinite,
            NewtonStatus::NonFinite => PcgStatus::NonFinite,
        },
        iterations: report.free_motion.iterations + newton.iterations as usize,
        relative_residual: newton.relative_residual,
    };
    for (v, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        v.copy_from_slice(stage.free.v[node as usize].as_slice());
    }
}

/// `δ_free = δ(q_k) - W λ_k`: the gaps if nothing touched, as the problem and the snapshot want them.
fn relieve(ws: &mut StepWorkspace) {
    let Some(stage) = &ws.newton else { return };
    let view = ws.problem.view();
    for (j, &carried) in stage.carried.iter().enumerate().take(ws.rows.len()).filter(|(_, c)| **c != 0.0) {
        ws.rows.delta_free.iter_mut().zip(view.column(j)).for_each(|(delta, w)| *delta -= w * carried);
    }
    ws.problem.delta_free_mut().copy_from_slice(&ws.rows.delta_free);
}

/// True where the forces that were found are those that the motion carried.
fn stays(ws: &StepWorkspace) -> bool {
    let Some(NewtonStage { carried, .. }) = &ws.newton else { return true };
    let lambda = &ws.lambda[..ws.rows.len()];
    let largest = lambda.iter().fold(0.0_f64, |most, l| most.max(l.abs()));
    lambda.iter().zip(carried).all(|(l, c)| (l - c).abs() <= STAY * largest)
}

/// Lets the next motion carry the forces that were found.
fn carry(world: &World, ws: &mut StepWorkspace) {
    let Some(stage) = &mut ws.newton else { return };
    let lambda = &ws.lambda[..ws.rows.len()];
    stage.carried[..lambda.len()].copy_from_slice(lambda);
    stage.free_load.fill(0.0);
    ws.rows.tissue.add_transposed(lambda, &mut stage.free_load);
    for (f, &node) in stage.free_load.chunks_exact(3).zip(world.model().node_of_free()) {
        stage.load[node as usize] = Vector3::new(f[0], f[1], f[2]);
    }
}
