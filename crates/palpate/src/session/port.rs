//! The tick as a driver calls it, in its own thread at its own rate.
//!
//! A call takes what the device measured, in the device's frame, and answers the wrench for its motors. It allocates
//! nothing, takes no lock, and asks the system for the time alone.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use palpate_devices::place::Place;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::Sender;
use palpate_haptics::wrench::{Twist, Wrench};

use super::clock::{ClockEvent, DeviceClock};
use super::motion::Motion;
use super::{Phase, Shared};
use crate::pace::{seconds, signed_seconds};
use crate::tick::{TickRecord, TickReport, TickStage};

/// What a device measured, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PortSample {
    /// Time of the measurement on the device's clock (ns); `None`: this machine's time of the call.
    pub time_ns: Option<u64>,
    /// Position (m).
    pub position: [f64; 3],
    /// Orientation as quaternion (w, x, y, z), of unit length.
    pub orientation: [f64; 4],
    /// Velocity (m/s) and angular velocity (rad/s); `None`: found from the poses.
    pub velocity: Option<[[f64; 3]; 2]>,
    /// Switches, one bit each.
    pub buttons: u32,
    /// How far the gripper is open, 0 closed to 1 open; 1 for a device without.
    pub gripper: f64,
}

impl PortSample {
    /// Numbers that are not finite stay as they are, for the tick to refuse.
    fn pose(&self) -> Isometry3<f64> {
        let [w, x, y, z] = self.orientation;
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        Isometry3::from_parts(Translation3::from(self.position), rotation)
    }
}

/// What a tick answers.
#[derive(Clone, Copy, Debug)]
pub struct PortReport {
    /// What the tick did, in world axes.
    pub record: TickRecord,
    /// Wrench for the device's motors, in its own axes (N, N m); zero where anything is wrong.
    pub wrench: Wrench,
    /// The tool behind the coupling, in the device's frame: what a screen shows.
    pub tool: Isometry3<f64>,
    /// Time since the tick before that the limits were given (s), no more than either clock's; a period at the first.
    pub dt: f64,
    /// What the device's timestamp was worth.
    pub clock: ClockEvent,
    /// What the session was doing.
    pub phase: Phase,
    /// Work of the tick (s).
    pub work: f64,
}

/// The device as the tick sees it: the driver's sample on its way in, the wrench on its way out.
struct Exchange {
    spec: DeviceSpec,
    sample: DeviceSample,
    wrench: Wrench,
}

impl HapticDevice for Exchange {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, _tick: TickTime) -> Result<DeviceSample, DeviceError> {
        Ok(self.sample)
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        self.wrench = wrench;
        Ok(())
    }

    fn close(&mut self) {
        self.wrench = Wrench::zero();
    }
}

/// Tells what a session is doing, beside a tick of its port and after its end.
pub struct PhaseReader {
    shared: Arc<Shared>,
}

impl PhaseReader {
    /// The phase now.
    pub fn phase(&self) -> Phase {
        self.shared.phase()
    }
}

/// The driver's end of a session. One thread at a time calls it.
pub struct Port {
    stage: TickStage,
    device: Exchange,
    place: Place,
    clock: DeviceClock,
    motion: Motion,
    reports: Sender<TickReport>,
    shared: Arc<Shared>,
    /// This port's zero of this machine's clock.
    epoch: Instant,
    /// Whether a tick has seen the session's start.
    started: bool,
    /// Time of the tick before (ns), since the session's start.
    time_ns: Option<u64>,
}

impl Port {
    pub(super) fn new(
        stage: TickStage,
        spec: DeviceSpec,
        place: Place,
        reports: Sender<TickReport>,
        shared: Arc<Shared>,
    ) -> Self {
        let device =
            Exchange { spec, sample: DeviceSample::at_rest(0.0, Isometry3::identity()), wrench: Wrench::zero() };
        let (clock, motion, epoch) = (DeviceClock::default(), Motion::default(), Instant::now());
        Self { stage, device, place, clock, motion, reports, shared, epoch, started: false, time_ns: None }
    }

    /// Limits that this port was opened with.
    pub fn spec(&self) -> &DeviceSpec {
        &self.device.spec
    }

    /// For threads that cannot have the port while another one ticks.
    pub fn phase_reader(&self) -> PhaseReader {
        PhaseReader { shared: Arc::clone(&self.shared) }
    }

    /// Nominal time between ticks (s).
    pub fn period(&self) -> f64 {
        self.stage.period()
    }

    /// Where the device stands.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// One tick. Before the session has started there is no force.
    #[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
    pub fn tick(&mut self, sample: &PortSample) -> PortReport {
        self.tick_at(sample, Instant::now())
    }

