//! Motions under forces on rows whose half solves are at hand: `A⁻¹ Hᵀ λ = Pᵀ L⁻ᵀ Y λ`.

use super::numeric::Factor;
use super::reach::{ReachWorkspace, rows_per_block};
use super::solve::{SolveStatus, permute_back};
use super::substitution;
use super::symbolic::SymbolicFactor;

impl ReachWorkspace {
    /// As [`SolveWorkspace::take_in_full`](super::SolveWorkspace::take_in_full), of [`Factor::guess_correction`].
    pub fn take_in_full(&mut self) -> u32 {
        std::mem::take(&mut self.in_full)
    }

    /// Adds `Y λ` to `permuted`.
    fn add_combination(&mut self, symbolic: &SymbolicFactor, lambda: &[f64]) {
        if let Some(nodal) = self.nodal.as_mut().filter(|_| self.by_nodes) {
            nodal.add_combination(symbolic, lambda, &mut self.permuted);
            return;
        }
        for (sorted, &r) in self.lambda.iter_mut().zip(&self.sorted) {
            *sorted = lambda[r as usize];
        }
        let (blocks, lambda) = (&self.blocks[..self.used], &self.lambda[..self.rows]);
        for (block, lambda) in blocks.iter().zip(lambda.chunks(rows_per_block(self.rows))) {
            block.add_combination(symbolic, lambda, &mut self.permuted);
        }
    }
}

impl Factor {
    /// `x = A⁻¹ Hᵀ λ` for the rows of the last half solve with this factor: `Y λ` and one backward substitution.
    ///
    /// `lambda` has one entry per row, `x` length `3 n`. Allocates nothing.
    pub fn correct(&self, lambda: &[f64], x: &mut [f64], workspace: &mut ReachWorkspace) -> SolveStatus {
        self.correct_by(false, lambda, x, workspace)
    }

    /// As [`Self::correct`], by the copy of `L` in 16 bits where there is one, with the error of [`Self::precondition`]. For
    /// what conjugate gradients start from.
    pub fn guess_correction(&self, lambda: &[f64], x: &mut [f64], workspace: &mut ReachWorkspace) -> SolveStatus {
        self.correct_by(true, lambda, x, workspace)
    }

    fn correct_by(&self, copy: bool, lambda: &[f64], x: &mut [f64], workspace: &mut ReachWorkspace) -> SolveStatus {
        if !self.is_valid() {
            return SolveStatus::InvalidFactor;
        }
        if workspace.revision != self.revision() {
            return SolveStatus::OtherFactor;
        }
        if lambda.len() != workspace.rows || x.len() != self.symbolic().degrees_of_freedom() {
            return SolveStatus::WrongSize;
        }
        workspace.permuted.fill(0.0);
        workspace.add_combination(self.symbolic(), lambda);
        let permuted = &mut workspace.permuted;
        let by_copy = self.packed().filter(|_| copy).is_some_and(|packed| {
            workspace.packed.take(permuted);
            workspace.packed.backward(self.symbolic(), packed);
            workspace.packed.give(permuted)
        });
        if !by_copy {
            workspace.in_full += u32::from(copy && self.keeps_copy());
            substitution::backward(self.symbolic(), self.values(), permuted, &mut workspace.front_rows);
        }
        permute_back(&self.symbolic().ordering().old_of_new, &workspace.permuted, x);
        if let Some(update) = self.changed() {
            update.finish_solve(x, &mut workspace.change);
        }
        SolveStatus::Ok
    }
}
