//! Tests: do runs replay that were paused, stopped under contact, killed, or served by a device that failed?

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use nalgebra::Isometry3;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::wrench::Wrench;
use palpate_trace::{TickFlags, Trace};

use super::recorded::tests::rewrite;
use super::{ReplayError, replay, replay_until};
use crate::engine::Engine;
use crate::gathering::Gathering;
use crate::pace::seconds;
use crate::record::NoTrace;
use crate::run::RunOptions;
use crate::scene::{NodeSelection, Scene};
use crate::session::{Phase, Port, PortReport, PortSample, Session};
use crate::slide::slide;
use crate::tick::{TickReport, Ticker};
use crate::world::{ChangeRequest, World};

/// Pressed into the block of [`slide`] by 4 mm within the first 300 ticks, and held.
fn press(tick: u64) -> [f64; 3] {
    [0.015, 0.02, 0.05 - 0.006 * (tick as f64 / 300.0).min(1.0)]
}

/// A device with faults, by tick.
#[derive(Clone)]
struct Faulty {
    spec: DeviceSpec,
    tick: u64,
    /// Its pose is no number.
    unsound: Range<u64>,
    /// It tells no pose.
    silent: Range<u64>,
    /// It does not take the force.
    forceless: Range<u64>,
}

impl Faulty {
    fn sound() -> Self {
        Self { spec: DeviceSpec::virtual_device(0.0), tick: 0, unsound: 0..0, silent: 0..0, forceless: 0..0 }
    }
}

impl HapticDevice for Faulty {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        self.tick = tick.index;
        let [x, y, mut z] = press(tick.index);
        if self.silent.contains(&self.tick) {
            return Err(DeviceError::Timeout);
        }
        if self.unsound.contains(&self.tick) {
            z = f64::NAN;
        }
        Ok(DeviceSample::at_rest(tick.time, Isometry3::translation(x, y, z)))
    }

    fn write(&mut self, _wrench: Wrench) -> Result<(), DeviceError> {
        if self.forceless.contains(&self.tick) { Err(DeviceError::Timeout) } else { Ok(()) }
    }

    fn close(&mut self) {}
}

/// What the threads of a run do, here in a fixed order: a step every 33 ticks but in the pauses, whose first tick finds the
/// stage at rest. The trace.
fn record(path: &Path, device: Faulty, ticks: u64, pauses: &[Range<u64>]) -> Trace {
    let world = slide(0.8);
    let options = RunOptions { trace: Some(path.into()), ..RunOptions::default() };
    let spec = device.spec.clone();
    let engine = Engine::with_tick(&world, &options, &spec, world.first_tool(), NoTrace::Refused, |ends| {
        Ticker::new(&world, Box::new(device), ends.snapshots, ends.poses, ends.line)
    });
    let (mut ticker, mut engine) = engine.unwrap().split();
    let mut before = None;
    for k in 0..ticks {
        let time = seconds(k * 1_000_000);
        if pauses.iter().any(|pause| pause.start == k) {
            engine.stage.rest();
        }
        if k % 33 == 0 && !pauses.iter().any(|pause| pause.contains(&k)) {
            let report = engine.stage.advance(time);
            engine.stage.trace(&report, true);
        }
        let dt = ticker.since(before.replace(time), time);
        let report = TickReport { record: ticker.tick(time, dt), latency: 0.0, work: 0.0, overruns: 0 };
        ticker.trace(&report);
    }
    engine.finish(Gathering::new(&world), Some(0.0));
    let trace = Trace::load(path).unwrap();
    assert_eq!(trace.ticks.len() as u64, ticks, "the rings hold some seconds");
    trace
}

fn force(trace: &Trace, tick: usize) -> f64 {
    Vec::from(trace.ticks[tick].force).iter().map(|f| f * f).sum::<f64>().sqrt()
}

#[test]
fn pauses_and_an_end_under_contact_replay_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pauses.mcap");
    // Before the first step; under contact; and at the end, where a driver goes on.
    let trace = record(&path, Faulty::sound(), 800, &[0..66, 400..470, 700..800]);
    assert!(force(&trace, 399) > 0.1 && force(&trace, 699) > 0.1, "{} N", force(&trace, 399));
    assert!(force(&trace, 469) == 0.0 && force(&trace, 799) == 0.0, "{} N", force(&trace, 469));
    let report = replay(&path).unwrap();
    assert!(report.is_identical() && report.ticks == 800, "{report:?}");

    // The ticks that find the stage at rest have no pose to answer to.
    let faulty = Faulty { unsound: 398..404, silent: 698..704, ..Faulty::sound() };
    let trace = record(&path, faulty, 800, &[400..402, 700..702]);
    assert!(trace.ticks[400].flags.contains(TickFlags::NO_SNAPSHOT | TickFlags::BAD_POSE));
    assert!(trace.ticks[700].flags.contains(TickFlags::NO_SNAPSHOT | TickFlags::DEVICE_MISSING));
    let report = replay(&path).unwrap();
    assert!(report.is_identical() && report.ticks == 800, "{report:?}");
}

