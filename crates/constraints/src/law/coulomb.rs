//! Unilateral contact with dry friction, on the exact second-order cone: three rows `[n, t, s]`.
//!
//! ```text
//! 0 <= delta_n _|_ lambda_n >= 0 ,   |lambda_t| <= mu lambda_n ,
//! delta_t = 0 (stick)   or   lambda_t = -mu lambda_n delta_t / |delta_t| (slip)
//! ```
//!
//! As one complementarity over the cone K = {|lambda_t| <= mu lambda_n} the law is not associated; De Saxcé's corrected
//! gap `delta + mu |delta_t| n` makes it so [De Saxcé and Feng 1998].
//!
//! # Exact local solution
//! 1. Separation: `b_n >= 0` gives `lambda = 0`.
//! 2. Stick: `lambda = -W^-1 b`, if it lies in K.
//! 3. Slip: `delta_n = 0` and `delta_t = -s lambda_t` with `s > 0`. Eliminating the normal row (see
//!    [`LocalCompliance`]) leaves one unknown:
//!
//! ```text
//! lambda_t(s) = -(S + s I)^-1 c ,  lambda_n(s) = -(b_n + w . lambda_t(s)) / W_nn ,  |lambda_t(s)| = mu lambda_n(s)
//! ```
//!
//! With `W_aa` positive definite a root exists: at `s = 0` the force is the stick force, outside K, and for `s >= s_max`
//! (closed form) it is inside. `h(s) = mu lambda_n / |lambda_t| - 1` is solved by Newton inside that bracket. `h` is
//! linear in `s` where `S` is isotropic, coupled or not, so that few iterations are needed; a step that leaves the
//! bracket is replaced by a bisection, so that their number is bounded. For large `mu` and strong coupling the local
//! problem itself has several solutions; separation is taken before stick, and stick before slip.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance, is_finite};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Largest friction coefficient accepted; beyond it a contact is better described by bilateral tangential rows.
pub const MAX_FRICTION: f64 = 1e3;

/// Newton takes 2 to 6 steps; this many are reached only when bisection runs down to neighbouring numbers.
const MAX_ITERATIONS: usize = 100;

/// Unilateral contact with dry friction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coulomb {
    /// Friction coefficient, dimensionless, 0 to [`MAX_FRICTION`].
    pub friction: f64,
}

impl ContactLaw for Coulomb {
    const NAME: &'static str = "coulomb";
    const ASSOCIATED: bool = false;

    #[inline]
    fn rows(&self) -> usize {
        3
    }

    fn validate(&self) -> Result<(), LawError> {
        if (0.0..=MAX_FRICTION).contains(&self.friction) {
            return Ok(());
        }
        Err(LawError {
            law: Self::NAME,
            parameter: "friction",
            value: self.friction,
            remedy: "give a number from 0 to 1000 (typical: 0.02 wet tissue, 0.5 dry skin)",
        })
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x >= 0.0
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        if b.x >= 0.0 || W.is_rigid() {
            return Vector3::zeros();
        }
        let frictionless = Vector3::new(W.normal_force(b.x), 0.0, 0.0);
        if self.friction <= 0.0 {
            return frictionless;
        }
        let stick = W.closing_force(b);
        if stick.x > 0.0 && stick.yz().norm() <= self.friction * stick.x && is_finite(&stick) {
            return stick;
        }
        let slip = self.slip(W, b);
        if is_finite(&slip) { slip } else { frictionless }
    }

