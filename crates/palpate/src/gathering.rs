//! Gathers the reports of a run into its summary.

mod climbing;
mod room;
mod summary;
mod unsolved;

use std::collections::BTreeMap;

use palpate_constraints::compliance::ComplianceMethod;
use palpate_haptics::device::DeviceError;

use crate::counted::counted;
use crate::factor_thread::FactorThreadDeath;
use crate::refresh::RefreshReport;
use crate::run::{Observer, Progress};
use crate::step::{FactorFit, FailedElement, StepReport, StepStatus, Tangle};
use crate::summary::{EventRecord, PortSummary, RunEnd, Tail, Unconverged};
use crate::tick::{TickFlags, TickReport};
use crate::world::World;
use climbing::Climbing;
use room::Room;
use unsolved::Unsolved;

/// Tails, counts and extremes of a run so far.
pub(crate) struct Gathering {
    body: String,
    regions: Vec<String>,
    pub(crate) end: RunEnd,
    pub(crate) failed: bool,
    pub(crate) missed: u64,
    pub(crate) notes: Vec<String>,
    step_work: Tail,
    factor_work: Tail,
    tick_work: Tail,
    tick_latency: Tail,
    iterations: Tail,
    factor_age: Tail,
    contacts: Tail,
    body_contacts: Tail,
    compliance_error: Tail,
    force_error: Tail,
    correction_iterations: Tail,
    overlap: f64,
    early: u64,
    exact_steps: u64,
    climbing: Climbing,
    active: usize,
    time: f64,
    force: f64,
    step_overruns: u64,
    tick_overruns: u64,
    factors_refused: u64,
    room: Room,
    fall_backs: u64,
    answered: BTreeMap<&'static str, u64>,
    shortened: u64,
    rescued: [u64; 4], // repeated; with elements held open; tangled; led
    /// The tangle of the last step, with the time at which it was first seen (s).
    tangle: Option<(f64, Tangle)>,
    in_full: u64,
    unsettled: u64,
    unsolved: Unsolved,
    filtered: u64,
    inverted: u64,
    worst_residual: f64,
    worst_tick_residual: f64,
    largest_force: f64,
    largest_jump: f64,
    changes: Vec<EventRecord>,
    outdated: [u64; 2], // all; of those with a factor of the step's own
    pub(crate) unconverged: Unconverged,
    pub(crate) factor_thread_death: Option<FactorThreadDeath>,
    events: Vec<String>,
    force_jump: Tail,
    beyond_patch: u64,
    patches_full: u64,
    frozen_at_rigid: u64,
    impulse: [f64; 2],
    port: PortSummary,
    /// Length of a step and of a tick (s).
    lengths: [f64; 2],
    /// Ticks whose device did not answer, with time and reason of the first.
    unanswered: u64,
    first_unanswered: Option<(f64, DeviceError)>,
}

impl Gathering {
    /// For a run of `world`, whose body the notes name.
    pub(crate) fn new(world: &World) -> Self {
        let nanoseconds = || Tail::new(1e-9);
        Self {
            body: world.description().bodies[0].name.clone(),
            regions: world.mesh().region_names.clone(),
            end: RunEnd::Completed,
            failed: false,
            missed: 0,
            notes: Vec::new(),
            step_work: nanoseconds(),
            factor_work: nanoseconds(),
            tick_work: nanoseconds(),
            tick_latency: nanoseconds(),
            iterations: Tail::new(1.0),
            factor_age: Tail::new(1e-6),
            contacts: Tail::new(1.0),
            body_contacts: Tail::new(1.0),
            compliance_error: Tail::new(1e-9),
            force_error: Tail::new(1e-9),
            correction_iterations: Tail::new(1.0),
            overlap: 0.0,
            early: 0,
            exact_steps: 0,
            climbing: Climbing::default(),
            active: 0,
            time: 0.0,
            force: 0.0,
            step_overruns: 0,
            tick_overruns: 0,
            factors_refused: 0,
            room: Room::default(),
            fall_backs: 0,
            answered: BTreeMap::new(),
            shortened: 0,
            rescued: [0; 4],
            tangle: None,
            in_full: 0,
            unsettled: 0,
            unsolved: Unsolved::default(),
            filtered: 0,
            inverted: 0,
            worst_residual: 0.0,
            worst_tick_residual: 0.0,
            largest_force: 0.0,
            largest_jump: 0.0,
            changes: Vec::new(),
            outdated: [0; 2],
            unconverged: Unconverged::default(),
            factor_thread_death: None,
            events: world.changes().iter().map(|change| change.text().to_string()).collect(),
            force_jump: Tail::new(1e-9),
            beyond_patch: 0,
            patches_full: 0,
            frozen_at_rigid: 0,
            impulse: [0.0; 2],
            port: PortSummary::new(world),
            lengths: [world.dt(), 1.0 / world.description().rates.tick],
            unanswered: 0,
            first_unanswered: None,
        }
    }

