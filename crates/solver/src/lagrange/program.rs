//! The program of a body and its contacts, in numbers of order one, kept as long as its entries stay where they are.

use super::LagrangeProblem;
use crate::conic::{Cones, KeptSolver, Tolerance, Until};
use crate::problem::scatter;
use crate::report::SolveStatus;
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use palpate_constraints::law::{ConicForm, natural_stiffness};

/// Tolerance asked of Clarabel, on numbers of order one; the residual judges the answer.
const TOLERANCE: Tolerance = Tolerance { gap: 1e-16, feasibility: 1e-13, shift: 1e-11 };

/// What the numbers of a program, of order one, are multiples of: `h w / length` is unknown, `stiffness length` the unit of
/// force.
#[derive(Clone, Copy)]
pub(super) struct Units {
    pub(super) length: f64,
    stiffness: f64,
}

/// A laid out program.
struct Program {
    solver: KeptSolver,
    column_start: Vec<usize>,
    row: Vec<usize>,
    cones: Cones,
    /// Place of each entry of the cones in their matrix, and the values there.
    places: Vec<usize>,
    constraints: Vec<f64>,
}

/// Row of the cones at which a block begins, and the factors of its rows.
struct Placed {
    first: usize,
    factors: [f64; 3],
}

/// The program that was laid out last, and the numbers of the one at work.
#[derive(Default)]
pub(super) struct KeptProgram {
    program: Option<Program>,
    cones: Cones,
    blocks: Vec<Placed>,
    /// Row of the cones and factor of each row of the problem; a factor of zero has no row.
    place: Vec<(usize, f64)>,
    value: Vec<f64>,
    /// What each unknown is a multiple of.
    scale: Vec<f64>,
    linear: Vec<f64>,
}

impl KeptProgram {
    /// Writes the numbers of a problem into the program, which is laid out anew where its entries are others.
    ///
    /// # Errors
    /// Numbers that are not finite, sizes that disagree, a law without a place in the program.
    pub(super) fn prepare(&mut self, problem: &LagrangeProblem<'_>, freedoms: usize) -> Result<Units, SolveStatus> {
        let view = &problem.view;
        let inside = problem.jacobian.iter().all(|&(row, dof, _)| row < view.rows() && dof < freedoms);
        let entries = problem.row.len() == problem.value.len()
            && problem.column_start.windows(2).all(|ends| ends[0] <= ends[1])
            && problem.column_start.first() == Some(&0)
            && problem.column_start.last() == Some(&problem.row.len())
            && problem.row.iter().all(|row| *row < freedoms);
        if !view.is_consistent() || problem.column_start.len() != freedoms + 1 || !inside || !entries {
            return Err(SolveStatus::Invalid);
        }
        let length = view.delta_free.iter().fold(f64::MIN_POSITIVE, |most, gap| most.max(gap.abs()));
        let stiffnesses = view.blocks.iter().map(|b| natural_stiffness(&view.diagonal_block(b), b.law.rows()));
        let stiffness = stiffnesses.sum::<f64>() / view.blocks.len() as f64;
        let entries = problem.jacobian.iter().map(|(.., h)| h).chain(problem.value);
        let finite = entries.into_iter().all(|a| a.is_finite()) && length.is_finite();
        if !(finite && stiffness.is_finite() && stiffness > 0.0 && problem.dt > 0.0) {
            return Err(SolveStatus::NotFinite);
        }
        let units = Units { length, stiffness };
        self.write_quadratic(problem, 1.0 / (problem.dt * problem.dt * stiffness));
        self.admit(problem, length)?;
        self.linear.clear();
        self.linear.resize(freedoms, 0.0);
        let known = self.program.as_ref().is_some_and(|program| {
            program.column_start == problem.column_start
                && program.row == problem.row
                && program.cones.have_structure_of(&self.cones)
        });
        if !known {
            self.program = Some(self.lay_out(problem)?);
        }
        let Some(program) = &mut self.program else { return Err(SolveStatus::Invalid) };
        self.cones.write(&program.places, &mut program.constraints);
        program.solver.set_matrices(&self.value, &program.constraints)?;
        Ok(units)
    }

