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
//! (closed form) it is inside. `h(s) = mu lambda_n / |lambda_t| - 1` is solved by Newton inside that bracket, from the `s`
//! that belongs to a force nearby where one is known, else from 0. `h` is
//! linear in `s` where `S` is isotropic, coupled or not, so that few iterations are needed; a step that leaves the
//! bracket is replaced by a bisection, so that their number is bounded. For large `mu` and strong coupling the local
//! problem itself has several solutions; separation is taken before stick, and stick before slip.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance, is_finite};
use nalgebra::{Vector2, Vector3};
use palpate_fem::lanes::Real;
use serde::{Deserialize, Serialize};

/// Largest friction coefficient accepted; beyond it a contact is better described by bilateral tangential rows.
pub const MAX_FRICTION: f64 = 1e3;

/// Newton takes 2 to 6 steps; this many are reached only when bisection runs down to neighbouring numbers.
const MAX_ITERATIONS: usize = 100;

/// A step of Newton below this part of the unknown is the last: the error behind it is below rounding.
const LAST_STEP: f64 = 1e-9;

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
        self.resolve_from(W, b, &Vector3::zeros())
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve_from(&self, W: &LocalCompliance, b: &Vector3<f64>, start: &Vector3<f64>) -> Vector3<f64> {
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
        let slip = self.slip(W, b, start);
        if is_finite(&slip) { slip } else { frictionless }
    }

    /// Projection onto the cone, in three cases: polar cone, inside, and the cone's surface.
    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        if !is_finite(force) {
            return Vector3::zeros();
        }
        let mu = self.coefficient();
        let tangential = force.yz().norm();
        // The norm overflows beyond 1e154 N; a cone has no size, so that the projection of a part is that part of it.
        if !tangential.is_finite() {
            let size = force.amax();
            let nearest = self.project(&(force / size)) * size;
            return if is_finite(&nearest) { nearest } else { Vector3::zeros() };
        }
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
        // Beyond 1e305 N.
        if is_finite(&surface) { surface } else { Vector3::zeros() }
    }

    #[inline]
    fn corrected_gap(&self, delta: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(delta.x + self.coefficient() * delta.yz().norm(), delta.y, delta.z)
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::SecondOrder { friction: self.friction }
    }

    #[inline]
    fn natural_map(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Vector3<f64> {
        natural_map(self.friction, rho, (*delta).into(), (*lambda).into()).into()
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
        equation.disc(0.0, self.coefficient(), rho, delta, lambda);
        equation
    }
}

/// [`ContactLaw::natural_map`] of one contact, or of one in each lane. `rho` in N/m, `delta` in m, `lambda` in N.
#[inline(always)]
pub(super) fn natural_map<T: Real>(mu: T, rho: T, delta: [T; 3], lambda: [T; 3]) -> [T; 3] {
    let zero = mu.constant(0.0);
    let norm = |y: T, z: T| (y * y + z * z).sqrt();
    // As in `coefficient`.
    let mu = mu.larger(zero);
    let corrected = delta[0] + mu * norm(delta[1], delta[2]);
    let x = [lambda[0] - corrected * rho, lambda[1] - delta[1] * rho, lambda[2] - delta[2] * rho];
    let tangential = norm(x[1], x[2]);
    // The three cases of the projection: the cone's surface, inside, polar cone.
    let normal = ((x[0] + mu * tangential) / (mu * mu + 1.0)).larger(zero);
    let shrink = mu * normal / tangential;
    let surface = [normal, shrink * x[1], shrink * x[2]];
    // Forces beyond 1e154 N have no norm, and no residual: a projection made up for them would pass for a solution.
    // Infinity and NaN become NaN here, all else 0.
    let nowhere = (x[0] + tangential) * 0.0;
    let finite = mu.constant(f64::INFINITY).above(surface[0].abs() + surface[1].abs() + surface[2].abs());
    let outside = tangential.above(mu * x[0] * (1.0 + 4.0 * f64::EPSILON));
    let pushed = (mu * tangential).above(-x[0]);
    let part = |c: usize| {
        let nearest = surface[c].or_where_not(finite, zero).or_where_not(outside, x[c]).or_where_not(pushed, zero);
        lambda[c] - nearest + nowhere
    };
    [part(0), part(1), part(2)]
}

