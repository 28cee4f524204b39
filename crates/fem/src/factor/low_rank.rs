//! A factor that serves a body after a cut or a change of what is held, until the next factorisation absorbs it.
//!
//! With `A₁ = A₀ + S N Sᵀ` over the few nodes that the change touches, `X = A₀⁻¹ S` and `C = Sᵀ X`, Sherman, Morrison and
//! Woodbury give
//! ```text
//! A₁⁻¹ = A₀⁻¹ - X M Xᵀ,     M = (I + N C)⁻¹ N
//! ```
//! and nodes that are held fast, as unit columns `E` among those of `S`, add the exact limit of a stiff spring:
//! ```text
//! M ← M + B (Eᵀ (C - C M C) E)⁻¹ Bᵀ,     B = (I - M C) E
//! ```
//! Courtecuisse et al. (Medical Image Analysis 18, 2014) cut tissue so, with elements in the place of nodes; `N` here may
//! be singular, so that elements may go, come or change, and nodes be held or released, in one change. It is exact to
//! rounding times the condition number of `A₀`, and costs three solves a touched node once, and a product with three columns
//! a touched node in each use.

#![allow(non_snake_case)]

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltParams, LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::lu::partial_pivoting::factor::{PartialPivLuParams, lu_in_place, lu_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Auto, MatMut, MatRef, Par, Spec};

use nalgebra::DMatrixViewMut;

use super::change::MatrixChange;
use super::numeric::Factor;
use super::solve::{SolveStatus, SolveWorkspace};
use super::symbolic::SymbolicFactor;
use crate::nodal_rows::NodalRows;

/// Columns that are solved for at once.
const COLUMNS: usize = 24;

/// How [`Factor::change`] ended.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateStatus {
    /// The factor serves the changed body.
    Ok,
    /// The factor is invalid.
    InvalidFactor,
    /// The change belongs to another body, or touches more nodes than there is memory for.
    WrongSize,
    /// The changed matrix is not positive definite, or not finite.
    NotPositiveDefinite,
}

/// What is to be taken from a factor's inverse: `X M Xᵀ`.
pub(super) struct LowRankUpdate {
    nodes: Vec<u32>,
    held: Vec<bool>,
    /// `X = A₀⁻¹ S`, `3 n` rows, by columns.
    X: Vec<f64>,
    /// `M`, by columns.
    M: Vec<f64>,
    degrees_of_freedom: usize,
    capacity: usize,
    C: Vec<f64>,
    system: Vec<f64>,
    B: Vec<f64>,
    order: Vec<usize>,
    inverse: Vec<usize>,
    memory: MemBuffer,
    solve: SolveWorkspace,
}

impl LowRankUpdate {
    /// Memory for changes of as many nodes as the symbolic factor states.
    pub(super) fn new(symbolic: &SymbolicFactor) -> Self {
        let (n, rows) = (symbolic.degrees_of_freedom(), 3 * symbolic.change_capacity());
        let lu = lu_in_place_scratch::<usize, f64>(rows, 2 * rows, Par::Seq, lu_params());
        let llt = cholesky_in_place_scratch::<f64>(rows, Par::Seq, llt_params());
        Self {
            nodes: Vec::with_capacity(rows / 3),
            held: Vec::with_capacity(rows / 3),
            X: Vec::with_capacity(n * rows),
            M: Vec::with_capacity(rows * rows),
            degrees_of_freedom: n,
            capacity: rows / 3,
            C: Vec::with_capacity(rows * rows),
            system: Vec::with_capacity(2 * rows * rows),
            B: Vec::with_capacity(rows * rows),
            order: vec![0; rows],
            inverse: vec![0; rows],
            memory: MemBuffer::new(lu.or(llt)),
            solve: SolveWorkspace::with_columns(symbolic, COLUMNS),
        }
    }

