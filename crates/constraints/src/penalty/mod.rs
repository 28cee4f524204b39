//! Penalty contact: springs and dampers in place of laws, the first of the lecture's direct approaches.
//!
//! ```text
//! normal:    F_n = max(0, k p + c dp/dt),   p = max(0, -δ_n) at the step's end, dp/dt = (p - p_begin) / h
//! tangents:  F_t = -min(k |δ_t|, μ F_n) δ_t / |δ_t|,   δ_t = slip during the step
//! ```
//!
//! All of it is implicit: `δ = δ_free + h H w` at the end of the step, `A w = h Hᵀ F(δ)`, solved by Newton's method in
//! [`solve`]. `k` in N/m, `c = damping k` in N s/m; `k` is given, or a multiple of the stiffness `1 / (h² H D⁻¹ Hᵀ)` that
//! the diagonal blocks `D` of `A` show at the contact.
//!
//! What a penalty cannot do, whatever its parameters: weight `m g` sinks in by `m g / k`, since force *is* penetration; a block that
//! Coulomb's law holds on a slope creeps by `F_t / k` in every step, since friction is slip within a step; and one that falls
//! rebounds where `k` is not well damped. As `k` grows the answer tends to that of Signorini's and Coulomb's laws with an
//! error of order `1 / k`, and the condition of `A + h² k Hᵀ H` grows with `k`. Contacts have no coupling of their own:
//! n of them make 2ⁿ linear branches that Newton's method must search [Duriez, Dubois, Kheddar and Andriot 2006].

pub mod solve;

use nalgebra::{Matrix3, Vector3};
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::sparse::SystemMatrix;
use serde::{Deserialize, Serialize};

/// How stiff contacts are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PenaltyConfig {
    /// Stiffness of each contact (N/m), `> 0`; without it, that of the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Without `stiffness`: this many times the body's own stiffness at the contact, `> 0`. Default 10.
    pub multiple: f64,
    /// Damping coefficient over stiffness (s), `>= 0`: a contact gives up its force in about this time. Default 2 ms.
    pub damping: f64,
}

impl Default for PenaltyConfig {
    fn default() -> Self {
        Self { stiffness: None, multiple: 10.0, damping: 2e-3 }
    }
}

/// One contact's spring and damper in this step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PenaltyContact {
    /// `k` (N/m); 0 for a contact that no force moves.
    pub stiffness: f64,
    /// `c / h` (N/m).
    pub damping: f64,
    /// `p_begin` (m), `>= 0`: how deep the skin lay in the tool when the step began, both where they were then.
    pub before: f64,
    /// Friction coefficient `μ`.
    pub friction: f64,
}

impl PenaltyContact {
    /// The contact whose normal row is row `n` of `rows`, in a step of `dt` (s). `gap_before` (m) is the gap when the step
    /// began.
    #[allow(non_snake_case)]
    pub fn new(
        config: &PenaltyConfig,
        friction: f64,
        A: &SystemMatrix,
        rows: &NodalRows,
        n: usize,
        dt: f64,
        gap_before: f64,
    ) -> Self {
        let stiffness = config.stiffness.or_else(|| body_stiffness(A, rows, n, dt).map(|k| config.multiple * k));
        let stiffness = stiffness.filter(|k| k.is_finite() && *k > 0.0).unwrap_or(0.0);
        let before = if gap_before < 0.0 { -gap_before } else { 0.0 };
        Self { stiffness, damping: stiffness * config.damping / dt, before, friction }
    }

    /// `k + c / h` and `p_begin c / h`: the normal force is `max(0, -total δ_n - shift)`.
    fn normal(&self) -> (f64, f64) {
        (self.stiffness + self.damping, self.damping * self.before)
    }

    /// Normal force (N) at the gap `delta` (m).
    fn normal_force(&self, delta: &Vector3<f64>) -> f64 {
        let (total, shift) = self.normal();
        (-total * delta.x - shift).max(0.0)
    }

    /// Largest friction (N) at the gap `delta` (m): `μ F_n`.
    pub fn bound(&self, delta: &Vector3<f64>) -> f64 {
        self.friction * self.normal_force(delta)
    }

    /// Force `[n, t, s]` (N) at the gap `delta` (m): inside Coulomb's cone for every argument that is finite.
    pub fn force(&self, delta: &Vector3<f64>) -> Vector3<f64> {
        self.force_within(delta, self.bound(delta))
    }

    /// The same with friction of at most `bound` (N) whatever the normal force, as by Tresca's law.
    pub fn force_within(&self, delta: &Vector3<f64>, bound: f64) -> Vector3<f64> {
        let slip = delta.yz();
        let wanted = self.stiffness * slip.norm();
        let share = if wanted > bound { bound / wanted } else { 1.0 };
        let friction = slip * (-self.stiffness * share);
        Vector3::new(self.normal_force(delta), friction.x, friction.y)
    }

