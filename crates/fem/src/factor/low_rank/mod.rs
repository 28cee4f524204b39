//! A factor that serves a body after a cut or a change of what is held, until the next factorisation absorbs it.
//!
//! With `X = A₀⁻¹ S` over the unit columns `S` of the few nodes that the change touches, and `C = Sᵀ X`, nodes that are held
//! fast, as the columns `E` of `S`, take from the inverse what the limit of a stiff spring does:
//! ```text
//! A_h⁻¹ = A₀⁻¹ - X E (Eᵀ C E)⁻¹ Eᵀ Xᵀ,     C_h = C - C E Y,  Y = (Eᵀ C E)⁻¹ Eᵀ C
//! ```
//! and a change `S N Sᵀ` of the matrix on the other nodes follows by Sherman, Morrison and Woodbury:
//! ```text
//! A₁⁻¹ = A₀⁻¹ - X M Xᵀ,     M = E (Eᵀ C E)⁻¹ Eᵀ + (I - E Y) (I + N C_h)⁻¹ N (I - E Y)ᵀ
//! ```
//! Courtecuisse et al. (Medical Image Analysis 18, 2014) cut tissue so, with elements in the place of nodes; `N` here may
//! be singular, so that elements may go, come or change, and nodes be held or released, in one change. It is exact to
//! rounding times the condition number of `A₀`, and costs three solves a touched node once, and a product with three columns
//! a touched node in each use.

#![allow(non_snake_case)]

mod middle;

use faer::linalg::matmul::matmul;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrixViewMut;

use self::middle::Middle;
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
    middle: Middle,
    degrees_of_freedom: usize,
    capacity: usize,
    solve: SolveWorkspace,
}

impl LowRankUpdate {
    /// Memory for changes of as many nodes as the symbolic factor states.
    pub(super) fn new(symbolic: &SymbolicFactor) -> Self {
        let (n, rows) = (symbolic.degrees_of_freedom(), 3 * symbolic.change_capacity());
        Self {
            nodes: Vec::with_capacity(rows / 3),
            held: Vec::with_capacity(rows / 3),
            X: Vec::with_capacity(n * rows),
            middle: Middle::new(rows),
            degrees_of_freedom: n,
            capacity: rows / 3,
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
        self.middle.C.clear();
        for x in self.X.chunks_exact(n) {
            let touched = self.nodes.iter().flat_map(|&node| &x[3 * node as usize..3 * node as usize + 3]);
            self.middle.C.extend(touched);
        }
        let sound = self.middle.find(change.values(), &self.held);
        if sound { UpdateStatus::Ok } else { UpdateStatus::NotPositiveDefinite }
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
        for (column, touched) in self.middle.M.chunks_exact(rows.max(1)).zip(touched) {
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
        let M = MatRef::from_column_major_slice(&self.middle.M, k, k);
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
