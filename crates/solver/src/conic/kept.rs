//! Clarabel, kept: a solver for programs of one structure, whose numbers change.
//!
//! ```text
//! minimise 1/2 x^T P x + q^T x   subject to   b - A x in K
//! ```
//!
//! The structure (which entries of `P` and `A` there are, and the cones) is ordered and laid out once; numbers are written
//! into it, and solving allocates nothing. Clarabel's own equilibration is off: it would scale every later program as the
//! first one asked for, so that a solution depended on what was solved before. What is given here is scaled already.

use crate::report::SolveStatus;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultInfo, DefaultSettings, DefaultSolution, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// How far Clarabel goes, on numbers of order one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerance {
    /// Duality gap, absolute and relative.
    pub(crate) gap: f64,
    /// Infeasibilities, relative.
    pub(crate) feasibility: f64,
    /// Shift of the diagonal that keeps a factorisation quasidefinite; iterative refinement takes it back.
    pub(crate) shift: f64,
}

/// When a program ends before its tolerance.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Until {
    /// When the time is over.
    pub(crate) deadline: Option<Instant>,
    /// Duality gap and infeasibilities that are enough, absolute, of numbers of order one.
    pub(crate) enough: f64,
}

/// What the first of a sequence of programs is solved to, and share of the residual that the error of the others may make: a
/// third of the interior-point iterations is saved against solving each as far as it goes.
const FIRST: f64 = 1e-6;
const SHARE: f64 = 0.1;

impl Until {
    /// For a program of a sequence on the way to a fixed point, from a residual; none is known for the first. The error of
    /// forces goes with the root of the duality gap, and stays under the residual that the program starts from.
    pub(crate) fn on_the_way(residual: Option<f64>, deadline: Option<Instant>) -> Self {
        let enough = residual.map_or(FIRST, |residual| (SHARE * residual).powi(2).min(FIRST));
        Self { deadline, enough }
    }

    /// Whether the time is over.
    pub(crate) fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    fn is_met(&self, info: &DefaultInfo<f64>) -> bool {
        let converging = info.ktratio <= 1.0;
        converging && info.gap_abs < self.enough && info.res_primal < self.enough && info.res_dual < self.enough
    }
}

/// A solver and when it ends.
pub(crate) struct KeptSolver {
    solver: DefaultSolver<f64>,
    until: Arc<Mutex<Until>>,
}

impl KeptSolver {
    /// Lays out programs with the entries of `quadratic` (upper triangle) and `constraints`, stored zeros among them.
    /// Clarabel goes as far as `tolerance`.
    ///
    /// # Errors
    /// [`SolveStatus::Invalid`] where sizes disagree.
    pub(crate) fn new(
        quadratic: &CscMatrix<f64>,
        constraints: &CscMatrix<f64>,
        cones: &[SupportedConeT<f64>],
        tolerance: Tolerance,
    ) -> Result<Self, SolveStatus> {
        let (linear, right) = (vec![0.0; quadratic.n], vec![0.0; constraints.m]);
        let mut solver = DefaultSolver::new(quadratic, &linear, constraints, &right, cones, settings(tolerance))
            .map_err(|_| SolveStatus::Invalid)?;
        // Clarabel throws its table of times of inner stages away with each solve, and allocates it anew. Below a timer that
        // nobody resets it stays.
        if let Some(timers) = solver.timers.as_mut() {
            timers.start_as_current("kept");
        }
        let until = Arc::new(Mutex::new(Until::default()));
        let seen = Arc::clone(&until);
        solver.set_termination_callback(move |info: &DefaultInfo<f64>| {
            let until = *seen.lock().unwrap_or_else(PoisonError::into_inner);
            until.is_met(info) || until.is_late()
        });
        Ok(Self { solver, until })
    }

    /// Writes the entries of `P` and `A` in the order of [`KeptSolver::new`].
    ///
    /// # Errors
    /// [`SolveStatus::Invalid`] for another number of entries.
    pub(crate) fn set_matrices(&mut self, quadratic: &Vec<f64>, constraints: &Vec<f64>) -> Result<(), SolveStatus> {
        self.solver.update_P(quadratic).map_err(|_| SolveStatus::Invalid)?;
        self.solver.update_A(constraints).map_err(|_| SolveStatus::Invalid)
    }

    /// Solves with `q` and `b` from Clarabel's own start, the same bits whatever was solved before.
    ///
    /// # Errors
    /// How Clarabel ended, where it has no answer. An answer may be short of the tolerance: the residual judges it.
    pub(crate) fn solve(
        &mut self,
        linear: &Vec<f64>,
        right: &Vec<f64>,
        until: Until,
    ) -> Result<&DefaultSolution<f64>, SolveStatus> {
        if until.is_late() {
            return Err(SolveStatus::TimeLimit);
        }
        *self.until.lock().unwrap_or_else(PoisonError::into_inner) = until;
        self.solver.update_q(linear).map_err(|_| SolveStatus::Invalid)?;
        self.solver.update_b(right).map_err(|_| SolveStatus::Invalid)?;
        // The start is computed; where that fails, it is nought instead of the end of the last program.
        for values in [&mut self.solver.variables.x, &mut self.solver.variables.s, &mut self.solver.variables.z] {
            values.fill(0.0);
        }
        self.solver.solve();
        match self.solver.solution.status {
            SolverStatus::Solved
            | SolverStatus::AlmostSolved
            | SolverStatus::InsufficientProgress
            | SolverStatus::MaxIterations
            | SolverStatus::NumericalError => Ok(&self.solver.solution),
            SolverStatus::CallbackTerminated if until.is_met(&self.solver.info) => Ok(&self.solver.solution),
            SolverStatus::CallbackTerminated => Err(SolveStatus::TimeLimit),
            _ => Err(SolveStatus::NoSolution),
        }
    }

    /// Iterations of the last program.
    pub(crate) fn iterations(&self) -> u32 {
        self.solver.solution.iterations
    }
}

/// Clarabel on the calling thread, silent, for programs whose numbers change.
fn settings(tolerance: Tolerance) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_string(),
        presolve_enable: false,
        equilibrate_enable: false,
        tol_gap_abs: tolerance.gap,
        tol_gap_rel: tolerance.gap,
        tol_feas: tolerance.feasibility,
        static_regularization_constant: tolerance.shift,
        ..DefaultSettings::default()
    }
}
