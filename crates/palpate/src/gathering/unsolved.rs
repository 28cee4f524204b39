//! Steps whose contact problem was not solved.

use palpate_solver::report::{SolveReport, SolveStatus};

use crate::counted::counted;
use crate::scene::{ContactMethod, SceneDescription};
use crate::step::StepReport;

/// Steps whose contact forces missed the tolerance, with the first and the worst of them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unsolved {
    pub(super) steps: u64,
    first: Option<First>,
    worst: f64,
}

/// The first such step.
#[derive(Clone, Copy, Debug)]
struct First {
    step: u64,
    time: f64,
    solve: SolveReport,
    solver: &'static str,
    /// Whether there was a compliance to solve with.
    usable: bool,
}

impl Unsolved {
    /// Counts a step.
    pub(super) fn add(&mut self, report: &StepReport) {
        if report.solve.is_solved() {
            return;
        }
        let (step, time, solve) = (report.step, report.time, report.solve);
        self.steps += 1;
        self.worst = self.worst.max(solve.residual);
        self.first.get_or_insert(First { step, time, solve, solver: report.solver, usable: report.compliance.usable });
    }

    /// What there is to say of them: how many, the first, why, and what helps.
    pub(super) fn note(&self, scene: &SceneDescription) -> Option<String> {
        let First { step, time, solve, solver, usable } = self.first?;
        let steps = counted(self.steps, "step was", "steps were");
        let (tolerance, worst) = (scene.solver.tolerance, self.worst);
        let begin = format!("the contact forces of {steps} not solved to {tolerance:e}");
        if !usable {
            return Some(format!(
                "{begin}, the first step {step} at {time:.3} s: it had no compliance and went on without contact"
            ));
        }
        let (ended, residual) = (solve.status.in_words(), solve.residual);
        let remedy = remedy(scene, solve.status);
        Some(format!(
            "{begin}, with a residual of up to {worst:.1e}; the first is step {step} at {time:.3} s, where `{solver}` ended with \
             \"{ended}\" at {residual:.1e}; {remedy}"
        ))
    }
}

/// What helps against this end by the scene's method.
fn remedy(scene: &SceneDescription, status: SolveStatus) -> String {
    let most = scene.solver.max_sweeps;
    let automatic = palpate_solver::solver::SolverKind::Automatic;
    match (scene.contact.method, status) {
        (ContactMethod::Penalty, SolveStatus::MaxIterations) => {
            format!("lower the stiffness of `penalty`, or raise `max_sweeps` of [solver] above {most}")
        }
        (ContactMethod::Penalty, _) => {
            "lower the stiffness of `penalty`: forces that the motion does not balance are left out".into()
        }
        (ContactMethod::Lagrange, _) => "set a larger `tolerance` of [solver], or method = \"compliance\"".into(),
        (ContactMethod::Compliance, _) if scene.solver.kind != automatic => {
            format!("set kind = \"automatic\" in [solver], or raise its `max_sweeps` above {most}")
        }
        (ContactMethod::Compliance, SolveStatus::MaxIterations) => {
            format!(
                "raise `max_sweeps` of [solver] above {most}, or save the problems by --save-problems and try `palpate solve`"
            )
        }
        (ContactMethod::Compliance, _) => {
            "the rows may conflict: press less deep, or save the problems by --save-problems and try `palpate solve`"
                .into()
        }
    }
}
