//! Where a run stands on its [`Ladder`], what the rung below would have missed, and which rung comes next.
//!
//! ```text
//! x = P⁻¹ Hᵀ λ,  P of the rung below        h² H x against W λ: its error along the forces
//! y = P⁻¹ Hᵀ e_j                            h² H y against column j of W, whose turn it would be
//! ```
//! Only exact steps stand above another method, so that `W` is that of the step's own matrix. Where the correction is exact
//! the forces would be refined, and wrong by the square of what `W` is wrong by.

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_fem::factor::SolveStatus;
use palpate_fem::preconditioner::{Preconditioner, WarpedPreconditioner};

use super::accuracy::opening;
use super::column;
use super::refinement::expected;
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
    /// After a step: up where it missed the accuracy; down where the rung below would have met it for long enough. `lower`
    /// is the relative error of that rung, NaN where it was not measured.
    fn advance(&mut self, ladder: &Ladder, contact: bool, missed: bool, lower: f64) {
        self.since = self.since.saturating_add(1);
        let place = usize::from(self.place);
        if missed && place + 1 < ladder.rungs().len() {
            // It came down too early; whatever more it climbs now, it has done so once.
            if self.since <= self.wait {
                (self.wait, self.since) = ((2 * self.wait).min(MOST_CALM_STEPS), u32::MAX);
            }
            (self.place, self.calm) = (self.place + 1, 0);
            return;
        }
        if place == 0 {
            self.wait = if contact { self.wait } else { CALM_STEPS };
            return;
        }
        if !contact || lower <= LOWER_SHARE * ladder.accuracy {
            self.calm += 1;
        } else if lower > LOWER_SHARE * ladder.accuracy {
            self.calm = 0;
        }
        // What was too early in contact is none where nothing is left of it.
        if self.calm >= if contact { self.wait } else { CALM_STEPS } {
            (self.place, self.calm, self.since) = (self.place - 1, 0, 0);
        }
    }
}

/// The rung of the step that begins; none without a ladder.
pub(super) fn begin(world: &World, state: &StepState) -> Option<Rung> {
    let ladder = world.plan().ladder?;
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
    let exact = report.method == ComplianceMethod::Exact;
    let known = report.error.of_forces();
    if contact && state.climb.place > 0 {
        report.error.lower = match rung {
            Rung::Exact if exact => probe(world, factor, ws, report),
            // The same factor until the error makes it anew, which it does above the share that the lower rung may use up.
            _ => known.unwrap_or(f64::NAN),
        };
    }
    report.error.missed_accuracy = contact && !exact && known.is_some_and(|error| error > ladder.accuracy);
    state.climb.advance(&ladder, contact, report.error.missed_accuracy, report.error.lower);
}

/// The relative error that the contact forces of the rung below would have: the greater of those by the error of its
/// compliance along the forces and in one column; NaN where neither could be compared.
fn probe(world: &World, factor: &FactorSample, ws: &mut StepWorkspace, report: &StepReport) -> f64 {
    let along = along_forces(factor, ws).unwrap_or(f64::NAN);
    let column = of_column(world, factor, ws, report).unwrap_or(f64::NAN);
    match world.plan().correction {
        MotionCorrection::Exact => expected(along).max(expected(column)), // ignores one NaN
        MotionCorrection::Matching => along.max(column),
    }
}

/// `P⁻¹ Hᵀ λ` of the latest factor into `ws.probe`; `ws.lambda_of_sample` is λ.
fn answer(factor: &FactorSample, ws: &mut StepWorkspace) -> Option<()> {
    ws.load.fill(0.0);
    ws.rows.tissue.add_transposed(&ws.lambda_of_sample[..ws.rows.len()], &mut ws.load);
    let (factor, rotations) = (&factor.factor, &ws.rotations[..]);
    let status = WarpedPreconditioner { factor, rotations, workspace: &mut ws.solve }.apply(&ws.load, &mut ws.probe);
    (status == SolveStatus::Ok).then_some(())
}