    /// `-dF/dδ` (N/m) with the bound of friction held: symmetric and positive semidefinite.
    pub fn tangent_within(&self, delta: &Vector3<f64>, bound: f64) -> Matrix3<f64> {
        let mut tangent = Matrix3::zeros();
        if self.normal_force(delta) > 0.0 {
            tangent[(0, 0)] = self.stiffness + self.damping;
        }
        let slip = delta.yz();
        let size = slip.norm();
        let sliding = self.stiffness * size > bound;
        for i in 0..2 {
            for j in 0..2 {
                let unit = f64::from(u8::from(i == j));
                tangent[(i + 1, j + 1)] = if sliding {
                    bound / size * (unit - slip[i] * slip[j] / (size * size))
                } else if bound > 0.0 {
                    self.stiffness * unit
                } else {
                    0.0
                };
            }
        }
        tangent
    }

    /// Energy (J) whose negative derivative is [`PenaltyContact::force_within`].
    pub fn energy_within(&self, delta: &Vector3<f64>, bound: f64) -> f64 {
        let (normal, slip, k) = (self.normal_force(delta), delta.yz().norm(), self.stiffness);
        if k <= 0.0 {
            return 0.0;
        }
        let friction = if k * slip <= bound { 0.5 * k * slip * slip } else { bound * (slip - 0.5 * bound / k) };
        0.5 * normal * normal / (k + self.damping) + friction
    }
}

/// `1 / (h² H D⁻¹ Hᵀ)` (N/m) of row `n`, with `D` the diagonal blocks of `A`; none where no node of it can move.
#[allow(non_snake_case)]
fn body_stiffness(A: &SystemMatrix, rows: &NodalRows, n: usize, dt: f64) -> Option<f64> {
    if n >= rows.len() {
        return None;
    }
    let mut compliance = 0.0;
    for (node, value) in rows.row(n) {
        let block = A.blocks.get(A.pattern.find(node, node)?)?;
        compliance += value.dot(&(block.cholesky()?.inverse() * value));
    }
    (compliance > 0.0).then(|| 1.0 / (dt * dt * compliance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn contact(stiffness: f64, damping: f64, before: f64, friction: f64) -> PenaltyContact {
        PenaltyContact { stiffness, damping, before, friction }
    }

    proptest! {
        /// The force is the slope of the energy, and the tangent that of the force, by central differences of 1e-7 of the
        /// gap's size: 1e-6 is their rounding and the kink's distance.
        #[test]
        fn force_and_tangent_are_derivatives(
            k in 1.0..1e4f64, c in 0.0..5e3f64, p in 0.0..1e-3f64, mu in 0.0..1.5f64,
            n in -2e-3..1e-3f64, t in -1e-3..1e-3f64, s in -1e-3..1e-3f64,
        ) {
            let (contact, at) = (contact(k, c, p, mu), Vector3::new(n, t, s));
            let (total, shift) = contact.normal();
            let force = contact.force(&at);
            let (bound, slip) = (mu * force.x, at.yz().norm());
            let step = 1e-9;
            // Away from the kinks of law and friction.
            prop_assume!((total * n + shift).abs() > 10.0 * step * total);
            prop_assume!((k * slip - bound).abs() > 10.0 * step * (k + mu * total) && slip > 1e-5);
            let tangent = contact.tangent_within(&at, bound);
            prop_assert_eq!(contact.force_within(&at, bound), force);
            for j in 0..3 {
                let e = Vector3::ith(j, step);
                let energy = |at: Vector3<f64>| contact.energy_within(&at, bound);
                let slope = (energy(at + e) - energy(at - e)) / (2.0 * step);
                prop_assert!((slope + force[j]).abs() <= 1e-5 * force.norm() + 1e-9 * total, "{slope} {force:?}");
                let held = |at: Vector3<f64>| contact.force_within(&at, bound);
                let change = (held(at - e) - held(at + e)) / (2.0 * step);
                prop_assert!((change - tangent.column(j)).norm() <= 1e-5 * total, "{change:?} {tangent:?}");
            }
            prop_assert!(force.x >= 0.0 && force.yz().norm() <= bound * (1.0 + 1e-12));
        }
    }

    /// Parting faster than the damper follows pulls at nothing.
    #[test]
    fn a_damper_never_pulls() {
        let parting = contact(100.0, 400.0, 1e-3, 0.3);
        assert_eq!(parting.force(&Vector3::new(-0.5e-3, 1e-4, 0.0)), Vector3::zeros());
        // At rest the damper carries nothing: k p.
        assert!((parting.force(&Vector3::new(-1e-3, 0.0, 0.0)).x - 0.1).abs() < 1e-15);
    }
}
