//! Rows held closed, in both directions: joints, clamps, sutures.
//!
//! ```text
//! delta = 0 ,  lambda free
//! ```
//!
//! The local problem is linear: `lambda = -W_aa^-1 b`.

use super::{ConicForm, ContactLaw, LawError, Linearization, LocalCompliance, MAX_BLOCK_ROWS, is_finite};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Rows held closed together. A joint with more than [`MAX_BLOCK_ROWS`] rows takes several blocks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bilateral {
    /// Number of rows, 1 to [`MAX_BLOCK_ROWS`].
    pub rows: usize,
}

impl ContactLaw for Bilateral {
    const NAME: &'static str = "bilateral";

    #[inline]
    fn rows(&self) -> usize {
        self.rows
    }

    fn validate(&self) -> Result<(), LawError> {
        if (1..=MAX_BLOCK_ROWS).contains(&self.rows) {
            return Ok(());
        }
        Err(LawError {
            law: Self::NAME,
            parameter: "rows",
            value: self.rows as f64,
            remedy: "give 1, 2 or 3, and several blocks for a joint with more rows",
        })
    }

    #[inline]
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
        delta.x == 0.0 && delta.y == 0.0 && delta.z == 0.0
    }

    #[inline]
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
        let lambda = W.closing_force(b);
        if is_finite(&lambda) { lambda } else { Vector3::zeros() }
    }

    #[inline]
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
        if is_finite(force) { *force } else { Vector3::zeros() }
    }

    fn conic_form(&self) -> ConicForm {
        ConicForm::Free
    }

    #[inline]
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
        let mut equation = Linearization::without_force(lambda);
        (0..3).for_each(|row| equation.close(row, rho, delta));
        equation
    }
}
