//! Explicit central differences with lumped mass (leapfrog), and the step they bear.
//!
//! ```text
//! (v⁺ - v⁻)/h + α (v⁺ + v⁻)/2 = M⁻¹ (f_ext + f_int(q) + β (f_int(q) - f_int(q - h v⁻))/h) + g,   q⁺ = q + h v⁺
//! ```
//! `v⁻` and `v⁺` belong to the half steps before and after `q`: the state holds `q` and the velocity half a step earlier.
//! Of second order without stiffness damping; energy oscillates but does not drift below the critical step; a free mode is
//! a little too fast, `sin(ω' h/2) = ω h/2`.
//!
//! Stiffness damping is lagged: the rate of the elastic force over the last step stands for `-K v`, which costs a second
//! evaluation of forces but no tangent, and lowers the order to one. Mass damping is centred and costs nothing.
//!
//! Stable below `h = 2/ω (√(1 + ξ²) - ξ)`, `ξ = β ω/2`, for the largest `ω² = λ_max(M⁻¹ K)` [Belytschko, Liu, Moran
//! 2000]; see [`super::critical_step`]. Mass damping does not change it.

use nalgebra::Vector3;
use thiserror::Error;

use super::critical_step::CriticalStep;
use crate::{
    assembly::{AssemblyReport, FemWorkspace, internal_forces},
    model::{FemModel, FemState},
};

/// Scratch of explicit steps.
#[derive(Clone, Debug)]
pub struct ExplicitWorkspace {
    /// Internal forces at the last configuration; its matrix is not used.
    pub fem: FemWorkspace,
    /// Forces a step earlier (N), where there is stiffness damping.
    earlier: Vec<Vector3<f64>>,
    /// The configuration a step earlier.
    before: FemState,
    /// Velocities of the free nodes after the step.
    velocity: Vec<f64>,
}

impl ExplicitWorkspace {
    /// Memory for a body.
    pub fn new(model: &FemModel) -> Self {
        let damped = model.rayleigh_stiffness() > 0.0;
        Self {
            fem: FemWorkspace::new(model),
            earlier: if damped { vec![Vector3::zeros(); model.nodes()] } else { Vec::new() },
            before: if damped { model.rest_state() } else { FemState::default() },
            velocity: vec![0.0; 3 * model.free_nodes()],
        }
    }

    /// Velocities (m/s) that the last [`explicit_velocity`] found, `3 n` values over the free nodes.
    pub fn velocity(&self) -> &[f64] {
        &self.velocity
    }
}

/// What an explicit step did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExplicitReport {
    /// What the evaluation of the forces met.
    pub assembly: AssemblyReport,
    /// First node whose motion is not finite.
    pub non_finite: Option<u32>,
    /// Largest speed of a node whose speed is a number (m/s).
    pub fastest: f64,
}

/// Why a body cannot be integrated explicitly.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum ExplicitError {
    /// The substeps are above the critical step.
    #[error(
        "{substeps} explicit substeps of {dt:.4e} s are above the critical step of {critical:.4e} s (largest frequency \
         {omega:.4e} rad/s): use at least {needed}, or an implicit integrator"
    )]
    Unstable {
        /// Substeps that were asked for.
        substeps: u32,
        /// Length of one (s).
        dt: f64,
        /// The critical step (s).
        critical: f64,
        /// Upper bound of the largest frequency (rad/s).
        omega: f64,
        /// Substeps that are needed.
        needed: u32,
    },
    /// A free node without mass.
    #[error(
        "node {node} has no mass: explicit integration divides by it; give a density, or use an implicit integrator"
    )]
    Massless {
        /// The mesh node.
        node: u32,
    },
}

/// Checks that every free node has mass.
///
/// # Errors
/// [`ExplicitError::Massless`] with the first node that has none.
pub fn check_mass(model: &FemModel) -> Result<(), ExplicitError> {
    let massless = |&&node: &&u32| model.mass()[node as usize] <= 0.0;
    model.node_of_free().iter().find(massless).map_or(Ok(()), |&node| Err(ExplicitError::Massless { node }))
}

/// Refuses a step `dt` (s) in so many substeps, if these are above the critical step.
///
/// # Errors
/// [`ExplicitError::Unstable`] with the substeps that are needed.
pub fn check_step(dt: f64, substeps: u32, critical: &CriticalStep) -> Result<(), ExplicitError> {
    let substep = dt / f64::from(substeps);
    if substep <= critical.step {
        return Ok(());
    }
    let needed = critical.substeps(dt, 1.0);
    Err(ExplicitError::Unstable { substeps, dt: substep, critical: critical.step, omega: critical.upper, needed })
}

/// The velocity `v⁺` of the free nodes after a step `dt` (s), into [`ExplicitWorkspace::velocity`]; the state stays: a step
/// corrects it by contact before it moves, and takes the memory of viscous tissue along first
/// ([`advance_memory`](crate::assembly::advance_memory)). `f_ext` is one force per mesh node (N), or empty. Allocates
/// nothing.
pub fn explicit_velocity(
    model: &FemModel,
    dt: f64,
    f_ext: &[Vector3<f64>],
    state: &FemState,
    ws: &mut ExplicitWorkspace,
) -> ExplicitReport {
    let assembly = forces(model, dt, state, ws);
    let half = 0.5 * dt * model.rayleigh_mass();
    let mut report = ExplicitReport { assembly, non_finite: None, fastest: 0.0 };
    for (k, &node) in model.node_of_free().iter().enumerate() {
        let i = node as usize;
        let v = (state.v[i] * (1.0 - half) + acceleration(model, i, f_ext, ws) * dt) / (1.0 + half);
        if report.non_finite.is_none() && !(v * dt).iter().all(|x| x.is_finite()) {
            report.non_finite = Some(node);
        }
        report.fastest = report.fastest.max(v.norm());
        ws.velocity[3 * k..3 * k + 3].copy_from_slice(v.as_slice());
    }
    report
}

/// Internal forces at the state and, where there is stiffness damping, a step earlier.
fn forces(model: &FemModel, dt: f64, state: &FemState, ws: &mut ExplicitWorkspace) -> AssemblyReport {
    ws.fem.dt = dt;
    if model.rayleigh_stiffness() > 0.0 {
        ws.before.q.copy_from_slice(&state.q);
        ws.before.memory.copy_from_slice(&state.memory);
        for &node in model.node_of_free() {
            ws.before.q[node as usize] -= state.v[node as usize] * dt;
        }
        internal_forces(model, &ws.before, &mut ws.fem);
        ws.earlier.copy_from_slice(&ws.fem.f_int);
    }
    let report = internal_forces(model, state, &mut ws.fem);
    if model.rayleigh_stiffness() > 0.0 {
        let rate = model.rayleigh_stiffness() / dt;
        ws.fem.f_int.iter_mut().zip(&ws.earlier).for_each(|(f, earlier)| *f += (*f - earlier) * rate);
    }
    report
}

/// Acceleration of a node (m/s²) without mass damping.
fn acceleration(model: &FemModel, node: usize, f_ext: &[Vector3<f64>], ws: &ExplicitWorkspace) -> Vector3<f64> {
    (f_ext.get(node).copied().unwrap_or_default() + ws.fem.f_int[node]) / model.mass()[node] + model.gravity()
}
