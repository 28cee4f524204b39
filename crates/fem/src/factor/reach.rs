//! Half solves over the reach of sparse rows: `Y = L⁻¹ P Hᵀ`, hence `H A⁻¹ Hᵀ = Yᵀ Y` and `A⁻¹ Hᵀ λ = Pᵀ L⁻ᵀ Y λ`.
//!
//! A row that touches few nodes gives a column of `Y` that is nonzero only on the path from those nodes to the root
//! of the elimination tree (Gilbert and Peierls 1988). `Y` is computed on the union of the paths of all rows, by
//! supernodes with dense kernels, and `W` needs no backward substitution. The rows are sorted by the first supernode
//! that they reach: since subtrees are contiguous in elimination order, the rows that have reached a supernode then
//! lie close together, and only the range from the first to the last of them is computed there. Blocks of sorted rows
//! are solved side by side on the workers of a pool, and the large supernodes of a block by several of them; how rows are
//! put into blocks, and how supernodes are cut, depends on sizes alone.

use nalgebra::DMatrixViewMut;

use super::half_block::{BLOCK_ROWS, HalfBlock, INACTIVE};
use super::low_rank::{scratch_of_compliance, scratch_of_solve};
use super::nodal_compliance::NodalCompliance;
use super::numeric::Factor;
use super::packed_fronts::PackedWorkspace;
use super::symbolic::SymbolicFactor;
use super::workers::join;
use crate::nodal_rows::NodalRows;

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
    pub(super) blocks: Vec<HalfBlock>,
    /// Blocks of the last half solve.
    pub(super) used: usize,
    pub(super) gram: Vec<f64>,
    /// First supernode that each row reaches, and the rows sorted by it.
    first: Vec<u32>,
    pub(super) sorted: Vec<u32>,
    pub(super) lambda: Vec<f64>,
    pub(super) permuted: Vec<f64>,
    /// Rows below each front, for the correction.
    pub(super) front_rows: Vec<f64>,
    pub(super) packed: PackedWorkspace,
    /// For the part of a change since the factorisation.
    pub(super) change: Vec<f64>,
    widest_pattern: usize,
    pub(super) rows: usize,
    /// Revision of the factor that the half solves are of; zero while there is none.
    pub(super) revision: u64,
    /// Half solves of nodes, where they are kept.
    pub(super) nodal: Option<Box<NodalCompliance>>,
    /// Whether the last compliance came from them.
    pub(super) by_nodes: bool,
    pub(super) in_full: u32,
}

impl ReachWorkspace {
    /// Memory for up to `max_rows` rows on bodies of this topology: `8 · max_rows · 3 n` bytes of address space, of
    /// which only what is reached is ever touched.
    pub fn new(symbolic: &SymbolicFactor, max_rows: usize) -> Self {
        let block_rows = BLOCK_ROWS.min(max_rows);
        Self {
            max_rows,
            blocks: (0..max_rows.div_ceil(BLOCK_ROWS)).map(|_| HalfBlock::new(symbolic, block_rows)).collect(),
            used: 0,
            gram: vec![0.0; max_rows * max_rows],
            first: vec![0; max_rows],
            sorted: Vec::with_capacity(max_rows),
            lambda: vec![0.0; max_rows],
            permuted: vec![0.0; symbolic.degrees_of_freedom()],
            front_rows: vec![0.0; symbolic.tree().pattern_start(symbolic.supernode_count())],
            packed: PackedWorkspace::new(symbolic),
            widest_pattern: symbolic.tree().widest_pattern(),
            change: vec![0.0; change_scratch(symbolic, max_rows)],
            rows: 0,
            revision: 0,
            nodal: None,
            by_nodes: false,
            in_full: 0,
        }
    }

    /// Keeps the half solves of nodes from one compliance to the next with the same factor, for rows that touch the same few
    /// nodes again and again.
    #[must_use]
    pub fn keeping_nodes(mut self, symbolic: &SymbolicFactor) -> Self {
        self.nodal = Some(Box::new(NodalCompliance::new(symbolic, self.max_rows)));
        self
    }

    /// The most rows that a half solve takes.
    pub fn max_rows(&self) -> usize {
        self.max_rows
    }

    /// Rows of the last half solve; zero if it failed.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Sorts the rows by the first supernode that they reach.
    fn sort(&mut self, symbolic: &SymbolicFactor, rows: &NodalRows) -> Result<(), ReachStatus> {
        let place_in_order = &symbolic.ordering().new_of_old;
        for r in 0..rows.len() {
            self.first[r] = u32::MAX;
            for (node, _) in rows.row(r) {
                let new = place_in_order.get(node as usize).ok_or(ReachStatus::UnknownNode { node })?;
                self.first[r] = self.first[r].min(symbolic.tree().owner(3 * *new as usize) as u32);
            }
        }
        self.sorted.clear();
        self.sorted.extend(0..rows.len() as u32);
        let first = &self.first;
        self.sorted.sort_unstable_by_key(|&r| (first[r as usize], r));
        Ok(())
    }
}

