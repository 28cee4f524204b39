//! The upper half of the stiffness: which blocks are summed, and how they fill the full pattern.
//!
//! Only blocks `(i, j)` with `i <= j` are summed; those below the diagonal are their transposes.

use nalgebra::{Matrix3, Vector3};

use crate::sparse::BlockPattern;

/// Set in an upper position where a block must be transposed.
pub(super) const TRANSPOSED: u32 = 1 << 31;

/// Destination of a block that has a fixed node.
pub(super) const NOWHERE: u32 = u32::MAX;

/// The blocks of a pattern on and above the diagonal, numbered by rows.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct UpperBlocks {
    /// For each block of the pattern its upper block, with [`TRANSPOSED`] below the diagonal.
    upper_of_block: Vec<u32>,
    count: usize,
}

impl UpperBlocks {
    /// Numbers the upper blocks of a pattern.
    pub(crate) fn new(pattern: &BlockPattern) -> Self {
        let mut upper_of_block = vec![NOWHERE; pattern.blocks()];
        let mut count = 0;
        for i in 0..pattern.rows() {
            for p in pattern.row(i).filter(|&p| pattern.columns()[p] as usize >= i) {
                upper_of_block[p] = count;
                count += 1;
            }
        }
        for i in 0..pattern.rows() {
            for p in pattern.row(i) {
                let j = pattern.columns()[p];
                if (j as usize) < i {
                    let mirror = pattern.find(j, i as u32).map_or(NOWHERE, |m| upper_of_block[m]);
                    upper_of_block[p] = mirror | TRANSPOSED;
                }
            }
        }
        Self { upper_of_block, count: count as usize }
    }

    /// Number of upper blocks.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Number of block `(i, j)` of the pattern, for `i <= j`.
    pub(crate) fn position(&self, pattern: &BlockPattern, i: u32, j: u32) -> Option<u32> {
        pattern.find(i, j).map(|p| self.upper_of_block[p])
    }

    /// The upper block that block `p` of the pattern is, or is the transpose of.
    #[inline]
    pub(crate) fn block<'a>(&self, p: usize, upper: &'a [Matrix3<f64>]) -> Half<'a> {
        let u = self.upper_of_block[p];
        let block = &upper[(u & !TRANSPOSED) as usize];
        if u & TRANSPOSED == 0 { Half::Upper(block) } else { Half::Lower(block) }
    }
}

/// A block of the symmetric matrix by its upper half.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Half<'a> {
    /// The block itself.
    Upper(&'a Matrix3<f64>),
    /// The transpose of the block.
    Lower(&'a Matrix3<f64>),
}

impl Half<'_> {
    /// The block times `factor`.
    #[inline]
    pub(crate) fn scaled(self, factor: f64) -> Matrix3<f64> {
        match self {
            Half::Upper(block) => block * factor,
            Half::Lower(block) => block.transpose() * factor,
        }
    }

    /// The block times a vector.
    #[inline]
    pub(crate) fn times(self, v: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Half::Upper(block) => block * v,
            Half::Lower(block) => block.tr_mul(v),
        }
    }
}
