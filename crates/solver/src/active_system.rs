//! The linear system of one Newton step, in the unknowns that are left once the given forces are taken out.
//!
//! With the laws' equations in their own frames (see [`Linearization`]) the change of the forces is
//!
//! ```text
//! d = d_given + sum_l c_l sqrt(rho_l) z_l
//! ```
//!
//! with a direction `c_l` for each unknown: a row that is closed, the normal of a sliding contact together with the
//! friction that grows with it (`n + mu u`), and the turning of that friction (`v`, across the slip). Open contacts have
//! none. Each unknown has an equation on the row `t_l` that it closes,
//!
//! ```text
//! g_k sqrt(rho_k) t_k . W d + (1 - g_k) z_k = -F_k / sqrt(rho_k)
//! ```
//!
//! so that the matrix is of order one for any stiffness of the bodies. It is solved by iteration in single precision
//! ([`KrylovSpace`]), where the matrix is not formed, or by a factorisation in double precision.

use crate::coupled_block::CoupledBlock;
use crate::dense::LinearSystem;
use crate::krylov::KrylovSpace;
use crate::problem::{Block, ProblemView, gather, scatter};
use crate::single::SingleCompliance;
use crate::vectors::add_columns;
use nalgebra::{Matrix3, Vector3};
use palpate_constraints::law::{Linearization, LocalCompliance, RowEquation};

/// An unknown of the system.
#[derive(Clone, Copy, Debug)]
struct Unknown {
    /// Forces per unit, in the rows of the contact: `c_l`.
    direction: Vector3<f64>,
    /// The row it closes: `t_l`.
    test: Vector3<f64>,
    /// `g_l`, 1 for a closed row.
    weight: f64,
    /// `F_l`, N.
    value: f64,
}

/// A block with unknowns.
#[derive(Clone, Copy, Debug)]
struct ActiveBlock {
    block: Block,
    /// Number of its first unknown.
    first: usize,
    unknowns: [Unknown; 3],
    count: usize,
    /// `sqrt(rho)`, (N/m)^1/2.
    scale: f64,
}

/// How a system is to be solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// Added to the diagonals of closed rows, which are of order one.
    pub(crate) shift: f64,
    /// Error that is good enough, relative, for a solution by iteration; `None` for a factorisation.
    pub(crate) iterative: Option<f64>,
    /// Unknowns up to which there is time for a factorisation.
    pub(crate) largest_factor: usize,
}

/// Memory of the systems of a run.
#[derive(Clone, Debug)]
pub(crate) struct ActiveSystem {
    blocks: Vec<ActiveBlock>,
    /// Changes of the forces that the laws give: block, and N.
    given: Vec<(Block, Vector3<f64>)>,
    /// `sqrt(rho)` of every block of the problem.
    scales: Vec<f64>,
    /// `W d_given`, m.
    gap: Vec<f64>,
    /// `W c_l` of one unknown, m.
    image: Vec<f64>,
    system: LinearSystem,
    krylov: KrylovSpace,
    coupled: Vec<CoupledBlock>,
    single: SingleCompliance,
    /// `W d_given` in single precision, relative to the largest of `d_given`.
    single_gap: Vec<f32>,
    /// Right side, a quad for each block.
    right: Vec<[f64; 4]>,
    /// The change of the forces, N.
    pub(crate) direction: Vec<f64>,
}

