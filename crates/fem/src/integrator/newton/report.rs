//! When Newton's method stops, and what it did.

use crate::assembly::AssemblyReport;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewtonConfig {
    /// Most iterations (linear solves), at least 1.
    pub iterations: u32,
    /// Bound on the residual, relative to the forces that it balances; positive.
    pub tolerance: f64,
}

impl Default for NewtonConfig {
    /// 1e-9 within 50 iterations: quadratic convergence makes the last digits cheap, and a reference wants them.
    fn default() -> Self {
        Self { iterations: 50, tolerance: 1e-9 }
    }
}

/// How the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewtonStatus {
    /// The residual is within tolerance, or at the rounding of the forces.
    Converged,
    /// The iterations are used up; the state is the best so far.
    OutOfIterations,
    /// No multiple of the direction lowers the potential; the state is the best so far.
    Stalled,
    /// No matrix could be factored; the state is the best so far.
    Singular,
    /// A force, a tangent or a motion is not finite; the state is the best so far, or untouched.
    NonFinite,
}

/// What Newton's method did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewtonReport {
    /// How it ended.
    pub status: NewtonStatus,
    /// Linear solves.
    pub iterations: u32,
    /// `‖r‖` (N) at the end.
    pub residual: f64,
    /// The same, relative to the forces that it balances.
    pub relative_residual: f64,
    /// Halvings of all line searches.
    pub cuts: u32,
    /// By how much the potential fell (J).
    pub decrease: f64,
    /// Iterations that needed the filtered tangent.
    pub filtered: u32,
    /// Iterations that needed a raised diagonal.
    pub raised: u32,
    /// The last assembly.
    pub assembly: AssemblyReport,
}

impl NewtonReport {
    /// Before the first iteration.
    pub(in crate::integrator) fn begin() -> Self {
        Self {
            status: NewtonStatus::OutOfIterations,
            iterations: 0,
            residual: f64::INFINITY,
            relative_residual: f64::INFINITY,
            cuts: 0,
            decrease: 0.0,
            filtered: 0,
            raised: 0,
            assembly: AssemblyReport::NONE,
        }
    }

    /// True for [`NewtonStatus::Converged`].
    pub fn is_converged(&self) -> bool {
        self.status == NewtonStatus::Converged
    }
}
