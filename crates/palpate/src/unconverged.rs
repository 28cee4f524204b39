//! Linear solves of a run that ended without convergence, and contact that was left out.

use palpate_fem::pcg::PcgStatus;
use serde::Serialize;

use crate::step::StepReport;
use crate::world::{Integration, World};

/// Steps in which something was not solved. Residuals are relative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Unconverged {
    /// Steps whose free motion ended without convergence.
    pub free_motions: u64,
    /// Worst residual of these.
    pub free_motion_residual: f64,
    /// Steps whose exact correction ended without convergence.
    pub corrections: u64,
    /// Worst residual of these.
    pub correction_residual: f64,
    /// Steps that factored their own matrix to go on, after iterations that did not converge.
    pub rescued: u64,
    /// Steps with contacts whose forces were left out for want of a compliance.
    pub without_contact: u64,
    /// Begin of the first of those (s).
    #[serde(skip)]
    first_without: Option<f64>,
}

impl Unconverged {
    pub(crate) fn add(&mut self, report: &StepReport) {
        if report.free_motion.status != PcgStatus::Converged {
            self.free_motions += 1;
            self.free_motion_residual = self.free_motion_residual.max(report.free_motion.relative_residual);
        }
        if report.error.correction_unconverged {
            self.corrections += 1;
            self.correction_residual = self.correction_residual.max(report.error.correction_residual);
        }
        self.rescued += u64::from(report.rescued);
        if report.rows.rows > 0 && !report.compliance.usable {
            self.without_contact += 1;
            self.first_without.get_or_insert(report.time);
        }
    }

    /// What there is to say of them at the end of a run of `world`, with what a user can do.
    pub(crate) fn notes(&self, world: &World) -> Vec<String> {
        let mut notes = Vec::new();
        let [motions, corrections] = [self.free_motions, self.corrections];
        if motions + corrections > 0 {
            let body = &world.description().bodies[0];
            let remedy = match world.integration() {
                Integration::Newton(config) => {
                    format!("give `newton` more than {} iterations or take a smaller step", config.iterations)
                }
                _ => format!(
                    "give the body more than max_iterations = {} a step, a higher rates.factor, a smaller step, or \
                     compliance = \"exact\"",
                    body.max_iterations
                ),
            };
            notes.push(format!(
                "body {}: the free motion of {motions} steps and the correction of {corrections} ended without convergence, \
                 with residuals up to {:.1e} and {:.1e}: motion and forces of these steps are wrong by about as much; {remedy}",
                body.name, self.free_motion_residual, self.correction_residual
            ));
        }
        if let Some(first) = self.first_without {
            notes.push(format!(
                "{} steps went on without contact, the first at {first:.3} s: the matrix of the body could not be factored, \
                 or gave no compliance; try a smaller step, a softer press or a finer mesh",
                self.without_contact
            ));
        }
        notes
    }
}
