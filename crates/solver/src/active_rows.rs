//! The rows of a problem, sorted for a step of Newton: forces that the laws give, and unknowns.
//!
//! The symbols are those of [`crate::active_system`].

use crate::active_block::ActiveBlock;
use crate::problem::{Block, ProblemView, gather, scatter};
use crate::vectors::add_columns;
use nalgebra::Vector3;
use palpate_constraints::law::LocalCompliance;

/// A change of the force of a block without unknowns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GivenForce {
    pub(crate) block: Block,
    /// N.
    pub(crate) force: Vector3<f64>,
    /// `sqrt(rho)`, (N/m)^1/2.
    pub(crate) scale: f64,
}

/// Memory of the sorting, and of the step that comes of it.
#[derive(Clone, Debug)]
pub(crate) struct ActiveRows {
    /// Blocks with unknowns.
    pub(crate) blocks: Vec<ActiveBlock>,
    /// Changes of the forces that the laws give to blocks without unknowns.
    pub(crate) given: Vec<GivenForce>,
    /// The change of the forces, N.
    pub(crate) direction: Vec<f64>,
}

impl ActiveRows {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self { blocks: Vec::with_capacity(rows), given: Vec::with_capacity(rows), direction: Vec::with_capacity(rows) }
    }

    /// Sorts the rows at the forces `lambda` (N) and the gap `at` (m), and leaves the given forces in `direction`; `scales` are
    /// `sqrt(rho)` of the blocks. Returns the number of unknowns.
    pub(crate) fn sort(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        scales: impl Iterator<Item = f64>,
        lambda: &[f64],
        at: &[f64],
    ) -> usize {
        self.blocks.clear();
        self.given.clear();
        self.direction.clear();
        self.direction.resize(view.rows(), 0.0);
        let mut size = 0;
        for ((block, local), scale) in view.blocks.iter().zip(local).zip(scales) {
            let force = gather(lambda, block);
            let mut given = -force;
            if !local.is_rigid() {
                let equation = block.law.linearize(local.rho(), &gather(at, block), &force);
                let mut active = ActiveBlock::new(block, size, scale);
                given = active.read(&equation);
                if active.count > 0 {
                    size += active.count;
                    self.blocks.push(active);
                }
            }
            if given != Vector3::zeros() {
                scatter(&given, block, &mut self.direction);
                if self.blocks.last().is_none_or(|last| last.block.start != block.start) {
                    self.given.push(GivenForce { block: *block, force: given, scale });
                }
            }
        }
        size
    }

    /// `gap += W d_given`, m.
    pub(crate) fn add_given(&self, view: &ProblemView<'_>, gap: &mut [f64]) {
        for given in &self.given {
            add_columns(view, &given.block, &given.force, gap);
        }
        for active in self.blocks.iter().filter(|active| active.given != Vector3::zeros()) {
            add_columns(view, &active.block, &active.given, gap);
        }
    }

    /// The right sides of all equations, with the `gap` (m) that the given forces make.
    pub(crate) fn fill_right(&self, gap: &[f64], column: &mut [f64]) {
        for active in &self.blocks {
            let right = active.right(&gather(gap, &active.block));
            for (entry, right) in column.iter_mut().skip(active.first).zip(&right[..active.count]) {
                *entry = *right;
            }
        }
    }

    /// Adds the forces of the unknowns to `direction`.
    pub(crate) fn add_solution(&mut self, solution: &[f64]) {
        for active in &self.blocks {
            let own = solution.get(active.first..active.first + active.count).unwrap_or(&[]);
            active.add(own, &mut self.direction);
        }
    }
}
