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
//! Clarabel allocates as it solves.

use crate::problem::{ProblemView, gather};
use crate::report::SolveStatus;
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use palpate_constraints::law::{ConicForm, LocalCompliance};
use std::f64::consts::PI;
use std::time::Instant;

/// Tolerance asked of Clarabel, on numbers of order one: as far as its interior-point method goes in double precision. It
/// answers `AlmostSolved` or `InsufficientProgress` where it does not come so far, and the residual judges the answer.
const TOLERANCE: f64 = 1e-13;

/// Largest asymmetry of `W` that is taken for rounding, relative to `sqrt(W_ii W_jj)`.
const ASYMMETRY: f64 = 1e-2;

/// A conic program whose linear term changes.
pub(crate) struct ConicProgram {
    solver: DefaultSolver<f64>,
    linear: Vec<f64>,
    /// Largest scaled gap.
    size: f64,
    deadline: Option<Instant>,
}

/// Rows `b - A x` in cones, column by column as they come.
#[derive(Default)]
struct Cones {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Cones {
    /// A row `constant + sum of entries` of the cone that is pushed next.
    fn row(&mut self, constant: f64, entries: &[(usize, f64)]) {
        for (column, value) in entries {
            self.rows.push(self.right.len());
            self.columns.push(*column);
            self.values.push(-value);
        }
        self.right.push(constant);
    }

    /// The admissible forces of a block from row `n` on; limits are of scaled forces.
    fn admit(&mut self, form: ConicForm, n: usize, scale: f64) {
        let (t, s) = (n + 1, n + 2);
        match form {
            ConicForm::Free => {}
            ConicForm::NonNegative => {
                self.row(0.0, &[(n, 1.0)]);
                self.cones.push(NonnegativeConeT(1));
            }
            ConicForm::Interval { limit } => {
                self.row(0.0, &[(n, 1.0)]);
                self.row(limit / scale, &[(n, -1.0)]);
                self.cones.push(NonnegativeConeT(2));
            }
            ConicForm::SecondOrder { friction } if friction > 0.0 => {
                self.row(0.0, &[(n, friction)]);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(SecondOrderConeT(3));
            }
            ConicForm::Cylinder { limit } if limit > 0.0 => {
                self.admit(ConicForm::NonNegative, n, scale);
                self.row(limit / scale, &[]);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(SecondOrderConeT(3));
            }
            ConicForm::Polyhedral { friction, facets } if friction > 0.0 => {
                let half = PI / facets as f64;
                for j in 0..facets {
                    let (sin, cos) = ((2 * j + 1) as f64 * half).sin_cos();
                    self.row(0.0, &[(n, friction * half.cos()), (t, -cos), (s, -sin)]);
                }
                self.cones.push(NonnegativeConeT(facets));
            }
            // Without friction.
            _ => {
                self.admit(ConicForm::NonNegative, n, scale);
                self.row(0.0, &[(t, 1.0)]);
                self.row(0.0, &[(s, 1.0)]);
                self.cones.push(ZeroConeT(2));
            }
        }
    }
}

impl ConicProgram {
    /// # Errors
    /// [`SolveStatus::Unsupported`] for an asymmetric `W`, [`SolveStatus::NotFinite`] for numbers that are not.
    pub(crate) fn new(
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        deadline: Option<Instant>,
    ) -> Result<Self, SolveStatus> {
        let rows = view.rows();
        let scale = |a: usize| local.get(a).map_or(1.0, |local| local.rho().sqrt());
        let mut row_scale = vec![1.0; rows];
        for (a, block) in view.blocks.iter().enumerate() {
            row_scale.iter_mut().skip(block.start).take(block.law.rows()).for_each(|s| *s = scale(a));
        }
        let size =
            view.delta_free.iter().zip(&row_scale).map(|(gap, s)| (gap * s).abs()).fold(f64::MIN_POSITIVE, f64::max);
        if !size.is_finite() {
            return Err(SolveStatus::NotFinite);
        }
        let quadratic = upper_triangle(view, &row_scale)?;
        let mut cones = Cones::default();
        for (a, block) in view.blocks.iter().enumerate() {
            cones.admit(block.law.conic_form(), block.start, scale(a) * size);
        }
        let settings = settings(TOLERANCE);
        let Cones { rows: i, columns: j, values, right, cones } = cones;
        let constraints = CscMatrix::new_from_triplets(right.len(), rows, i, j, values);
        let linear = vec![0.0; rows];
        let solver = DefaultSolver::new(&quadratic, &linear, &constraints, &right, &cones, settings)
            .map_err(|_| SolveStatus::Unsupported)?;
        Ok(Self { solver, linear, size, deadline })
    }