impl ActiveSystem {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self {
            blocks: Vec::with_capacity(rows),
            given: Vec::with_capacity(rows),
            scales: Vec::with_capacity(rows),
            gap: Vec::with_capacity(rows),
            image: Vec::with_capacity(rows),
            system: LinearSystem::with_capacity(rows),
            krylov: KrylovSpace::with_capacity(rows, rows),
            coupled: Vec::with_capacity(rows),
            single: SingleCompliance::with_capacity(rows),
            single_gap: Vec::with_capacity(SingleCompliance::longest(rows)),
            right: Vec::with_capacity(rows),
            direction: Vec::with_capacity(rows),
        }
    }

    /// Forgets the last problem; room for one of so many rows.
    pub(crate) fn begin(&mut self, rows: usize) {
        self.scales.clear();
        self.single.begin(rows);
    }

    /// The direction of Newton at the forces and their gap, left in `direction`; `false` where the system is singular,
    /// or the time does not allow for a factorisation.
    pub(crate) fn solve(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        lambda: &[f64],
        way: &Way,
    ) -> bool {
        let size = self.linearize(view, local, delta, lambda);
        size == 0
            || way.iterative.is_some_and(|tolerance| self.iterate(view, tolerance, way.shift))
            || size <= way.largest_factor && self.factor(view, size, way.shift)
    }

    /// Sorts the rows into given and unknown forces; returns the number of unknowns.
    fn linearize(&mut self, view: &ProblemView<'_>, local: &[LocalCompliance], delta: &[f64], lambda: &[f64]) -> usize {
        if self.scales.is_empty() {
            self.scales.extend(local.iter().map(|local| local.rho().sqrt()));
        }
        self.blocks.clear();
        self.given.clear();
        self.direction.clear();
        self.direction.resize(view.rows(), 0.0);
        let mut size = 0;
        for ((block, local), scale) in view.blocks.iter().zip(local).zip(&self.scales) {
            let force = gather(lambda, block);
            let mut given = -force;
            if !local.is_rigid() {
                let equation = block.law.linearize(local.rho(), &gather(delta, block), &force);
                let mut active = ActiveBlock::new(block, size, *scale);
                given = active.read(&equation);
                if active.count > 0 {
                    size += active.count;
                    self.blocks.push(active);
                }
            }
            if given != Vector3::zeros() {
                scatter(&given, block, &mut self.direction);
                self.given.push((*block, given));
            }
        }
        size
    }

    /// Solves by iteration to a relative error; `false` where that is not reached.
    fn iterate(&mut self, view: &ProblemView<'_>, tolerance: f64, shift: f64) -> bool {
        let Self { blocks, given, krylov, coupled, single, single_gap, right, direction, .. } = self;
        let with_unknowns = blocks.iter().map(|active| &active.block);
        single.admit(view, with_unknowns.chain(given.iter().map(|(block, _)| block)));
        // Relative to their largest, so that they stay in the range of single precision.
        let size = given.iter().fold(f64::MIN_POSITIVE, |size, (_, force)| size.max(force.amax()));
        single_gap.clear();
        single_gap.resize(single.length(), 0.0);
        for (block, force) in given.iter() {
            single.accumulate(block, &(force / size), single_gap);
        }
        right.clear();
        coupled.clear();
        for active in blocks.iter() {
            let Some(block) = active.couple(view, single, shift) else { return false };
            let gap = block.read(single_gap);
            right.push(active.right(&(Vector3::new(gap[0], gap[1], gap[2]).map(f64::from) * size)));
            coupled.push(block);
        }
        let Some(solution) = krylov.solve(single, coupled, right, tolerance) else { return false };
        for (active, z) in blocks.iter().zip(solution) {
            active.add(z, direction);
        }
        true
    }

    /// Solves by a factorisation; `false` where the matrix is singular.
    fn factor(&mut self, view: &ProblemView<'_>, size: usize, shift: f64) -> bool {
        let Self { blocks, given, gap, image, system, direction, .. } = self;
        gap.clear();
        gap.resize(view.rows(), 0.0);
        for (block, force) in given.iter() {
            add_columns(view, block, force, gap);
        }
        system.reset(size);
        for from in blocks.iter() {
            for (j, unknown) in from.unknowns().iter().enumerate() {
                image.clear();
                image.resize(view.rows(), 0.0);
                add_columns(view, &from.block, &(unknown.direction * from.scale), image);
                let column = system.column_mut(from.first + j);
                for to in blocks.iter() {
                    let gap = gather(image, &to.block) * to.scale;
                    for (entry, unknown) in column.iter_mut().skip(to.first).zip(to.unknowns()) {
                        *entry = unknown.weight * unknown.test.dot(&gap);
                    }
                }
                if let Some(diagonal) = column.get_mut(from.first + j) {
                    *diagonal += unknown.own(shift);
                }
            }
        }
        let column = system.column_mut(size);
        for active in blocks.iter() {
            let right = active.right(&gather(gap, &active.block));
            for (entry, right) in column.iter_mut().skip(active.first).zip(&right[..active.count]) {
                *entry = *right;
            }
        }
        let Some(solution) = system.solve() else { return false };
        for active in blocks.iter() {
            active.add(solution.get(active.first..active.first + active.count).unwrap_or(&[]), direction);
        }
        true
    }
}

impl Unknown {
    /// Factor of the unknown in its own equation, beside what comes through `W`.
    fn own(&self, shift: f64) -> f64 {
        self.weight * shift + (1.0 - self.weight)
    }
}

impl ActiveBlock {
    fn new(block: &Block, first: usize, scale: f64) -> Self {
        let none = Unknown { direction: Vector3::zeros(), test: Vector3::zeros(), weight: 1.0, value: 0.0 };
        Self { block: *block, first, unknowns: [none; 3], count: 0, scale }
    }

    #[inline]
    fn unknowns(&self) -> &[Unknown] {
        self.unknowns.get(..self.count).unwrap_or(&[])
    }

    /// Takes the unknowns from the law's equation; returns the change of the given forces, in rows of the contact.
    fn read(&mut self, equation: &Linearization) -> Vector3<f64> {
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
        given
    }

    fn push(&mut self, axis: Vector3<f64>, weight: f64, value: f64) {
        if let Some(unknown) = self.unknowns.get_mut(self.count) {
            *unknown = Unknown { direction: axis, test: axis, weight, value };
            self.count += 1;
        }
    }

    /// Right sides of the block's equations, with the `gap` (m) that the given forces make.
    fn right(&self, gap: &Vector3<f64>) -> [f64; 4] {
        let mut right = [0.0; 4];
        for (entry, unknown) in right.iter_mut().zip(self.unknowns()) {
            *entry = -unknown.value / self.scale - unknown.weight * self.scale * unknown.test.dot(gap);
        }
        right
    }

    /// The block's equations in single precision; `None` where it was not admitted.
    fn couple(&self, view: &ProblemView<'_>, single: &SingleCompliance, shift: f64) -> Option<CoupledBlock> {
        let (mut tests, mut directions, mut own) = (Matrix3::zeros(), Matrix3::zeros(), Vector3::repeat(1.0));
        for (l, unknown) in self.unknowns().iter().enumerate() {
            tests.set_row(l, &(unknown.test * (unknown.weight * self.scale)).transpose());
            directions.set_column(l, &(unknown.direction * self.scale));
            own[l] = unknown.own(shift);
        }
        let (place, rows) = (single.place(&self.block)?, self.block.law.rows());
        Some(CoupledBlock::new(place, rows, &tests, &directions, &own, &view.diagonal_block(&self.block)))
    }

    /// Adds the forces that belong to values of the unknowns.
    fn add(&self, z: &[f64], direction: &mut [f64]) {
        let mut force = gather(direction, &self.block);
        for (unknown, z) in self.unknowns().iter().zip(z) {
            force += unknown.direction * (z * self.scale);
        }
        scatter(&force, &self.block, direction);
    }
}
