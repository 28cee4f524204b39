//! The contact problem as a conic program for Clarabel.
//!
//! ```text
//! minimise 1/2 lambda^T W lambda + (delta_free + s)^T lambda   over admissible forces
//! ```
//!
//! Its optimality is `delta + s` in the normal cone of the admissible forces at `lambda`, with opposite sign: with `s = 0`
//! the associated law (friction over the cone then opens sliding contacts by `mu |delta_t|`), with `s` De Saxcé's
//! correction `mu |delta_t| n` at the solution Coulomb's. Blocks are scaled by `sqrt(rho_a)` and the gaps by their largest,
//! so that the solver sees numbers of order one. A program needs a symmetric matrix: it gets the symmetric part of `W`, and
//! what the other part makes of the forces so far is added to `delta_free` (single precision files are asymmetric by 1e-6).
//!
//! Programs are kept by their structure, which is the sequence of the blocks' cones: one that was solved lately, with
//! whatever numbers, is solved again without allocation, and so is the first after [`ConicPrograms::rehearse`]. Without it the
//! first of a structure allocates, however long the workspace has existed: the cones are known with the laws only, and
//! Clarabel orders and lays out a program in memory of its own.

mod cones;
mod corrections;
mod kept;

use crate::gauss_seidel::{self, GaussSeidelWorkspace};
use crate::problem::{ProblemView, gather, scatter};
use crate::report::SolveStatus;
use clarabel::algebra::CscMatrix;
pub(crate) use cones::Cones;
pub(crate) use corrections::Corrections;
pub(crate) use kept::{KeptSolver, Tolerance, Until};
use palpate_constraints::law::LocalCompliance;

/// As far as Clarabel's interior-point method goes in double precision. It answers `AlmostSolved` or `InsufficientProgress`
/// where it does not come so far, and the residual judges the answer. With Clarabel's own shift of 1e-8 or a gap of 1e-13 the
/// forces of rank-deficient contact stop short of a residual of 1e-8.
const TOLERANCE: Tolerance = Tolerance { gap: 1e-16, feasibility: 1e-13, shift: 1e-11 };

/// Largest asymmetry of `W` that is taken for rounding, relative to `sqrt(W_ii W_jj)`.
const ASYMMETRY: f64 = 1e-2;

/// Structures that are kept: contacts come and go by ones and twos, so that the same numbers of them return.
const KEPT: usize = 8;

/// A laid out program.
struct Program {
    solver: KeptSolver,
    cones: Cones,
    /// Place of each entry of the cones in their matrix, and the values there.
    places: Vec<usize>,
    constraints: Vec<f64>,
}

/// Programs by structure, the last used last, and the numbers of the one at work.
#[derive(Default)]
pub(crate) struct ConicPrograms {
    programs: Vec<Program>,
    cones: Cones,
    quadratic: Vec<f64>,
    linear: Vec<f64>,
    row_scale: Vec<f64>,
    /// Largest scaled gap.
    size: f64,
    /// Whether `W` is symmetric to the last bit.
    symmetric: bool,
}

impl std::fmt::Debug for ConicPrograms {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ConicPrograms").field("kept", &self.programs.len()).finish_non_exhaustive()
    }
}

/// A copy begins without programs: they are memory only.
impl Clone for ConicPrograms {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl ConicPrograms {
    /// Writes the numbers of a problem into the program of its structure, which is laid out where there is none.
    ///
    /// # Errors
    /// [`SolveStatus::Unsupported`] for an asymmetric `W`, [`SolveStatus::NotFinite`] for numbers that are not.
    pub(crate) fn prepare(&mut self, view: &ProblemView<'_>, local: &[LocalCompliance]) -> Result<(), SolveStatus> {
        let rows = view.rows();
        self.row_scale.clear();
        for (block, local) in view.blocks.iter().zip(local) {
            self.row_scale.extend(std::iter::repeat_n(local.rho().sqrt(), block.law.rows()));
        }
        let scaled = view.delta_free.iter().zip(&self.row_scale).map(|(gap, s)| (gap * s).abs());
        self.size = scaled.fold(f64::MIN_POSITIVE, f64::max);
        if !self.size.is_finite() || self.row_scale.len() != rows {
            return Err(SolveStatus::NotFinite);
        }
        self.symmetric = upper_triangle(view, &self.row_scale, &mut self.quadratic)?;
        self.cones.clear();
        for (block, scale) in view.blocks.iter().zip(local.iter().map(|local| local.rho().sqrt())) {
            self.cones.admit(block.law.conic_form(), block.start, scale * self.size);
        }
        match self.programs.iter().position(|program| program.cones.have_structure_of(&self.cones)) {
            Some(known) => self.programs[known..].rotate_left(1),
            None => self.lay_out(rows)?,
        }
        let Some(program) = self.programs.last_mut() else { return Err(SolveStatus::Invalid) };
        self.cones.write(&program.places, &mut program.constraints);
        program.solver.set_matrices(&self.quadratic, &program.constraints)
    }

    /// Lays out the program of a problem's structure and solves it, since Clarabel makes memory in the first solution, too.
    /// `gaps` is scratch.
    ///
    /// # Errors
    /// Those of [`crate::gauss_seidel::prepare`] and of [`ConicPrograms::prepare`].
    pub(crate) fn rehearse(
        &mut self,
        view: &ProblemView<'_>,
        gaps: &mut GaussSeidelWorkspace,
    ) -> Result<(), SolveStatus> {
        let mut lambda = vec![0.0; view.rows()];
        gauss_seidel::prepare(view, &mut lambda, gaps)?;
        self.prepare(view, &gaps.local)?;
        // Whatever the end of this program, its memory is there.
        let _ = self.solve(view, &[], Until::default(), &mut lambda);
        Ok(())
    }

