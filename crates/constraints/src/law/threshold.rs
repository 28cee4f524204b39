//! A contact that holds up to a limit and then gives way, as skin under a needle tip before puncture: one row.
//!
//! ```text
//! 0 <= lambda <= limit ,   delta >= 0 at lambda = 0 ,   delta = 0 in between ,   delta <= 0 at lambda = limit
//! ```
//!
//! The local problem has the one solution `lambda = clamp(-b / W, 0, limit)`. The law has no memory: what has once given
//! way holds again in the next step unless its owner replaces the law.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance, RowEquation};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A force that opposes closing, up to a limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Threshold {
    /// Largest force, N, `>= 0` and finite.
    pub limit: f64,
}

impl Threshold {
    /// The nearest force that is admissible, whatever the limit.
    #[inline]
    fn clamp(&self, lambda: f64) -> f64 {
        // Written so that NaN gives no force.
        if lambda > 0.0 && self.limit > 0.0 { lambda.min(self.limit).min(f64::MAX) } else { 0.0 }
    }
}

impl ContactLaw for Threshold {
    const NAME: &'static str = "threshold";

    #[inline]
    fn rows(&self) -> usize {
        1
    }

    fn validate(&self) -> Result<(), LawError> {
        if self.limit >= 0.0 && self.limit.is_finite() {
            return Ok(());
        }
        Err(LawError {
            law: Self::NAME,
            parameter: "limit",
            value: self.limit,
            remedy: "give a force in N, zero or more (a needle punctures skin at about 1 N)",
        })
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x >= 0.0
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.clamp(W.normal_force(b.x)), 0.0, 0.0)
    }

    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(if force.x.is_finite() { self.clamp(force.x) } else { 0.0 }, 0.0, 0.0)
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::Interval { limit: self.limit }
    }

    #[inline]
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        let x = lambda.x - rho * delta.x;
        if x >= self.limit {
            equation.rows[0] = RowEquation::Given { excess: lambda.x - self.limit, slope: 0.0 };
        } else if x > 0.0 {
            equation.close(0, rho, delta);
        }
        equation
    }
}
