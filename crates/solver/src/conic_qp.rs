//! Problems without friction as one quadratic program, solved by Clarabel's interior-point method: contact, thresholds and
//! closed rows.
//!
//! ```text
//! minimise 1/2 lambda^T W lambda + delta_free^T lambda ,   lambda admissible
//! ```
//!
//! The program is the problem itself, since these laws are associated; rows of `W` may be redundant. Laws with friction
//! (a coefficient or limit above zero) end as [`SolveStatus::Unsupported`]: [`crate::conic_friction`] takes them.
//! Conflicting closed rows make the program unbounded, and end as [`SolveStatus::NoSolution`]. Clarabel starts from its
//! own point, not from `lambda`: a reference and a fall-back at step rate, not for the tick. Problems whose laws have been
//! met lately, in the same order, or prepared for are solved without allocation.

use crate::conic::{ConicPrograms, Until};
use crate::gauss_seidel::GaussSeidelWorkspace;
use crate::iteration::{self, Advance, Stop};
use crate::open_contacts::form_gap_of_closed;
use crate::problem::ProblemView;
use crate::report::{SolveReport, SolveStatus};
use crate::solver::ConstraintSolver;
use crate::watch::Watch;
use palpate_constraints::law::ConicForm;
use serde::{Deserialize, Serialize};

/// Parameters of the quadratic program.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ConicQpConfig {
    /// Natural-map residual that counts as solved, relative, `> 0`; Clarabel itself always goes as far as it can. Default
    /// 1e-6.
    pub tolerance: f64,
}

impl Default for ConicQpConfig {
    fn default() -> Self {
        Self { tolerance: 1e-6 }
    }
}

/// Memory of the quadratic program: of the gaps, and programs by structure, laid out as they are met.
#[derive(Clone, Debug, Default)]
pub struct ConicQpWorkspace {
    gaps: GaussSeidelWorkspace,
    programs: ConicPrograms,
}

impl ConicQpWorkspace {
    /// Memory for problems of up to `rows` rows.
    #[must_use]
    pub fn with_capacity(rows: usize) -> Self {
        Self { gaps: GaussSeidelWorkspace::with_capacity(rows), programs: ConicPrograms::default() }
    }
}

impl ConstraintSolver for ConicQpConfig {
    const NAME: &'static str = "conic_qp";
    type Workspace = ConicQpWorkspace;

    fn workspace(&self, rows: usize) -> ConicQpWorkspace {
        ConicQpWorkspace::with_capacity(rows)
    }

    /// There is one program: the limit of iterations says whether it is solved at all.
    fn limited(self, tolerance: f64, _max_iterations: Option<u32>) -> Self {
        Self { tolerance }
    }

    fn prepare(&self, view: &ProblemView<'_>, ws: &mut ConicQpWorkspace) -> Result<(), SolveStatus> {
        ws.programs.rehearse(view, &mut ws.gaps)
    }

    fn solve_watched(
        &self,
        view: &ProblemView<'_>,
        lambda: &mut [f64],
        ws: &mut ConicQpWorkspace,
        watch: &mut Watch<'_>,
    ) -> SolveReport {
        let stop = Stop { tolerance: self.tolerance, max_iterations: 1, stall: 1 };
        let deadline = watch.deadline();
        let ConicQpWorkspace { gaps, programs } = ws;
        let report = iteration::run(view, lambda, stop, gaps, watch, |lambda, ws, _| {
            let linear = |form| match form {
                ConicForm::Free | ConicForm::NonNegative | ConicForm::Interval { .. } => true,
                ConicForm::SecondOrder { friction } | ConicForm::Polyhedral { friction, .. } => friction == 0.0,
                ConicForm::Cylinder { limit } => limit == 0.0,
            };
            if !view.blocks.iter().all(|block| linear(block.law.conic_form())) {
                return Advance::Ended(SolveStatus::Unsupported);
            }
            // These laws are associated: no gap is corrected.
            let until = Until { deadline, enough: 0.0 };
            let solved = programs.prepare(view, &ws.local).and_then(|()| programs.solve(view, &[], until, lambda));
            match solved {
                Ok(()) => form_gap_of_closed(view, lambda, &mut ws.delta),
                Err(status) => return Advance::Ended(status),
            }
            Advance::Formed
        });
        match report.status {
            // One program is all there is.
            SolveStatus::MaxIterations => SolveReport { status: SolveStatus::Stalled, ..report },
            _ => report,
        }
    }
}
