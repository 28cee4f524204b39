//! The constraint solvers.

use palpate_solver::gauss_seidel::{GaussSeidelConfig, SweepOrder};
use palpate_solver::solver::{Solver, SolverKind};
use serde::{Deserialize, Serialize};

/// When the constraint solvers stop.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverDescription {
    /// Register name of the solver at step rate. `automatic`, the default, begins with a few sweeps of Gauss-Seidel and goes
    /// on to semismooth Newton, the accelerated gradient and many sweeps where those do not settle it; it allocates nothing
    /// but faer's packing memory at the first Newton step of a thread. `gauss_seidel`, `semismooth_newton`, ... have no
    /// fall-back. The tick always takes warm-started Gauss-Seidel, whose work is bounded.
    pub kind: SolverKind,
    /// Part of each local change that `gauss_seidel` takes at step rate, in (0, 1]; 1 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<f64>,
    /// Order in which `gauss_seidel` visits the contacts at step rate; `forward` by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep_order: Option<SweepOrder>,
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
        Self {
            kind: SolverKind::Automatic,
            relaxation: None,
            sweep_order: None,
            tolerance: 1e-6,
            max_sweeps: 2000,
            tick_tolerance: 1e-3,
            tick_sweeps: 30,
        }
    }
}

impl SolverDescription {
    /// The solver at step rate.
    #[must_use]
    pub fn solver(&self) -> Solver {
        let solver = match self.kind.solver() {
            Solver::GaussSeidel(default) => Solver::GaussSeidel(GaussSeidelConfig {
                relaxation: self.relaxation.unwrap_or(default.relaxation),
                order: self.sweep_order.unwrap_or(default.order),
                ..default
            }),
            other => other,
        };
        solver.limited(self.tolerance, Some(self.max_sweeps))
    }
}