    pub(crate) fn step(&mut self, report: &StepReport, observer: &mut dyn Observer) {
        self.step_work.record(report.times.total);
        self.iterations.record(report.free_motion.iterations as f64);
        self.factor_age.record(report.factor_age);
        self.contacts.record(report.detection.contacts as f64);
        self.body_contacts.record(f64::from(report.bodies.contacts));
        if let Some(error) = report.error.measured() {
            self.compliance_error.record(error);
            self.correction_iterations.record(f64::from(report.error.correction_iterations));
        }
        if let Some(error) = report.error.of_forces() {
            self.force_error.record(error);
        }
        self.overlap = self.overlap.max(report.error.overlap);
        self.exact_steps += u64::from(report.rows.rows > 0 && report.method == ComplianceMethod::Exact);
        self.climbing.add(report);
        self.active = report.active;
        self.step_overruns += u64::from(report.overruns);
        self.room.add(report);
        self.factors_refused += u64::from(report.refused);
        self.fall_backs += u64::from(report.attempts > 1);
        if report.attempts > 0 {
            *self.answered.entry(report.solver).or_default() += 1;
        }
        self.shortened += u64::from(report.cuts > 0);
        self.rescued[0] += u64::from(report.repeated > 0);
        self.rescued[1] += u64::from(report.folds.folded > 0);
        self.rescued[2] += u64::from(report.tangle.is_some());
        self.rescued[3] += u64::from(report.led);
        let since = self.tangle.map_or(report.time, |(since, _)| since);
        self.tangle = report.tangle.map(|tangle| (since, tangle));
        self.in_full += u64::from(report.in_full > 0);
        self.unsettled += u64::from(report.unsettled);
        self.unsolved.add(report);
        self.filtered += u64::from(report.assembly.filtered);
        self.inverted += u64::from(report.assembly.inverted);
        self.worst_residual = self.worst_residual.max(report.solve.residual);
        if report.change.changed {
            let phase = report.change.phase as usize;
            let outside = String::from("a change from outside");
            let texts = (self.changes.len()..phase).map(|k| self.events.get(k).unwrap_or(&outside));
            let (time, iterations) = (report.time, report.free_motion.iterations);
            let (factor, touched) = (report.change.factor, report.change.touched);
            let event = |text: &String| EventRecord { time, event: text.clone(), factor, touched, iterations };
            let records: Vec<_> = texts.map(event).collect();
            self.changes.extend(records);
        }
        let renewed = report.change.factor == FactorFit::Renewed;
        self.outdated[0] += u64::from(renewed || report.change.factor == FactorFit::Outdated);
        self.outdated[1] += u64::from(renewed);
        self.unconverged.add(report);
        self.patches_full += u64::from(report.patch.left_out > 0);
        self.frozen_at_rigid += u64::from(report.frozen_at_rigid);
        self.impulse[0] += report.force.norm() * self.lengths[0];
        if report.status == StepStatus::RolledBack {
            self.failed = true;
            let place = match report.failed {
                Some(failed) => self.name(failed),
                None => "nowhere in particular".into(),
            };
            let cause = match report.assembly.non_finite {
                Some(_) => "whose force is not finite".into(),
                None => format!("while the smallest volume ratio was {:.3}", report.assembly.min_jacobian),
            };
            self.notes.push(format!(
                "step {} at {:.3} s: body {} became non-finite or was torn apart {place}, {cause}, and was rolled back; \
                 try a smaller step, a softer press or a finer mesh",
                report.step, report.time, self.body
            ));
        }
        observer.step(report);
    }

    /// An element in words.
    fn name(&self, element: FailedElement) -> String {
        let region = self.regions.get(usize::from(element.region));
        let region = region.map(|name| format!(" of region `{name}`")).unwrap_or_default();
        format!("at tetrahedron {}{region}", element.tetrahedron)
    }

    pub(crate) fn refresh(&mut self, report: &RefreshReport) {
        self.factor_work.record(report.work);
        self.early += u64::from(report.early);
        self.factors_refused += u64::from(!report.is_ok());
    }

    pub(crate) fn tick(&mut self, report: &TickReport, observer: &mut dyn Observer) {
        self.tick_work.record(report.work);
        self.tick_latency.record(report.latency);
        self.tick_overruns += u64::from(report.overruns);
        let record = &report.record;
        self.time = record.time;
        self.force = record.wrench.force.norm();
        self.largest_force = self.largest_force.max(self.force);
        self.largest_jump = self.largest_jump.max(record.force_jump);
        if record.flags.contains(TickFlags::NEW_SNAPSHOT) && record.active > 0 {
            self.force_jump.record(record.force_jump);
        }
        self.beyond_patch += u64::from(record.flags.contains(TickFlags::BEYOND_PATCH));
        self.impulse[1] += record.contact_wrench.force.norm() * self.lengths[1];
        self.port.add(record);
        self.room.tick(record);
        self.worst_tick_residual = self.worst_tick_residual.max(record.residual);
        if let Some(error) = record.device_error {
            self.unanswered += 1;
            self.first_unanswered.get_or_insert((record.time, error));
        }
        observer.tick(report);
    }

    /// Names the changes from outside among the events.
    pub(crate) fn name_changes<'a>(&mut self, texts: impl Iterator<Item = &'a str>) {
        let outside = self.changes.iter_mut().skip(self.events.len());
        outside.zip(texts).for_each(|(record, text)| record.event = format!("from outside: {text}"));
    }

    /// What there is to say about a device that did not answer.
    pub(crate) fn device_note(&self) -> Option<String> {
        let (time, error) = self.first_unanswered?;
        let ticks = counted(self.unanswered, "tick", "ticks");
        Some(format!("no force in {ticks}, the first at {time:.3} s: {error}"))
    }

    /// Steps, factors and ticks so far.
    pub(crate) fn counts(&self) -> [u64; 3] {
        [self.step_work.count(), self.factor_work.count(), self.tick_work.count()]
    }

    pub(crate) fn progress(&self) -> Progress {
        Progress { time: self.time, rates: None, contacts: self.active, force: self.force }
    }
}
