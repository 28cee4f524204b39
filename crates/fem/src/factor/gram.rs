//! The compliance `W = H A⁻¹ Hᵀ` as scalar products of half solves.

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrixViewMut;

use super::reach::{ReachStatus, ReachWorkspace, widen};

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
        self.gram[..m * m].fill(0.0);
        let mut group = Group::default();
        for k in 0..self.reached.len() {
            let s = self.reached[k] as usize;
            let end = self.reached.get(k + 1).map_or(self.columns, |&next| self.base[next as usize] as usize);
            let next = Group::new(self.base[s] as usize..end, self.active[s]);
            let joined = group.joined(&next);
            if joined.work() <= GRAM_WASTE * (group.paid + next.paid) {
                group = joined;
            } else {
                self.add_products(&group);
                group = next;
            }
        }
        self.add_products(&group);
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

    /// Adds the scalar products over one group of degrees of freedom to the lower triangle of `gram`.
    fn add_products(&mut self, group: &Group) {
        let (from, to) = (group.active.0 as usize, group.active.1 as usize);
        if group.columns.is_empty() || from >= to {
            return;
        }
        let m = self.rows;
        let half = MatRef::from_column_major_slice_with_stride(
            &self.half[group.columns.start * self.stride..group.columns.end * self.stride],
            self.stride,
            group.columns.len(),
            self.stride,
        );
        let half = half.subrows(from, to - from);
        let gram = MatMut::from_column_major_slice_mut(&mut self.gram[..m * m], m, m);
        triangular::matmul(
            gram.submatrix_mut(from, from, to - from, to - from),
            BlockStructure::TriangularLower,
            Accum::Add,
            half,
            BlockStructure::Rectangular,
            half.transpose(),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
    }
}

/// Neighbouring columns of `half` that are multiplied over the same range of rows.
#[derive(Clone, Debug, Default)]
struct Group {
    columns: std::ops::Range<usize>,
    active: (u32, u32),
    /// Work of its members if each were multiplied on its own.
    paid: f64,
}

impl Group {
    fn new(columns: std::ops::Range<usize>, active: (u32, u32)) -> Self {
        let mut group = Self { columns, active, paid: 0.0 };
        group.paid = group.work();
        group
    }

    fn work(&self) -> f64 {
        let rows = self.active.1.saturating_sub(self.active.0) as f64;
        rows * rows * self.columns.len() as f64
    }

    fn joined(&self, next: &Self) -> Self {
        if self.columns.is_empty() {
            return next.clone();
        }
        let mut active = self.active;
        widen(&mut active, next.active);
        Self { columns: self.columns.start..next.columns.end, active, paid: self.paid + next.paid }
    }
}
