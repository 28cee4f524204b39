//! Block Gauss-Seidel with damped steps of Newton in between: for a thread that has time for a few dozen sweeps and no more.
//!
//! Sweeps settle what a contact does where it is, and are slow in what contacts do against one another: a body that nothing
//! but contacts holds yields to one force by its mass, and to two opposite ones by its elasticity, which may be a tenth of
//! that. Held between two jaws, a block moves by the squeeze of one jaw rather than let the force of the other rise; thirty
//! sweeps leave a percent of the gaps. A step solves for all forces that are closed or slide at once,
//! ```text
//! (dF/dlambda + dF/ddelta W + shift) d = -F ,   lambda' = P(lambda + t d) ,   t = 1, 1/2 or 0
//! ```
//! in the symbols of the active system of Newton. The shift, a part of the mean diagonal of `W_aa`, makes it a step of
//! Levenberg (1944) and Marquardt (1963): contacts that lie beside one another on the same nodes share their force in
//! many ways, and an undamped step throws it to and fro. Between two steps a sweep or more finds anew which contacts
//! carry force.
//!
//! Where a contact is another than before, forces by the names of contacts do not balance, and such a body is moved by
//! millimetres for a few millinewtons: gaps then say nothing of what touches. So a run begins with a second gap, that
//! at forces which do balance, as they are known at the nodes; where the first residual is beyond a tenth the first
//! thing is a step that opens and closes contacts by that gap, and closes them by the true one.
//!
//! A step costs as much as so many sweeps ([`cost`]), and is taken where that is left of them: work is bounded by that
//! of `max_sweeps` sweeps, and a problem with too many closed rows has sweeps alone. Nothing is allocated, and no
//! memory of the thread is used.

