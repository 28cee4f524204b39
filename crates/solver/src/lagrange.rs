//! Lagrange multipliers over the whole body, the second of the lecture's direct approaches: one program of motion and contact,
//! without compliance.
//!
//! ```text
//! minimise 1/2 wᵀ A w   with   δ = δ_free + h H w   and   (δ_n + s, δ_t) in the dual of each force cone
//! its multipliers are the forces:  A w = h Hᵀ λ ,  λ in the cone ,  (δ_n + s) λ_n + δ_t · λ_t = 0
//! ```
//!
//! `w = v⁺ - v_free` (m/s), so that `δ_free` says what the right side of the body's own system would. Without friction this is
//! one quadratic program. With friction the cones are `δ_n + s >= μ |δ_t|`, and `s = μ |δ_t|` (De Saxcé's correction) is
//! iterated outside as in [`crate::conic_friction`], which is the same sequence of programs after `w` has been eliminated.
//!
//! Clarabel's interior-point method factors the sparse system of body and contacts anew in every iteration: a body of 1,000
//! nodes costs tenths of a second a program, one of 10,000 nodes minutes. It starts every program from its own point and
//! allocates. A comparison method at step rate.

use crate::conic::{answered, settings};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::{SolveReport, SolveStatus};
use crate::residual::{natural_map, scale};
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use clarabel::solver::{DefaultSolver, IPSolver};
use palpate_constraints::law::{ConicForm, natural_stiffness};

/// Tolerance asked of Clarabel, on numbers of order one; the residual judges the answer.
const TOLERANCE: f64 = 1e-12;

/// A fall of the residual by less than this part, so many programs in a row, ends a run as stalled.
const NOTABLE: f64 = 0.99;
const STALL: u32 = 10;

/// The body and its contacts in one step.
#[derive(Clone, Copy, Debug)]
pub struct LagrangeProblem<'a> {
    /// Upper triangle of `A` (kg) by columns: start of each column, and one past the last.
    pub column_start: &'a [usize],
    /// Row of each entry.
    pub row: &'a [usize],
    /// The entries (kg).
    pub value: &'a [f64],
    /// `H`: row, degree of freedom, value.
    pub jacobian: &'a [(usize, usize, f64)],
    /// Step `h` (s).
    pub dt: f64,
    /// Laws and gaps. Of the compliance only the diagonal blocks are read, for scaling and for the residual.
    pub view: ProblemView<'a>,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LagrangeConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of programs; without friction there is one. Default 200.
    pub max_programs: u32,
}

impl Default for LagrangeConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_programs: 200 }
    }
}

/// Solves for the motion `w` (m/s) that contact adds, and its forces (N): finite and admissible whatever the status.
///
/// Takes laws whose forces are all, not negative, or in a second-order cone; others end as [`SolveStatus::Unsupported`].
/// The report counts interior-point iterations: factorisations of the system of body and contacts. Allocates.
pub fn solve(problem: &LagrangeProblem<'_>, config: &LagrangeConfig, w: &mut [f64], lambda: &mut [f64]) -> SolveReport {
    w.fill(0.0);
    lambda.fill(0.0);
    let view = &problem.view;
    let Some(scale) = scale(view) else {
        return SolveReport { residual: 0.0, worst_gap: 0.0, ..SolveReport::failed(SolveStatus::Solved, 0) };
    };
    let mut program = match Program::new(problem, w.len()) {
        Ok(program) if lambda.len() == view.rows() => program,
        Ok(_) => return SolveReport::failed(SolveStatus::Invalid, 0),
        Err(status) => return SolveReport::failed(status, 0),
    };
    let mut delta = view.delta_free.to_vec();
    let (mut force, mut motion) = (lambda.to_vec(), w.to_vec());
    let mut best = SolveReport::failed(SolveStatus::MaxIterations, 0);
    let (mut iterations, mut idle) = (0, 0);
    let corrected = view.blocks.iter().any(|block| !block.law.is_associated());
    for _ in 0..if corrected { config.max_programs } else { 1 } {
        let solved = program.solve(problem, &delta, &mut motion, &mut force);
        iterations += program.solver.solution.iterations;
        if let Err(status) = solved {
            return SolveReport { status, iterations, ..best };
        }
        gaps(problem, &motion, &mut delta);
        let residual = natural_map(view, scale, &delta, &force);
        if !residual.relative.is_finite() {
            return SolveReport { status: SolveStatus::NotFinite, iterations, ..best };
        }
        idle = if residual.relative < NOTABLE * best.residual { 0 } else { idle + 1 };
        if residual.relative < best.residual {
            best.residual = residual.relative;
            best.worst_block = u32::try_from(residual.worst_block).unwrap_or(u32::MAX);
            best.worst_gap = residual.worst_gap;
            w.copy_from_slice(&motion);
            lambda.copy_from_slice(&force);
        }
        if best.residual <= config.tolerance {
            return SolveReport { status: SolveStatus::Solved, iterations, ..best };
        }
        if idle >= STALL {
            return SolveReport { status: SolveStatus::Stalled, iterations, ..best };
        }
    }
    let status = if corrected { SolveStatus::MaxIterations } else { SolveStatus::Stalled };
    SolveReport { status, iterations, ..best }
}

/// `δ = δ_free + h H w`.
pub fn gaps(problem: &LagrangeProblem<'_>, w: &[f64], delta: &mut [f64]) {
    delta.copy_from_slice(problem.view.delta_free);
    for &(row, dof, value) in problem.jacobian {
        if let (Some(delta), Some(w)) = (delta.get_mut(row), w.get(dof)) {
            *delta += problem.dt * value * w;
        }
    }
}

