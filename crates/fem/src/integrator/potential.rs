//! The potential whose minimum is a backward Euler step, or an equilibrium.
//!
//! ```text
//! Φ(q) = Ψ(q) - s (f_ext + M g)·q                                        J
//!      + 1/2h² ‖q - q̃‖²_M + α/2h ‖q - q0‖²_M + β/2h (q - q0)ᵀ K0 (q - q0)     a step h from q0, q̃ = q0 + h v0
//! r = -∂Φ/∂q = f_int + s (f_ext + M g) - M (q - q̃)/h² - (α M + β K0)(q - q0)/h          N
//! A = h² ∂²Φ/∂q² = M (1 + αh) + h² K(q) + βh K0                          kg (with h = 1 for an equilibrium: N/m)
//! ```
//! over the free nodes [Kane, Marsden, Ortiz, West 2000; Martin, Thomaszewski, Grinspun, Gross 2011]. The minimum gives
//! `v = (q - q0)/h`. `s` scales the loads of an equilibrium.
//!
//! Departure: stiffness damping is that of the filtered tangent `K0` at the begin of the step. Damping by the tangent at
//! the end has no potential; `K0` is semidefinite, so the term only dissipates.
//!
//! Energy: a line search from `q0` ends at `Φ(q) <= Φ(q0)`, so that `U(q) + ½ ‖v - v0‖²_M <= U(q0) + ½ ‖v0‖²_M` for a step
//! of any length, with `U = Ψ - (f_ext + M g)·q`: no step makes more potential energy than there was energy, whatever
//! the law. At the minimum, and where `U` is convex between `q0` and `q`, the whole energy `U + ½ ‖v‖²_M` falls by at
//! least `½ ‖v - v0‖²_M`. The first Newton iteration from `q0` is the step with one linearisation.

#![allow(non_snake_case)]

use nalgebra::Vector3;

use super::{dot, newton::ImplicitWorkspace, nodal};
use crate::{
    assembly::{AssemblyReport, Coefficients, Folds, assemble_with, incremental_energy, internal_forces},
    model::{FemModel, FemState},
};

/// Which potential: the terms of a body under loads, for one step or none.
#[derive(Clone, Copy, Debug)]
pub struct Potential<'a> {
    /// The body.
    pub model: &'a FemModel,
    /// One force per mesh node (N), or empty.
    pub f_ext: &'a [Vector3<f64>],
    /// Factor `s` of `f_ext` and gravity.
    pub load: f64,
    /// The step `h` (s); none for an equilibrium.
    pub dt: Option<f64>,
}

/// The potential along a direction `d`: `Φ(q + t d) - Φ(q) = Ψ(q + t d) - Ψ(q) + t linear + t²/2 quadratic`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// Slope of everything but the elastic energy (J).
    pub(super) linear: f64,
    /// Curvature of everything but the elastic energy (J).
    pub(super) quadratic: f64,
    /// Slope of the whole potential, `-r·d` (J).
    pub(super) slope: f64,
}

