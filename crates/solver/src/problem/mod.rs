//! The contact problem as a value.
//!
//! ```text
//! delta = W lambda + delta_free ,   (delta_a, lambda_a) in the law of each block a
//! ```
//!
//! `W` in m/N, `delta` and `delta_free` in m (`>= 0` apart), `lambda` in N (positive pushes apart). `W` is stored by
//! columns, as nalgebra does: column `j` is the change of all gaps by a force on row `j`, which is what a solver adds
//! when it changes that force. For the symmetric `W` of contact problems rows and columns are the same numbers; the few
//! problems from elsewhere whose `W` is not symmetric (linear complementarity problems) are treated as they are written.

mod error;
mod semidefinite;
mod view;

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector, Dyn};
use palpate_constraints::law::Law;
use serde::{Deserialize, Serialize};

pub use error::ProblemError;
pub use semidefinite::PIVOT_TOLERANCE;
pub use view::ProblemView;
pub(crate) use view::{gather, scatter};

/// Largest asymmetry that [`ConstraintProblem::validate`] accepts, relative to `sqrt(W_ii W_jj)`. A compliance from a
/// factor is symmetric to 1e-12; a wrong sign or a missing row shows at order one.
pub const SYMMETRY_TOLERANCE: f64 = 1e-6;

/// Rows `start .. start + law.rows()`, solved together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// First row.
    pub start: usize,
    /// The law of the rows.
    pub law: Law,
}

/// A contact problem that owns its numbers and can be refilled without allocating.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConstraintProblem {
    compliance: Vec<f64>,
    delta_free: Vec<f64>,
    blocks: Vec<Block>,
    capacity: usize,
}

impl ConstraintProblem {
    /// From its parts; blocks follow in the order of `laws`.
    ///
    /// # Errors
    /// Sizes that disagree. Values are checked by [`ConstraintProblem::validate`].
    pub fn new(
        compliance: DMatrix<f64>,
        delta_free: DVector<f64>,
        laws: impl IntoIterator<Item = Law>,
    ) -> Result<Self, ProblemError> {
        let rows = delta_free.len();
        if compliance.nrows() != rows || compliance.ncols() != rows {
            let (w_rows, w_columns) = compliance.shape();
            return Err(ProblemError::WrongSize { w_rows, w_columns, rows });
        }
        let mut problem = Self {
            compliance: compliance.data.into(),
            delta_free: delta_free.data.into(),
            blocks: Vec::new(),
            capacity: rows,
        };
        for law in laws {
            problem.push_block(law);
        }
        problem.check_blocks()?;
        Ok(problem)
    }

    /// An empty problem with room for `rows` rows.
    #[must_use]
    pub fn with_capacity(rows: usize) -> Self {
        Self {
            compliance: Vec::with_capacity(rows * rows),
            delta_free: Vec::with_capacity(rows),
            blocks: Vec::with_capacity(rows),
            capacity: rows,
        }
    }

    /// Rows there is room for.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Empties the problem and sizes it to `rows` zero rows without blocks. Allocates nothing.
    ///
    /// # Errors
    /// [`ProblemError::CapacityExceeded`] past the capacity; the problem is then empty.
    pub fn reset(&mut self, rows: usize) -> Result<(), ProblemError> {
        self.compliance.clear();
        self.delta_free.clear();
        self.blocks.clear();
        if rows > self.capacity {
            return Err(ProblemError::CapacityExceeded { rows, capacity: self.capacity });
        }
        self.compliance.resize(rows * rows, 0.0);
        self.delta_free.resize(rows, 0.0);
        Ok(())
    }

    /// Appends a block behind the last one. More blocks than rows are refused by [`ConstraintProblem::validate`].
    pub fn push_block(&mut self, law: Law) {
        let start = self.blocks.last().map_or(0, |last| last.start + last.law.rows());
        self.blocks.push(Block { start, law });
    }

    /// Replaces the law of a block by one on as many rows; `false`, and nothing changes, where it is not.
    pub fn set_law(&mut self, block: usize, law: Law) -> bool {
        let Some(block) = self.blocks.get_mut(block).filter(|block| block.law.rows() == law.rows()) else {
            return false;
        };
        block.law = law;
        true
    }

