//! A run in real time once more, from what its trace says that each stage had.
//!
//! A step names the tool pose and the factor that it used, a factor the step whose matrix it is of, a tick the pose of
//! the device, its time, the step whose snapshot it had, and whether that was valid: a pause, and the end of a run, put one
//! that is not in the place of the last. Steps are done when the first tick needs them, factors when their matrix is there.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, Vector3};
use palpate_collision::ToolPose;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::{Writer, latest};
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::wrench::{Twist, Wrench};
use palpate_trace::{FactorStatus, StepRecord, TickFlags, TickRecord, Trace};

use super::Comparison;
use crate::changes::{ChangeQueue, requests};
use crate::engine::publish_rest;
use crate::pace::{seconds, signed_seconds};
use crate::record::{DEVICE_RECORD, TickLine};
use crate::refresh::FactorSample;
use crate::run::{Observer, RunError};
use crate::step::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, pass_events, step};
use crate::tick::{TickReport, Ticker};
use crate::world::{ChangeRequest, World};

/// How far a trace could be followed.
pub(super) enum Reached {
    /// To its last tick.
    End,
    /// As far as it was to be.
    Stop,
    /// To a record that is not there.
    MissingRecord,
    /// To a step that had another body than what the trace tells makes.
    MissingChange { step: u64 },
}

/// Does every tick of the trace again, as far as it can be followed and until `stop` is set, and hands it to the comparison.
pub(super) fn again(
    world: &World,
    trace: &Trace,
    stop: &AtomicBool,
    comparison: &mut Comparison<'_>,
) -> Result<Reached, RunError> {
    let (snapshot_writer, snapshots) = latest(&world.empty_snapshot());
    let (poses, _) = latest(&world.first_tool());
    let stated = trace.metadata.get("engine").and_then(|engine| engine.get(DEVICE_RECORD));
    let spec = stated.and_then(|text| toml::from_str(text).ok()).unwrap_or_else(|| DeviceSpec::virtual_device(0.0));
    let device = RecordedDevice { spec, ticks: trace.ticks.clone(), takes_force: true };
    let mut ticker = Ticker::new(world, Box::new(device), snapshots, poses, TickLine::none())?;
    let mut steps = Steps::new(world, trace, snapshot_writer)?;
    let mut before = None;
    for (index, record) in trace.ticks.iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            return Ok(Reached::Stop);
        }
        if record.tick != index as u64 {
            return Ok(Reached::MissingRecord);
        }
        if let Err(reached) = steps.up_to(record.snapshot_step, comparison) {
            return Ok(reached);
        }
        if record.flags.contains(TickFlags::NO_SNAPSHOT) {
            steps.rest();
        }
        let time = seconds(record.time_ns);
        // Before the first tick no clock has measured anything. Traces from before there was a lead have none.
        let host_lead = before.map(|_| signed_seconds(record.host_lead_ns));
        let dt = ticker.since(before.replace(time), time);
        let record = ticker.tick_by(time, dt, host_lead);
        comparison.tick(&TickReport { record, latency: 0.0, work: 0.0, overruns: 0 });
    }
    Ok(if trace.ticks.is_empty() { Reached::MissingRecord } else { Reached::End })
}

/// The steps of the trace, and the factors that later ones will want.
struct Steps<'a> {
    world: &'a World,
    trace: &'a Trace,
    state: StepState,
    ws: StepWorkspace,
    /// The factor in use first.
    factors: Vec<FactorSample>,
    /// Changes from outside that are still to come, and their way to the steps.
    changes: VecDeque<ChangeRequest>,
    queue: ChangeQueue,
    /// Bodies that events of the scene and these have led to, those on their way included.
    phases: usize,
    snapshots: Writer<HapticSnapshot>,
    /// Whether the last snapshot that was published is valid.
    valid: bool,
}

impl<'a> Steps<'a> {
    fn new(world: &'a World, trace: &'a Trace, snapshots: Writer<HapticSnapshot>) -> Result<Self, RunError> {
        let rest = world.start().clone();
        let mut ws = StepWorkspace::new(world);
        let factors = vec![FactorSample::first(world, &rest, &mut ws)?];
        let (changes, phases) = (requests(trace), world.changes().len());
        let queue = ChangeQueue::new(world, &mut ws);
        let state = StepState::new(world, rest);
        Ok(Self { world, trace, state, ws, factors, changes, queue, phases, snapshots, valid: false })
    }

    /// Takes the snapshot of the last step back, as a pause does.
    fn rest(&mut self) {
        if std::mem::take(&mut self.valid) {
            publish_rest(&mut self.snapshots, self.state.step);
        }
    }

    /// Goes on until `count` steps are done and the snapshot of the last is published.
    fn up_to(&mut self, count: u64, comparison: &mut Comparison<'_>) -> Result<(), Reached> {
        while self.state.step < count {
            let step = self.state.step;
            let record = usize::try_from(step).ok().and_then(|k| self.trace.steps.get(k));
            let record = record.filter(|record| record.step == step).ok_or(Reached::MissingRecord)?;
            let report = self.advance(record).ok_or(Reached::MissingRecord)?;
            // A change that is missing, or that cannot be read, shows at the first step that took it.
            if report.change.phase != record.phase {
                return Err(Reached::MissingChange { step });
            }
            comparison.step(&report);
        }
        Ok(())
    }

