//! Where a run stands on its [`Ladder`], what the rung below would have missed, and which rung comes next.
//!
//! ```text
//! x = P⁻¹ Hᵀ λ,  P of the rung below        h² H x against W_A λ: its error along the forces
//! y = P⁻¹ Hᵀ e_j                            h² H y against column j of W_A, the one that this step has sampled
//! ```
//! `W_A λ` and the column are those that the step has measured its own error with; on the exact rung they are its `W`.

use palpate_constraints::compliance::ComplianceMethod;
use palpate_fem::factor::SolveStatus;
use palpate_fem::preconditioner::{Preconditioner, WarpedPreconditioner};

use super::accuracy::opening;
use super::column;
use super::first_inverse::first_serves;
use super::{StepReport, StepState, StepStatus, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{CALM_STEPS, LOWER_SHARE, Ladder, MOST_CALM_STEPS, Rung, World};

/// Where a run stands, from step to step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Climb {
    /// Place of the rung, from 0.
    place: u8,
    /// Steps in a row in which the rung below would have done.
    calm: u32,
    /// How many of them it takes to go down.
    wait: u32,
    /// Steps since the run last went down.
    since: u32,
}

impl Default for Climb {
    fn default() -> Self {
        Self { place: 0, calm: 0, wait: CALM_STEPS, since: u32::MAX }
    }
}

impl Climb {
    /// After a step: up where it missed the accuracy; down where the rung below, not under `lowest`, would have met it for
    /// long enough. `lower` is the relative error of that rung, NaN where it was not measured.
    fn advance(&mut self, ladder: &Ladder, lowest: usize, contact: bool, missed: bool, lower: f64) {
        self.since = self.since.saturating_add(1);
        let place = usize::from(self.place);
        if missed && place + 1 < ladder.rungs().len() {
            // It came down too early.
            if self.since <= self.wait {
                self.wait = (2 * self.wait).min(MOST_CALM_STEPS);
            }
            (self.place, self.calm) = (self.place + 1, 0);
            return;
        }
        if place <= lowest {
            self.wait = if contact { self.wait } else { CALM_STEPS };
            return;
        }
        if !contact || lower <= LOWER_SHARE * ladder.accuracy {
            self.calm += 1;
        } else if lower > LOWER_SHARE * ladder.accuracy {
            self.calm = 0;
        }
        if self.calm >= self.wait {
            (self.place, self.calm, self.since) = (self.place - 1, 0, 0);
        }
    }
}

/// The rung of the step that begins; none without a ladder.
pub(super) fn begin(world: &World, state: &mut StepState, ws: &StepWorkspace) -> Option<Rung> {
    let ladder = world.plan().ladder?;
    let lowest = ladder.lowest(first_serves(state, ws));
    state.climb.place = state.climb.place.max(lowest as u8);
    Some(ladder.rung(usize::from(state.climb.place)))
}

/// Chooses the rung of the next step from what this one has measured.
pub(super) fn choose_next(
    world: &World,
    factor: &FactorSample,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let (Some(ladder), Some(rung)) = (world.plan().ladder, report.rung) else { return };
    // Rows without force are no matter: nothing moves by them.
    let contact = report.active > 0 || report.bodies.active > 0;
    if contact && (!report.compliance.usable || report.status != StepStatus::Advanced) {
        return;
    }
    let lowest = ladder.lowest(first_serves(state, ws));
    let below = usize::from(state.climb.place).checked_sub(1).filter(|below| *below >= lowest);
    let measured = report.error.measured();
    if contact {
        report.error.lower = match (below.map(|below| ladder.rung(below)), rung) {
            (None, _) => f64::NAN,
            // The same factor until the error makes it anew, which it does above the share that the lower rung may use up.
            (Some(_), Rung::Early) => measured.unwrap_or(f64::NAN),
            (Some(lower), _) => probe(world, lower, factor, ws, report),
        };
    }
    let exact = report.method == ComplianceMethod::Exact;
    let missed = contact && !exact && measured.is_some_and(|error| error > ladder.accuracy);
    state.climb.advance(&ladder, lowest, contact, missed, report.error.lower);
}

/// The greater of the relative errors that the compliance of another rung has along the forces and in the sampled column;
/// NaN where neither could be compared.
fn probe(world: &World, lower: Rung, factor: &FactorSample, ws: &mut StepWorkspace, report: &StepReport) -> f64 {
    let along = along_forces(lower, factor, ws, report).unwrap_or(f64::NAN);
    let column = of_column(world, lower, factor, ws, report).unwrap_or(f64::NAN);
    along.max(column) // ignores one NaN
}

/// `P⁻¹ Hᵀ λ` of another rung into `ws.probe`; `ws.lambda_of_sample` is λ.
fn answer(lower: Rung, factor: &FactorSample, ws: &mut StepWorkspace) -> Option<()> {
    ws.load.fill(0.0);
    ws.rows.tissue.add_transposed(&ws.lambda_of_sample[..ws.rows.len()], &mut ws.load);
    let first = ws.first.as_ref().filter(|_| lower == Rung::Warped);
    let (factor, rotations) = match first.and_then(|first| Some((first.factor.as_ref()?, &first.rotations[..]))) {
        Some(first) => first,
        None => (&factor.factor, &ws.rotations[..]),
    };
    let status = WarpedPreconditioner { factor, rotations, workspace: &mut ws.solve }.apply(&ws.load, &mut ws.probe);
    (status == SolveStatus::Ok).then_some(())
}