    /// A program of the present structure takes the place of the one that was not used for longest.
    fn lay_out(&mut self, rows: usize) -> Result<(), SolveStatus> {
        let starts = (0..=rows).map(|j| j * (j + 1) / 2).collect();
        let indices = (0..rows).flat_map(|j| 0..=j).collect();
        let quadratic = CscMatrix::new(rows, rows, starts, indices, self.quadratic.clone());
        let (constraints, places) = self.cones.matrix(rows);
        let solver = KeptSolver::new(&quadratic, &constraints, self.cones.cones(), TOLERANCE)?;
        if self.programs.len() >= KEPT {
            self.programs.remove(0);
        }
        self.programs.push(Program { solver, cones: self.cones.clone(), places, constraints: constraints.nzval });
        Ok(())
    }

    /// Solves the problem that was prepared with the corrections of its gaps (one for each block, see
    /// [`ConicPrograms::scale`]; none where there is none), adds what the asymmetry makes of the forces `lambda` (N), and
    /// writes the new forces there, admissible.
    ///
    /// # Errors
    /// How Clarabel ended, where it has no answer.
    pub(crate) fn solve(
        &mut self,
        view: &ProblemView<'_>,
        corrections: &[f64],
        until: Until,
        lambda: &mut [f64],
    ) -> Result<(), SolveStatus> {
        let Some(program) = self.programs.last_mut() else { return Err(SolveStatus::Invalid) };
        self.linear.clear();
        self.linear.extend_from_slice(view.delta_free);
        if !self.symmetric {
            let at = |i: usize, j: usize| view.column(j).get(i).copied().unwrap_or(0.0);
            for (i, linear) in self.linear.iter_mut().enumerate() {
                *linear += lambda.iter().enumerate().map(|(j, f)| 0.5 * (at(i, j) - at(j, i)) * f).sum::<f64>();
            }
        }
        let size = self.size;
        self.linear.iter_mut().zip(&self.row_scale).for_each(|(linear, scale)| *linear *= scale / size);
        for (block, correction) in view.blocks.iter().zip(corrections) {
            self.linear[block.start] += correction;
        }
        let solution = program.solver.solve(&self.linear, &self.cones.right, until)?;
        for block in view.blocks {
            let force = gather(&solution.x, block) * (self.row_scale[block.start] * size);
            scatter(&block.law.project(&force), block, lambda);
        }
        Ok(())
    }

    /// What a gap (m) of this row is multiplied by in the program.
    pub(crate) fn scale(&self, row: usize) -> f64 {
        self.row_scale.get(row).map_or(1.0, |scale| scale / self.size)
    }
}

/// The upper triangle of the scaled `W`, symmetrised, by columns; whether it was symmetric to the last bit.
fn upper_triangle(view: &ProblemView<'_>, scale: &[f64], values: &mut Vec<f64>) -> Result<bool, SolveStatus> {
    let mut symmetric = true;
    values.clear();
    let at = |i: usize, j: usize| view.column(j).get(i).copied().unwrap_or(0.0);
    for j in 0..view.rows() {
        for i in 0..=j {
            let (w, transposed) = (at(i, j), at(j, i));
            if !(w.is_finite() && transposed.is_finite()) {
                return Err(SolveStatus::NotFinite);
            }
            if (w - transposed).abs() > ASYMMETRY * (at(i, i) * at(j, j)).abs().sqrt() {
                return Err(SolveStatus::Unsupported);
            }
            symmetric &= w == transposed;
            values.push(0.5 * (w + transposed) * scale[i] * scale[j]);
        }
    }
    Ok(symmetric)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::ConstraintProblem;
    use nalgebra::{DMatrix, DVector};
    use palpate_constraints::law::Signorini;

    fn prepare(programs: &mut ConicPrograms, rows: usize) {
        let (w, free) = (DMatrix::identity(rows, rows), DVector::from_element(rows, -1.0));
        let problem = ConstraintProblem::new(w, free, vec![Signorini.into(); rows]).unwrap();
        let view = problem.view();
        let local = view.blocks.iter().map(|block| LocalCompliance::new(&view.diagonal_block(block), 1));
        programs.prepare(&view, &local.collect::<Vec<_>>()).unwrap();
        let mut lambda = vec![0.0; rows];
        programs.solve(&view, &[], Until::default(), &mut lambda).unwrap();
        assert!(lambda.iter().all(|force| (force - 1.0).abs() < 1e-6), "{lambda:?}");
    }

    /// Rows of the programs that are kept, the last used last.
    fn kept(programs: &ConicPrograms) -> Vec<usize> {
        programs.programs.iter().map(|program| program.cones.right.len()).collect()
    }

    #[test]
    fn the_structure_that_was_not_met_for_longest_makes_room() {
        let mut programs = ConicPrograms::default();
        (1..=KEPT).for_each(|rows| prepare(&mut programs, rows));
        prepare(&mut programs, 1);
        assert_eq!(kept(&programs), [2, 3, 4, 5, 6, 7, 8, 1]);
        prepare(&mut programs, KEPT + 1);
        assert_eq!(kept(&programs), [3, 4, 5, 6, 7, 8, 1, 9]);
        assert!(programs.clone().programs.is_empty());
    }
}
