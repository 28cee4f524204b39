//! Backward Euler: with one linearisation, or by Newton's method on the incremental potential.
//!
//! Both are of first order and damp: a free mode `ω` shrinks by `1/√(1 + (ωh)²)` in each step, and its phase advances by
//! `atan(ωh)` instead of `ωh`. One linearisation [Baraff, Witkin 1998] costs one assembly and one solve and is stable
//! for linear tissue; its residual is whatever the curvature of the forces leaves. Newton's method drives the residual to
//! a tolerance, and its line search keeps the step from overshooting: the reference.

use nalgebra::Vector3;

use super::{
    newton::{ImplicitWorkspace, NewtonConfig, NewtonReport, NewtonStatus, factor_definite, minimise},
    nodal,
    potential::Potential,
};
use crate::{
    assembly::{AssemblyReport, advance_memory, assemble},
    factor::FactorStatus,
    model::{FemModel, FemState},
};

/// What a step with one linearisation did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearisedReport {
    /// Forces and matrix at the begin of the step.
    pub assembly: AssemblyReport,
    /// Whether its matrix could be factored.
    pub factor: FactorStatus,
    /// Whether the state moved on; if not, it is untouched.
    pub advanced: bool,
}

/// One step `dt` (s) with one linearisation and a direct solve: `A Δv = b`, `v += Δv`, `q += h v`.
///
/// `f_ext` is one force per mesh node (N), or empty. The model's own choice of filter applies. Allocates nothing.
pub fn linearised_step(
    model: &FemModel,
    dt: f64,
    f_ext: &[Vector3<f64>],
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
) -> LinearisedReport {
    ws.fem.filter = model.filter();
    let assembly = assemble(model, state, dt, f_ext, &mut ws.fem);
    let factor = ws.factor.refactor(&ws.fem.system).status;
    ws.direction.copy_from_slice(&ws.fem.rhs);
    let solved = factor == FactorStatus::Ok && ws.factor.solve(&mut ws.direction, &mut ws.solve).is_ok();
    let advanced = solved && ws.direction.iter().all(|d| d.is_finite());
    if advanced {
        for (k, &node) in model.node_of_free().iter().enumerate() {
            let node = node as usize;
            state.v[node] += nodal(&ws.direction, k);
            state.q[node] += state.v[node] * dt;
        }
        advance_memory(model, state, dt);
    }
    LinearisedReport { assembly, factor, advanced }
}

/// Factors the system matrix of the end of the last [`newton_step`] into `ws.factor`, filtered where the exact one is not
/// positive definite: the compliance of contacts that correct the step. False where it cannot be factored.
pub fn factor_end(model: &FemModel, dt: f64, state: &FemState, ws: &mut ImplicitWorkspace) -> bool {
    let potential = Potential { model, f_ext: &[], load: 1.0, dt: Some(dt) };
    factor_definite(&potential, state, ws, &mut NewtonReport::begin()).is_ok()
}

/// One step `dt` (s) by Newton's method with line search on the incremental potential, from the state at its begin.
///
/// `f_ext` as for [`linearised_step`]. With a non-finite status the state is what it was; with any other status it has
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