    /// Number of rows `m`.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.delta_free.len()
    }

    /// `W`, m/N.
    #[must_use]
    pub fn compliance(&self) -> DMatrixView<'_, f64> {
        DMatrixView::from_slice_generic(&self.compliance, Dyn(self.rows()), Dyn(self.rows()))
    }

    /// `W`, m/N, to be filled.
    pub fn compliance_mut(&mut self) -> DMatrixViewMut<'_, f64> {
        let rows = self.rows();
        DMatrixViewMut::from_slice_generic(&mut self.compliance, Dyn(rows), Dyn(rows))
    }

    /// Gaps without contact forces, m.
    #[must_use]
    pub fn delta_free(&self) -> &[f64] {
        &self.delta_free
    }

    /// Gaps without contact forces, m, to be filled.
    pub fn delta_free_mut(&mut self) -> &mut [f64] {
        &mut self.delta_free
    }

    /// Blocks in the order of their rows.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The problem as solvers read it.
    #[must_use]
    pub fn view(&self) -> ProblemView<'_> {
        ProblemView {
            compliance: &self.compliance,
            stride: self.rows(),
            delta_free: &self.delta_free,
            blocks: &self.blocks,
        }
    }

    /// Checks sizes, parameters and numbers, symmetry to [`SYMMETRY_TOLERANCE`], and that no two rows are coupled more
    /// strongly than a semidefinite `W` allows. O(m²).
    ///
    /// # Errors
    /// The first mistake, with its row.
    pub fn validate(&self) -> Result<(), ProblemError> {
        self.validate_symmetric_to(SYMMETRY_TOLERANCE)
    }

    /// [`ConstraintProblem::validate`] with another tolerance of symmetry; infinity for problems that need not be
    /// symmetric.
    ///
    /// # Errors
    /// The first mistake, with its row.
    pub fn validate_symmetric_to(&self, tolerance: f64) -> Result<(), ProblemError> {
        self.check_blocks()?;
        for (index, block) in self.blocks.iter().enumerate() {
            block.law.validate().map_err(|source| ProblemError::Law { block: index, row: block.start, source })?;
        }
        self.check_finite()?;
        let w = self.compliance();
        for column in 0..self.rows() {
            let value = w[(column, column)];
            // A problem that need not be symmetric need not be a compliance either.
            if value < 0.0 && tolerance.is_finite() {
                return Err(ProblemError::NegativeDiagonal { row: column, value });
            }
        }
        for column in 0..self.rows() {
            for row in 0..column {
                let (value, transposed) = (w[(row, column)], w[(column, row)]);
                let scale = (w[(row, row)] * w[(column, column)]).sqrt();
                let asymmetry = (value - transposed).abs() / scale;
                if asymmetry > tolerance {
                    return Err(ProblemError::NotSymmetric { row, column, value, transposed, asymmetry, tolerance });
                }
                // A minor of order two; with the room that the symmetry is given.
                if tolerance.is_finite() && value.abs() > scale * (1.0 + tolerance.max(SYMMETRY_TOLERANCE)) {
                    return Err(ProblemError::Indefinite { row, column, value, bound: scale });
                }
            }
        }
        Ok(())
    }

    /// All numbers are finite.
    pub(crate) fn check_finite(&self) -> Result<(), ProblemError> {
        if let Some((row, &value)) = self.delta_free.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(ProblemError::NonFiniteGap { row, value });
        }
        if let Some((k, &value)) = self.compliance.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            let rows = self.rows().max(1);
            return Err(ProblemError::NonFiniteCompliance { row: k % rows, column: k / rows, value });
        }
        Ok(())
    }

    /// Blocks tile the rows.
    pub(crate) fn check_blocks(&self) -> Result<(), ProblemError> {
        let rows = self.rows();
        let mut expected = 0;
        for (index, block) in self.blocks.iter().enumerate() {
            let end = block.start.saturating_add(block.law.rows());
            if block.start != expected || end > rows || end == block.start {
                let law = block.law.name();
                return Err(ProblemError::WrongBlock { block: index, law, start: block.start, end, expected, rows });
            }
            expected = end;
        }
        if expected < rows {
            return Err(ProblemError::RowsWithoutLaw { first: expected, rows });
        }
        Ok(())
    }
}
