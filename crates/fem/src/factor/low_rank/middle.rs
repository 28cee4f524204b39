//! The small matrix between the columns of a low-rank update.

#![allow(non_snake_case)]

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltParams, LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::lu::partial_pivoting::factor::{PartialPivLuParams, lu_in_place, lu_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Auto, MatMut, MatRef, Par, Spec};

/// `M` of [`super::LowRankUpdate`], and memory to find it.
pub(super) struct Middle {
    /// `C = Sᵀ A₀⁻¹ S`, by columns, given before [`Self::find`].
    pub(super) C: Vec<f64>,
    /// `M`, by columns.
    pub(super) M: Vec<f64>,
    /// `Y`, by columns.
    Y: Vec<f64>,
    /// `(Eᵀ C E)⁻¹`.
    stiffness: Vec<f64>,
    /// Whether each node is held.
    held: Vec<bool>,
    system: Vec<f64>,
    order: Vec<usize>,
    inverse: Vec<usize>,
    memory: MemBuffer,
}

impl Middle {
    /// Memory for up to `rows` rows.
    pub(super) fn new(rows: usize) -> Self {
        let lu = lu_in_place_scratch::<usize, f64>(rows, 2 * rows, Par::Seq, lu_params());
        let llt = cholesky_in_place_scratch::<f64>(rows, Par::Seq, llt_params());
        let square = || Vec::with_capacity(rows * rows);
        Self {
            C: square(),
            M: square(),
            Y: square(),
            stiffness: square(),
            held: Vec::with_capacity(rows / 3),
            system: Vec::with_capacity(2 * rows * rows),
            order: vec![0; rows],
            inverse: vec![0; rows],
            memory: MemBuffer::new(lu.or(llt)),
        }
    }

    /// Finds `M` from `C`, the change `N` and which nodes are held; false where the changed matrix is not positive definite
    /// or a number is not finite.
    pub(super) fn find(&mut self, N: &[f64], held: &[bool]) -> bool {
        self.held.clear();
        self.held.extend_from_slice(held);
        self.M.clear();
        let rows = 3 * held.len();
        if !(self.hold(rows) && self.stays_definite(N, rows) && self.invert_change(N, rows)) {
            return false;
        }
        self.join(rows);
        self.M.iter().all(|m| m.is_finite())
    }

    /// `C ← C_h`, with `Y` and `(Eᵀ C E)⁻¹` kept; false where `A₀` is not positive definite.
    fn hold(&mut self, rows: usize) -> bool {
        let held = held_rows(&self.held).count();
        self.Y.clear();
        self.stiffness.clear();
        if held == 0 {
            return true;
        }
        let (C, place) = (&self.C, |column: usize| column * rows);
        self.system.clear();
        self.system.extend(held_rows(&self.held).flat_map(|j| held_rows(&self.held).map(move |i| C[place(j) + i])));
        self.Y.extend((0..rows).flat_map(|j| held_rows(&self.held).map(move |i| C[place(j) + i])));
        let mut L = MatMut::from_column_major_slice_mut(&mut self.system, held, held);
        let memory = MemStack::new(&mut self.memory);
        if cholesky_in_place(L.rb_mut(), LltRegularization::default(), Par::Seq, memory, llt_params()).is_err() {
            return false;
        }
        // Z = L⁻¹ Eᵀ C, C_h = C - Zᵀ Z, Y = L⁻ᵀ Z
        let mut Z = MatMut::from_column_major_slice_mut(&mut self.Y, held, rows);
        solve_lower_triangular_in_place(L.rb(), Z.rb_mut(), Par::Seq);
        let C = MatMut::from_column_major_slice_mut(&mut self.C, rows, rows);
        matmul(C, Accum::Add, Z.rb().transpose(), Z.rb(), -1.0, Par::Seq);
        solve_upper_triangular_in_place(L.rb().transpose(), Z, Par::Seq);
        self.stiffness.resize(held * held, 0.0);
        self.stiffness.iter_mut().step_by(held + 1).for_each(|one| *one = 1.0);
        let mut inverse = MatMut::from_column_major_slice_mut(&mut self.stiffness, held, held);
        solve_lower_triangular_in_place(L.rb(), inverse.rb_mut(), Par::Seq);
        solve_upper_triangular_in_place(L.rb().transpose(), inverse, Par::Seq);
        for row in held_rows(&self.held) {
            self.C[row * rows..(row + 1) * rows].fill(0.0);
            self.C.iter_mut().skip(row).step_by(rows).for_each(|c| *c = 0.0);
        }
        true
    }

    /// Whether `A₁` is positive definite: just where `C_h + C_h N C_h`, its Schur complement, is on the nodes not held.
    fn stays_definite(&mut self, N: &[f64], rows: usize) -> bool {
        let C = MatRef::from_column_major_slice(&self.C, rows, rows);
        self.system.clear();
        self.system.resize(2 * rows * rows, 0.0);
        let (CN, schur) = self.system.split_at_mut(rows * rows);
        let mut CN = MatMut::from_column_major_slice_mut(CN, rows, rows);
        matmul(CN.rb_mut(), Accum::Replace, C, MatRef::from_column_major_slice(N, rows, rows), 1.0, Par::Seq);
        schur.copy_from_slice(&self.C);
        let mut schur = MatMut::from_column_major_slice_mut(schur, rows, rows);
        matmul(schur.rb_mut(), Accum::Add, CN.rb(), C, 1.0, Par::Seq);
        for row in held_rows(&self.held) {
            schur[(row, row)] = 1.0;
        }
        let memory = MemStack::new(&mut self.memory);
        cholesky_in_place(schur, LltRegularization::default(), Par::Seq, memory, llt_params()).is_ok()
    }

    /// `M ← (I + N C_h)⁻¹ N`, zero at held nodes; false where that is singular.
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

    /// `M ← E (Eᵀ C E)⁻¹ Eᵀ + (I - E Y) M (I - E Y)ᵀ`.
    fn join(&mut self, rows: usize) {
        let held = held_rows(&self.held).count();
        if held == 0 {
            return;
        }
        let Y = MatRef::from_column_major_slice(&self.Y, held, rows);
        self.system.clear();
        self.system.resize(held * rows, 0.0);
        let mut YM = MatMut::from_column_major_slice_mut(&mut self.system, held, rows);
        let M = MatRef::from_column_major_slice(&self.M, rows, rows);
        matmul(YM.rb_mut(), Accum::Replace, Y, M, 1.0, Par::Seq);
        let corner = MatMut::from_column_major_slice_mut(&mut self.stiffness, held, held);
        matmul(corner, Accum::Add, YM.rb(), Y.transpose(), 1.0, Par::Seq);
        // M is zero in the rows and columns of held nodes.
        for (a, row) in held_rows(&self.held).enumerate() {
            for column in (0..rows).filter(|column| !self.held[column / 3]) {
                let value = -self.system[column * held + a];
                (self.M[column * rows + row], self.M[row * rows + column]) = (value, value);
            }
            for (b, column) in held_rows(&self.held).enumerate() {
                self.M[column * rows + row] = self.stiffness[b * held + a];
            }
        }
    }
}

/// Rows of the held nodes among those of all nodes that a change touches.
fn held_rows(held: &[bool]) -> impl Iterator<Item = usize> + '_ {
    (0..3 * held.len()).filter(|row| held[row / 3])
}

fn lu_params() -> Spec<PartialPivLuParams, f64> {
    Spec::new(<PartialPivLuParams as Auto<f64>>::auto())
}

fn llt_params() -> Spec<LltParams, f64> {
    Spec::new(<LltParams as Auto<f64>>::auto())
}