    /// One tick that began at `begin`.
    fn tick_at(&mut self, sample: &PortSample, begin: Instant) -> PortReport {
        let host = nanoseconds(begin.saturating_duration_since(self.epoch));
        let (elapsed, clock) = self.clock.advance(sample.time_ns, host);
        let phase = self.shared.phase();
        let pose = sample.pose();
        let estimate = self.motion.advance(&pose, elapsed.map(|elapsed| seconds(elapsed.time)));
        let velocity = sample
            .velocity
            .map_or(estimate, |[linear, angular]| Twist { linear: linear.into(), angular: angular.into() });
        self.device.sample = self.place.sample(&DeviceSample {
            time: seconds(host),
            pose,
            velocity,
            buttons: sample.buttons,
            gripper: sample.gripper,
        });
        // The start is known before the phase says so: a tick counts from it exactly where it is traced.
        let start = self.shared.start.get().filter(|_| phase != Phase::Ready);
        let begun = start.map(|start| nanoseconds(begin.saturating_duration_since(*start)));
        if begun.is_some() && !self.started {
            (self.started, self.time_ns) = (true, None);
            self.stage.restart();
        }
        // Whole nanoseconds, as a trace keeps them: a replay divides by the same times.
        let before = self.time_ns;
        let time_ns = match (before, elapsed) {
            (Some(before), Some(elapsed)) => before.saturating_add(elapsed.time),
            _ => begun.unwrap_or(0),
        };
        self.time_ns = Some(time_ns);
        let time = seconds(time_ns);
        let dt = self.stage.since(before.map(seconds), time);
        let lead = before.and(elapsed).map(|elapsed| signed_seconds(elapsed.host_lead()));
        let record = self.stage.tick(&mut self.device, time, dt, lead);
        let work = begin.elapsed().as_secs_f64();
        let overruns = before.map_or(0, |_| missed(dt, self.stage.period()));
        if phase.is_live() {
            let report = TickReport { record, latency: 0.0, work, overruns };
            self.stage.trace(&report);
            self.reports.send(report);
        }
        let wrench = self.place.wrench_in_device(&record.wrench);
        let tool = self.place.pose_in_device(&record.tool_pose);
        PortReport { record, wrench, tool, dt: record.granted, clock, phase, work }
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.shared.has_port.store(false, Ordering::Release);
    }
}

/// Whole periods that passed unused in `dt` seconds.
fn missed(dt: f64, period: f64) -> u32 {
    // Saturates; half a period of jitter is no miss.
    (dt / period - 0.5).max(0.0) as u32
}

fn nanoseconds(duration: std::time::Duration) -> u64 {
    // Five centuries fit.
    duration.as_nanos() as u64
}

#[cfg(test)]
mod two_clocks;

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;
    use std::time::Instant;

    use nalgebra::Isometry3;

    use super::{Phase, PortSample, missed};
    use crate::replay::replay;
    use crate::run::RunOptions;
    use crate::session::Session;
    use crate::slide::slide;

    const SAMPLE: PortSample = PortSample {
        time_ns: None,
        position: [0.015, 0.02, 0.06],
        orientation: [1.0, 0.0, 0.0, 0.0],
        velocity: None,
        buttons: 0,
        gripper: 0.25,
    };

    /// As a thread may see it that ticks while another one starts the session.
    #[test]
    fn a_tick_between_start_and_phase_is_neither_counted_nor_traced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("start.mcap");
        let options = RunOptions { trace: Some(path.clone()), threads: Some(1), ..RunOptions::default() };
        let (mut session, mut port) = Session::open(Arc::new(slide(0.8)), &options).unwrap();
        session.shared.start.set(Instant::now()).unwrap();
        let ready = port.tick(&SAMPLE);
        assert_eq!(ready.phase, Phase::Ready);
        assert!(session.start());
        let live: Vec<_> = (0..5).map(|_| port.tick(&SAMPLE)).collect();
        assert!(live.iter().all(|report| report.phase == Phase::Running));
        assert_eq!(live[0].record.index, 0, "the first of the trace");
        session.stop().unwrap().unwrap();
        let numbers = |path: &Path| -> Vec<u64> {
            palpate_trace::Trace::load(path).unwrap().ticks.iter().map(|tick| tick.tick).collect()
        };
        assert_eq!(numbers(&path), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_device_that_loses_its_pose_at_the_start_has_none_from_before_and_replays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lost.mcap");
        let options = RunOptions { trace: Some(path.clone()), threads: Some(1), ..RunOptions::default() };
        let (mut session, mut port) = Session::open(Arc::new(slide(0.8)), &options).unwrap();
        assert_eq!(port.tick(&SAMPLE).record.device_pose, Isometry3::translation(0.015, 0.02, 0.06));
        assert!(session.start());
        let lost = port.tick(&PortSample { position: [f64::NAN; 3], ..SAMPLE }).record;
        assert_eq!((lost.device_pose, lost.gripper.device), (Isometry3::identity(), 1.0), "nothing is known of it");
        (0..20).for_each(|_| _ = port.tick(&SAMPLE));
        session.stop().unwrap().unwrap();
        let report = replay(&path).unwrap();
        assert!(report.is_identical() && report.ticks == 21, "{report:?}");
    }

    #[test]
    fn a_late_tick_counts_the_periods_it_missed() {
        let counts: Vec<u32> = [0.5e-3, 1e-3, 1.4e-3, 1.6e-3, 2e-3, 10e-3].map(|dt| missed(dt, 1e-3)).into();
        assert_eq!(counts, [0, 0, 0, 1, 1, 9]);
    }
}
