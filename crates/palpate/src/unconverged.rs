//! Linear solves of a run that ended without convergence, and contact that was left out.

use palpate_fem::pcg::PcgStatus;
use serde::Serialize;

use crate::counted::counted;
use crate::scene::Readable;
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
    /// Comparisons of a column of the compliance that ended without convergence: they tell no error.
    pub comparisons: u64,
    /// Worst residual of these.
    pub comparison_residual: f64,
    /// Comparisons that were left out, for their steps had no time for them.
    pub comparisons_left_out: u64,
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
        if report.error.sample_unconverged {
            self.comparisons += 1;
            self.comparison_residual = self.comparison_residual.max(report.error.sample_residual);
        }
        self.comparisons_left_out += u64::from(report.error.sample_left_out);
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
                    let most = counted(config.iterations, "iteration", "iterations");
                    format!("give `newton` more than {most} or take a smaller step")
                }
                _ => format!(
                    "give the body more than max_iterations = {} a step, a higher rates.factor, a smaller step, or \
                     compliance = \"exact\"",
                    body.max_iterations
                ),
            };
            notes.push(format!(
                "body {}: the free motion of {} and the correction of {corrections} ended without convergence, \
                 with residuals up to {:.1e} and {:.1e}: motion and forces of these steps are wrong by about as much; {remedy}",
                body.name,
                counted(motions, "step", "steps"),
                self.free_motion_residual,
                self.correction_residual
            ));
        }
        notes.extend(self.comparison_note(world));
        notes.extend(self.left_out_note(world));
        if let Some(first) = self.first_without {
            notes.push(format!(
                "{} went on without contact, the first at {first:.3} s: the matrix of the body could not be factored, \
                 or gave no compliance; try a smaller step, a softer press or a finer mesh",
                counted(self.without_contact, "step", "steps")
            ));
        }
        notes
    }

    /// What there is to say of comparisons of a column that steps had no time for.
    fn left_out_note(&self, world: &World) -> Option<String> {
        (self.comparisons_left_out > 0).then(|| {
            format!(
                "body {}: {} of a column of the compliance left out, for the step would have been late: what the error \
                 is there no column tells; take a coarser mesh, or lower rates.step",
                world.description().bodies[0].name,
                counted(self.comparisons_left_out, "comparison", "comparisons")
            )
        })
    }

    /// What there is to say of comparisons of a column that did not converge.
    fn comparison_note(&self, world: &World) -> Option<String> {
        let (plan, body) = (world.plan().sampling, &world.description().bodies[0]);
        let share = Readable(body.error_sampling);
        let younger = match world.plan().has_factor_thread() {
            true => "a higher rates.factor for a younger factor",
            false => "compliance = \"async\" for a younger factor",
        };
        let longer = match plan.is_limited() {
            true => format!("error_sampling above {share} for longer ones, or "),
            false => String::new(),
        };
        (self.comparisons > 0).then(|| {
            format!(
                "body {}: {} of a column of the compliance ended without convergence in at most {}, with residuals up to \
                 {:.1e}: the error there is not known; give the body {longer}{younger}",
                body.name,
                counted(self.comparisons, "comparison", "comparisons"),
                counted(plan.iterations, "iteration", "iterations"),
                self.comparison_residual
            )
        })
    }
}
