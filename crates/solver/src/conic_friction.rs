//! Coulomb friction as a sequence of second-order cone programs, solved by Clarabel's interior-point method
//! [Acary, Cadoux, Lemaréchal and Malick 2011].
//!
//! ```text
//! repeat: s = mu |delta_t| n (De Saxcé's correction) at the gap so far
//!         minimise 1/2 lambda^T W lambda + (delta_free + s)^T lambda ,   lambda in the cones
//! until natural-map residual <= tolerance
//! ```
//!
//! Each program is convex, whatever the rank of `W`; at the fixed point of `s` the law is Coulomb's, exactly.
//! Associated laws need one program. The plain fixed point is approached linearly, faster for less friction: on a body
//! held by many contacts (`OneObject-i100000` of Siconos's problems) its error falls by less than a tenth a program. So
//! it is accelerated ([Anderson 1965]), and programs far from it are solved no further than it is worth. It need not
//! exist where the problem has no solution.
//!
//! A program leaves errors of the order of `sqrt(1e-16)` of its largest force where a contact is between slip and stick, and
//! all of a block whose share of the energy is below that of the largest. So, once [`IDLE`] programs have not lowered the
//! residual, sweeps of block Gauss-Seidel on the exact laws go on from the best forces.
//!
//! Clarabel starts every program from its own point: a reference and a fall-back at step rate, not for the tick.
//! Problems whose laws have been met lately, in the same order, or prepared for are solved without allocation.

use crate::conic::{ConicPrograms, Corrections, Until};
use crate::gauss_seidel::{GaussSeidelWorkspace, sweep};
use crate::iteration::{self, Advance, Stop};
use crate::open_contacts::form_gap_of_closed;
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
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

/// Memory of the sequence of cone programs: of sweeps and of the fixed point, and programs by structure, laid out as they
/// are met.
#[derive(Clone, Debug)]
pub struct ConicFrictionWorkspace {
    sweeps: GaussSeidelWorkspace,
    programs: ConicPrograms,
    corrections: Corrections,
}

impl ConstraintSolver for ConicFrictionConfig {
    const NAME: &'static str = "conic_friction";
    type Workspace = ConicFrictionWorkspace;

    fn workspace(&self, rows: usize) -> ConicFrictionWorkspace {
        ConicFrictionWorkspace {
            sweeps: GaussSeidelWorkspace::with_capacity(rows),
            programs: ConicPrograms::default(),
            corrections: Corrections::with_capacity(rows),
        }
    }

    fn limited(self, tolerance: f64, max_iterations: Option<u32>) -> Self {
        Self { tolerance, max_iterations: max_iterations.unwrap_or(self.max_iterations), ..self }
    }

    fn prepare(&self, view: &ProblemView<'_>, ws: &mut ConicFrictionWorkspace) -> Result<(), SolveStatus> {
        ws.programs.rehearse(view, &mut ws.sweeps)
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut ConicFrictionWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop =
            Stop { tolerance: self.tolerance, max_iterations: self.max_iterations, stall: self.stall_iterations };
        let deadline = watch.deadline();
        let ConicFrictionWorkspace { sweeps, programs, corrections } = ws;
        let (mut least, mut idle, mut first) = (f64::INFINITY, 0, true);
        iteration::run(view, lambda, stop, sweeps, watch, |lambda, ws, residual| {
            // The residual of the start is none of a program's.
            if idle < IDLE && !first {
                corrections.note(residual);
                idle = if residual < 0.99 * least { 0 } else { idle + 1 };
                least = least.min(residual);
                if idle >= IDLE && ws.best.len() == lambda.len() {
                    lambda.copy_from_slice(&ws.best);
                    view.gap(lambda, &mut ws.delta);
                }
            }
            if idle >= IDLE {
                sweep(view, lambda, 1.0, false, ws);
                return Advance::Updated;
            }
            let until = Until::on_the_way((!first).then_some(residual), deadline);
            if first {
                first = false;
                corrections.begin();
                if let Err(status) = programs.prepare(view, &ws.local) {
                    return Advance::Ended(status);
                }
            }
            let given = corrections.next(view, &ws.delta, |row| programs.scale(row));
            match programs.solve(view, given, until, lambda) {
                Ok(()) => form_gap_of_closed(view, lambda, &mut ws.delta),
                Err(status) => return Advance::Ended(status),
            }
            Advance::Formed
        })
    }
}
