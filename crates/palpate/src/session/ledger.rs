//! Counts and tails of a session so far, for whoever asks while it runs.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::run::{Observer, Progress};
use crate::step::StepReport;
use crate::summary::{Percentiles, PortSummary, Tail};
use crate::tick::{TickFlags, TickReport};
use crate::world::World;

/// A session so far. Times in seconds, forces in newtons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Time of the latest tick since the start (s).
    pub time: f64,
    /// Steps of the tissue.
    pub steps: u64,
    /// Factors that have reached the step, the first included.
    pub factors: u64,
    /// Ticks.
    pub ticks: u64,
    /// Steps, factors and ticks per second over the last second.
    pub rates: [f64; 3],
    /// Work of a step (s).
    pub step_work: Percentiles,
    /// Work of a tick (s).
    pub tick_work: Percentiles,
    /// Periods that the step missed.
    pub step_overruns: u64,
    /// Periods that passed without a tick between two ticks.
    pub tick_overruns: u64,
    /// Contacts that found no room.
    pub contacts_dropped: u64,
    /// Contacts that carry force, at the latest step.
    pub contacts: u32,
    /// Ticks that were cut by a limit of force, torque, power or slew.
    pub limited: u64,
    /// Ticks that sent no force because a number or a pose was not sound.
    pub refused: u64,
    /// The device's port: energy, and what acted on the force.
    pub port: PortSummary,
    /// Largest force that was sent (N).
    pub largest_force: f64,
    /// Largest jump of the contact force at a new snapshot (N).
    pub largest_jump: f64,
    /// Age of the factor at the latest step (s).
    pub factor_age: f64,
    /// Relative error of the compliance that the latest step measured; NaN where it measured none.
    pub compliance_error: f64,
    /// Relative error of the contact forces of the latest step, as far as it is known
    /// ([`ComplianceError::of_forces`](crate::step::ComplianceError::of_forces)); NaN where it is not.
    pub force_error: f64,
    /// Deepest overlap that the correction of the latest step left (m).
    pub overlap: f64,
    /// Conjugate-gradient iterations of the latest step: of free motion and correction.
    pub iterations: u32,
}

/// The statistics with what they are made of; written by the watching thread, read by any.
#[derive(Clone)]
pub(super) struct Ledger {
    page: Arc<Mutex<Page>>,
}

struct Page {
    statistics: Statistics,
    step_work: Tail,
    tick_work: Tail,
}

impl Ledger {
    pub(super) fn new(world: &World) -> Self {
        let (step_work, tick_work) = (Tail::new(1e-9), Tail::new(1e-9));
        let statistics = Statistics { port: PortSummary::new(world), ..Statistics::default() };
        Self { page: Arc::new(Mutex::new(Page { statistics, step_work, tick_work })) }
    }

    /// Everything so far.
    pub(super) fn statistics(&self) -> Statistics {
        let page = self.page();
        Statistics {
            step_work: page.step_work.percentiles(),
            tick_work: page.tick_work.percentiles(),
            ..page.statistics
        }
    }

    fn page(&self) -> MutexGuard<'_, Page> {
        // Every value of the page is sound by itself, whoever was interrupted while writing.
        self.page.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Ledger {
    fn progress(&mut self, progress: &Progress) {
        if let Some(rates) = progress.rates {
            self.page().statistics.rates = rates;
        }
    }

    fn step(&mut self, report: &StepReport) {
        let mut page = self.page();
        page.step_work.record(report.times.total);
        let s = &mut page.statistics;
        s.steps += 1;
        s.factors = report.factor_epoch + 1;
        s.step_overruns += u64::from(report.overruns);
        s.contacts_dropped += report.dropped();
        s.contacts = report.active as u32;
        s.factor_age = report.factor_age;
        s.compliance_error = report.error.measured().unwrap_or(f64::NAN);
        s.force_error = report.error.of_forces().unwrap_or(f64::NAN);
        s.overlap = report.error.overlap;
        s.iterations = report.free_motion.iterations as u32 + report.error.correction_iterations;
    }

    fn tick(&mut self, report: &TickReport) {
        let mut page = self.page();
        page.tick_work.record(report.work);
        let (s, record) = (&mut page.statistics, &report.record);
        let any = |flags: &[TickFlags]| flags.iter().any(|&flag| record.flags.contains(flag));
        s.time = record.time;
        s.ticks += 1;
        s.tick_overruns += u64::from(report.overruns);
        use TickFlags as F;
        let limited = any(&[F::FORCE_LIMITED, F::TORQUE_LIMITED, F::POWER_LIMITED, F::SLEW_LIMITED]);
        s.port.add(record);
        s.limited += u64::from(limited);
        s.refused += u64::from(any(&[TickFlags::BAD_POSE, TickFlags::NON_FINITE]));
        s.largest_force = s.largest_force.max(record.wrench.force.norm());
        s.largest_jump = s.largest_jump.max(record.force_jump);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// A block on a floor that has room for four of its twenty-five nodes.
    const CROWDED: &str = r#"
        name = "crowded"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [4, 4, 2] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        [[fixed_body]]
        name = "floor"
        shape = { kind = "plane", normal = [0, 0, 1] }
        max_contacts = 4
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.005 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.3] }]
    "#;

    #[test]
    fn contacts_of_other_bodies_without_room_are_counted() {
        let world = Scene::from_toml(CROWDED, Path::new("")).unwrap().build().unwrap();
        let mut simulation = Simulation::new(&world).unwrap();
        let report = simulation.step(&world.first_pose());
        let mut ledger = Ledger::new(&world);
        ledger.step(&report);
        ledger.step(&report);
        assert_eq!((report.detection.dropped, report.dropped()), (0, 21));
        assert_eq!(ledger.statistics().contacts_dropped, 2 * 21);
    }

    /// What the latest step knows of itself, as its report says it; of a step that measures nothing there is no error.
    #[test]
    fn the_latest_step_tells_its_error_its_overlap_and_its_iterations() {
        let mut scene = Scene::bundled("block").unwrap();
        let old = palpate_constraints::compliance::ComplianceMethod::Asynchronous;
        scene.edit(|scene| scene.bodies[0].compliance = old).unwrap();
        let world = scene.build().unwrap();
        let mut ledger = Ledger::new(&world);
        let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
        let free = simulation.step(&nalgebra::Isometry3::translation(-0.008, 0.0, 0.08));
        ledger.step(&free);
        let told = ledger.statistics();
        assert!(told.compliance_error.is_nan() && told.force_error.is_nan() && told.overlap == 0.0, "{told:?}");
        let press = |k: u32| nalgebra::Isometry3::translation(-0.008, 0.0, 0.042 - 0.0005 * f64::from(k));
        let report = (0..12).map(|k| simulation.step(&press(k))).last().unwrap();
        ledger.step(&report);
        let told = ledger.statistics();
        assert!(report.active > 0 && report.error.correction_iterations > 0);
        assert_eq!(Some(told.compliance_error), report.error.measured());
        assert_eq!(Some(told.force_error), report.error.of_forces());
        assert_eq!(told.overlap, report.error.overlap);
        assert_eq!(
            u64::from(told.iterations),
            report.free_motion.iterations as u64 + u64::from(report.error.correction_iterations)
        );
    }
}