    /// Projection onto the cone, in three cases: polar cone, inside, and the cone's surface.
    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        if !is_finite(force) {
            return Vector3::zeros();
        }
        let mu = self.friction;
        let tangential = force.yz().norm();
        // With room for the rounding of a sliding force, so that projecting it again changes no bit.
        if force.x >= 0.0 && tangential <= mu * force.x * (1.0 + 4.0 * f64::EPSILON) {
            return *force;
        }
        if mu * tangential <= -force.x {
            return Vector3::zeros();
        }
        let lambda_n = ((force.x + mu * tangential) / (1.0 + mu * mu)).max(0.0);
        let shrink = if tangential > 0.0 { mu * lambda_n / tangential } else { 0.0 };
        let surface = Vector3::new(lambda_n, shrink * force.y, shrink * force.z);
        // The norm overflows beyond 1e154 N.
        if is_finite(&surface) { surface } else { Vector3::zeros() }
    }

    #[inline]
    fn corrected_gap(&self, delta: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(delta.x + self.friction * delta.yz().norm(), delta.y, delta.z)
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::SecondOrder { friction: self.friction }
    }

    /// The equation of [Alart and Curnier 1991], with `x = lambda - rho delta`: no force where `x_n <= 0`; else
    /// `delta_n = 0` and `lambda_t` the projection of `x_t` onto the disc of radius `mu x_n`.
    #[inline]
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        let x = lambda - delta * rho;
        if x.x <= 0.0 || !is_finite(&x) {
            return equation;
        }
        equation.close(0, rho, delta);
        equation.disc(0.0, self.friction, rho, delta, lambda);
        equation
    }
}

/// The slip force as a function of `s`, in the principal axes of `S`.
struct SlipForce {
    /// `-lambda_t`, N.
    p: Vector2<f64>,
    /// `|lambda_t|`, N.
    tangential: f64,
    /// `lambda_n`, N.
    normal: f64,
}

impl Coulomb {
    /// Solves case 3. Expects `b_n < 0`, positive friction, and a stick force outside the cone.
    #[allow(non_snake_case)]
    fn slip(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        let mu = self.friction;
        let c = W.rotated(&W.reduced(b));
        let w = W.rotated(&W.nt);
        let force = |s: f64| {
            let p = Vector2::new(c.x / (W.sigma.x + s), c.y / (W.sigma.y + s));
            SlipForce { p, tangential: p.norm(), normal: (w.dot(&p) - b.x) * W.inv_nn }
        };

        // |lambda_t| <= |c| / (sigma_min + s) and |w . lambda_t| <= |w| |lambda_t| put s_max inside the cone.
        let free_normal = W.normal_force(b.x);
        let s_max = (1.0 / mu + w.norm() * W.inv_nn) * c.norm() / free_normal;
        if !s_max.is_finite() {
            return Vector3::new(free_normal, 0.0, 0.0);
        }
        let (mut low, mut high) = (0.0, s_max);
        let mut s = 0.0;
        let mut best = force(s);
        for _ in 0..MAX_ITERATIONS {
            let excess = mu * best.normal - best.tangential; // h |lambda_t|
            if excess < 0.0 {
                low = s
            } else {
                high = s
            }
            if excess.abs() <= 2.0 * f64::EPSILON * best.tangential {
                break;
            }
            let next = newton(mu, W, &w, &best, s, excess).filter(|next| *next > low && *next < high);
            let next = next.unwrap_or(if low > 0.0 { (low * high).sqrt() } else { 0.5 * high });
            // Steps of rounding size, or a bracket of neighbouring numbers.
            if (next - s).abs() <= 2.0 * f64::EPSILON * next || !(next > low && next < high) {
                break;
            }
            s = next;
            best = force(s);
        }
        // On the cone's surface to the last bit, whatever is left of the root's error.
        let lambda_n = best.normal.max(0.0);
        let lambda_t = W.rotated_back(&(best.p * (-mu * lambda_n / best.tangential)));
        Vector3::new(lambda_n, lambda_t.x, lambda_t.y)
    }
}

/// Newton step of `h(s) = mu lambda_n / |lambda_t| - 1`; none where `h` does not increase.
#[inline]
#[allow(non_snake_case)]
fn newton(mu: f64, W: &LocalCompliance, w: &Vector2<f64>, at: &SlipForce, s: f64, excess: f64) -> Option<f64> {
    let dp = Vector2::new(-at.p.x / (W.sigma.x + s), -at.p.y / (W.sigma.y + s));
    let d_tangential = at.p.dot(&dp) / at.tangential;
    let d_normal = w.dot(&dp) * W.inv_nn;
    let slope = mu * (d_normal * at.tangential - at.normal * d_tangential);
    (slope > 0.0).then(|| s - excess * at.tangential / slope)
}
