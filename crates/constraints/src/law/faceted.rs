//! Unilateral contact with dry friction on a cone of `k` flat facets: three rows `[n, t, s]`. For comparison with the
//! exact cone of [`Coulomb`](super::Coulomb), and the law that a linear complementarity problem can express
//! [Stewart and Trinkle 1996].
//!
//! The disc `|lambda_t| <= mu lambda_n` is replaced by the regular polygon with the `k` corners `mu lambda_n d_j`, the
//! first along `t`. Friction takes the corner or the side of it that opposes the slip most (maximal dissipation); up to
//! `1 - cos(pi / k)` of its size is lost, and its direction errs by up to `pi / k`.
//!
//! As for the exact cone, the gap that is complementary over the cone has the dissipation added to its normal part:
//! `delta + mu max_j(-d_j . delta_t) n`.
//!
//! # Exact local solution
//! By enumeration: separation, stick, and for each corner (one unknown, `delta_n = 0`) and each side (two unknowns,
//! `delta_n = 0` and no slip along the side) the linear solution; the one that violates its conditions least is the
//! answer. All are taken relative to the facet in whose sector a vector lies: the mirror symmetry of the polygon keeps a
//! projection in the sector of its argument.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance, MAX_FRICTION, is_finite};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Largest number of facets; with it the cone is exact to 3e-4.
pub const MAX_FACETS: usize = 128;

/// Unilateral contact with dry friction on a cone of flat facets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FacetedCoulomb {
    /// Friction coefficient, dimensionless, 0 to [`MAX_FRICTION`].
    pub friction: f64,
    /// Number of facets, 3 to [`MAX_FACETS`].
    pub facets: usize,
}

/// The polygon's side in whose sector a vector lies.
struct Side {
    /// Unit normal.
    m: Vector2<f64>,
    /// Unit tangent, counter-clockwise.
    e: Vector2<f64>,
}

impl FacetedCoulomb {
    /// Half the angle of a sector.
    fn half_angle(&self) -> f64 {
        PI / self.facets.clamp(3, MAX_FACETS) as f64
    }

    /// Side number `j`.
    fn side(&self, j: f64) -> Side {
        let (sin, cos) = ((2.0 * j + 1.0) * self.half_angle()).sin_cos();
        Side { m: Vector2::new(cos, sin), e: Vector2::new(-sin, cos) }
    }

    fn side_of(&self, x: &Vector2<f64>) -> Side {
        let angle = x.y.atan2(x.x).rem_euclid(TAU);
        self.side((angle / (2.0 * self.half_angle())).floor())
    }

    /// Side or corner slip with `delta_n = 0`: the force, and by how much (N) it violates its conditions.
    #[allow(non_snake_case)]
    fn slip(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.half_angle().sin_cos();
        let mu = self.friction;
        let b_t = b.yz();
        let mut best = (f64::INFINITY, Vector3::zeros());
        let mut offer = |violation: f64, lambda: Vector3<f64>| {
            // A comparison with NaN is false.
            if violation < best.0 && lambda.x >= 0.0 && is_finite(&lambda) {
                best = (violation, lambda);
            }
        };
        for j in 0..self.facets.clamp(3, MAX_FACETS) {
            let Side { m, e } = self.side(j as f64);
            // The side: lambda_t = mu cos lambda_n m + nu e.
            let w_m = W.nn + mu * cos * W.nt.dot(&m);
            let (w_e, Tm) = (W.nt.dot(&e), W.tt * m);
            let (a21, a22) = (w_e + mu * cos * e.dot(&Tm), e.dot(&(W.tt * e)));
            let det = w_m * a22 - w_e * a21;
            let normal = (-b.x * a22 + e.dot(&b_t) * w_e) / det;
            let along = (-e.dot(&b_t) * w_m + b.x * a21) / det;
            let p = m * (mu * cos * normal) + e * along;
            let slip = W.nt * normal + W.tt * p + b_t;
            let violation = (along.abs() - mu * sin * normal).max(m.dot(&slip) * W.rho()).max(0.0);
            offer(violation, Vector3::new(normal, p.x, p.y));

            // The corner at the begin of the side: no corner beside it opposes the slip more.
            let d = m * cos - e * sin;
            let normal = -b.x / (W.nn + mu * W.nt.dot(&d));
            let p = d * (mu * normal);
            let slip = W.nt * normal + W.tt * p + b_t;
            let before = self.side(j as f64 - 1.0);
            let violation = (-e.dot(&slip)).max(before.e.dot(&slip)).max(0.0) * W.rho();
            offer(violation, Vector3::new(normal, p.x, p.y));
        }
        best.1
    }
}

