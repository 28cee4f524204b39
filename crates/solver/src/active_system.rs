//! The linear system of one Newton step, in the unknowns that are left once the given forces are taken out.
//!
//! With the laws' equations in their own frames (see [`Linearization`](palpate_constraints::law::Linearization)) the
//! change of the forces is
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

use crate::active_block::ActiveBlock;
use crate::active_rows::ActiveRows;
use crate::coupled_block::CoupledBlock;
use crate::dense::LinearSystem;
use crate::first_substitution::FirstSubstitution;
use crate::krylov::KrylovSpace;
use crate::problem::{ProblemView, gather};
use crate::single::SingleCompliance;
use crate::vectors::add_columns;
use palpate_constraints::law::LocalCompliance;
use pulp::{Arch, Simd, WithSimd};

/// Iterations for each unknown beyond which a system of that size is solved faster by a factorisation.
const DEAR: f64 = 0.2;

/// Shifts from which on iteration is tried again: it then does not take many.
const DEAR_SHIFT: f64 = 1e-3;

/// How a system is to be solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// Added to the diagonals of closed rows, which are of order one.
    pub(crate) shift: f64,
    /// Error that is good enough, relative, for a solution by iteration.
    pub(crate) accuracy: f64,
    /// Unknowns up to which there is time for a factorisation.
    pub(crate) largest_factor: usize,
}

/// Memory of the systems of a run.
#[derive(Clone, Debug)]
pub(crate) struct ActiveSystem {
    pub(crate) rows: ActiveRows,
    /// `sqrt(rho)` of every block of the problem.
    scales: Vec<f64>,
    /// `W d_given`, m.
    gap: Vec<f64>,
    /// `W c_l` of one unknown, m.
    image: Vec<f64>,
    system: LinearSystem,
    krylov: KrylovSpace,
    /// Iterations of the last solution by iteration.
    last_iterations: usize,
    coupled: Vec<CoupledBlock>,
    pub(crate) single: SingleCompliance,
    first: FirstSubstitution,
}

impl ActiveSystem {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self {
            rows: ActiveRows::with_capacity(rows),
            scales: Vec::with_capacity(rows),
            gap: Vec::with_capacity(rows),
            image: Vec::with_capacity(rows),
            system: LinearSystem::with_capacity(rows),
            krylov: KrylovSpace::with_capacity(rows, rows),
            last_iterations: 0,
            coupled: Vec::with_capacity(rows),
            single: SingleCompliance::with_capacity(rows),
            first: FirstSubstitution::with_capacity(rows, rows),
        }
    }

    /// Forgets the last problem; room for one of so many rows.
    pub(crate) fn begin(&mut self, rows: usize) {
        self.scales.clear();
        self.single.begin(rows);
        self.last_iterations = 0;
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
        if self.scales.is_empty() {
            self.scales.extend(local.iter().map(|local| local.rho().sqrt()));
        }
        let size = self.rows.sort(view, local, self.scales.iter().copied(), lambda, delta);
        if size == 0 {
            return true;
        }
        let fits = size <= way.largest_factor;
        let dear = self.last_iterations as f64 > DEAR * size as f64 && way.shift < DEAR_SHIFT;
        fits && dear && self.factor(view, size, way.shift)
            || self.iterate(view, way.accuracy, way.shift)
            || fits && !dear && self.factor(view, size, way.shift)
    }

    /// Solves by iteration to a relative error; `false` where that is not reached.
    fn iterate(&mut self, view: &ProblemView<'_>, tolerance: f64, shift: f64) -> bool {
        let Self { rows, krylov, coupled, single, first, last_iterations, .. } = self;
        let ActiveRows { blocks, given, direction } = rows;
        let with_unknowns = blocks.iter().map(|active| &active.block);
        single.admit(view, with_unknowns.chain(given.iter().map(|given| &given.block)));
        coupled.clear();
        if !Arch::new().dispatch(Couple { blocks, single, shift, coupled }) {
            return false;
        }
        let Some((right, size)) = first.run(single, coupled, blocks, given) else { return false };
        let solution = krylov.solve(single, coupled, right, tolerance * size);
        *last_iterations = solution.map_or(usize::MAX, |(_, iterations)| iterations);
        let Some((solution, _)) = solution else { return false };
        first.add(blocks, solution, direction);
        true
    }

    /// Solves by a factorisation; `false` where the matrix is singular.
    fn factor(&mut self, view: &ProblemView<'_>, size: usize, shift: f64) -> bool {
        let Self { rows, gap, image, system, .. } = self;
        gap.clear();
        gap.resize(view.rows(), 0.0);
        rows.add_given(view, gap);
        let matrix = &mut system.augmented;
        matrix.reset(size);
        for from in &rows.blocks {
            for (j, unknown) in from.unknowns().iter().enumerate() {
                image.clear();
                image.resize(view.rows(), 0.0);
                add_columns(view, &from.block, &(unknown.direction * from.scale), image);
                let column = matrix.column_mut(from.first + j);
                for to in &rows.blocks {
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
        rows.fill_right(gap, matrix.column_mut(size));
        let Some(solution) = system.solve() else { return false };
        rows.add_solution(solution);
        true
    }
}

/// Forms the equations of the blocks; `false` where one of them was not admitted.
struct Couple<'a> {
    blocks: &'a [ActiveBlock],
    single: &'a SingleCompliance,
    shift: f64,
    coupled: &'a mut Vec<CoupledBlock>,
}

impl WithSimd for Couple<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        for active in self.blocks {
            let Some(block) = active.couple(self.single, self.shift) else { return false };
            self.coupled.push(block);
        }
        true
    }
}