/// `‖h² H P⁻¹ Hᵀ λ - W λ‖ / ‖W λ‖`.
fn along_forces(factor: &FactorSample, ws: &mut StepWorkspace) -> Option<f64> {
    let m = ws.rows.len();
    ws.lambda_of_sample[..m].copy_from_slice(&ws.lambda[..m]);
    answer(factor, ws)?;
    let (mut missed, mut all) = (0.0, 0.0);
    for r in 0..m {
        let truth = opening(ws, r);
        let tissue = ws.dt * ws.dt * ws.rows.tissue.dot(r, &ws.probe);
        let error = tissue + ws.dt * ws.rows.rigid.dot(r, &ws.rigid.correction) - truth;
        (missed, all) = (missed + error * error, all + truth * truth);
    }
    (all > 0.0).then(|| (missed / all).sqrt())
}

/// The largest error of the column whose turn it would be, relative to its largest entry.
fn of_column(world: &World, factor: &FactorSample, ws: &mut StepWorkspace, report: &StepReport) -> Option<f64> {
    let m = ws.rows.len();
    let row = world.plan().sampling.row(report.step, m);
    if !column::push(ws, row) {
        return None;
    }
    answer(factor, ws)?;
    let w = ws.problem.view().column(row);
    column::error(m, |r| column::entry(ws, r, &ws.probe), |r| w[r])
}

/// Memory for the answer of another rung to a load: `3 x nodes` where there is a ladder.
pub(super) fn probe_room(world: &World) -> Vec<f64> {
    vec![
        0.0;
        if world.plan().ladder.is_some_and(|ladder| ladder.ends_exact()) { 3 * world.model().free_nodes() } else { 0 }
    ]
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
        assert_eq!(ladder.rungs(), [Rung::Asynchronous, Rung::Early, Rung::Exact]);
        let mut climb = Climb::default();
        for place in 1..3 {
            climb.advance(&ladder, true, true, f64::NAN);
            assert_eq!(climb.place, place);
        }
        climb.advance(&ladder, true, true, f64::NAN);
        assert_eq!(climb.place, 2, "there is nothing above exact steps");
        // Not while the rung below would use up more than its share, nor by a step that measured nothing.
        for _ in 0..100 {
            climb.advance(&ladder, true, false, 0.06);
            climb.advance(&ladder, true, false, f64::NAN);
        }
        assert_eq!((climb.place, climb.calm), (2, 0));
        for step in 1..=2 * CALM_STEPS {
            climb.advance(&ladder, true, false, 0.04);
            assert_eq!(u32::from(climb.place), 2 - step / CALM_STEPS, "step {step}");
        }
    }

    #[test]
    fn who_comes_down_too_early_waits_twice_as_long_until_the_tool_has_left() {
        let ladder = ladder();
        let mut climb = Climb::default();
        climb.advance(&ladder, true, true, f64::NAN);
        let mut waits = Vec::new();
        for _ in 0..6 {
            let mut steps = 0;
            while climb.place == 1 {
                climb.advance(&ladder, true, false, 0.01);
                steps += 1;
            }
            waits.push(steps);
            climb.advance(&ladder, true, true, f64::NAN);
        }
        assert_eq!(waits, [15, 30, 60, 120, 240, 240]);
        (0..500).for_each(|_| climb.advance(&ladder, false, false, f64::NAN));
        assert_eq!((climb.place, climb.wait), (0, CALM_STEPS));
    }

    /// Exact steps that take longer than a step has are no way to keep an accuracy: the ladder ends before them, says so, and
    /// stays on its last rung however often that misses.
    #[test]
    fn a_ladder_ends_before_steps_that_take_too_long() {
        let mut scene = crate::scene::Scene::bundled("block").unwrap();
        scene.edit(|d| (d.bodies[0].accuracy, d.rates.step, d.rates.tick) = (Some(0.1), 5000.0, 5000.0)).unwrap();
        let world = scene.build().unwrap();
        let ladder = world.plan().ladder.unwrap();
        assert!(world.plan().factorization > world.dt());
        assert_eq!(ladder.rungs(), [Rung::Asynchronous, Rung::Early]);
        assert_eq!((ladder.rung(1), ladder.rung(7)), (Rung::Early, Rung::Early));
        assert!(world.warnings().iter().any(|w| w.contains("accuracy = 0.1 may be missed")), "{:?}", world.warnings());
        let mut climb = Climb::default();
        (0..5).for_each(|_| climb.advance(&ladder, true, true, f64::NAN));
        assert_eq!(climb.place, 1);
    }
}
