//! The sparsity pattern of a body, built once, and the system matrix that is refilled at every step.

use std::sync::Arc;

use nalgebra::Matrix3;
use rayon::prelude::*;

/// Marks a node that is fixed and therefore has no row in the system.
pub const FIXED: u32 = u32::MAX;

/// Block-compressed rows over the free nodes of a body: block `(i, j)` exists where an element holds both.
///
/// Symmetric, both halves stored; columns ascend within a row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockPattern {
    row_start: Vec<usize>,
    column: Vec<u32>,
}

impl BlockPattern {
    /// The pattern of elements given by their free nodes; [`FIXED`] entries are skipped.
    pub fn from_elements(free_nodes: usize, elements: &[[u32; 4]]) -> Self {
        Self::from_cliques(free_nodes, elements.iter().map(<[u32; 4]>::as_slice))
    }

    /// The pattern of sets of nodes that are all coupled to one another; [`FIXED`] entries are skipped.
    pub fn from_cliques<'a>(free_nodes: usize, cliques: impl IntoIterator<Item = &'a [u32]>) -> Self {
        let mut pairs: Vec<(u32, u32)> = (0..free_nodes as u32).map(|i| (i, i)).collect();
        // Pairs come many times; sorting them away now and then bounds the memory by twice that of the distinct ones.
        let mut distinct = pairs.len();
        for clique in cliques {
            for &i in clique.iter().filter(|&&i| i != FIXED) {
                for &j in clique.iter().filter(|&&j| j != FIXED) {
                    pairs.push((i, j));
                }
            }
            if pairs.len() > 2 * distinct + (1 << 20) {
                pairs.sort_unstable();
                pairs.dedup();
                distinct = pairs.len();
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut row_start = vec![0; free_nodes + 1];
        for &(i, _) in &pairs {
            row_start[i as usize + 1] += 1;
        }
        for i in 0..free_nodes {
            row_start[i + 1] += row_start[i];
        }
        Self { row_start, column: pairs.into_iter().map(|(_, j)| j).collect() }
    }

    /// Number of block rows: free nodes of the body.
    pub fn rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Number of stored 3 x 3 blocks.
    pub fn blocks(&self) -> usize {
        self.column.len()
    }

    /// Positions of the blocks of row `i`.
    pub fn row(&self, i: usize) -> std::ops::Range<usize> {
        self.row_start[i]..self.row_start[i + 1]
    }

    /// Column of each block.
    pub fn columns(&self) -> &[u32] {
        &self.column
    }

    /// Position of block `(i, j)`, if it exists.
    pub fn find(&self, i: u32, j: u32) -> Option<usize> {
        let range = self.row(i as usize);
        self.column[range.clone()].binary_search(&j).ok().map(|k| range.start + k)
    }
}

/// A symmetric matrix over the free nodes: `A = M + h C + h² K` in kg, or any other matrix of this pattern.
#[derive(Clone, Debug)]
pub struct SystemMatrix {
    /// Where the blocks lie; shared by every matrix of the body.
    pub pattern: Arc<BlockPattern>,
    /// One 3 x 3 block per position of the pattern.
    pub blocks: Vec<Matrix3<f64>>,
}

impl SystemMatrix {
    /// A zero matrix.
    pub fn zeros(pattern: Arc<BlockPattern>) -> Self {
        let blocks = vec![Matrix3::zeros(); pattern.blocks()];
        Self { pattern, blocks }
    }

    /// `y = A x`; vectors of length `3 n`. The same bits for any number of threads, since each row is one sum.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        y.par_chunks_mut(3 * 64).enumerate().for_each(|(chunk, y)| {
            for (k, y) in y.chunks_exact_mut(3).enumerate() {
                let mut sum = [0.0; 3];
                for p in self.pattern.row(64 * chunk + k) {
                    let j = 3 * self.pattern.column[p] as usize;
                    let a = &self.blocks[p];
                    for c in 0..3 {
                        let xc = x[j + c];
                        sum[0] += a[(0, c)] * xc;
                        sum[1] += a[(1, c)] * xc;
                        sum[2] += a[(2, c)] * xc;
                    }
                }
                y.copy_from_slice(&sum);
            }
        });
    }
}
