//! A contact in the linear system of a Newton step: its unknowns and the equations that they close.
//!
//! The symbols are those of [`crate::active_system`].

use crate::coupled_block::CoupledBlock;
use crate::problem::{Block, gather, scatter};
use crate::single::SingleCompliance;
use nalgebra::Vector3;
use palpate_constraints::law::{Linearization, RowEquation};

/// An unknown of the system.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unknown {
    /// Forces per unit, in the rows of the contact: `c_l`.
    pub(crate) direction: Vector3<f64>,
    /// The row it closes: `t_l`.
    pub(crate) test: Vector3<f64>,
    /// `g_l`, 1 for a closed row.
    pub(crate) weight: f64,
    /// `F_l`, N.
    value: f64,
}

/// A block with unknowns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ActiveBlock {
    pub(crate) block: Block,
    /// Number of its first unknown.
    pub(crate) first: usize,
    unknowns: [Unknown; 3],
    pub(crate) count: usize,
    /// `sqrt(rho)`, (N/m)^1/2.
    pub(crate) scale: f64,
    /// Change of the forces that the law gives, in rows of the contact, N.
    pub(crate) given: Vector3<f64>,
}

impl Unknown {
    /// Factor of the unknown in its own equation, beside what comes through `W`.
    pub(crate) fn own(&self, shift: f64) -> f64 {
        self.weight * shift + (1.0 - self.weight)
    }
}

impl ActiveBlock {
    /// The block without unknowns; the next of the system has the number `first`, and `scale` is `sqrt(rho)`.
    pub(crate) fn new(block: &Block, first: usize, scale: f64) -> Self {
        let none = Unknown { direction: Vector3::zeros(), test: Vector3::zeros(), weight: 1.0, value: 0.0 };
        Self { block: *block, first, unknowns: [none; 3], count: 0, scale, given: Vector3::zeros() }
    }

    /// The unknowns, in the order of their numbers.
    #[inline]
    pub(crate) fn unknowns(&self) -> &[Unknown] {
        self.unknowns.get(..self.count).unwrap_or(&[])
    }

    /// Takes the unknowns from the law's equation; returns the change of the given forces.
    pub(crate) fn read(&mut self, equation: &Linearization) -> Vector3<f64> {
        let frame = equation.frame();
        let mut given = Vector3::zeros();
        let rows = self.block.law.rows().min(3);
        let mut normal = Vector3::x();
        for (i, row) in equation.rows.iter().enumerate().take(rows) {
            let axis: Vector3<f64> = frame.column(i).into();
            match *row {
                RowEquation::Given { excess, slope } => {
                    given -= axis * excess;
                    normal += axis * slope;
                }
                RowEquation::Closed { value } => self.push(axis, 1.0, value),
                RowEquation::Turning { value, weight } => {
                    self.push(axis, weight, value);
                }
            }
        }
        // The force of the normal row brings the friction that grows with it.
        if matches!(equation.rows[0], RowEquation::Closed { .. }) {
            self.unknowns[0].direction = normal;
        }
        self.given = given;
        given
    }

    fn push(&mut self, axis: Vector3<f64>, weight: f64, value: f64) {
        if let Some(unknown) = self.unknowns.get_mut(self.count) {
            *unknown = Unknown { direction: axis, test: axis, weight, value };
            self.count += 1;
        }
    }

    /// Right sides of the block's equations, with the `gap` (m) that the given forces make.
    #[inline]
    pub(crate) fn right(&self, gap: &Vector3<f64>) -> [f64; 4] {
        let mut right = [0.0; 4];
        for (entry, unknown) in right.iter_mut().zip(self.unknowns()) {
            *entry = -unknown.value / self.scale - unknown.weight * self.scale * unknown.test.dot(gap);
        }
        right
    }

    /// The block's equations in single precision; `None` where it was not admitted.
    #[inline(always)]
    pub(crate) fn couple(&self, single: &SingleCompliance, shift: f64) -> Option<CoupledBlock> {
        let (mut tests, mut directions, mut own) = ([[0.0; 4]; 3], [[0.0; 4]; 3], [1.0, 1.0, 1.0, 0.0]);
        for (l, unknown) in self.unknowns().iter().enumerate() {
            for c in 0..3 {
                tests[c][l] = (unknown.test[c] * (unknown.weight * self.scale)) as f32;
                directions[l][c] = (unknown.direction[c] * self.scale) as f32;
            }
            own[l] = unknown.own(shift) as f32;
        }
        let (place, rows) = (single.place(&self.block)?, self.block.law.rows());
        Some(CoupledBlock::new(place, rows, &tests, &directions, &own, &single.diagonal_block(place, rows)))
    }

    /// Adds the forces that belong to values of the unknowns.
    pub(crate) fn add(&self, z: &[f64], direction: &mut [f64]) {
        let mut force = gather(direction, &self.block);
        for (unknown, z) in self.unknowns().iter().zip(z) {
            force += unknown.direction * (z * self.scale);
        }
        scatter(&force, &self.block, direction);
    }
}
