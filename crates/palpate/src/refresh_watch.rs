//! When a factor is too old for what the tissue does, as the steps that use it tell.

use crate::step::{FactorFit, StepReport};
use crate::world::{LOWER_SHARE, Plan, Rung};

/// Iterations of a step below which a factor is young enough, whatever it was before: two of them cost less than a tenth
/// of a factorisation each.
const FEW_ITERATIONS: usize = 12;

/// Growth of the iterations since a factor came into use at which it is too old.
const JUMP: usize = 2;

/// Measured relative error of the compliance at which a factor is too old where the run has no ladder.
const LARGEST_ERROR: f64 = 0.1;

/// Watches the steps for a factor that ages faster than the factor rate expects.
#[derive(Clone, Debug)]
pub struct RefreshWatch {
    epoch: Option<u64>,
    /// Iterations of the first step with that factor.
    iterations: usize,
    /// Of the ladder.
    accuracy: Option<f64>,
}

impl RefreshWatch {
    /// A watch that holds the measured error of the compliance to a tenth, or on a ladder that of the forces to its accuracy.
    pub fn new(plan: &Plan) -> Self {
        Self { epoch: None, iterations: 0, accuracy: plan.ladder.map(|ladder| ladder.accuracy) }
    }

    /// Whether the error that a step measured tells that its factor is too old. On a ladder early refreshes for the error's
    /// sake are a rung of their own, where that of the forces counts.
    fn is_wrong(&self, report: &StepReport) -> bool {
        match (report.rung, self.accuracy) {
            (Some(Rung::Early), Some(accuracy)) => {
                report.error.of_forces().is_some_and(|error| error > LOWER_SHARE * accuracy)
            }
            (Some(_), Some(_)) => false,
            _ => report.error.measured().is_some_and(|error| error > LARGEST_ERROR),
        }
    }

    /// Whether the factor that this step used is too old: its iterations have doubled since it came into use, the
    /// compliance from it is wrong, it preconditions no more, or it is of the body before an event. A function of the reports alone, so that runs in lockstep repeat it.
    pub fn is_too_old(&mut self, report: &StepReport) -> bool {
        let iterations = report.free_motion.iterations.max(report.error.correction_iterations as usize);
        if self.epoch != Some(report.factor_epoch) {
            (self.epoch, self.iterations) = (Some(report.factor_epoch), iterations);
        }
        let jumped = iterations > FEW_ITERATIONS && iterations > JUMP * self.iterations;
        let wrong = self.is_wrong(report);
        let of_another_body = report.change.factor != FactorFit::Own;
        report.factor_age > 0.0 && (jumped || wrong) || report.rescued || of_another_body
    }
}