use crate::active_rows::ActiveRows;
use crate::gauss_seidel::{GaussSeidelConfig, GaussSeidelWorkspace, residual, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::SolveReport;
use crate::small_system::SmallSystem;
use crate::vectors::form_gap;
use crate::watch::Watch;
use nalgebra::Matrix3;

/// Sweeps before the first step: what they settle needs none (ten contacts of a ball on the liver: 8 at the median, 12
/// at p99).
const FIRST: u32 = 12;

/// Sweeps between two steps.
const BETWEEN: u32 = 2;

/// Added to the diagonals of closed rows, which are of order one.
const SHIFT: f64 = 0.3;

/// Growth of the residual up to which a step is taken: it opens and closes contacts, which the sweeps after it settle.
const ACCEPTED: f64 = 3.0;

/// Residual of the forces that a run begins with beyond which they are taken for out of balance. Warm starts on tissue
/// that is held have 1e-3 to 1e-2.
const LOST: f64 = 0.1;

/// Memory of the steps.
#[derive(Clone, Debug)]
pub struct Steps {
    rows: ActiveRows,
    /// `W d_given`, m.
    gap: Vec<f64>,
    system: SmallSystem,
    /// Forces before the step, N, and their gap, m.
    lambda: Vec<f64>,
    delta: Vec<f64>,
}

impl Steps {
    /// Memory for problems of up to `rows` rows, of which up to `unknowns` are closed where a step is taken.
    #[must_use]
    pub fn with_capacity(rows: usize, unknowns: usize) -> Self {
        let vector = || Vec::with_capacity(rows);
        Self {
            rows: ActiveRows::with_capacity(rows),
            gap: vector(),
            system: SmallSystem::with_capacity(unknowns.min(rows)),
            lambda: vector(),
            delta: vector(),
        }
    }

    /// `d` of all rows for the gap `delta` (m), where they were sorted by `at`; `false` where the system is singular.
    fn solve(&mut self, view: &ProblemView<'_>, size: usize, at: &[f64], delta: &[f64]) -> bool {
        let Self { rows, gap, system, .. } = self;
        gap.clear();
        gap.extend(delta.iter().zip(at).map(|(delta, at)| delta - at));
        rows.add_given(view, gap);
        let matrix = &mut system.augmented;
        matrix.reset(size);
        for from in &rows.blocks {
            let columns =
                [0, 1, 2].map(|c| if c < from.block.law.rows() { view.column(from.block.start + c) } else { &[] });
            for to in &rows.blocks {
                let between = Matrix3::from_columns(&columns.map(|column| gather(column, &to.block)));
                for (j, unknown) in from.unknowns().iter().enumerate() {
                    let gap = between * unknown.direction * (from.scale * to.scale);
                    let column = matrix.column_mut(from.first + j);
                    for (entry, unknown) in column.iter_mut().skip(to.first).zip(to.unknowns()) {
                        *entry = unknown.weight * unknown.test.dot(&gap);
                    }
                }
            }
            for (j, unknown) in from.unknowns().iter().enumerate() {
                if let Some(diagonal) = matrix.column_mut(from.first + j).get_mut(from.first + j) {
                    *diagonal += unknown.own(SHIFT);
                }
            }
        }
        rows.fill_right(gap, matrix.column_mut(size));
        let Some(solution) = system.solve() else { return false };
        rows.add_solution(solution);
        true
    }

    /// Takes the step, or half of it, or leaves forces and gap as they are: `false`.
    fn take(&mut self, view: &ProblemView<'_>, lambda: &mut [f64], ws: &mut GaussSeidelWorkspace) -> bool {
        let now = residual(view, lambda, 1.0, ws).relative;
        self.lambda.clear();
        self.lambda.extend_from_slice(lambda);
        self.delta.clear();
        self.delta.extend_from_slice(&ws.delta);
        for t in [1.0, 0.5] {
            for block in view.blocks {
                let force = gather(&self.lambda, block) + gather(&self.rows.direction, block) * t;
                scatter(&block.law.project(&force), block, lambda);
            }
            form_gap(view, lambda, &mut ws.delta);
            // False for NaN.
            if residual(view, lambda, 1.0, ws).relative < ACCEPTED * now {
                return true;
            }
        }
        lambda.copy_from_slice(&self.lambda);
        ws.delta.copy_from_slice(&self.delta);
        false
    }
}

/// What a step with so many unknowns is taken to cost in a problem of so many rows, in sweeps: an estimate by what
/// grows with the square of the unknowns, what goes with every unknown, and the gap formed anew. It was set by the time
/// of whole runs, not of single steps, and may be low by a third.
#[must_use]
pub fn cost(unknowns: usize, rows: usize) -> u32 {
    let sweeps = (unknowns * unknowns / 5 + 4 * unknowns).div_ceil(rows.max(1)) + 1;
    u32::try_from(sweeps).unwrap_or(u32::MAX)
}

/// Solves from the forces in `lambda` (N) and leaves the answer there; `at`: the gap (m) by which the first step knows
/// what touches where the forces are out of balance, or nothing. `config` has tolerance and limits: relaxation and
/// order are the plain ones. A step counts as [`cost`] iterations.
pub fn solve(
    view: &ProblemView<'_>,
    (lambda, at): (&mut [f64], &[f64]),
    config: &GaussSeidelConfig,
    ws: &mut GaussSeidelWorkspace,
    steps: &mut Steps,
) -> SolveReport {
    let stop = Stop { tolerance: config.tolerance, max_iterations: config.max_sweeps, stall: config.stall_sweeps };
    let (mut to_sweep, mut left, mut steps_on) = (FIRST, config.max_sweeps, true);
    let mut at = Some(at).filter(|at| at.len() == view.rows());
    iteration::run(view, lambda, stop, ws, &mut Watch::none(), |lambda, ws, now| {
        if at.is_some() && now > LOST {
            to_sweep = 0;
        } else {
            at = None;
        }
        if to_sweep == 0 && steps_on {
            let seen = at.take();
            let here = seen.unwrap_or(&ws.delta);
            let scales = ws.local.iter().map(|local| local.rho().sqrt());
            let size = steps.rows.sort(view, &ws.local, scales, lambda, here);
            let cost = cost(size, view.rows());
            // What cannot be paid, and what came to nothing, is not tried again.
            steps_on = size > 0 && size <= steps.system.augmented.capacity() && cost <= left;
            if steps_on {
                (to_sweep, left) = (BETWEEN, left - cost);
                steps_on = steps.solve(view, size, here, &ws.delta) && steps.take(view, lambda, ws);
                return Advance::Several(cost);
            }
        }
        to_sweep = to_sweep.saturating_sub(1);
        left = left.saturating_sub(1);
        sweep(view, lambda, 1.0, false, ws);
        Advance::Updated
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gauss_seidel;
    use crate::problem::ConstraintProblem;
    use crate::report::SolveStatus;
    use crate::residual::evaluate;
    use nalgebra::{DMatrix, DVector};
    use palpate_constraints::law::{Coulomb, Law};

    const EACH: usize = 6;
    const ROWS: usize = 6 * EACH;

    /// A light body between two jaws of `EACH` contacts, which move towards each other and up: its mass yields to a net force
    /// ten times as much as its skin does to one at a contact.
    fn squeezed() -> ConstraintProblem {
        let (mass, skin) = (0.2, 2e-2); // m/N
        let matrix = DMatrix::from_fn(ROWS, ROWS, |i, j| {
            let (a, b, row, column) = (i / 3, j / 3, i % 3, j % 3);
            let side = |a: usize, row: usize| if a < EACH && row == 0 { -1.0 } else { 1.0 };
            let apart = (a % EACH).abs_diff(b % EACH) as f64;
            let near = if a / EACH == b / EACH { skin / (1.0 + 2.0 * apart) } else { 0.0 };
            if row == column { mass * side(a, row) * side(b, row) + near } else { 0.0 }
        });
        let free = |i: usize| match i % 3 {
            0 => -3e-4 * (1.0 + 0.3 * (i as f64).sin()),
            1 => 1e-4 * (1.0 + 0.2 * (i as f64).cos()),
            _ => 0.0,
        };
        let laws = [Law::Coulomb(Coulomb { friction: 0.8 }); 2 * EACH];
        ConstraintProblem::new(matrix, DVector::from_fn(ROWS, |i, _| free(i)), laws).expect("the sizes agree")
    }

    fn workspace() -> (GaussSeidelWorkspace, Steps) {
        (GaussSeidelWorkspace::with_capacity(ROWS), Steps::with_capacity(ROWS, ROWS))
    }

    fn judge(problem: &ConstraintProblem, lambda: &[f64]) -> f64 {
        evaluate(&problem.view(), lambda, &mut vec![0.0; lambda.len()]).relative
    }

    const TICK: GaussSeidelConfig = GaussSeidelConfig {
        tolerance: 1e-9,
        max_sweeps: 30,
        relaxation: 1.0,
        order: gauss_seidel::SweepOrder::Forward,
        stall_sweeps: 200,
    };

    fn solved(problem: &ConstraintProblem) -> (Vec<f64>, Vec<f64>) {
        let (mut ws, _) = workspace();
        let mut lambda = vec![0.0; ROWS];
        let config = GaussSeidelConfig { max_sweeps: 20_000, stall_sweeps: 20_000, ..TICK };
        assert!(gauss_seidel::solve(&problem.view(), &mut lambda, &config, &mut ws).is_solved());
        (lambda, ws.delta)
    }

    #[test]
    fn forces_out_of_balance_are_mended_for_the_work_of_sweeps_that_are_not_done() {
        let problem = squeezed();
        let (exact, at) = solved(&problem);
        let (mut ws, mut steps) = workspace();
        for share in [0.5, 0.9, 1.1, 1.5] {
            // One jaw presses more, or less, than the other.
            let mut swept = exact.clone();
            swept[..3 * EACH].iter_mut().for_each(|force| *force *= share);
            let mut stepped = swept.clone();
            gauss_seidel::solve(&problem.view(), &mut swept, &TICK, &mut ws);
            let report = solve(&problem.view(), (&mut stepped, &at), &TICK, &mut ws, &mut steps);
            let (swept, stepped) = (judge(&problem, &swept), judge(&problem, &stepped));
            assert!(stepped < 0.6 * swept, "{stepped:e} after steps, {swept:e} after sweeps alone");
            assert!((report.residual / stepped - 1.0).abs() < 1e-6, "{} {stepped}", report.residual);
            assert!(report.iterations <= TICK.max_sweeps, "{}", report.iterations);
        }
    }

    #[test]
    fn with_time_enough_it_ends_at_the_solution_whatever_gap_it_begins_with() {
        let problem = squeezed();
        let (mut ws, mut steps) = workspace();
        let config = GaussSeidelConfig { max_sweeps: 5000, stall_sweeps: 5000, ..TICK };
        for at in [&[][..], &[-1e-3; ROWS], &[1e-3; ROWS], &[f64::NAN; ROWS]] {
            let mut lambda = vec![0.01; ROWS];
            let report = solve(&problem.view(), (&mut lambda, at), &config, &mut ws, &mut steps);
            assert_eq!(report.status, SolveStatus::Solved, "{report:?}");
            assert!(judge(&problem, &lambda) < 2.0 * config.tolerance);
        }
    }

    #[test]
    fn steps_that_cost_more_than_is_left_or_have_no_room_are_sweeps() {
        let problem = squeezed();
        let (mut ws, mut none) = (GaussSeidelWorkspace::with_capacity(ROWS), Steps::with_capacity(ROWS, 0));
        let (mut swept, mut stepped) = (vec![0.0; ROWS], vec![0.0; ROWS]);
        let few = GaussSeidelConfig { max_sweeps: cost(ROWS, ROWS).min(6), ..TICK };
        gauss_seidel::solve(&problem.view(), &mut swept, &few, &mut ws);
        let report = solve(&problem.view(), (&mut stepped, &[]), &few, &mut ws, &mut workspace().1);
        assert_eq!((&stepped, report.iterations), (&swept, few.max_sweeps));
        stepped.fill(0.0);
        swept.fill(0.0);
        gauss_seidel::solve(&problem.view(), &mut swept, &TICK, &mut ws);
        solve(&problem.view(), (&mut stepped, &[]), &TICK, &mut ws, &mut none);
        assert_eq!(stepped, swept);
    }

    #[test]
    fn numbers_that_are_none_end_without_force() {
        let problem = squeezed();
        let (mut ws, mut steps) = workspace();
        let view = problem.view();
        let mut bad = view.delta_free.to_vec();
        bad[3] = f64::NAN;
        let mut lambda = vec![0.01; ROWS];
        let view = ProblemView { delta_free: &bad, ..view };
        let report = solve(&view, (&mut lambda, &bad), &TICK, &mut ws, &mut steps);
        assert!(!report.is_solved());
        assert!(lambda.iter().all(|force| force.is_finite()), "{lambda:?}");
    }
}