    /// The next step, from its record.
    fn advance(&mut self, record: &StepRecord) -> Option<StepReport> {
        let number = self.state.step;
        let in_use = self.factors.iter().position(|factor| factor.epoch == record.factor_epoch)?;
        self.factors.drain(..in_use);
        let time = seconds(record.time_ns);
        let frame = pose(record.tool_position, record.tool_orientation);
        let tool = ToolPose { frame, opening: record.tool_opening };
        // The step says how many have been taken by its begin; one that is missing shows there.
        while self.phases < record.phase as usize
            && let Some(change) = self.changes.pop_front()
        {
            self.queue.change(self.world, &change, |_| ()).ok()?;
            self.phases += 1;
        }
        let factor = self.factors.first_mut()?;
        pass_events(self.world, time, factor, &mut self.state, &mut self.ws);
        let input = StepInput { time, tool, factor };
        let report = step(self.world, &input, &mut self.state, &mut self.ws, self.snapshots.value_mut());
        self.valid = self.snapshots.value_mut().valid;
        self.snapshots.publish();
        let made = |factor: &&palpate_trace::FactorRecord| {
            factor.taken_step == number && factor.status == FactorStatus::Ready && report.status == StepStatus::Advanced
        };
        for factor in self.trace.factors.iter().filter(made) {
            let (q, system) = (self.state.before(), &self.ws.fem.system);
            let sample = FactorSample::new(self.world, factor.epoch, number, time, q, system);
            let mut sample = sample.ok()?;
            if self.world.changes_ever() {
                sample.remember(&self.state.state_before().memory);
            }
            sample.prepared = self.ws.room_for_prepared(self.world);
            let mut nodes = Vec::with_capacity(sample.room_for_nodes());
            self.ws.latest_nodes(&mut nodes);
            sample.prepare(&nodes);
            self.factors.push(sample);
        }
        Some(report)
    }
}

/// A device that measures what another one measured, and fails where that one failed.
struct RecordedDevice {
    spec: DeviceSpec,
    ticks: Vec<TickRecord>,
    /// Whether the device took the force of the tick at hand.
    takes_force: bool,
}

impl HapticDevice for RecordedDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        let record = usize::try_from(tick.index).ok().and_then(|k| self.ticks.get(k)).ok_or(DeviceError::Closed)?;
        self.takes_force = !record.flags.contains(TickFlags::WRITE_FAILED);
        if record.flags.contains(TickFlags::DEVICE_MISSING) && self.takes_force {
            return Err(DeviceError::Timeout);
        }
        let mut pose = pose(record.device_position, record.device_orientation);
        if record.flags.contains(TickFlags::BAD_POSE) {
            // The record holds the last good one.
            pose.translation.vector.fill(f64::NAN);
        }
        let velocity = Twist { linear: record.device_velocity.into(), angular: record.device_angular_velocity.into() };
        Ok(DeviceSample { velocity, gripper: record.device_gripper, ..DeviceSample::at_rest(tick.time, pose) })
    }

    fn write(&mut self, _wrench: Wrench) -> Result<(), DeviceError> {
        if self.takes_force { Ok(()) } else { Err(DeviceError::Timeout) }
    }

    fn close(&mut self) {}
}

/// The pose with exactly these bits.
fn pose(position: [f64; 3], orientation: [f64; 4]) -> Isometry3<f64> {
    let rotation = Unit::new_unchecked(Quaternion::from_vector(orientation.into()));
    Isometry3::from_parts(Translation3::from(Vector3::from(position)), rotation)
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::AtomicBool;

    use crate::replay::{ReplayError, replay};
    use crate::run::{Length, RunOptions, Unobserved, run};
    use crate::slide::slide;
    use palpate_trace::{Trace, TraceConfig, TraceWriter};

    #[test]
    fn a_run_in_real_time_replays_to_the_bit_and_notices_one_changed_bit() {
        let folder = tempfile::tempdir().unwrap();
        let (path, copy) = (folder.path().join("run.mcap"), folder.path().join("copy.mcap"));
        let world = slide(0.8);
        let options = RunOptions { length: Length::Seconds(0.9), trace: Some(path.clone()), ..RunOptions::default() };
        let outcome = run(&world, &options, &AtomicBool::new(false), &mut Unobserved).unwrap();
        assert!(outcome.summary.largest_force > 0.1, "{} N", outcome.summary.largest_force);
        let report = replay(&path).unwrap();
        assert!(report.is_identical(), "{report:?}");
        assert_eq!(report.ticks as u64, outcome.summary.ticks);

        // The last bit of one tool pose that a step used.
        let mut trace = Trace::load(&path).unwrap();
        let used = trace.steps.iter().position(|s| s.tool_force[2] > 0.0).unwrap();
        let z = &mut trace.steps[used].tool_position[2];
        *z = f64::from_bits(z.to_bits() ^ 1);
        rewrite(&trace, &copy);
        assert!(!replay(&copy).unwrap().is_identical());

        trace.factors.remove(0);
        rewrite(&trace, &copy);
        assert!(matches!(replay(&copy), Err(ReplayError::RealTime { .. })), "a factor is missing");
    }

    /// Without how the run ended, as a trace of a run that was killed.
    pub(in crate::replay) fn rewrite(trace: &Trace, path: &std::path::Path) {
        let mut engine = trace.metadata["engine"].clone();
        engine.remove("start_unix_ns");
        let config = TraceConfig { engine, attachments: trace.attachments.clone(), ..TraceConfig::default() };
        let mut writer = TraceWriter::create(path, &config).unwrap();
        trace.ticks.iter().for_each(|tick| writer.write_tick(tick).unwrap());
        trace.steps.iter().for_each(|step| writer.write_step(step).unwrap());
        trace.factors.iter().for_each(|factor| writer.write_factor(factor).unwrap());
        assert!(writer.finish().2.is_none());
    }
}
