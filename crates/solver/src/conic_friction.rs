//! Coulomb friction as a sequence of second-order cone programs, solved by Clarabel's interior-point method
//! [Acary, Cadoux, Lemaréchal and Malick 2011].
//!
//! ```text
//! repeat: s = mu |delta_t| n (De Saxcé's correction) at the gap so far
//!         minimise 1/2 lambda^T W lambda + (delta_free + s)^T lambda ,   lambda in the cones
//! until natural-map residual <= tolerance
//! ```
//!
//! Each program is convex, whatever the rank of `W`; at the fixed point of `s` the law is Coulomb's, exactly. Associated
//! laws need one program. The fixed point is approached linearly, faster for less friction; it need not exist where the
//! problem has no solution. A program leaves errors of the order of `sqrt(1e-13)` of its largest force where a contact is between
//! slip and stick, and all of a block whose share of the energy is below 1e-13 of the largest. So, once [`IDLE`] programs have not
//! lowered the residual, sweeps of block Gauss-Seidel on the exact laws go on from the best forces. Clarabel starts every program from its own point and allocates: a reference and a fall-back
//! at step rate, not for the tick.

use crate::conic::ConicProgram;
use crate::gauss_seidel::{GaussSeidelWorkspace, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::problem::ProblemView;
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};

/// Programs without a fall of the residual by a hundredth after which sweeps go on.
pub const IDLE: u32 = 5;

/// Parameters of the sequence of cone programs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ConicFrictionConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of programs and of sweeps after them, in all. Default 1000.
    pub max_iterations: u32,
    /// Programs or sweeps without a fall of the residual by a hundredth after which the run ends as stalled. Default 50.
    pub stall_iterations: u32,
}

impl Default for ConicFrictionConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000, stall_iterations: 50 }
    }
}

impl ConstraintSolver for ConicFrictionConfig {
    const NAME: &'static str = "conic_friction";
    type Workspace = GaussSeidelWorkspace;

    fn workspace(&self, rows: usize) -> GaussSeidelWorkspace {
        GaussSeidelWorkspace::with_capacity(rows)
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut GaussSeidelWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop =
            Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: self.stall_iterations };
        let deadline = watch.deadline();
        let mut program = None;
        let (mut least, mut idle) = (f64::INFINITY, 0);
        iteration::run(view, lambda, stop, ws, watch, |lambda, ws, residual| {
            if idle < IDLE {
                // The residual of the start is none of a program's.
                let falls = program.is_none() || residual < 0.99 * least;
                idle = if falls { 0 } else { idle + 1 };
                least = if program.is_none() { least } else { least.min(residual) };
                if idle >= IDLE && ws.best.len() == lambda.len() {
                    lambda.copy_from_slice(&ws.best);
                    view.gap(lambda, &mut ws.delta);
                }
            }
            if idle >= IDLE {
                sweep(view, lambda, 1.0, false, ws);
                return Advance::Updated;
            }
            if program.is_none() {
                match ConicProgram::new(view, &ws.local, deadline) {
                    Ok(new) => program = Some(new),
                    Err(status) => return Advance::Ended(status),
                }
            }
            let solved = program.as_mut().map_or(Ok(()), |program| program.solve(view, &ws.local, &ws.delta, lambda));
            match solved {
                Ok(()) => view.gap(lambda, &mut ws.delta),
                Err(status) => return Advance::Ended(status),
            }
            Advance::Formed
        })
    }
}