    /// True where nothing is changed.
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Forgets the change: factors serve as they are.
    pub(super) fn clear(&mut self) {
        self.nodes.clear();
        self.held.clear();
        self.X.clear();
        self.M.clear();
    }

    /// Finds what to take from the inverse of `factor`, which has no update itself. Anything but [`UpdateStatus::Ok`] leaves
    /// the update empty.
    pub(super) fn set(&mut self, factor: &Factor, change: &MatrixChange) -> UpdateStatus {
        self.clear();
        let fits = factor.symbolic().degrees_of_freedom() == self.degrees_of_freedom
            && change.nodes().len() <= self.capacity
            && change.nodes().iter().all(|&node| 3 * (node as usize) < self.degrees_of_freedom);
        if !fits {
            return UpdateStatus::WrongSize;
        }
        if !factor.is_valid() {
            return UpdateStatus::InvalidFactor;
        }
        self.nodes.extend_from_slice(change.nodes());
        self.held.extend_from_slice(change.held());
        let status = self.find(factor, change);
        if status != UpdateStatus::Ok {
            self.clear();
        }
        status
    }

    fn find(&mut self, factor: &Factor, change: &MatrixChange) -> UpdateStatus {
        let (n, rows) = (self.degrees_of_freedom, 3 * self.nodes.len());
        self.X.resize(n * rows, 0.0);
        for (column, x) in self.X.chunks_exact_mut(n).enumerate() {
            x[3 * self.nodes[column / 3] as usize + column % 3] = 1.0;
        }
        for columns in self.X.chunks_mut(n * COLUMNS) {
            if factor.solve_columns(columns, &mut self.solve) != SolveStatus::Ok {
                return UpdateStatus::InvalidFactor;
            }
        }
        self.C.clear();
        for x in self.X.chunks_exact(n) {
            let touched = self.nodes.iter().flat_map(|&node| &x[3 * node as usize..3 * node as usize + 3]);
            self.C.extend(touched);
        }
        let N = change.values();
        let sound = self.stays_definite(N, rows) && self.invert_change(N, rows) && self.hold(rows);
        if sound && self.M.iter().all(|m| m.is_finite()) { UpdateStatus::Ok } else { UpdateStatus::NotPositiveDefinite }
    }

    /// Whether `A₁` is positive definite before anything is held: just where `C + C N C`, its Schur complement, is.
    fn stays_definite(&mut self, N: &[f64], rows: usize) -> bool {
        let C = MatRef::from_column_major_slice(&self.C, rows, rows);
        self.system.clear();
        self.system.resize(rows * rows, 0.0);
        let mut CN = MatMut::from_column_major_slice_mut(&mut self.system, rows, rows);
        matmul(CN.rb_mut(), Accum::Replace, C, MatRef::from_column_major_slice(N, rows, rows), 1.0, Par::Seq);
        self.B.clear();
        self.B.extend_from_slice(&self.C);
        let mut schur = MatMut::from_column_major_slice_mut(&mut self.B, rows, rows);
        matmul(schur.rb_mut(), Accum::Add, CN.rb(), C, 1.0, Par::Seq);
        let memory = MemStack::new(&mut self.memory);
        cholesky_in_place(schur, LltRegularization::default(), Par::Seq, memory, llt_params()).is_ok()
    }

