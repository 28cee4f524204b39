//! Half solves over the reach of sparse rows: `Y = L⁻¹ P Hᵀ`, hence `H A⁻¹ Hᵀ = Yᵀ Y` and `A⁻¹ Hᵀ λ = Pᵀ L⁻ᵀ Y λ`.
//!
//! A row that touches few nodes gives a column of `Y` that is nonzero only on the path from those nodes to the root
//! of the elimination tree (Gilbert and Peierls 1988). `Y` is computed on the union of the paths of all rows, by
//! supernodes with dense kernels, and `W` needs no backward substitution. The rows are sorted by the first supernode
//! that they reach: since subtrees are contiguous in elimination order, the rows that have reached a supernode then
//! lie close together, and only the range from the first to the last of them is computed there.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Conj, MatMut, Par};
use nalgebra::DMatrixViewMut;

use super::low_rank::{scratch_of_compliance, scratch_of_solve};
use super::numeric::Factor;
use super::solve::{SolveStatus, permute_back};
use super::symbolic::SymbolicFactor;
use crate::nodal_rows::NodalRows;
use crate::ordering::NO_PARENT;

/// How a half solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReachStatus {
    /// `Y` is in the workspace.
    Ok,
    /// More rows than the workspace was made for; nothing was computed.
    TooManyRows {
        /// The workspace's capacity.
        capacity: u32,
    },
    /// A row touches a node that the body does not have; nothing was computed.
    UnknownNode {
        /// The node in question.
        node: u32,
    },
    /// The factor is invalid: no refactorisation has succeeded, or the last one failed.
    InvalidFactor,
    /// The workspace belongs to another topology, or the matrix for `W` has not one row and column per row of `H`.
    WrongSize,
}

/// What a half solve reports.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReachReport {
    /// Whether `Y` was computed.
    pub status: ReachStatus,
    /// Rows of `H`.
    pub rows: usize,
    /// Supernodes on the union of the paths.
    pub supernodes: usize,
    /// Degrees of freedom on the union of the paths: rows of `Y` that are stored.
    pub degrees_of_freedom: usize,
}

/// Memory for half solves of up to a stated number of rows, and their result.
pub struct ReachWorkspace {
    max_rows: usize,
    /// `Yᵀ`: one column of `stride` numbers per reached degree of freedom, one entry per (sorted) row of `H`.
    pub(super) half: Vec<f64>,
    pub(super) stride: usize,
    update: Vec<f64>,
    pub(super) gram: Vec<f64>,
    /// Per supernode: first column of `half`, and the range of sorted rows that are nonzero there.
    pub(super) base: Vec<u32>,
    pub(super) active: Vec<(u32, u32)>,
    pub(super) reached: Vec<u32>,
    /// First supernode that each row reaches, and the rows sorted by it.
    first: Vec<u32>,
    pub(super) sorted: Vec<u32>,
    place: Vec<u32>,
    lambda: Vec<f64>,
    permuted: Vec<f64>,
    /// For the part of a change since the factorisation.
    change: Vec<f64>,
    memory: MemBuffer,
    widest_pattern: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Revision of the factor that `half` was computed with; zero while there is none.
    pub(super) revision: u64,
}

/// No row has reached the supernode.
const INACTIVE: (u32, u32) = (u32::MAX, 0);

impl ReachWorkspace {
    /// Memory for up to `max_rows` rows on bodies of this topology: `8 · max_rows · 3 n` bytes of address space, of
    /// which only what is reached is ever touched.
    pub fn new(symbolic: &SymbolicFactor, max_rows: usize) -> Self {
        let n = symbolic.degrees_of_freedom();
        let supernodes = symbolic.supernode_count();
        let widest_pattern = symbolic.tree().widest_pattern();
        let largest_stride = stride_for(max_rows);
        Self {
            max_rows,
            half: vec![0.0; largest_stride * n],
            stride: largest_stride,
            update: vec![0.0; largest_stride * widest_pattern],
            gram: vec![0.0; max_rows * max_rows],
            base: vec![0; supernodes],
            active: vec![INACTIVE; supernodes],
            reached: Vec::with_capacity(supernodes),
            first: vec![0; max_rows],
            sorted: Vec::with_capacity(max_rows),
            place: vec![0; max_rows],
            lambda: vec![0.0; max_rows],
            permuted: vec![0.0; n],
            change: vec![0.0; change_scratch(symbolic, max_rows)],
            memory: MemBuffer::new(symbolic.supernodes().solve_in_place_scratch::<f64>(1, Par::Seq)),
            widest_pattern,
            rows: 0,
            columns: 0,
            revision: 0,
        }
    }

