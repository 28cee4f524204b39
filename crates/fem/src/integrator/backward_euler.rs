//! Backward Euler by Newton's method on the incremental potential.
//!
//! Of first order, and it damps: a free mode `ω` shrinks by `1/√(1 + (ωh)²)` in each step, and its phase advances by
//! `atan(ωh)` instead of `ωh`. So does the step with one linearisation [Baraff, Witkin 1998], which is one assembly
//! ([`assemble`](crate::assembly::assemble)) and one solve, `A Δv = b`, of its caller: stable for linear tissue, with
//! whatever residual the curvature of the forces leaves. Newton's method drives the residual to a tolerance, and its line
//! search keeps the step from overshooting: the reference.

use nalgebra::Vector3;

use super::{
    newton::{ImplicitWorkspace, NewtonConfig, NewtonReport, NewtonStatus, factor_definite, minimise},
    potential::Potential,
};
use crate::{
    assembly::advance_memory,
    model::{FemModel, FemState},
};

/// Factors the system matrix of the end of the last [`newton_step`] into `ws.factor`, filtered where the exact one is not
/// positive definite: the compliance of contacts that correct the step. False where it cannot be factored.
pub fn factor_end(model: &FemModel, dt: f64, state: &FemState, ws: &mut ImplicitWorkspace) -> bool {
    let potential = Potential { model, f_ext: &[], load: 1.0, dt: Some(dt) };
    factor_definite(&potential, state, ws, &mut NewtonReport::begin()).is_ok()
}

/// One step `dt` (s) by Newton's method with line search on the incremental potential, from the state at its begin.
///
/// `f_ext` is one force per mesh node (N), or empty. With a non-finite status the state is what it was; with any other status it has
/// moved to the lowest potential that was found. Afterwards `ws.fem.system` is the system matrix `A` (kg) of the end of
/// the step, with the exact tangent. Allocates nothing.
pub fn newton_step(
    model: &FemModel,
    dt: f64,
    f_ext: &[Vector3<f64>],
    config: &NewtonConfig,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
) -> NewtonReport {
    let potential = Potential { model, f_ext, load: 1.0, dt: Some(dt) };
    potential.begin(state, ws);
    let report = minimise(&potential, config, state, ws);
    if report.status == NewtonStatus::NonFinite {
        state.q.copy_from_slice(&ws.start);
        return report;
    }
    for &node in model.node_of_free() {
        let node = node as usize;
        state.v[node] = (state.q[node] - ws.start[node]) / dt;
    }
    advance_memory(model, state, dt);
    report
}