/// The slip force as a function of `s`, in the principal axes of `S`.
struct SlipForce {
    s: f64,
    /// `1 / (sigma + s)`, N/m.
    inverse: Vector2<f64>,
    /// `-lambda_t`, N.
    p: Vector2<f64>,
    /// `|lambda_t|`, N.
    tangential: f64,
    /// `lambda_n`, N.
    normal: f64,
}

impl Coulomb {
    /// The coefficient by which forces are computed: one below zero, which [`validate`](ContactLaw::validate) refuses,
    /// is none.
    fn coefficient(&self) -> f64 {
        self.friction.max(0.0)
    }

    /// Solves case 3, from the slip that belongs to the force `start`. Expects `b_n < 0`, positive friction, and a stick
    /// force outside the cone.
    #[allow(non_snake_case)]
    fn slip(&self, W: &LocalCompliance, b: &Vector3<f64>, start: &Vector3<f64>) -> Vector3<f64> {
        let mu = self.friction;
        let c = W.rotated(&W.reduced(b));
        let w = W.rotated(&W.nt);
        let force = |s: f64| {
            let inverse = Vector2::new(1.0 / (W.sigma.x + s), 1.0 / (W.sigma.y + s));
            let p = c.component_mul(&inverse);
            SlipForce { s, inverse, p, tangential: p.norm(), normal: (w.dot(&p) - b.x) * W.inv_nn }
        };
        // (S + s I) p = c at the solution.
        let p = -W.rotated(&start.yz());
        let guess = p.dot(&(c - W.sigma.component_mul(&p))) / p.norm_squared();
        let (mut low, mut high) = (0.0, f64::INFINITY);
        let mut at = force(if guess > 0.0 && guess < f64::MAX { guess } else { 0.0 });
        for _ in 0..MAX_ITERATIONS {
            let excess = mu * at.normal - at.tangential; // h |lambda_t|
            if excess < 0.0 {
                low = at.s
            } else {
                high = at.s
            }
            if excess.abs() <= 2.0 * f64::EPSILON * at.tangential {
                break;
            }
            let mut next = newton(mu, W, &w, &at, excess);
            // False for NaN.
            let inside = next > low && next < high;
            if !inside {
                // |lambda_t| <= |c| / (sigma_min + s) and |w . lambda_t| <= |w| |lambda_t| put s_max inside the cone.
                let free_normal = W.normal_force(b.x);
                let s_max = (1.0 / mu + w.norm() * W.inv_nn) * c.norm() / free_normal;
                if !s_max.is_finite() {
                    return Vector3::new(free_normal, 0.0, 0.0);
                }
                high = high.min(s_max);
                next = if low > 0.0 { (low * high).sqrt() } else { 0.5 * high };
            }
            let step = (next - at.s).abs();
            // Steps of rounding size, or a bracket of neighbouring numbers.
            if step <= 2.0 * f64::EPSILON * next || !(next > low && next < high) {
                break;
            }
            at = force(next);
            // Newton's error is of the order of the square of its step.
            if inside && step <= LAST_STEP * next {
                break;
            }
        }
        // On the cone's surface to the last bit, whatever is left of the root's error.
        let lambda_n = at.normal.max(0.0);
        let lambda_t = W.rotated_back(&(at.p * (-mu * lambda_n / at.tangential)));
        Vector3::new(lambda_n, lambda_t.x, lambda_t.y)
    }
}

/// Newton step of `h(s) = mu lambda_n / |lambda_t| - 1`; NaN where `h` does not increase.
#[inline]
#[allow(non_snake_case)]
fn newton(mu: f64, W: &LocalCompliance, w: &Vector2<f64>, at: &SlipForce, excess: f64) -> f64 {
    let dp = -at.p.component_mul(&at.inverse);
    let squared = at.tangential * at.tangential;
    let slope = mu * (w.dot(&dp) * W.inv_nn * squared - at.normal * at.p.dot(&dp));
    if slope > 0.0 { at.s - excess * squared / slope } else { f64::NAN }
}