    /// Solves with the linear term that belongs to the gap `delta` (m) at the forces `lambda` (N), and writes the new forces
    /// there, admissible.
    ///
    /// # Errors
    /// How Clarabel ended, where it has no answer.
    pub(crate) fn solve(
        &mut self,
        view: &ProblemView<'_>,
        local: &[LocalCompliance],
        delta: &[f64],
        lambda: &mut [f64],
    ) -> Result<(), SolveStatus> {
        let at = |i: usize, j: usize| view.column(j).get(i).copied().unwrap_or(0.0);
        for (block, local) in view.blocks.iter().zip(local) {
            let gap = gather(delta, block);
            let correction = block.law.corrected_gap(&gap).x - gap.x;
            let scale = local.rho().sqrt() / self.size;
            for row in block.start..block.start + block.law.rows() {
                let shift = if row == block.start { correction } else { 0.0 };
                let skew: f64 = lambda.iter().enumerate().map(|(j, f)| 0.5 * (at(row, j) - at(j, row)) * f).sum();
                self.linear[row] = (view.delta_free[row] + shift + skew) * scale;
            }
        }
        if let Some(deadline) = self.deadline {
            // What is left of the time, for this program.
            let time_limit = deadline.saturating_duration_since(Instant::now()).as_secs_f64();
            if time_limit <= 0.0 {
                return Err(SolveStatus::TimeLimit);
            }
            let settings = DefaultSettings { time_limit, ..self.solver.settings().clone() };
            self.solver.update_settings(settings).map_err(|_| SolveStatus::Unsupported)?;
        }
        self.solver.update_q(&self.linear).map_err(|_| SolveStatus::Unsupported)?;
        self.solver.solve();
        answered(self.solver.solution.status)?;
        for (block, local) in view.blocks.iter().zip(local) {
            let force = gather(&self.solver.solution.x, block) * (local.rho().sqrt() * self.size);
            crate::problem::scatter(&block.law.project(&force), block, lambda);
        }
        Ok(())
    }
}

/// Clarabel on the calling thread, silent, to this tolerance.
pub(crate) fn settings(tolerance: f64) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_string(),
        presolve_enable: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    }
}

/// Whether Clarabel has an answer, be it short of its tolerance: the residual judges it.
pub(crate) fn answered(status: SolverStatus) -> Result<(), SolveStatus> {
    match status {
        SolverStatus::Solved
        | SolverStatus::AlmostSolved
        | SolverStatus::InsufficientProgress
        | SolverStatus::MaxIterations
        | SolverStatus::NumericalError => Ok(()),
        SolverStatus::MaxTime => Err(SolveStatus::TimeLimit),
        _ => Err(SolveStatus::NoSolution),
    }
}

/// The upper triangle of the scaled `W`, symmetrised.
fn upper_triangle(view: &ProblemView<'_>, scale: &[f64]) -> Result<CscMatrix<f64>, SolveStatus> {
    let rows = view.rows();
    let mut starts = Vec::with_capacity(rows + 1);
    let mut indices = Vec::with_capacity(rows * (rows + 1) / 2);
    let mut values = Vec::with_capacity(rows * (rows + 1) / 2);
    starts.push(0);
    let at = |i: usize, j: usize| view.column(j).get(i).copied().unwrap_or(0.0);
    for j in 0..rows {
        for i in 0..=j {
            let (w, transposed) = (at(i, j), at(j, i));
            if !(w.is_finite() && transposed.is_finite()) {
                return Err(SolveStatus::NotFinite);
            }
            if (w - transposed).abs() > ASYMMETRY * (at(i, i) * at(j, j)).abs().sqrt() {
                return Err(SolveStatus::Unsupported);
            }
            indices.push(i);
            values.push(0.5 * (w + transposed) * scale[i] * scale[j]);
        }
        starts.push(indices.len());
    }
    Ok(CscMatrix::new(rows, rows, starts, indices, values))
}
