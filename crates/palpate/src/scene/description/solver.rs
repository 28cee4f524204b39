//! The constraint solvers.

use palpate_solver::solver::SolverKind;
use serde::{Deserialize, Serialize};

/// When the constraint solvers stop.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverDescription {
    /// Register name of the solver at step rate. `automatic`, the default, begins with a few sweeps of Gauss-Seidel and goes
    /// on to semismooth Newton, many sweeps and the accelerated gradient where those do not settle it; it allocates nothing
    /// but faer's packing memory at the first Newton step of a thread. `gauss_seidel`, `semismooth_newton`, ... have no
    /// fall-back. The tick always takes warm-started Gauss-Seidel, whose work is bounded.
    pub kind: SolverKind,
    /// Relative natural-map residual at step rate.
    pub tolerance: f64,
    /// Largest number of sweeps, or of the solver's own iterations, at step rate; of each solver that `automatic` tries.
    pub max_sweeps: u32,
    /// Relative natural-map residual of a tick.
    pub tick_tolerance: f64,
    /// Largest number of Gauss-Seidel sweeps in one tick.
    pub tick_sweeps: u32,
}

impl Default for SolverDescription {
    fn default() -> Self {
        Self { kind: SolverKind::Automatic, tolerance: 1e-6, max_sweeps: 2000, tick_tolerance: 1e-3, tick_sweeps: 30 }
    }
}
