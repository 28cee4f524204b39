//! The end of the step: the motion under the contact forces, and back to the state before where the body failed.

use nalgebra::Vector3;
use palpate_constraints::body::{Body, SoftBody};
use palpate_constraints::compliance::{self, WarpedInverse};
use palpate_fem::assembly::advance_memory;
use palpate_fem::pcg::PcgStatus;

use super::accuracy;
use super::free_motion::complete;
use super::rigid;
use super::stages::inverse;
use super::{FailedElement, StepReport, StepState, StepStatus, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{Integration, World};

/// `h A⁻¹ Hᵀ lambda` into `ws.correction`, with the inverse that gave `W`, for the part of `lambda` that the free motion
/// does not carry already, or the motion of a direct approach; false where that cannot be. Roughly where an exact
/// correction begins there.
fn correction(world: &World, factor: &FactorSample, begins: bool, ws: &mut StepWorkspace) -> bool {
    if let Some(direct) = &ws.direct {
        let tissue = ws.correction.len();
        ws.correction.copy_from_slice(direct.of_tissue(tissue));
        // From the forces, so that what one body gains in momentum the others lose.
        return ws.rigid.correct(&ws.rows, &ws.lambda[..ws.rows.len()], ws.dt);
    }
    if let Some(newton) = &mut ws.newton {
        newton.carried.iter_mut().zip(&ws.lambda).for_each(|(carried, lambda)| *carried = lambda - *carried);
    }
    let lambda = ws.newton.as_ref().map_or(&ws.lambda, |newton| &newton.carried);
    let lambda = &lambda[..ws.rows.len()];
    let (dt, correction) = (ws.dt, &mut ws.correction);
    let moved = ws.rigid.correct(&ws.rows, lambda, dt);
    moved
        && match &mut ws.explicit {
            Some(explicit) => {
                let inverse = WarpedInverse { inverse: &explicit.inverse, rotations: None };
                SoftBody { inverse, workspace: &mut explicit.compliance, correction }.correct(&ws.rows, lambda, dt)
            }
            None => {
                let own = ws.own.as_ref().filter(|_| ws.own_is_current);
                let (inverse, _) = inverse(world, factor, own, ws.newton.as_ref(), ws.first.as_ref(), &ws.rotations);
                if begins {
                    return compliance::guess(inverse, lambda, dt, correction, &mut ws.compliance);
                }
                SoftBody { inverse, workspace: &mut ws.compliance, correction }.correct(&ws.rows, lambda, dt)
            }
        }
}

/// Motion of a node in one step, relative to the body's mean motion and to its size, beyond which the body is no longer
/// one: tissue that folds and tears apart does so by growing powers, and is stopped long before its numbers overflow.
const TORN: f64 = 10.0;

/// True where all positions are finite and no node has left the body.
fn is_whole(state: &StepState, nodes: &[u32], h: f64, size: f64) -> bool {
    let velocities = || nodes.iter().map(|&n| state.fem.v[n as usize]);
    let mean: Vector3<f64> = velocities().sum::<Vector3<f64>>() / nodes.len() as f64;
    // Written so that NaN is not whole.
    let near = velocities().all(|v| h * (v - mean).norm() <= TORN * size);
    near && state.fem.q.iter().all(|q| q.iter().all(|x| x.is_finite()))
}

/// The element to name when a body fails: the one that is known to be at fault, or one at the node that has gone astray,
/// whose velocity is not finite or the farthest from the body's mean.
pub(super) fn failed_element(world: &World, state: &StepState, known: Option<u32>) -> Option<FailedElement> {
    let mesh = world.mesh();
    let astray = || {
        let nodes = world.model().node_of_free();
        let velocities = || nodes.iter().map(|&n| state.fem.v[n as usize]);
        let mean = velocities().sum::<Vector3<f64>>() / nodes.len() as f64;
        let far = |v: Vector3<f64>| if v.norm().is_finite() { (v - mean).norm() } else { f64::INFINITY };
        let strays =
            nodes.iter().copied().zip(velocities().map(far)).map(|(n, d)| (n, if d.is_nan() { 0.0 } else { d }));
        let (node, _) = strays.reduce(|a, b| if b.1 > a.1 { b } else { a })?;
        let corner = mesh.tetrahedra.iter().position(|t| t.contains(&node));
        corner.or_else(|| mesh.mid_nodes.iter().position(|t| t.contains(&node))).map(|t| t as u32)
    };
    let tetrahedron = known.filter(|&t| (t as usize) < mesh.tetrahedra.len()).or_else(astray)?;
    let tetrahedron_of_scene =
        world.left().map_or(Some(tetrahedron), |left| left.get(tetrahedron as usize).copied())?;
    Some(FailedElement {
        tetrahedron: tetrahedron_of_scene,
        region: mesh.regions.get(tetrahedron as usize).copied().unwrap_or(0),
    })
}

/// `v+ = v_free + h A⁻¹ Hᵀ lambda`, `q+ = q + h v+`, with the inverse that gave `W`; back to the state before where a
/// number is not finite or the body is torn apart. Rigid bodies move and go back with it.
pub(super) fn correct(
    world: &World,
    factor: &FactorSample,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let h = ws.dt;
    let lambda = &ws.lambda[..ws.rows.len()];
    let touched = match &ws.newton {
        // Forces that the motion carries and that were let go of must leave it again.
        Some(newton) => lambda.iter().zip(&newton.carried).any(|(l, carried)| l != carried),
        None => lambda.iter().any(|&l| l != 0.0),
    };
    let begins = accuracy::corrects_exactly(world, ws, report);
    if !(touched && begins) {
        complete(world, factor, state, ws, report);
    }
    if touched && !correction(world, factor, begins, ws) {
        ws.correction.fill(f64::NAN);
    }
    if touched {
        accuracy::correct_exactly(world, factor, state, ws, report);
    } else {
        accuracy::measure_overlap(world, false, ws, report);
    }
    // Explicit forces are those of a step that ended where this one begins.
    let explicit = matches!(world.integration(), Integration::Explicit { .. });
    if explicit {
        advance_memory(world.model(), &mut state.fem, h);
    }
    let held = world.model().held();
    for (k, &node) in world.model().node_of_free().iter().enumerate().filter(|(k, _)| !held[*k]) {
        let v_free = Vector3::new(ws.v_free[3 * k], ws.v_free[3 * k + 1], ws.v_free[3 * k + 2]);
        let corrected = if touched {
            Vector3::new(ws.correction[3 * k], ws.correction[3 * k + 1], ws.correction[3 * k + 2])
        } else {
            Vector3::zeros()
        };
        let node = node as usize;
        state.prediction.learn(k, &(v_free - state.fem.v[node]), &corrected);
        let v = v_free + corrected;
        state.fem.v[node] = v;
        state.fem.q[node] += h * v;
    }
    let rigid_is_whole = rigid::advance_rigid(world, state, ws, touched);
    let overflow = report.assembly.non_finite.is_some() || report.free_motion.status == PcgStatus::NonFinite;
    if overflow || !rigid_is_whole || !is_whole(state, world.model().node_of_free(), h, ws.size) {
        report.failed = failed_element(world, state, report.assembly.non_finite);
        state.roll_back();
        report.status = StepStatus::RolledBack;
        (report.force, report.torque) = (Vector3::zeros(), Vector3::zeros());
        return;
    }
    if !explicit {
        advance_memory(world.model(), &mut state.fem, h);
    }
}