#[test]
fn a_replay_that_is_asked_to_end_compares_no_more_and_tells_what_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ended.mcap");
    record(&path, Faulty::sound(), 200, &[]);
    let report = replay_until(&path, &AtomicBool::new(true)).unwrap();
    assert_eq!((report.ticks, report.unreached, report.lost), (0, Some(200), 0));
    assert!(report.is_identical(), "what was not reached is no difference: {report:?}");
    assert_eq!(replay_until(&path, &AtomicBool::new(false)).unwrap().unreached, None);
}

#[test]
fn a_force_that_the_device_did_not_take_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forceless.mcap");
    let trace = record(&path, Faulty { forceless: 400..403, ..Faulty::sound() }, 600, &[]);
    let failed = TickFlags::DEVICE_MISSING | TickFlags::WRITE_FAILED;
    let told: Vec<_> = trace.ticks.iter().filter(|t| t.flags.contains(failed)).map(|t| t.tick).collect();
    assert_eq!(told, [400, 401, 402]);
    assert!(force(&trace, 399) > 0.1 && force(&trace, 400) == 0.0, "{} N", force(&trace, 399));
    let report = replay(&path).unwrap();
    assert!(report.is_identical() && report.ticks == 600, "{report:?}");
}

/// The block of [`slide`] with room for a change.
fn changeable() -> World {
    let text = slide(0.8).scene().text().replace("rayleigh_stiffness", "changes = 1\nrayleigh_stiffness");
    Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap()
}

/// Ticks at a millisecond until what it answers suits.
fn tick_until(port: &mut Port, suits: impl Fn(&PortReport) -> bool) {
    for k in 0..20_000 {
        let sample = PortSample {
            time_ns: None,
            position: press(k.max(300)),
            orientation: [1.0, 0.0, 0.0, 0.0],
            velocity: None,
            buttons: 0,
            gripper: 1.0,
        };
        if suits(&port.tick(&sample)) {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("it never came");
}

/// Steps that a trace holds of the body after the first change.
fn steps_after_a_change(path: &Path) -> usize {
    let (trace, _) = Trace::recover(path).unwrap();
    trace.steps.iter().filter(|step| step.phase == 1).count()
}

#[test]
fn a_session_that_is_paused_cut_and_stopped_or_killed_replays_and_one_without_its_changes_says_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (folder.path().join("session.mcap"), folder.path().join("killed.mcap"));
    let options = RunOptions { trace: Some(path.clone()), threads: Some(1), ..RunOptions::default() };
    let (mut session, mut port) = Session::open(Arc::new(changeable()), &options).unwrap();
    assert!(session.start());
    let force = |report: &PortReport| report.record.wrench.force.norm();
    let presses = |report: &PortReport| force(report) > 0.1;
    tick_until(&mut port, presses);
    assert!(session.pause(true));
    tick_until(&mut port, |report| report.phase == Phase::Paused && force(report) == 0.0);
    let release = NodeSelection::Box { min: [0.0; 3], max: [0.015, 0.015, 0.001] };
    session.change(&ChangeRequest { release: Some(release), ..ChangeRequest::default() }).unwrap();
    assert!(session.pause(false));
    tick_until(&mut port, presses);
    // What a kill would leave: the file as it is now, with a chunk behind the change, and no end.
    tick_until(&mut port, |report| {
        let looks = report.record.index % 100 == 0;
        if looks {
            std::fs::copy(&path, &copy).unwrap();
        }
        looks && steps_after_a_change(&copy) > 10
    });
    let driver = std::thread::spawn(move || tick_until(&mut port, |report| report.phase == Phase::Stopped));
    let outcome = session.stop().unwrap().unwrap();
    driver.join().unwrap();
    if outcome.summary.trace.is_some_and(|trace| trace.dropped > 0) {
        println!("skipped: this machine was too slow to keep all records, without which there is no replay");
        return;
    }
    let report = replay(&path).unwrap();
    assert!(report.is_identical() && report.ticks > 10, "{report:?}");

    let report = replay(&copy).unwrap();
    assert!(report.is_identical() && report.damage.is_some() && report.ticks > 400, "{report:?}");
    let trace = Trace::load(&path).unwrap();
    let changed = trace.steps.iter().find(|step| step.phase == 1).unwrap().step;
    rewrite(&trace, &copy);
    let error = replay(&copy).unwrap_err();
    assert!(matches!(error, ReplayError::MissingChanges { step, .. } if step == changed), "{error}");
}
