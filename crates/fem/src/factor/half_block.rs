//! Half solves of some of the rows: `Y = L⁻¹ P Hᵀ` on the union of their paths, with dense kernels.
//!
//! The supernodes of a block come one after the other; blocks are solved side by side, and within a block the products of
//! large supernodes are ([`half_front`]).

use faer::MatMut;

use super::half_front;
use super::numeric::Factor;
use super::symbolic::SymbolicFactor;
use crate::nodal_rows::NodalRows;
use crate::ordering::NO_PARENT;

/// Rows that are solved together: enough that `L` is not read too often, few enough that there is work for several
/// threads and that their half solves stay in the caches.
pub(super) const BLOCK_ROWS: usize = 64;

/// No row has reached the supernode.
pub(super) const INACTIVE: (u32, u32) = (u32::MAX, 0);

/// Up to [`BLOCK_ROWS`] rows and their half solves.
#[derive(Debug, Default)]
pub(super) struct HalfBlock {
    /// `Yᵀ`: one column of `stride` numbers per reached degree of freedom, one entry per row of the block.
    pub(super) half: Vec<f64>,
    pub(super) stride: usize,
    update: Vec<f64>,
    /// Columns of each supernode.
    widths: Vec<u32>,
    /// Per supernode: first column of `half`, and the range of rows that are nonzero there.
    pub(super) base: Vec<u32>,
    pub(super) active: Vec<(u32, u32)>,
    pub(super) reached: Vec<u32>,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl HalfBlock {
    /// Memory for `rows` rows.
    pub(super) fn new(symbolic: &SymbolicFactor, rows: usize) -> Self {
        let (count, stride) = (symbolic.supernode_count(), stride_for(rows));
        Self {
            half: vec![0.0; stride * symbolic.degrees_of_freedom()],
            stride,
            update: vec![0.0; stride * symbolic.tree().widest_pattern()],
            widths: (0..count).map(|s| symbolic.tree().columns(s).len() as u32).collect(),
            base: vec![0; count],
            active: vec![INACTIVE; count],
            reached: Vec::with_capacity(count),
            columns: 0,
            rows: 0,
        }
    }

    /// As much memory, with nothing in it.
    pub(super) fn empty_like(other: &Self) -> Self {
        Self {
            half: vec![0.0; other.half.len()],
            stride: other.stride,
            update: vec![0.0; other.update.len()],
            widths: other.widths.clone(),
            base: vec![0; other.base.len()],
            active: vec![INACTIVE; other.active.len()],
            reached: Vec::with_capacity(other.active.len()),
            columns: 0,
            rows: 0,
        }
    }

    /// Columns of a supernode.
    pub(super) fn width(&self, s: usize) -> usize {
        self.widths[s] as usize
    }

    /// Solves for the rows `sorted` of `rows`, whose nodes all exist.
    pub(super) fn solve(&mut self, factor: &Factor, rows: &NodalRows, sorted: &[u32]) {
        let symbolic = factor.symbolic();
        self.rows = sorted.len();
        self.stride = stride_for(sorted.len());
        self.find_reach(symbolic, rows, sorted);
        self.place_rows(symbolic, rows, sorted);
        for k in 0..self.reached.len() {
            self.eliminate(factor, self.reached[k] as usize);
        }
    }

    /// Finds the supernodes that the rows reach, in elimination order, and which rows are nonzero where.
    fn find_reach(&mut self, symbolic: &SymbolicFactor, rows: &NodalRows, sorted: &[u32]) {
        let tree = symbolic.tree();
        let place_in_order = &symbolic.ordering().new_of_old;
        self.active.fill(INACTIVE);
        for (place, &r) in sorted.iter().enumerate() {
            for (node, _) in rows.row(r as usize) {
                let s = tree.owner(3 * place_in_order[node as usize] as usize);
                widen(&mut self.active[s], (place as u32, place as u32 + 1));
            }
        }
        // children come before parents, so one ascending pass carries every range to the root
        self.reached.clear();
        self.columns = 0;
        for s in 0..self.active.len() {
            if self.active[s] == INACTIVE {
                continue;
            }
            self.base[s] = self.columns as u32;
            self.columns += tree.columns(s).len();
            self.reached.push(s as u32);
            let parent = tree.parents()[s];
            if parent != NO_PARENT {
                let range = self.active[s];
                widen(&mut self.active[parent as usize], range);
            }
        }
    }

    /// Places `P Hᵀ` in the zeroed compact columns.
    fn place_rows(&mut self, symbolic: &SymbolicFactor, rows: &NodalRows, sorted: &[u32]) {
        let tree = symbolic.tree();
        self.half[..self.columns * self.stride].fill(0.0);
        for (place, &r) in sorted.iter().enumerate() {
            for (node, value) in rows.row(r as usize) {
                let dof = 3 * symbolic.ordering().new_of_old[node as usize] as usize;
                let s = tree.owner(dof);
                let column = self.base[s] as usize + dof - tree.columns(s).start;
                for c in 0..3 {
                    self.half[(column + c) * self.stride + place] += value[c];
                }
            }
        }
    }

    /// Forward substitution on supernode `s`: its own block, then its share of every row further up.
    fn eliminate(&mut self, factor: &Factor, s: usize) {
        let tree = factor.symbolic().tree();
        let supernode = factor.llt().supernode(s);
        let width = supernode.val().ncols();
        let (top, below) = supernode.val().split_at_row(width);
        let (from, to) = (self.active[s].0 as usize, self.active[s].1 as usize);
        let rows = to - from;
        let stride = self.stride;
        let base = self.base[s] as usize;

        let own = &mut self.half[base * stride..(base + width) * stride];
        let own = MatMut::from_column_major_slice_with_stride_mut(own, stride, width, stride).subrows_mut(from, rows);
        let update = &mut self.update[..rows * below.nrows()];
        half_front::eliminate(top, below, own, MatMut::from_column_major_slice_mut(&mut *update, rows, below.nrows()));
        for (&dof, update) in supernode.pattern().iter().zip(update.chunks_exact(rows)) {
            let above = tree.owner(dof as usize);
            let column = self.base[above] as usize + dof as usize - tree.columns(above).start;
            let target = &mut self.half[column * stride + from..column * stride + to];
            for (target, update) in target.iter_mut().zip(update) {
                *target -= update;
            }
        }
    }

    /// Adds `Y λ` to a vector in elimination order; `lambda` has one entry per row of the block.
    pub(super) fn add_combination(&self, symbolic: &SymbolicFactor, lambda: &[f64], into: &mut [f64]) {
        for &s in &self.reached {
            let s = s as usize;
            let (from, to) = (self.active[s].0 as usize, self.active[s].1 as usize);
            for (k, dof) in symbolic.tree().columns(s).enumerate() {
                let start = (self.base[s] as usize + k) * self.stride;
                let half = &self.half[start + from..start + to];
                into[dof] += half.iter().zip(&lambda[from..to]).map(|(y, l)| y * l).sum::<f64>();
            }
        }
    }
}

/// Extends a range of rows so that it holds another.
pub(super) fn widen(range: &mut (u32, u32), other: (u32, u32)) {
    *range = (range.0.min(other.0), range.1.max(other.1));
}

/// Rows rounded up so that columns start at multiples of a cache line.
fn stride_for(rows: usize) -> usize {
    rows.next_multiple_of(8)
}
