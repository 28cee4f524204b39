//! Full solves with the factor.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::{Conj, MatMut, Par};

use super::low_rank::scratch_of_solve;
use super::numeric::Factor;
use super::packed_fronts::PackedWorkspace;
use super::substitution;
use super::symbolic::SymbolicFactor;

/// How a solve ended. On anything but `Ok` the vectors are left as they were.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolveStatus {
    /// Solved.
    Ok,
    /// The factor is invalid: no refactorisation has succeeded, or the last one failed.
    InvalidFactor,
    /// A vector or a workspace has the wrong length, or more columns than the workspace was made for.
    WrongSize,
    /// The half solves that a correction would reuse were taken from another factor, or there are none.
    OtherFactor,
}

impl SolveStatus {
    /// True for [`SolveStatus::Ok`].
    pub fn is_ok(self) -> bool {
        self == Self::Ok
    }
}

/// Scratch of full solves, for one thread.
pub struct SolveWorkspace {
    permuted: Vec<f64>,
    /// Rows below each front.
    rows: Vec<f64>,
    packed: PackedWorkspace,
    memory: MemBuffer,
    columns: usize,
    /// Rows below a supernode that `memory` suffices for.
    widest_pattern: usize,
    /// For the part of a change since the factorisation.
    change: Vec<f64>,
    in_full: u32,
}

impl SolveWorkspace {
    /// Memory for solves of one column.
    pub fn new(symbolic: &SymbolicFactor) -> Self {
        Self::with_columns(symbolic, 1)
    }

    /// Memory for solves of up to `columns` columns at once.
    pub fn with_columns(symbolic: &SymbolicFactor, columns: usize) -> Self {
        Self {
            permuted: vec![0.0; symbolic.degrees_of_freedom() * columns],
            memory: MemBuffer::new(symbolic.supernodes().solve_in_place_scratch::<f64>(columns, Par::Seq)),
            rows: vec![0.0; symbolic.tree().pattern_start(symbolic.supernode_count())],
            packed: PackedWorkspace::new(symbolic),
            columns,
            widest_pattern: symbolic.tree().widest_pattern(),
            change: vec![0.0; scratch_of_solve(symbolic.change_capacity())],
            in_full: 0,
        }
    }

    /// How many solves by the copy in 16 bits were asked for and done by the stored values, since this was asked last: the copy
    /// was refused, or a vector has left the range of single precision. They are as good, and take twice as long and more.
    pub fn take_in_full(&mut self) -> u32 {
        std::mem::take(&mut self.in_full)
    }
}

impl Factor {
    /// `x ← A⁻¹ x`, a vector of length `3 n` in the body's own order. Allocates nothing. On a worker of a pool, independent
    /// subtrees are solved side by side; the bits do not depend on it.
    pub fn solve(&self, x: &mut [f64], workspace: &mut SolveWorkspace) -> SolveStatus {
        self.solve_by(false, x, workspace)
    }

    /// As [`Self::solve`], by the copy of `L` in 16 bits where there is one: a quarter of the bytes in the order in which they
    /// are wanted, and a relative error of about 1e-5 times the root of the condition of `A`. For preconditioners. Where its
    /// numbers would leave the range of single precision, as [`Self::solve`], and counted
    /// ([`SolveWorkspace::take_in_full`]).
    pub fn precondition(&self, x: &mut [f64], workspace: &mut SolveWorkspace) -> SolveStatus {
        self.solve_by(true, x, workspace)
    }

    /// By the packed copy, or the stored values.
    fn solve_by(&self, copy: bool, x: &mut [f64], workspace: &mut SolveWorkspace) -> SolveStatus {
        let symbolic = self.symbolic();
        let n = symbolic.degrees_of_freedom();
        let fits = workspace.permuted.len() >= n
            && workspace.rows.len() == symbolic.tree().pattern_start(symbolic.supernode_count())
            && workspace.packed.fits(symbolic)
            && workspace.change.len() == scratch_of_solve(symbolic.change_capacity());
        if x.len() != n || !fits {
            return SolveStatus::WrongSize;
        }
        if !self.is_valid() {
            return SolveStatus::InvalidFactor;
        }
        let permuted = &mut workspace.permuted[..n];
        permute(&symbolic.ordering().old_of_new, x, permuted);
        let by_copy = self.packed().filter(|_| copy).is_some_and(|packed| {
            workspace.packed.take(permuted);
            workspace.packed.forward(symbolic, packed);
            workspace.packed.backward(symbolic, packed);
            workspace.packed.give(permuted)
        });
        if !by_copy {
            workspace.in_full += u32::from(copy && self.keeps_copy());
            substitution::forward(symbolic, self.values(), permuted, &mut workspace.rows);
            substitution::backward(symbolic, self.values(), permuted, &mut workspace.rows);
        }
        permute_back(&symbolic.ordering().old_of_new, permuted, x);
        if let Some(update) = self.changed() {
            update.finish_solve(x, &mut workspace.change);
        }
        SolveStatus::Ok
    }

    /// `X ← A⁻¹ X` for the columns of a dense matrix, one after another in `x`, each of length `3 n`.
    pub fn solve_columns(&self, x: &mut [f64], workspace: &mut SolveWorkspace) -> SolveStatus {
        let n = self.symbolic().degrees_of_freedom();
        let columns = x.len() / n;
        let fits = workspace.permuted.len() == n * workspace.columns
            && workspace.change.len() == scratch_of_solve(self.symbolic().change_capacity())
            && workspace.widest_pattern >= self.symbolic().tree().widest_pattern();
        if x.len() != n * columns || columns > workspace.columns || !fits {
            return SolveStatus::WrongSize;
        }
        if !self.is_valid() {
            return SolveStatus::InvalidFactor;
        }
        let order = &self.symbolic().ordering().old_of_new;
        let permuted = &mut workspace.permuted[..n * columns];
        for (x, permuted) in x.chunks_exact(n).zip(permuted.chunks_exact_mut(n)) {
            permute(order, x, permuted);
        }
        self.llt().solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(permuted, n, columns),
            Par::Seq,
            MemStack::new(&mut workspace.memory),
        );
        for (x, permuted) in x.chunks_exact_mut(n).zip(permuted.chunks_exact(n)) {
            permute_back(order, permuted, x);
            if let Some(update) = self.changed() {
                update.finish_solve(x, &mut workspace.change);
            }
        }
        SolveStatus::Ok
    }
}

/// `permuted = P x`, by nodes.
pub(super) fn permute(order: &[u32], x: &[f64], permuted: &mut [f64]) {
    for (&old, permuted) in order.iter().zip(permuted.chunks_exact_mut(3)) {
        let i = 3 * old as usize;
        permuted.copy_from_slice(&x[i..i + 3]);
    }
}

/// `x = Pᵀ permuted`, by nodes.
pub(super) fn permute_back(order: &[u32], permuted: &[f64], x: &mut [f64]) {
    for (&old, permuted) in order.iter().zip(permuted.chunks_exact(3)) {
        let i = 3 * old as usize;
        x[i..i + 3].copy_from_slice(permuted);
    }
}
