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
//! problem has no solution. Clarabel starts every program from its own point and allocates: a reference and a fall-back
//! at step rate, not for the tick.

use crate::conic::ConicProgram;
use crate::gauss_seidel::GaussSeidelWorkspace;
use crate::iteration::{self, Advance, Stop};
use crate::problem::ProblemView;
use crate::report::SolveReport;
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};

/// Parameters of the sequence of cone programs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ConicFrictionConfig {
    /// Natural-map residual to reach, relative, `> 0`. Default 1e-6.
    pub tolerance: f64,
    /// Limit of programs. Default 200.
    pub max_iterations: u32,
    /// Programs without a fall of the residual by a hundredth after which the run ends as stalled. Default 20.
    pub stall_iterations: u32,
}

impl Default for ConicFrictionConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 200, stall_iterations: 20 }
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
        iteration::run(view, lambda, stop, ws, watch, |lambda, ws, _| {
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