    /// `M = (I + N C)⁻¹ N`; false where that is singular.
    fn invert_change(&mut self, N: &[f64], rows: usize) -> bool {
        let (square, N) = (rows * rows, MatRef::from_column_major_slice(N, rows, rows));
        self.system.clear();
        self.system.resize(2 * square, 0.0);
        let C = MatRef::from_column_major_slice(&self.C, rows, rows);
        let mut system = MatMut::from_column_major_slice_mut(&mut self.system, rows, 2 * rows);
        let (mut left, mut right) = system.rb_mut().split_at_col_mut(rows);
        matmul(left.rb_mut(), Accum::Replace, N, C, 1.0, Par::Seq);
        for i in 0..rows {
            left[(i, i)] += 1.0;
        }
        right.copy_from(N);
        // Eliminated along with the matrix, the right sides become L⁻¹ P N.
        let (order, inverse) = (&mut self.order[..rows], &mut self.inverse[..rows]);
        lu_in_place(system, order, inverse, Par::Seq, MemStack::new(&mut self.memory), lu_params());
        let system = MatMut::from_column_major_slice_mut(&mut self.system, rows, 2 * rows);
        let (left, right) = system.split_at_col_mut(rows);
        if (0..rows).any(|i| left[(i, i)] == 0.0 || !left[(i, i)].is_finite()) {
            return false;
        }
        solve_upper_triangular_in_place(left.rb(), right, Par::Seq);
        self.M.extend_from_slice(&self.system[square..]);
        true
    }

    /// Adds what holds the held nodes to `M`; false where the changed matrix is not positive definite there.
    fn hold(&mut self, rows: usize) -> bool {
        let held = 3 * self.held.iter().filter(|&&held| held).count();
        if held == 0 {
            return true;
        }
        let C = MatRef::from_column_major_slice(&self.C, rows, rows);
        // B = E - M C E
        self.system.clear();
        for (_, column) in
            self.held.iter().flat_map(|held| [held; 3]).zip(self.C.chunks_exact(rows)).filter(|(h, _)| **h)
        {
            self.system.extend_from_slice(column);
        }
        self.B.clear();
        self.B.resize(rows * held, 0.0);
        let CE = MatRef::from_column_major_slice(&self.system, rows, held);
        let mut B = MatMut::from_column_major_slice_mut(&mut self.B, rows, held);
        matmul(B.rb_mut(), Accum::Replace, MatRef::from_column_major_slice(&self.M, rows, rows), CE, -1.0, Par::Seq);
        let places = || (0..rows).filter(|row| self.held[row / 3]);
        for (column, row) in places().enumerate() {
            B[(row, column)] += 1.0;
        }
        // Eᵀ (C - C M C) E = Eᵀ C B, the held rows of C B moved together
        let mut CB = MatMut::from_column_major_slice_mut(&mut self.system, rows, held);
        matmul(CB.rb_mut(), Accum::Replace, C, B.rb(), 1.0, Par::Seq);
        for (column, (place, row)) in (0..held).flat_map(|column| places().enumerate().map(move |to| (column, to))) {
            self.system[column * held + place] = self.system[column * rows + row];
        }
        let mut schur = MatMut::from_column_major_slice_mut(&mut self.system[..held * held], held, held);
        let llt = cholesky_in_place(
            schur.rb_mut(),
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            llt_params(),
        );
        if llt.is_err() {
            return false;
        }
        // With Eᵀ C B = L Lᵀ and Z = B L⁻ᵀ, M += Z Zᵀ.
        solve_lower_triangular_in_place(schur.rb(), B.rb_mut().transpose_mut(), Par::Seq);
        let M = MatMut::from_column_major_slice_mut(&mut self.M, rows, rows);
        matmul(M, Accum::Add, B.rb(), B.rb().transpose(), 1.0, Par::Seq);
        true
    }

    /// `z ← z - X M Xᵀ r` with `z = A₀⁻¹ r` given: what `A₁⁻¹ r` is; held nodes come out as zero. `scratch` is as long as
    /// [`scratch_of_solve`] says.
    pub(super) fn finish_solve(&self, z: &mut [f64], scratch: &mut [f64]) {
        let rows = 3 * self.nodes.len();
        // Xᵀ r = Sᵀ A₀⁻¹ r
        let (touched, weights) = scratch.split_at_mut(scratch.len() / 2);
        let (touched, weights) = (&mut touched[..rows], &mut weights[..rows]);
        for (touched, &node) in touched.chunks_exact_mut(3).zip(&self.nodes) {
            touched.copy_from_slice(&z[3 * node as usize..3 * node as usize + 3]);
        }
        weights.fill(0.0);
        for (column, touched) in self.M.chunks_exact(rows.max(1)).zip(touched) {
            weights.iter_mut().zip(column).for_each(|(weight, m)| *weight += m * *touched);
        }
        for (column, weight) in self.X.chunks_exact(self.degrees_of_freedom).zip(weights) {
            z.iter_mut().zip(column).for_each(|(z, x)| *z -= x * *weight);
        }
        for (&node, _) in self.nodes.iter().zip(&self.held).filter(|(_, held)| **held) {
            z[3 * node as usize..3 * node as usize + 3].fill(0.0);
        }
    }

