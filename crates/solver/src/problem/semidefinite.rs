//! Whether a compliance is positive semidefinite.

use super::{ConstraintProblem, ProblemError};
use nalgebra::DMatrix;

/// Negative pivots down to this part of the row's own compliance are taken for rounding, or for the single precision of a
/// file. A row that is a combination of others leaves a pivot of that size, of either sign.
pub const PIVOT_TOLERANCE: f64 = 1e-6;

impl ConstraintProblem {
    /// Looks for a negative pivot in the factorisation `L D L^T` of the symmetric part of `W`, rows in their order; those
    /// that are combinations of rows before them are passed over. O(m³) and allocates: for problems from files, not for
    /// the step.
    ///
    /// # Errors
    /// [`ProblemError::NegativePivot`] with the first such row.
    pub fn check_semidefinite(&self) -> Result<(), ProblemError> {
        let w = self.compliance();
        let rows = self.rows();
        let mut left = DMatrix::from_fn(rows, rows, |i, j| 0.5 * (w[(i, j)] + w[(j, i)]));
        for k in 0..rows {
            let (pivot, own) = (left[(k, k)], w[(k, k)].abs());
            if pivot < -PIVOT_TOLERANCE * own || (own == 0.0 && pivot < 0.0) {
                return Err(ProblemError::NegativePivot { row: k, pivot });
            }
            if pivot <= PIVOT_TOLERANCE * own {
                continue;
            }
            for j in k + 1..rows {
                let factor = left[(j, k)] / pivot;
                if factor != 0.0 {
                    for i in j..rows {
                        left[(i, j)] -= factor * left[(i, k)];
                    }
                }
            }
        }
        Ok(())
    }
}