/// `‖h² H P⁻¹ Hᵀ λ - W_A λ‖ / ‖W_A λ‖`, where the motion under the forces is that of the step's own matrix.
fn along_forces(lower: Rung, factor: &FactorSample, ws: &mut StepWorkspace, report: &StepReport) -> Option<f64> {
    let exact = report.method == ComplianceMethod::Exact;
    if !exact && report.error.along_forces.is_nan() {
        return None;
    }
    let m = ws.rows.len();
    ws.lambda_of_sample[..m].copy_from_slice(&ws.lambda[..m]);
    answer(lower, factor, ws)?;
    let (mut missed, mut all) = (0.0, 0.0);
    for r in 0..m {
        let truth = opening(ws, r);
        let tissue = ws.dt * ws.dt * ws.rows.tissue.dot(r, &ws.probe);
        let error = tissue + ws.dt * ws.rows.rigid.dot(r, &ws.rigid.correction) - truth;
        (missed, all) = (missed + error * error, all + truth * truth);
    }
    (all > 0.0).then(|| (missed / all).sqrt())
}

/// The largest error of a column, relative to the largest entry of the exact one: the column that the step has sampled, or
/// on the exact rung the one whose turn it would be.
fn of_column(
    world: &World,
    lower: Rung,
    factor: &FactorSample,
    ws: &mut StepWorkspace,
    report: &StepReport,
) -> Option<f64> {
    let m = ws.rows.len();
    let exact = report.method == ComplianceMethod::Exact;
    if !exact && report.error.sampled.is_nan() {
        return None;
    }
    let row = if exact { world.plan().sampling.row(report.step, m) } else { report.error.sampled_row as usize };
    if !column::push(ws, row) {
        return None;
    }
    answer(lower, factor, ws)?;
    let w = ws.problem.view().column(row);
    let truth = |r: usize| if exact { w[r] } else { column::entry(ws, r, &ws.sample) };
    column::error(m, |r| column::entry(ws, r, &ws.probe), truth)
}

/// Memory for the answer of another rung to a load: `3 x nodes` where there is a ladder.
pub(super) fn probe_room(world: &World) -> Vec<f64> {
    vec![0.0; if world.plan().ladder.is_some() { 3 * world.model().free_nodes() } else { 0 }]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ladder() -> Ladder {
        let scene = crate::scene::Scene::bundled("block");
        let mut scene = scene.unwrap();
        scene.edit(|d| d.bodies[0].accuracy = Some(0.1)).unwrap();
        scene.build().unwrap().plan().ladder.unwrap()
    }

    #[test]
    fn a_run_climbs_at_once_and_comes_down_after_calm_steps_one_rung_at_a_time() {
        let ladder = ladder();
        assert_eq!(ladder.rungs(), Rung::ALL);
        let mut climb = Climb::default();
        for place in 1..4 {
            climb.advance(&ladder, 0, true, true, f64::NAN);
            assert_eq!(climb.place, place);
        }
        climb.advance(&ladder, 0, true, true, f64::NAN);
        assert_eq!(climb.place, 3, "there is nothing above exact steps");
        // Not while the rung below would use up more than its share, nor by a step that measured nothing.
        for _ in 0..100 {
            climb.advance(&ladder, 0, true, false, 0.06);
            climb.advance(&ladder, 0, true, false, f64::NAN);
        }
        assert_eq!((climb.place, climb.calm), (3, 0));
        for step in 1..=3 * CALM_STEPS {
            climb.advance(&ladder, 0, true, false, 0.04);
            assert_eq!(u32::from(climb.place), 3 - step / CALM_STEPS, "step {step}");
        }
    }

    #[test]
    fn who_comes_down_too_early_waits_twice_as_long_until_the_tool_has_left() {
        let ladder = ladder();
        let mut climb = Climb::default();
        climb.advance(&ladder, 0, true, true, f64::NAN);
        let mut waits = Vec::new();
        for _ in 0..6 {
            let mut steps = 0;
            while climb.place == 1 {
                climb.advance(&ladder, 0, true, false, 0.01);
                steps += 1;
            }
            waits.push(steps);
            climb.advance(&ladder, 0, true, true, f64::NAN);
        }
        assert_eq!(waits, [15, 30, 60, 120, 240, 240]);
        (0..500).for_each(|_| climb.advance(&ladder, 0, false, false, f64::NAN));
        assert_eq!((climb.place, climb.wait), (0, CALM_STEPS));
    }

    #[test]
    fn a_rung_that_is_gone_is_not_come_down_to() {
        let ladder = ladder();
        let mut climb = Climb::default();
        climb.advance(&ladder, 1, true, true, f64::NAN);
        (0..500).for_each(|_| climb.advance(&ladder, 1, false, false, 0.0));
        assert_eq!(climb.place, 1);
        assert_eq!((ladder.lowest(true), ladder.lowest(false)), (0, 1));
    }
}
