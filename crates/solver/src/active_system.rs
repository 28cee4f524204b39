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
//! so that the matrix is of order one for any stiffness of the bodies. Columns of `W` are read where they lie; those of
//! a sliding contact are combined once.

use crate::columns::Columns;
use crate::dense::LinearSystem;
use crate::gauss_seidel::add_columns;
use crate::krylov::KrylovSystem;
use crate::problem::{Block, ProblemView, gather, scatter};
use nalgebra::Vector3;
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
    shape: Shape,
    /// `sqrt(rho)`, (N/m)^1/2.
    scale: f64,
}

/// What the unknowns of a block are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    /// Its rows, all closed.
    Rows,
    /// The normal with the friction that grows with it, and the turning of that friction.
    Slip,
    /// Anything else.
    Mixed,
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
    /// `sqrt(rho)` of every block of the problem.
    scales: Vec<f64>,
    /// `W d_given`, m.
    gap: Vec<f64>,
    /// `W c_l` of the unknowns of one block, m.
    image: Vec<f64>,
    system: LinearSystem,
    krylov: KrylovSystem,
    /// The change of the forces, N.
    pub(crate) direction: Vec<f64>,
}

impl ActiveSystem {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self {
            blocks: Vec::with_capacity(rows),
            scales: Vec::with_capacity(rows),
            gap: Vec::with_capacity(rows),
            image: Vec::with_capacity(rows),
            system: LinearSystem::with_capacity(rows),
            krylov: KrylovSystem::with_capacity(rows),
            direction: Vec::with_capacity(rows),
        }
    }

    /// Forgets the last problem.
    pub(crate) fn begin(&mut self) {
        self.scales.clear();
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
        if size > 0 {
            let Self { blocks, gap, image, system, krylov, direction, .. } = self;
            let mut solution = None;
            if let Some(tolerance) = way.iterative {
                krylov.reset(size);
                assemble(view, blocks, gap, image, way.shift, size, krylov);
                solution = krylov.solve(tolerance);
            }
            if solution.is_none() && size <= way.largest_factor {
                system.reset(size);
                assemble(view, blocks, gap, image, way.shift, size, system);
                solution = system.solve();
            }
            let Some(solution) = solution else { return false };
            for active in blocks.iter() {
                let mut force = gather(direction, &active.block);
                for (unknown, z) in active.unknowns().iter().zip(solution.iter().skip(active.first)) {
                    force += unknown.direction * (z * active.scale);
                }
                scatter(&force, &active.block, direction);
            }
        }
        true
    }

    /// Sorts the rows into given and unknown forces; returns the number of unknowns.
    fn linearize(&mut self, view: &ProblemView<'_>, local: &[LocalCompliance], delta: &[f64], lambda: &[f64]) -> usize {
        if self.scales.is_empty() {
            self.scales.extend(local.iter().map(|local| local.rho().sqrt()));
        }
        self.blocks.clear();
        for vector in [&mut self.direction, &mut self.gap] {
            vector.clear();
            vector.resize(view.rows(), 0.0);
        }
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
                add_columns(view, block, &given, &mut self.gap);
            }
        }
        size
    }
}

/// Writes matrix and right side.
fn assemble<S: Columns>(
    view: &ProblemView<'_>,
    blocks: &[ActiveBlock],
    gap: &[f64],
    image: &mut Vec<f64>,
    shift: f64,
    size: usize,
    system: &mut S,
) {
    for from in blocks {
        for (j, unknown) in from.unknowns().iter().enumerate() {
            let compliance = if from.shape == Shape::Rows {
                view.column(from.block.start + j)
            } else {
                image.clear();
                image.resize(view.rows(), 0.0);
                add_columns(view, &from.block, &unknown.direction, image);
                image.as_slice()
            };
            let column = system.column_mut(from.first + j);
            for to in blocks {
                to.write(compliance, from.scale, column, S::entry);
            }
            if let Some(diagonal) = column.get_mut(from.first + j) {
                S::add(diagonal, unknown.weight * shift + (1.0 - unknown.weight));
            }
        }
    }
    let right = system.column_mut(size);
    for active in blocks {
        let gap = gather(gap, &active.block);
        for (unknown, entry) in active.unknowns().iter().zip(right.iter_mut().skip(active.first)) {
            *entry = S::entry(-unknown.value / active.scale - unknown.weight * active.scale * unknown.test.dot(&gap));
        }
    }
}

impl ActiveBlock {
    fn new(block: &Block, first: usize, scale: f64) -> Self {
        let none = Unknown { direction: Vector3::zeros(), test: Vector3::zeros(), weight: 1.0, value: 0.0 };
        Self { block: *block, first, unknowns: [none; 3], count: 0, shape: Shape::Rows, scale }
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
                    self.shape = Shape::Mixed;
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
        if let [RowEquation::Closed { .. }, RowEquation::Given { .. }, RowEquation::Turning { .. }] = equation.rows {
            self.shape = Shape::Slip;
        }
        given
    }

    fn push(&mut self, axis: Vector3<f64>, weight: f64, value: f64) {
        if let Some(unknown) = self.unknowns.get_mut(self.count) {
            *unknown = Unknown { direction: axis, test: axis, weight, value };
            self.count += 1;
        }
    }

    /// The entries of the block's equations in the column of an unknown with the gaps `compliance` and the scale `from`.
    #[inline]
    fn write<E>(&self, compliance: &[f64], from: f64, column: &mut [E], of: impl Fn(f64) -> E) {
        let factor = self.scale * from;
        let Some(entries) = column.get_mut(self.first..self.first + self.count) else { return };
        let gaps = compliance.get(self.block.start..).unwrap_or(&[]);
        match (self.shape, entries, gaps) {
            (Shape::Rows, [n, t, s], [a, b, c, ..]) => {
                *n = of(factor * a);
                *t = of(factor * b);
                *s = of(factor * c);
            }
            (Shape::Rows, entries, gaps) => {
                for (entry, w) in entries.iter_mut().zip(gaps) {
                    *entry = of(factor * w);
                }
            }
            (Shape::Slip, [n, v], [a, b, c, ..]) => {
                let across = &self.unknowns[1];
                *n = of(factor * a);
                *v = of(factor * across.weight * (across.test.y * b + across.test.z * c));
            }
            (_, entries, _) => {
                let gap = gather(compliance, &self.block) * factor;
                for (entry, unknown) in entries.iter_mut().zip(&self.unknowns) {
                    *entry = of(unknown.weight * unknown.test.dot(&gap));
                }
            }
        }
    }
}
