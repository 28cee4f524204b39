//! Unilateral contact without friction: one row.
//!
//! ```text
//! 0 <= delta_n  _|_  lambda_n >= 0
//! ```
//!
//! The local problem `delta_n = W_nn lambda_n + b_n` has the one solution `lambda_n = max(0, -b_n / W_nn)`.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Unilateral contact without friction; no parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Signorini;

impl ContactLaw for Signorini {
    const NAME: &'static str = "signorini";

    #[inline]
    fn rows(&self) -> usize {
        1
    }

    fn validate(&self) -> Result<(), LawError> {
        Ok(())
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x >= 0.0
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(W.normal_force(b.x), 0.0, 0.0)
    }

    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        let lambda_n = if force.x.is_finite() { force.x.max(0.0) } else { 0.0 };
        Vector3::new(lambda_n, 0.0, 0.0)
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::NonNegative
    }

    #[inline]
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        if lambda.x - rho * delta.x > 0.0 {
            equation.close(0, rho, delta);
        }
        equation
    }
}
