//! A contact problem as solvers read it, in memory that somebody else owns.

use super::Block;
use nalgebra::{Matrix3, Vector3};

/// A contact problem that somebody else owns. Sizes and laws are checked by [`ProblemView::is_consistent`] only, not by
/// construction: solvers check before they start.
#[derive(Clone, Copy, Debug)]
pub struct ProblemView<'a> {
    /// `W` by columns, m/N: `W_ij = compliance[j * stride + i]`.
    pub compliance: &'a [f64],
    /// Distance between the starts of two columns, `>= rows`.
    pub stride: usize,
    /// Gaps without contact forces, m.
    pub delta_free: &'a [f64],
    /// Blocks in the order of their rows, without holes.
    pub blocks: &'a [Block],
}

impl<'a> ProblemView<'a> {
    /// Number of rows `m`.
    #[inline]
    #[must_use]
    pub fn rows(&self) -> usize {
        self.delta_free.len()
    }

    /// Whether the sizes agree, the blocks tile the rows, and each law's parameters are in their range. O(number of blocks).
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        let rows = self.rows();
        let needed = match rows.checked_sub(1) {
            None => Some(0),
            Some(last) => last.checked_mul(self.stride).and_then(|start| start.checked_add(rows)),
        };
        let mut next = 0;
        let tiled = self.blocks.iter().all(|block| {
            let fits = block.start == next && (1..=3).contains(&block.law.rows());
            next = block.start.saturating_add(block.law.rows());
            fits && block.law.validate().is_ok()
        });
        tiled && next == rows && self.stride >= rows && needed.is_some_and(|needed| self.compliance.len() >= needed)
    }

    /// Column `j` of `W`; empty where it lies outside the problem.
    #[inline]
    #[must_use]
    pub fn column(&self, j: usize) -> &'a [f64] {
        self.compliance.get(j * self.stride..).and_then(|tail| tail.get(..self.rows())).unwrap_or(&[])
    }

    /// The diagonal block of `W`, padded with zeros.
    #[inline]
    #[must_use]
    pub fn diagonal_block(&self, block: &Block) -> Matrix3<f64> {
        let rows = block.law.rows().min(3);
        let mut diagonal = Matrix3::zeros();
        for j in 0..rows {
            let column = self.column(block.start + j);
            for i in 0..rows {
                diagonal[(i, j)] = column.get(block.start + i).copied().unwrap_or(0.0);
            }
        }
        diagonal
    }

    /// `delta = W lambda + delta_free`. Columns with zero force are skipped. Does nothing where the lengths of `lambda`
    /// and `delta` are not the number of rows.
    pub fn gap(&self, lambda: &[f64], delta: &mut [f64]) {
        if lambda.len() != self.rows() || delta.len() != self.rows() {
            return;
        }
        delta.copy_from_slice(self.delta_free);
        for (j, &force) in lambda.iter().enumerate() {
            if force != 0.0 {
                for (gap, w) in delta.iter_mut().zip(self.column(j)) {
                    *gap += w * force;
                }
            }
        }
    }
}

/// The entries of a block in a long vector, padded with zeros.
#[inline]
pub(crate) fn gather(long: &[f64], block: &Block) -> Vector3<f64> {
    match long.get(block.start..).unwrap_or(&[]) {
        [x, y, z, ..] if block.law.rows() == 3 => Vector3::new(*x, *y, *z),
        [x, y, ..] if block.law.rows() == 2 => Vector3::new(*x, *y, 0.0),
        [x, ..] => Vector3::new(*x, 0.0, 0.0),
        [] => Vector3::zeros(),
    }
}

/// Writes the entries of a block into a long vector.
#[inline]
pub(crate) fn scatter(local: &Vector3<f64>, block: &Block, long: &mut [f64]) {
    let rows = block.law.rows();
    for (i, entry) in long.iter_mut().skip(block.start).take(rows.min(3)).enumerate() {
        *entry = local[i];
    }
}
