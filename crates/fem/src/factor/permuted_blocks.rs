//! The block pattern in elimination order.

use faer::sparse::SymbolicSparseColMat;

use crate::ordering::NodeOrdering;
use crate::sparse::BlockPattern;

/// Which half of a symmetric matrix.
pub(super) enum Triangle {
    Upper,
    Lower,
}

/// Both triangles of the permuted block pattern; sources are kept for the lower one.
pub(super) struct PermutedBlocks {
    /// For each node column of the lower triangle, where its blocks lie; the diagonal block comes first.
    pub(super) column_start: Vec<usize>,
    pub(super) row: Vec<u32>,
    /// Position in the blocks of the system matrix of each lower block, column by column.
    pub(super) source: Vec<u32>,
    upper_start: Vec<usize>,
    upper_row: Vec<u32>,
}

impl PermutedBlocks {
    pub(super) fn new(pattern: &BlockPattern, ordering: &NodeOrdering) -> Self {
        let mut all = Self {
            column_start: vec![0],
            row: Vec::new(),
            source: Vec::new(),
            upper_start: vec![0],
            upper_row: Vec::new(),
        };
        let mut column: Vec<(u32, u32)> = Vec::new();
        for (new, &old) in ordering.old_of_new.iter().enumerate() {
            column.clear();
            for p in pattern.row(old as usize) {
                let i = pattern.columns()[p];
                // A(i, old) is the lower block; it lies in row i, at the mirror of position p
                if let Some(source) = pattern.find(i, old) {
                    column.push((ordering.new_of_old[i as usize], source as u32));
                }
            }
            column.sort_unstable();
            for &(i, source) in &column {
                if i as usize >= new {
                    all.row.push(i);
                    all.source.push(source);
                }
                if i as usize <= new {
                    all.upper_row.push(i);
                }
            }
            all.column_start.push(all.row.len());
            all.upper_start.push(all.upper_row.len());
        }
        all
    }

    /// One triangle, three degrees of freedom per node.
    pub(super) fn degree_of_freedom_pattern(&self, triangle: Triangle) -> SymbolicSparseColMat<u32> {
        let (start, row) = match triangle {
            Triangle::Upper => (&self.upper_start, &self.upper_row),
            Triangle::Lower => (&self.column_start, &self.row),
        };
        let nodes = start.len() - 1;
        let mut column_start = Vec::with_capacity(3 * nodes + 1);
        let mut rows = Vec::with_capacity(9 * row.len());
        column_start.push(0);
        for j in 0..nodes as u32 {
            let blocks = &row[start[j as usize]..start[j as usize + 1]];
            for column in 3 * j..3 * j + 3 {
                let kept = |r: &u32| match triangle {
                    Triangle::Upper => *r <= column,
                    Triangle::Lower => *r >= column,
                };
                rows.extend(blocks.iter().flat_map(|&i| 3 * i..3 * i + 3).filter(kept));
                column_start.push(rows.len() as u32);
            }
        }
        SymbolicSparseColMat::new_checked(3 * nodes, 3 * nodes, column_start, None, rows)
    }
}