/// Supernodes, and degrees of freedom, on the union of the paths of all rows.
fn reached(blocks: &[HalfBlock], symbolic: &SymbolicFactor) -> (usize, usize) {
    let on_a_path = |s: &usize| blocks.iter().any(|block| block.active[*s] != INACTIVE);
    (0..symbolic.supernode_count())
        .filter(on_a_path)
        .fold((0, 0), |(count, columns), s| (count + 1, columns + symbolic.tree().columns(s).len()))
}

/// Rows in each block where `rows` are spread evenly over as few blocks as hold them.
pub(super) fn rows_per_block(rows: usize) -> usize {
    rows.div_ceil(rows.div_ceil(BLOCK_ROWS).max(1)).max(1)
}

/// Solves the blocks, `size` sorted rows each, side by side.
fn solve_blocks(factor: &Factor, rows: &NodalRows, sorted: &[u32], size: usize, blocks: &mut [HalfBlock]) {
    match blocks {
        [] => {}
        [block] => block.solve(factor, rows, sorted),
        _ => {
            let half = blocks.len() / 2;
            let (first, second) = blocks.split_at_mut(half);
            let (sorted_first, sorted_second) = sorted.split_at(half * size);
            join(
                || solve_blocks(factor, rows, sorted_first, size, first),
                || solve_blocks(factor, rows, sorted_second, size, second),
            );
        }
    }
}

impl Factor {
    /// Computes `Y = L⁻¹ P Hᵀ` for all rows into the workspace. Allocates nothing. The bits do not depend on the threads.
    pub fn half_solve(&self, rows: &NodalRows, workspace: &mut ReachWorkspace) -> ReachReport {
        workspace.rows = 0;
        workspace.revision = 0;
        workspace.by_nodes = false;
        let status = self.try_half_solve(rows, workspace).err().unwrap_or(ReachStatus::Ok);
        let (supernodes, degrees_of_freedom) = if status == ReachStatus::Ok {
            reached(&workspace.blocks[..workspace.used], self.symbolic())
        } else {
            (0, 0)
        };
        ReachReport { status, rows: rows.len(), supernodes, degrees_of_freedom }
    }

    fn try_half_solve(&self, rows: &NodalRows, workspace: &mut ReachWorkspace) -> Result<(), ReachStatus> {
        let symbolic = self.symbolic();
        if !self.is_valid() {
            return Err(ReachStatus::InvalidFactor);
        }
        if workspace.permuted.len() != symbolic.degrees_of_freedom()
            || !workspace.packed.fits(symbolic)
            || workspace.blocks.first().is_some_and(|block| block.active.len() != symbolic.supernode_count())
            || workspace.widest_pattern < symbolic.tree().widest_pattern()
            || workspace.change.len() < change_scratch(symbolic, workspace.max_rows)
        {
            return Err(ReachStatus::WrongSize);
        }
        if rows.len() > workspace.max_rows {
            return Err(ReachStatus::TooManyRows { capacity: workspace.max_rows as u32 });
        }
        workspace.sort(symbolic, rows)?;
        let size = rows_per_block(rows.len());
        workspace.used = rows.len().div_ceil(size);
        solve_blocks(self, rows, &workspace.sorted, size, &mut workspace.blocks[..workspace.used]);
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
        let mut w = w.into();
        let mut report = match self.by_nodes(rows, scale, &mut w, workspace) {
            Some(report) => report,
            None => self.half_solve(rows, workspace),
        };
        if report.status == ReachStatus::Ok {
            if !workspace.by_nodes {
                report.status = workspace.gram_into(scale, w.as_view_mut());
            }
            if let (ReachStatus::Ok, Some(update)) = (report.status, self.changed()) {
                update.finish_compliance(rows, scale, w, &mut workspace.change);
            }
        }
        report
    }

    /// `W` from the half solves of the touched nodes, where the workspace keeps them and that is the better way.
    fn by_nodes(
        &self,
        rows: &NodalRows,
        scale: f64,
        w: &mut DMatrixViewMut<'_, f64>,
        workspace: &mut ReachWorkspace,
    ) -> Option<ReachReport> {
        let fits = self.is_valid() && rows.len() <= workspace.max_rows && w.shape() == (rows.len(), rows.len());
        let nodal = workspace.nodal.as_mut().filter(|_| fits)?;
        if !nodal.keep(self, rows) {
            return None;
        }
        nodal.write(scale, w);
        let (supernodes, degrees_of_freedom) = reached(&nodal.blocks[..nodal.used], self.symbolic());
        (workspace.rows, workspace.revision, workspace.by_nodes) = (rows.len(), self.revision(), true);
        Some(ReachReport { status: ReachStatus::Ok, rows: rows.len(), supernodes, degrees_of_freedom })
    }
}

/// Scratch for changes: that of a compliance, and of a correction at least.
fn change_scratch(symbolic: &SymbolicFactor, max_rows: usize) -> usize {
    let nodes = symbolic.change_capacity();
    scratch_of_compliance(nodes, max_rows).max(scratch_of_solve(nodes))
}