impl ContactLaw for FacetedCoulomb {
    const NAME: &'static str = "faceted_coulomb";
    const ASSOCIATED: bool = false;

    #[inline]
    fn rows(&self) -> usize {
        3
    }

    fn validate(&self) -> Result<(), LawError> {
        let wrong = |parameter, value, remedy| Err(LawError { law: Self::NAME, parameter, value, remedy });
        if !(0.0..=MAX_FRICTION).contains(&self.friction) {
            return wrong("friction", self.friction, "give a number from 0 to 1000");
        }
        if !(3..=MAX_FACETS).contains(&self.facets) {
            return wrong("facets", self.facets as f64, "give 3 to 128; 16 or more lose less than 2 % of the friction");
        }
        Ok(())
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x >= 0.0
    }

    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        if b.x >= 0.0 || W.is_rigid() {
            return Vector3::zeros();
        }
        let frictionless = Vector3::new(W.normal_force(b.x), 0.0, 0.0);
        // Written so that NaN is frictionless.
        if !(self.friction > 0.0 && self.friction.is_finite()) {
            return frictionless;
        }
        let stick = W.closing_force(b);
        if stick.x > 0.0 && is_finite(&stick) {
            let reach = self.side_of(&stick.yz()).m.dot(&stick.yz());
            if reach <= self.friction * self.half_angle().cos() * stick.x {
                return stick;
            }
        }
        self.project(&self.slip(W, b))
    }

    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        if !is_finite(force) {
            return Vector3::zeros();
        }
        let (sin, cos) = self.half_angle().sin_cos();
        let mu = self.friction;
        let x = force.yz();
        let Side { m, e } = self.side_of(&x);
        let (u, v) = (m.dot(&x), e.dot(&x));
        let slope = mu * cos;
        // With room for rounding, so that projecting again changes no bit.
        if force.x >= 0.0 && u <= slope * force.x * (1.0 + 8.0 * f64::EPSILON) {
            return *force;
        }
        // The plane of the facet, then its edge, then the tip.
        let normal = (force.x + slope * u) / (1.0 + slope * slope);
        let nearest = if normal > 0.0 && v.abs() <= mu * sin * normal {
            let p = m * (slope * normal) + e * v;
            Vector3::new(normal, p.x, p.y)
        } else {
            let d = m * cos + e * (sin * v.signum());
            let normal = ((force.x + mu * d.dot(&x)) / (1.0 + mu * mu)).max(0.0);
            Vector3::new(normal, mu * normal * d.x, mu * normal * d.y)
        };
        if is_finite(&nearest) { nearest } else { Vector3::zeros() }
    }

    fn corrected_gap(&self, delta: &Vector3<f64>) -> Vector3<f64> {
        // The corner that opposes the slip most bounds the sector of -delta_t.
        let (sin, cos) = self.half_angle().sin_cos();
        let x = -delta.yz();
        let Side { m, e } = self.side_of(&x);
        let opposed = cos * m.dot(&x) + sin * e.dot(&x).abs();
        Vector3::new(delta.x + self.friction * opposed, delta.y, delta.z)
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::Polyhedral { friction: self.friction, facets: self.facets }
    }

    /// As for the exact cone, with the polygon in place of the disc.
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        let x = lambda - delta * rho;
        if x.x <= 0.0 || !is_finite(&x) {
            return equation;
        }
        equation.close(0, rho, delta);
        let (sin, cos) = self.half_angle().sin_cos();
        let mu = self.friction;
        let Side { m, e } = self.side_of(&x.yz());
        let (u, v) = (m.dot(&x.yz()), e.dot(&x.yz()));
        if u <= mu * cos * x.x {
            equation.close(1, rho, delta);
            equation.close(2, rho, delta);
        } else if v.abs() <= mu * sin * x.x {
            equation.facet(m, mu * cos, true, rho, delta, lambda);
        } else {
            let d = m * cos + e * (sin * v.signum());
            equation.facet(d, mu, false, rho, delta, lambda);
        }
        equation
    }
}