    /// The most rows that a half solve takes.
    pub fn max_rows(&self) -> usize {
        self.max_rows
    }

    /// Rows of the last half solve; zero if it failed.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Finds the supernodes that the rows reach, in elimination order, and which rows are nonzero where.
    fn find_reach(&mut self, symbolic: &SymbolicFactor, rows: &NodalRows) -> Result<(), ReachStatus> {
        let tree = symbolic.tree();
        let place_in_order = &symbolic.ordering().new_of_old;
        let owner = |node: u32| place_in_order.get(node as usize).map(|&new| tree.owner(3 * new as usize));
        for r in 0..rows.len() {
            self.first[r] = NO_PARENT;
            for (node, _) in rows.row(r) {
                let s = owner(node).ok_or(ReachStatus::UnknownNode { node })?;
                self.first[r] = self.first[r].min(s as u32);
            }
        }
        self.sorted.clear();
        self.sorted.extend(0..rows.len() as u32);
        let first = &self.first;
        self.sorted.sort_unstable_by_key(|&r| (first[r as usize], r));

        self.active.fill(INACTIVE);
        for (place, &r) in self.sorted.iter().enumerate() {
            self.place[r as usize] = place as u32;
            for s in rows.row(r as usize).filter_map(|(node, _)| owner(node)) {
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
        Ok(())
    }

    /// Places `P Hᵀ` in the zeroed compact columns.
    fn place_rows(&mut self, symbolic: &SymbolicFactor, rows: &NodalRows) {
        let tree = symbolic.tree();
        self.stride = stride_for(rows.len());
        self.half[..self.columns * self.stride].fill(0.0);
        for r in 0..rows.len() {
            for (node, value) in rows.row(r) {
                let dof = 3 * symbolic.ordering().new_of_old[node as usize] as usize;
                let s = tree.owner(dof);
                let column = self.base[s] as usize + dof - tree.columns(s).start;
                for c in 0..3 {
                    self.half[(column + c) * self.stride + self.place[r] as usize] += value[c];
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
        let mut own =
            MatMut::from_column_major_slice_with_stride_mut(own, stride, width, stride).subrows_mut(from, rows);
        solve_lower_triangular_in_place(top, own.rb_mut().transpose_mut(), Par::Seq);
        if below.nrows() == 0 {
            return;
        }
        let update = &mut self.update[..rows * below.nrows()];
        matmul(
            MatMut::from_column_major_slice_mut(&mut *update, rows, below.nrows()),
            Accum::Replace,
            own.rb(),
            below.transpose(),
            1.0,
            Par::Seq,
        );
        for (&dof, update) in supernode.pattern().iter().zip(update.chunks_exact(rows)) {
            let above = tree.owner(dof as usize);
            let column = self.base[above] as usize + dof as usize - tree.columns(above).start;
            let target = &mut self.half[column * stride + from..column * stride + to];
            for (target, update) in target.iter_mut().zip(update) {
                *target -= update;
            }
        }
    }
}

impl Factor {
    /// Computes `Y = L⁻¹ P Hᵀ` for all rows into the workspace. Allocates nothing.
    pub fn half_solve(&self, rows: &NodalRows, workspace: &mut ReachWorkspace) -> ReachReport {
        workspace.rows = 0;
        workspace.revision = 0;
        let status = self.try_half_solve(rows, workspace).err().unwrap_or(ReachStatus::Ok);
        let ok = status == ReachStatus::Ok;
        ReachReport {
            status,
            rows: rows.len(),
            supernodes: if ok { workspace.reached.len() } else { 0 },
            degrees_of_freedom: if ok { workspace.columns } else { 0 },
        }
    }

    fn try_half_solve(&self, rows: &NodalRows, workspace: &mut ReachWorkspace) -> Result<(), ReachStatus> {
        let symbolic = self.symbolic();
        if !self.is_valid() {
            return Err(ReachStatus::InvalidFactor);
        }
        if workspace.permuted.len() != symbolic.degrees_of_freedom()
            || workspace.active.len() != symbolic.supernode_count()
            || workspace.widest_pattern < symbolic.tree().widest_pattern()
            || workspace.change.len() < change_scratch(symbolic, workspace.max_rows)
        {
            return Err(ReachStatus::WrongSize);
        }
        if rows.len() > workspace.max_rows {
            return Err(ReachStatus::TooManyRows { capacity: workspace.max_rows as u32 });
        }
        workspace.find_reach(symbolic, rows)?;
        workspace.place_rows(symbolic, rows);
        for k in 0..workspace.reached.len() {
            workspace.eliminate(self, workspace.reached[k] as usize);
        }
        workspace.rows = rows.len();
        workspace.revision = self.revision();
        Ok(())
    }

    /// `W = scale · H A⁻¹ Hᵀ` into the `m x m` matrix `w`; the half solves stay in the workspace for [`Self::correct`].
    pub fn compliance_into<'w>(
        &self,
        rows: &NodalRows,
        scale: f64,
        w: impl Into<DMatrixViewMut<'w, f64>>,
        workspace: &mut ReachWorkspace,
    ) -> ReachReport {
        let mut report = self.half_solve(rows, workspace);
        if report.status == ReachStatus::Ok {
            let mut w = w.into();
            report.status = workspace.gram_into(scale, w.as_view_mut());
            if let (ReachStatus::Ok, Some(update)) = (report.status, self.changed()) {
                update.finish_compliance(rows, scale, w, &mut workspace.change);
            }
        }
        report
    }

    /// `x = A⁻¹ Hᵀ λ` for the rows of the last half solve with this factor: `Y λ` and one backward substitution.
    ///
    /// `lambda` has one entry per row, `x` length `3 n`. Allocates nothing.
    pub fn correct(&self, lambda: &[f64], x: &mut [f64], workspace: &mut ReachWorkspace) -> SolveStatus {
        let tree = self.symbolic().tree();
        if !self.is_valid() {
            return SolveStatus::InvalidFactor;
        }
        if workspace.revision != self.revision() {
            return SolveStatus::OtherFactor;
        }
        if lambda.len() != workspace.rows || x.len() != self.symbolic().degrees_of_freedom() {
            return SolveStatus::WrongSize;
        }
        for (sorted, &r) in workspace.lambda.iter_mut().zip(&workspace.sorted) {
            *sorted = lambda[r as usize];
        }
        workspace.permuted.fill(0.0);
        for &s in &workspace.reached {
            let s = s as usize;
            let (from, to) = (workspace.active[s].0 as usize, workspace.active[s].1 as usize);
            for (k, dof) in tree.columns(s).enumerate() {
                let start = (workspace.base[s] as usize + k) * workspace.stride;
                let half = &workspace.half[start + from..start + to];
                workspace.permuted[dof] = half.iter().zip(&workspace.lambda[from..to]).map(|(y, l)| y * l).sum();
            }
        }
        let n = workspace.permuted.len();
        self.llt().l_transpose_solve_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut workspace.permuted, n, 1),
            Par::Seq,
            MemStack::new(&mut workspace.memory),
        );
        permute_back(&self.symbolic().ordering().old_of_new, &workspace.permuted, x);
        if let Some(update) = self.changed() {
            update.finish_solve(x, &mut workspace.change);
        }
        SolveStatus::Ok
    }
}

/// Extends a range of rows so that it holds another.
pub(super) fn widen(range: &mut (u32, u32), other: (u32, u32)) {
    *range = (range.0.min(other.0), range.1.max(other.1));
}

/// Scratch for changes: that of a compliance, and of a correction at least.
fn change_scratch(symbolic: &SymbolicFactor, max_rows: usize) -> usize {
    let nodes = symbolic.change_capacity();
    scratch_of_compliance(nodes, max_rows).max(scratch_of_solve(nodes))
}

/// Rows rounded up so that columns start at multiples of a cache line.
fn stride_for(rows: usize) -> usize {
    rows.next_multiple_of(8)
}