    /// `w ← w - scale (H X) M (H X)ᵀ`, symmetric to the bit. `scratch` is as long as [`scratch_of_compliance`] says.
    pub(super) fn finish_compliance(
        &self,
        rows: &NodalRows,
        scale: f64,
        mut w: DMatrixViewMut<'_, f64>,
        scratch: &mut [f64],
    ) {
        let (m, k) = (rows.len(), 3 * self.nodes.len());
        let (HX, rest) = scratch.split_at_mut(m * k);
        let (HXM, product) = rest.split_at_mut(m * k);
        let product = &mut product[..m * m];
        for (column, x) in HX.chunks_exact_mut(m.max(1)).zip(self.X.chunks_exact(self.degrees_of_freedom)) {
            column.iter_mut().enumerate().for_each(|(r, to)| *to = rows.dot(r, x));
        }
        let HX = MatRef::from_column_major_slice(HX, m, k);
        let M = MatRef::from_column_major_slice(&self.M, k, k);
        let mut HXM = MatMut::from_column_major_slice_mut(HXM, m, k);
        matmul(HXM.rb_mut(), Accum::Replace, HX, M, scale, Par::Seq);
        let mut to = MatMut::from_column_major_slice_mut(&mut *product, m, m);
        matmul(to.rb_mut(), Accum::Replace, HXM.rb(), HX.transpose(), 1.0, Par::Seq);
        for j in 0..m {
            for i in j..m {
                let value = w[(i, j)] - 0.5 * (product[j * m + i] + product[i * m + j]);
                (w[(i, j)], w[(j, i)]) = (value, value);
            }
        }
    }
}

/// Numbers of scratch that a solve with a change of up to `nodes` nodes takes.
pub(super) fn scratch_of_solve(nodes: usize) -> usize {
    6 * nodes
}

/// Numbers of scratch that a compliance of `m` rows takes with a change of up to `nodes` nodes; none without changes.
pub(super) fn scratch_of_compliance(nodes: usize, m: usize) -> usize {
    if nodes == 0 { 0 } else { 6 * nodes * m + m * m }
}

fn lu_params() -> Spec<PartialPivLuParams, f64> {
    Spec::new(<PartialPivLuParams as Auto<f64>>::auto())
}

fn llt_params() -> Spec<LltParams, f64> {
    Spec::new(<LltParams as Auto<f64>>::auto())
}

impl Factor {
    /// Makes this the inverse of the changed matrix, until the next [`Factor::refactor`]; an earlier change is forgotten, so
    /// `change` is the whole difference from the matrix that was factored. Solves, half solves and corrections all see it.
    /// Allocates nothing. Anything but [`UpdateStatus::Ok`] leaves the factor what it was when it was made.
    ///
    /// Room for changes is stated by [`SymbolicFactor::with_room_for_changes`].
    pub fn change(&mut self, change: &MatrixChange) -> UpdateStatus {
        let Some(mut update) = self.update.take() else {
            return if change.is_empty() { UpdateStatus::Ok } else { UpdateStatus::WrongSize };
        };
        let status = update.set(self, change);
        self.update = Some(update);
        self.renew();
        status
    }

    /// The change that is on this factor, if any.
    pub(super) fn changed(&self) -> Option<&LowRankUpdate> {
        self.update.as_deref().filter(|update| !update.is_empty())
    }
}
