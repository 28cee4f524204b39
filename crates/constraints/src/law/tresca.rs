//! Unilateral contact with friction of a given strength: three rows `[n, t, s]`.
//!
//! ```text
//! 0 <= delta_n _|_ lambda_n >= 0 ,   |lambda_t| <= g ,
//! delta_t = 0 (stick)   or   lambda_t = -g delta_t / |delta_t| (slip)
//! ```
//!
//! The strength `g` is given and does not know the normal force: a point that is apart is held as well. The law is
//! associated, so that a problem of such contacts is one of convex optimisation and has one solution where `W` is
//! positive definite; Coulomb friction is the fixed point of `g = mu lambda_n`.
//!
//! # Exact local solution
//! With the normal row closed and eliminated (see [`LocalCompliance`]) the tangential force minimises
//! `1/2 p^T S p + c^T p` in the disc `|p| <= g`: `p = -(S + s I)^-1 c` with `s = 0` inside, else with `s > 0` from
//! `|p(s)| = g`. Newton on `1 / |p(s)| - 1 / g`, a concave function, rises to the root from `s = 0` without overshooting.
//! If the normal force that follows is negative, it is zero (the problem is convex), and `W_tt`, `b_t` take the place of
//! `S`, `c`.

use super::local::eigen;
use super::{ConicForm, ContactLaw, Law, LawError, Linearization, LocalCompliance, is_finite};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Newton takes 3 to 8 steps; more only where rounding keeps it from ending.
const MAX_ITERATIONS: usize = 60;

/// Unilateral contact with friction of a given strength.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tresca {
    /// Largest tangential force `g`, N, `>= 0` and finite.
    pub limit: f64,
}

impl Law {
    /// The law that a contact obeys whose gap is `gap` (m) where nothing touches: this one, but for Tresca's, which holds
    /// points that are apart as well. Whoever lists contacts before they touch means only those that would overlap to be
    /// held; the others slide freely, on as many rows.
    #[must_use]
    #[inline]
    pub fn at_free_gap(self, gap: f64) -> Self {
        match self {
            Law::Tresca(_) if gap > 0.0 => Tresca { limit: 0.0 }.into(),
            law => law,
        }
    }
}

impl ContactLaw for Tresca {
    const NAME: &'static str = "tresca";

    #[inline]
    fn rows(&self) -> usize {
        3
    }

    fn validate(&self) -> Result<(), LawError> {
        if self.limit >= 0.0 && self.limit.is_finite() {
            return Ok(());
        }
        Err(LawError {
            law: Self::NAME,
            parameter: "limit",
            value: self.limit,
            remedy: "give a force in N, zero or more",
        })
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x >= 0.0 && (self.limit == 0.0 || delta.y == 0.0 && delta.z == 0.0)
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        if W.is_rigid() {
            return Vector3::zeros();
        }
        let p = W.rotated_back(&in_disc(&W.sigma, &W.rotated(&W.reduced(b)), self.limit));
        let normal = -(b.x + W.nt.dot(&p)) * W.inv_nn;
        if normal >= 0.0 {
            return self.project(&Vector3::new(normal, p.x, p.y));
        }
        let (sigma, axis) = eigen(&W.tt);
        let c = Vector2::new(axis.x * b.y + axis.y * b.z, axis.x * b.z - axis.y * b.y);
        let p = in_disc(&sigma, &c, self.limit);
        self.project(&Vector3::new(0.0, axis.x * p.x - axis.y * p.y, axis.y * p.x + axis.x * p.y))
    }

    /// Projection onto the half-line and onto the disc.
    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        if !is_finite(force) {
            return Vector3::zeros();
        }
        let size = force.y.hypot(force.z);
        // With room for the rounding of a sliding force, so that projecting it again changes no bit.
        let shrink = if size <= self.limit * (1.0 + 4.0 * f64::EPSILON) { 1.0 } else { self.limit.max(0.0) / size };
        let nearest = Vector3::new(force.x.max(0.0), shrink * force.y, shrink * force.z);
        if is_finite(&nearest) { nearest } else { Vector3::zeros() }
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::Cylinder { limit: self.limit }
    }

    #[inline]
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        if lambda.x - rho * delta.x > 0.0 {
            equation.close(0, rho, delta);
        }
        equation.disc(self.limit, 0.0, rho, delta, lambda);
        equation
    }
}

/// Minimiser of `1/2 p^T diag(sigma) p + c^T p` in the disc of radius `g`; `sigma > 0`.
fn in_disc(sigma: &Vector2<f64>, c: &Vector2<f64>, g: f64) -> Vector2<f64> {
    // Written so that NaN gives no force.
    if !(g > 0.0 && c.x.is_finite() && c.y.is_finite()) {
        return Vector2::zeros();
    }
    let force = |s: f64| Vector2::new(-c.x / (sigma.x + s), -c.y / (sigma.y + s));
    let mut p = force(0.0);
    let mut size = p.norm();
    if size <= g {
        return p;
    }
    let mut s = 0.0;
    for _ in 0..MAX_ITERATIONS {
        let bend = p.x * p.x / (sigma.x + s) + p.y * p.y / (sigma.y + s);
        let step = (size / g - 1.0) * size * size / bend;
        // Of rounding size, overshot by rounding, or overflown.
        if !(step > 2.0 * f64::EPSILON * s && step.is_finite()) {
            break;
        }
        s += step;
        p = force(s);
        size = p.norm();
    }
    // On the circle to the last bit, whatever is left of the root's error.
    if size > 0.0 { p * (g / size) } else { Vector2::zeros() }
}
