//! The compliance `W = H A⁻¹ Hᵀ` as scalar products of half solves.

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrixViewMut;

use super::half_block::{HalfBlock, INACTIVE, widen};
use super::reach::{ReachStatus, ReachWorkspace, rows_per_block};
use super::workers::join;

/// Supernodes whose ranges of rows differ are multiplied together while this raises the work by at most a quarter:
/// few large products beat many small ones.
const GRAM_WASTE: f64 = 1.25;

impl ReachWorkspace {
    /// Writes `W = scale · Yᵀ Y = scale · H A⁻¹ Hᵀ` into `w`, which must be `m x m`. Symmetric to the bit.
    ///
    /// Takes a `&mut DMatrix<f64>` or a view of a larger one. The caller's `scale` is `h²` for a compliance in m/N.
    pub fn gram_into<'w>(&mut self, scale: f64, w: impl Into<DMatrixViewMut<'w, f64>>) -> ReachStatus {
        let mut w = w.into();
        let m = self.rows;
        if w.nrows() != m || w.ncols() != m {
            return ReachStatus::WrongSize;
        }
        if self.revision == 0 {
            return ReachStatus::InvalidFactor;
        }
        if m == 0 {
            return ReachStatus::Ok;
        }
        let gram = MatMut::from_column_major_slice_mut(&mut self.gram[..m * m], m, m);
        columns_of_blocks(&self.blocks[..self.used], 0..self.used, rows_per_block(m), gram);
        for j in 0..m {
            for i in j..m {
                let value = scale * self.gram[j * m + i];
                let (row, column) = (self.sorted[i] as usize, self.sorted[j] as usize);
                w[(row, column)] = value;
                w[(column, row)] = value;
            }
        }
        ReachStatus::Ok
    }
}

/// The lower triangle of the columns that belong to the blocks `chosen`; `gram` holds these columns.
fn columns_of_blocks(blocks: &[HalfBlock], chosen: std::ops::Range<usize>, size: usize, gram: MatMut<'_, f64>) {
    if chosen.len() > 1 {
        let middle = chosen.start + chosen.len() / 2;
        let (left, right) = gram.split_at_col_mut((middle - chosen.start) * size);
        join(
            || columns_of_blocks(blocks, chosen.start..middle, size, left),
            || columns_of_blocks(blocks, middle..chosen.end, size, right),
        );
    } else if let Some(column) = blocks.get(chosen.start) {
        let (_, gram) = gram.split_at_row_mut(chosen.start * size);
        rows_of_blocks(&blocks[chosen.start..], column, size, gram);
    }
}

/// The products of `blocks`, one under the other in `gram`, with the block `column`.
fn rows_of_blocks(blocks: &[HalfBlock], column: &HalfBlock, size: usize, gram: MatMut<'_, f64>) {
    match blocks {
        [] => {}
        [row] => product(row, column, gram),
        _ => {
            let half = blocks.len() / 2;
            let (upper, lower) = gram.split_at_row_mut(half * size);
            join(
                || rows_of_blocks(&blocks[..half], column, size, upper),
                || rows_of_blocks(&blocks[half..], column, size, lower),
            );
        }
    }
}

/// The scalar products of the rows of two blocks; of a block with itself, the lower triangle.
pub(super) fn product(row: &HalfBlock, column: &HalfBlock, mut gram: MatMut<'_, f64>) {
    gram.fill(0.0);
    let mut group = Group::default();
    for &s in &column.reached {
        let s = s as usize;
        if row.active[s] == INACTIVE {
            continue;
        }
        let next = Group::new(row, column, s);
        let joined = group.joined(&next);
        if group.touches(&next) && joined.work() <= GRAM_WASTE * (group.paid + next.paid) {
            group = joined;
        } else {
            group.add_products(row, column, gram.as_mut());
            group = next;
        }
    }
    group.add_products(row, column, gram);
}

/// Neighbouring columns of the half solves of two blocks that are multiplied over the same ranges of rows.
#[derive(Clone, Debug, Default)]
struct Group {
    /// First column in each block, and how many.
    start: [usize; 2],
    len: usize,
    active: [(u32, u32); 2],
    /// Work of its members if each were multiplied on its own.
    paid: f64,
}

impl Group {
    /// The columns of one supernode.
    fn new(row: &HalfBlock, column: &HalfBlock, s: usize) -> Self {
        let start = [row, column].map(|block| block.base[s] as usize);
        let mut group = Self { start, len: row.width(s), active: [row.active[s], column.active[s]], paid: 0.0 };
        group.paid = group.work();
        group
    }

    fn work(&self) -> f64 {
        let [rows, columns] = self.active.map(|(from, to)| f64::from(to.saturating_sub(from)));
        rows * columns * self.len as f64
    }

    /// Whether the columns of `next` follow on these in both blocks.
    fn touches(&self, next: &Self) -> bool {
        self.len == 0 || (0..2).all(|k| self.start[k] + self.len == next.start[k])
    }

    fn joined(&self, next: &Self) -> Self {
        if self.len == 0 {
            return next.clone();
        }
        let mut active = self.active;
        (0..2).for_each(|k| widen(&mut active[k], next.active[k]));
        Self { start: self.start, len: self.len + next.len, active, paid: self.paid + next.paid }
    }

    /// Adds the scalar products over these degrees of freedom.
    fn add_products(&self, row: &HalfBlock, column: &HalfBlock, gram: MatMut<'_, f64>) {
        if self.len == 0 {
            return;
        }
        let [left, right] = [(row, 0), (column, 1)].map(|(block, k)| {
            let values = &block.half[self.start[k] * block.stride..(self.start[k] + self.len) * block.stride];
            let (from, to) = (self.active[k].0 as usize, self.active[k].1 as usize);
            MatRef::from_column_major_slice_with_stride(values, block.stride, self.len, block.stride)
                .subrows(from, to - from)
        });
        let [rows, columns] = self.active.map(|(from, _)| from as usize);
        let structure =
            if std::ptr::eq(row, column) { BlockStructure::TriangularLower } else { BlockStructure::Rectangular };
        triangular::matmul(
            gram.submatrix_mut(rows, columns, left.nrows(), right.nrows()),
            structure,
            Accum::Add,
            left,
            BlockStructure::Rectangular,
            right.transpose(),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
    }
}