/// The program in numbers of order one: `h w / length` is unknown, `stiffness length` the unit of force.
struct Program {
    solver: DefaultSolver<f64>,
    right: Vec<f64>,
    length: f64,
    stiffness: f64,
    /// Row of the cones at which each block begins.
    first: Vec<usize>,
}

impl Program {
    /// # Errors
    /// Numbers that are not finite, sizes that disagree, a law without a place in the program.
    fn new(problem: &LagrangeProblem<'_>, freedoms: usize) -> Result<Self, SolveStatus> {
        let view = &problem.view;
        let inside = problem.jacobian.iter().all(|&(row, dof, _)| row < view.rows() && dof < freedoms);
        if !view.is_consistent() || problem.column_start.len() != freedoms + 1 || !inside {
            return Err(SolveStatus::Invalid);
        }
        let length = view.delta_free.iter().fold(f64::MIN_POSITIVE, |most, gap| most.max(gap.abs()));
        let stiffnesses = view.blocks.iter().map(|b| natural_stiffness(&view.diagonal_block(b), b.law.rows()));
        let stiffness = stiffnesses.sum::<f64>() / view.blocks.len() as f64;
        let finite = problem.value.iter().all(|a| a.is_finite()) && length.is_finite();
        if !(finite && stiffness.is_finite() && stiffness > 0.0 && problem.dt > 0.0) {
            return Err(SolveStatus::NotFinite);
        }

        // Rows `right - matrix y` of the cones: the gaps over `length`, tangential ones times their friction.
        let mut factor = vec![0.0; view.rows()];
        let (mut place, mut first, mut cones) = (vec![0; view.rows()], Vec::new(), Vec::new());
        let mut size = 0;
        for block in view.blocks {
            let (cone, factors) = cone(block.law.conic_form(), block.law.rows())?;
            first.push(size);
            for (i, f) in factors.iter().enumerate().take(block.law.rows()) {
                (place[block.start + i], factor[block.start + i]) = (size + i, *f);
            }
            size += factors.iter().take(block.law.rows()).filter(|f| **f != 0.0).count();
            cones.push(cone);
        }
        let mut right = vec![0.0; size];
        for (row, gap) in view.delta_free.iter().enumerate().filter(|&(row, _)| factor[row] != 0.0) {
            right[place[row]] = factor[row] * gap / length;
        }
        let entries = || problem.jacobian.iter().filter(|&&(row, ..)| factor[row] != 0.0);
        let matrix = CscMatrix::new_from_triplets(
            size,
            freedoms,
            entries().map(|&(row, ..)| place[row]).collect(),
            entries().map(|&(_, dof, _)| dof).collect(),
            entries().map(|&(row, _, value)| -factor[row] * value).collect(),
        );
        let unit = 1.0 / (problem.dt * problem.dt * stiffness);
        let value = problem.value.iter().map(|a| a * unit).collect();
        let quadratic = CscMatrix::new(freedoms, freedoms, problem.column_start.to_vec(), problem.row.to_vec(), value);
        let linear = vec![0.0; freedoms];
        let solver = DefaultSolver::new(&quadratic, &linear, &matrix, &right, &cones, settings(TOLERANCE))
            .map_err(|_| SolveStatus::Invalid)?;
        Ok(Self { solver, right, length, stiffness, first })
    }

    /// Solves with the correction that belongs to the gaps `delta` so far.
    fn solve(
        &mut self,
        problem: &LagrangeProblem<'_>,
        delta: &[f64],
        w: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), SolveStatus> {
        let view = &problem.view;
        for (block, &first) in view.blocks.iter().zip(&self.first) {
            let gap = gather(delta, block);
            let correction = block.law.corrected_gap(&gap).x - gap.x;
            self.right[first] = (view.delta_free[block.start] + correction) / self.length;
        }
        self.solver.update_b(&self.right).map_err(|_| SolveStatus::Invalid)?;
        self.solver.solve();
        let solution = &self.solver.solution;
        answered(solution.status)?;
        w.iter_mut().zip(&solution.x).for_each(|(w, y)| *w = y * self.length / problem.dt);
        for (block, &first) in view.blocks.iter().zip(&self.first) {
            let (_, factors) = cone(block.law.conic_form(), block.law.rows())?;
            let multiplier = nalgebra::Vector3::from_fn(|i, _| match factors[i] {
                0.0 => 0.0,
                factor => factor * solution.z.get(first + i).copied().unwrap_or(0.0),
            });
            let force = multiplier * (self.stiffness * self.length);
            scatter(&block.law.project(&force), block, lambda);
        }
        Ok(())
    }
}

/// The cone of the gaps that is dual to a set of forces, and the factor of each of the block's rows in it; rows without a
/// force have none.
fn cone(form: ConicForm, rows: usize) -> Result<(SupportedConeT<f64>, [f64; 3]), SolveStatus> {
    match form {
        ConicForm::Free => Ok((ZeroConeT(rows), [1.0; 3])),
        ConicForm::NonNegative => Ok((NonnegativeConeT(1), [1.0, 0.0, 0.0])),
        ConicForm::SecondOrder { friction } if friction > 0.0 => Ok((SecondOrderConeT(3), [1.0, friction, friction])),
        ConicForm::SecondOrder { .. } => Ok((NonnegativeConeT(1), [1.0, 0.0, 0.0])),
        _ => Err(SolveStatus::Unsupported),
    }
}