impl Potential<'_> {
    /// Factor between the unknown of the linear solve and the motion: `Δq = h x`, and between residual and right side.
    pub(super) fn scale(&self) -> f64 {
        self.dt.unwrap_or(1.0)
    }

    /// The step in which viscous tissue relaxes (s): for an equilibrium one without end.
    fn step(&self) -> f64 {
        self.dt.unwrap_or(f64::INFINITY)
    }

    /// `f_ext + M g` at a node (N), unscaled.
    pub(super) fn external(&self, node: usize) -> Vector3<f64> {
        self.f_ext.get(node).copied().unwrap_or_default() + self.model.gravity() * self.model.mass()[node]
    }

    /// Takes the begin of the step from `state`: `q0`, `q̃` and, where there is stiffness damping, `K0`.
    pub(super) fn begin(&self, state: &FemState, ws: &mut ImplicitWorkspace) {
        ws.start.copy_from_slice(&state.q);
        let Some(h) = self.dt else { return };
        for &node in self.model.node_of_free() {
            let node = node as usize;
            ws.predicted[node] = state.q[node] + state.v[node] * h;
        }
        if let Some(K0) = &mut ws.damping {
            ws.fem.filter = true;
            ws.fem.dt = h;
            assemble_with(self.model, state, Coefficients::STATIC, &[], &mut ws.fem);
            K0.blocks.copy_from_slice(&ws.fem.system.blocks);
        }
    }

    /// `A` into `ws.fem.system`, forces into `ws.fem.f_int`.
    pub(super) fn matrix(&self, state: &FemState, filter: bool, ws: &mut ImplicitWorkspace) -> AssemblyReport {
        ws.fem.filter = filter;
        ws.fem.dt = self.step();
        let coefficients = match self.dt {
            None => Coefficients::STATIC,
            Some(h) => Coefficients { mass: 1.0 + h * self.model.rayleigh_mass(), stiffness: h * h },
        };
        let report = assemble_with(self.model, state, coefficients, &[], &mut ws.fem);
        if let (Some(h), Some(K0)) = (self.dt, &ws.damping) {
            let factor = h * self.model.rayleigh_stiffness();
            ws.fem.system.blocks.iter_mut().zip(&K0.blocks).for_each(|(a, k)| *a += k * factor);
        }
        report
    }

    /// `r` (N) into `ws.residual`, from the forces in `ws.fem.f_int`. Returns the size of the forces that it balances
    /// (N): the norms of internal forces (reactions included), loads and momentum over the step.
    pub(super) fn residual(&self, state: &FemState, ws: &mut ImplicitWorkspace) -> f64 {
        let model = self.model;
        self.damping_force(state, ws);
        let mut external = 0.0;
        let mut momentum = 0.0;
        for (k, &node) in model.node_of_free().iter().enumerate() {
            let (node, mass) = (node as usize, model.mass()[node as usize]);
            let load = self.external(node) * self.load;
            external += load.norm_squared();
            let mut r = ws.fem.f_int[node] + load;
            if let Some(h) = self.dt {
                let q = state.q[node];
                momentum += ((ws.predicted[node] - ws.start[node]) * (mass / (h * h))).norm_squared();
                r -= (q - ws.predicted[node]) * (mass / (h * h));
                r -= (q - ws.start[node]) * (mass * model.rayleigh_mass() / h) + nodal(&ws.product, k);
            }
            ws.residual[3 * k..3 * k + 3].copy_from_slice(r.as_slice());
        }
        let internal: f64 = ws.fem.f_int.iter().map(Vector3::norm_squared).sum();
        external.sqrt() + momentum.sqrt() + internal.sqrt()
    }

    /// Forces alone, then [`Self::residual`].
    pub(super) fn residual_at(&self, state: &FemState, ws: &mut ImplicitWorkspace) -> f64 {
        ws.fem.dt = self.step();
        internal_forces(self.model, state, &mut ws.fem);
        self.residual(state, ws)
    }

    /// `β/h K0 (q - q0)` into `ws.product`.
    fn damping_force(&self, state: &FemState, ws: &mut ImplicitWorkspace) {
        let (Some(h), Some(K0)) = (self.dt, &ws.damping) else {
            ws.product.fill(0.0);
            return;
        };
        for (k, &node) in self.model.node_of_free().iter().enumerate() {
            let d = state.q[node as usize] - ws.start[node as usize];
            ws.moved[3 * k..3 * k + 3].copy_from_slice(d.as_slice());
        }
        K0.multiply(&ws.moved, &mut ws.product);
        let factor = self.model.rayleigh_stiffness() / h;
        ws.product.iter_mut().for_each(|p| *p *= factor);
    }

    /// The potential along `ws.direction` from the configuration whose residual is in `ws.residual`.
    pub(super) fn along(&self, ws: &mut ImplicitWorkspace) -> Line {
        let model = self.model;
        let slope = -dot(&ws.residual, &ws.direction);
        let (mut elastic, mut quadratic) = (0.0, 0.0);
        for (k, &node) in model.node_of_free().iter().enumerate() {
            let (d, node) = (nodal(&ws.direction, k), node as usize);
            elastic -= ws.fem.f_int[node].dot(&d);
            if let Some(h) = self.dt {
                quadratic += model.mass()[node] * (1.0 / (h * h) + model.rayleigh_mass() / h) * d.norm_squared();
            }
        }
        if let (Some(h), Some(K0)) = (self.dt, &ws.damping) {
            K0.multiply(&ws.direction, &mut ws.product);
            quadratic += model.rayleigh_stiffness() / h * dot(&ws.direction, &ws.product);
        }
        Line { linear: slope - elastic, quadratic, slope }
    }

    /// `Ψ(q)` (J), with the barrier of `folds`; of viscous tissue the energy that its step minimises.
    pub(super) fn elastic(&self, state: &FemState, folds: &Folds) -> f64 {
        incremental_energy(self.model, state, self.step()) + folds.energy(self.model, &state.q)
    }
}