    /// A program with the entries of this problem.
    fn lay_out(&self, problem: &LagrangeProblem<'_>) -> Result<Program, SolveStatus> {
        let (freedoms, column_start, row) = (self.scale.len(), problem.column_start.to_vec(), problem.row.to_vec());
        let quadratic = CscMatrix::new(freedoms, freedoms, column_start.clone(), row.clone(), self.value.clone());
        let (matrix, places) = self.cones.matrix(freedoms);
        let solver = KeptSolver::new(&quadratic, &matrix, self.cones.cones(), TOLERANCE)?;
        let (cones, constraints) = (self.cones.clone(), matrix.nzval);
        Ok(Program { solver, column_start, row, cones, places, constraints })
    }

    /// `A` times `unit` with ones on its diagonal, and the scale of each unknown that makes them.
    fn write_quadratic(&mut self, problem: &LagrangeProblem<'_>, unit: f64) {
        let columns = || problem.column_start.windows(2).map(|ends| ends[0]..ends[1]);
        self.scale.clear();
        self.scale.extend(columns().enumerate().map(|(j, entries)| {
            let diagonal: f64 = entries.filter(|&p| problem.row[p] == j).map(|p| problem.value[p] * unit).sum();
            if diagonal > 0.0 { 1.0 / diagonal.sqrt() } else { 1.0 }
        }));
        self.value.clear();
        for (j, entries) in columns().enumerate() {
            let scaled = |p: usize| problem.value[p] * unit * self.scale[problem.row[p]] * self.scale[j];
            self.value.extend(entries.map(scaled));
        }
    }

    /// The rows of the cones: gaps over `length`, tangential ones times their friction.
    fn admit(&mut self, problem: &LagrangeProblem<'_>, length: f64) -> Result<(), SolveStatus> {
        let view = &problem.view;
        self.cones.clear();
        self.blocks.clear();
        self.place.clear();
        for block in view.blocks {
            let (cone, factors) = cone(block.law.conic_form(), block.law.rows())?;
            let first = self.cones.right.len();
            self.blocks.push(Placed { first, factors });
            for (i, &factor) in factors.iter().enumerate().take(block.law.rows()) {
                self.place.push((first + i, factor));
                if factor != 0.0 {
                    self.cones.right.push(factor * view.delta_free[block.start + i] / length);
                }
            }
            self.cones.cone(cone);
        }
        for &(row, dof, value) in problem.jacobian {
            let (place, factor) = self.place[row];
            if factor != 0.0 {
                self.cones.entry(place, dof, -factor * value * self.scale[dof]);
            }
        }
        Ok(())
    }

    /// Solves with the corrections `given` over the length; motion (m/s) and forces (N) are written where there is an answer.
    ///
    /// # Errors
    /// How Clarabel ended, where it has no answer.
    pub(super) fn solve(
        &mut self,
        problem: &LagrangeProblem<'_>,
        units: Units,
        given: &[f64],
        until: Until,
        motion: &mut [f64],
        force: &mut [f64],
    ) -> Result<(), SolveStatus> {
        let view = &problem.view;
        let Some(program) = &mut self.program else { return Err(SolveStatus::Invalid) };
        for ((block, placed), correction) in view.blocks.iter().zip(&self.blocks).zip(given) {
            self.cones.right[placed.first] = view.delta_free[block.start] / units.length + correction;
        }
        let solution = program.solver.solve(&self.linear, &self.cones.right, until)?;
        for ((w, y), scale) in motion.iter_mut().zip(&solution.x).zip(&self.scale) {
            *w = y * scale * units.length / problem.dt;
        }
        for (block, placed) in view.blocks.iter().zip(&self.blocks) {
            let multiplier = nalgebra::Vector3::from_fn(|i, _| match placed.factors[i] {
                0.0 => 0.0,
                factor => factor * solution.z.get(placed.first + i).copied().unwrap_or(0.0),
            });
            let pull = multiplier * (units.stiffness * units.length);
            scatter(&block.law.project(&pull), block, force);
        }
        Ok(())
    }

    /// Interior-point iterations of the last program.
    pub(super) fn iterations(&self) -> u32 {
        self.program.as_ref().map_or(0, |program| program.solver.iterations())
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
