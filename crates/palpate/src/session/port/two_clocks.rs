//! Tests: whatever a device's clock and this machine's say, do force and fade-in change no faster than both allow, and does
//! such a run replay to the bit?

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU8};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use palpate_devices::place::{Place, PlaceConfig};
use palpate_haptics::exchange::every;
use palpate_trace::Trace;

use super::*;
use crate::engine::Engine;
use crate::gathering::Gathering;
use crate::record::NoTrace;
use crate::replay::replay;
use crate::run::RunOptions;
use crate::slide::slide;
use crate::tick::TickFlags;
use crate::world::World;

/// Largest change of force (N/s) and of the gain (1/s) in the scene of these tests. The force of the press would change by up
/// to 150 N/s.
const SLEW: f64 = 40.0;
const FADE: f64 = 1.0 / 0.1;

const MS: u64 = 1_000_000;

/// When a tick is: the device's stamp (ns), and this machine's time (ns).
type Moment = (Option<u64>, u64);

fn world() -> World {
    let mut scene = slide(0.8).scene().clone();
    scene.edit(|d| (d.limits.force_slew, d.limits.fade_in) = (SLEW, 1.0 / FADE)).unwrap();
    scene.build().unwrap()
}

/// Down into the block by 4 mm and out of it, twenty times a second.
fn sample(tick: usize, time_ns: Option<u64>) -> PortSample {
    let z = 0.046 + 0.004 * (tick as f64 * 1e-3 * 20.0 * std::f64::consts::TAU).cos();
    PortSample {
        time_ns,
        position: [0.015, 0.02, z],
        orientation: [1.0, 0.0, 0.0, 0.0],
        velocity: None,
        buttons: 0,
        gripper: 1.0,
    }
}

/// What a port answers at these moments on a session whose steps are done by this machine's time, in a fixed order.
fn run(path: &Path, moments: &[Moment], sample: impl Fn(usize, Option<u64>) -> PortSample) -> Vec<PortReport> {
    let world = world();
    let options = RunOptions { trace: Some(path.into()), ..RunOptions::default() };
    let spec = DeviceSpec::virtual_device(0.0);
    let config = TickStage::config(&world, &spec);
    let engine = Engine::with_tick(&world, &options, &spec, world.first_tool(), NoTrace::Refused, |ends| {
        TickStage::new(&world, &config, &spec, ends.snapshots, ends.poses, ends.line)
    });
    let (stage, mut engine) = engine.unwrap().split();
    let shared = Arc::new(Shared {
        phase: AtomicU8::new(Phase::Running as u8),
        paused: AtomicBool::new(false),
        stop: AtomicBool::new(false),
        has_port: AtomicBool::new(true),
        start: OnceLock::new(),
    });
    let place = Place::new(&PlaceConfig::default()).unwrap();
    let mut port = Port::new(stage, spec, place, every(moments.len()).0, Arc::clone(&shared));
    let epoch = port.epoch;
    shared.start.set(epoch).unwrap();
    let (mut reports, mut steps) = (Vec::new(), 0);
    for (k, &(stamp, host)) in moments.iter().enumerate() {
        while steps * 33 * MS <= host {
            let report = engine.stage.advance(seconds(steps * 33 * MS));
            engine.stage.trace(&report, true);
            steps += 1;
        }
        reports.push(port.tick_at(&sample(k, stamp), epoch + Duration::from_nanos(host)));
    }
    engine.finish(Gathering::new(&world), Some(0.0));
    reports
}

/// Checks a run tick by tick against both clocks, and its replay; how many ticks the slew held back.
fn check(name: &str, moments: &[Moment]) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clocks.mcap");
    let reports = run(&path, moments, sample);
    let mut held = 0;
    for (k, pair) in reports.windows(2).enumerate() {
        let (then, now) = (&pair[0].record, &pair[1].record);
        let host = seconds(moments[k + 1].1 - moments[k].1);
        let change = (now.wrench.force - then.wrench.force).norm();
        let rise = now.gain - then.gain;
        // Rounding of sums of forces up to 1 N, and of gains.
        assert!(change <= SLEW * host + 1e-12, "{name}, tick {k}: {change} N in {host} s");
        assert!(rise <= FADE * host + 1e-12, "{name}, tick {k}: the gain rises by {rise} in {host} s");
        // And by the device's, where that was believed.
        let device = now.time - then.time;
        assert!(change <= SLEW * device + 1e-12, "{name}, tick {k}: {change} N in {device} s of the device's");
        held += usize::from(now.flags.contains(TickFlags::SLEW_LIMITED));
    }
    assert!(reports.iter().any(|report| report.record.wrench.force.norm() > 0.1), "{name}: it presses");
    let trace = Trace::load(&path).unwrap();
    assert_eq!(trace.ticks.len(), moments.len(), "{name}");
    let report = replay(&path).unwrap();
    assert!(report.is_identical() && report.ticks == moments.len(), "{name}: {report:?}");
    held
}

/// So many ticks at 1 kHz by both clocks, changed by `change`, which is given the tick, the device's time and this machine's (ns).
fn ticks(count: u64, change: impl Fn(u64, u64, u64) -> (u64, u64)) -> Vec<Moment> {
    let moments = (0..count).map(|k| change(k, 7 * MS + k * MS, k * MS));
    moments.map(|(stamp, host)| (Some(stamp), host)).collect()
}

#[test]
fn a_timestamp_that_leaps_by_49_milliseconds_in_one_is_no_time_for_the_force_to_change() {
    let leaps = ticks(1200, |k, stamp, host| (stamp + k / 150 * 49 * MS, host));
    assert!(check("leaps", &leaps) > 100, "the slew acts");
}

#[test]
fn a_clock_that_runs_backwards_or_stands_still_gives_the_force_no_more_than_this_machine_does() {
    check("backwards", &ticks(900, |k, stamp, host| (if k % 300 == 299 { stamp - 200 * MS } else { stamp }, host)));
    check(
        "still",
        &ticks(900, |k, stamp, host| (if k % 300 > 200 { 7 * MS + k / 300 * 300 * MS } else { stamp }, host)),
    );
    let none: Vec<_> = (0..900).map(|k| (None, k * MS)).collect();
    assert!(check("none", &none) > 100);
}

#[test]
fn a_clock_that_runs_twice_as_fast_for_a_second_does_not_hurry_the_force() {
    let fast = |k: u64| k.clamp(300, 1300) - 300;
    assert!(check("fast", &ticks(1600, |k, stamp, host| (stamp + fast(k) * MS, host))) > 100);
    // Too little to be doubted.
    assert!(check("drift", &ticks(1200, |k, stamp, host| (stamp + k * MS / 25, host))) > 100);
    check("slow", &ticks(1200, |k, stamp, host| (stamp - k * MS / 25, host)));
}

#[test]
fn a_host_that_is_late_or_whose_clock_stands_still_gives_the_force_no_time_that_has_not_passed() {
    // Late by 20 ms in every 50: what the bus has kept comes at once.
    let late =
        |k: u64, host: u64| if k % 50 >= 30 { host.max(k / 50 * 50 * MS + 50 * MS) - MS + k % 50 * 1000 } else { host };
    check("late", &ticks(1200, |k, stamp, host| (stamp, late(k, host))));
    // Jitter of a third of a tick.
    check("jitter", &ticks(900, |k, stamp, host| (stamp, host + k * 7919 % 331 * 1000)));
    // Two ticks at a time, with timestamps and without.
    check("pairs", &ticks(900, |k, stamp, host| (stamp, host - k % 2 * MS)));
    let pairs: Vec<_> = (0..900).map(|k| (None, k / 2 * 2 * MS)).collect();
    check("pairs without stamps", &pairs);
}

#[test]
fn a_force_does_not_rest_on_a_clock_that_has_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stopped.mcap");
    let moments: Vec<_> = (0..700_u64).map(|k| (None, (k.min(500) + k.saturating_sub(600)) * MS)).collect();
    let held = |_, time_ns| sample(25, time_ns);
    let reports = run(&path, &moments, held);
    let force = |k: usize| reports[k].record.wrench.force.norm();
    assert!(force(500) > 0.1 && force(501) == force(500) && force(600) == 0.0, "{} N, {} N", force(500), force(600));
    assert!(force(699) > 0.1, "and it comes back when time goes on: {} N", force(699));
    assert!(replay(&path).unwrap().is_identical());
}

#[test]
fn a_jump_of_the_pose_is_seen_behind_a_leap_of_the_clock() {
    let folder = tempfile::tempdir().unwrap();
    let moments = ticks(400, |k, stamp, host| (stamp + k / 300 * 49 * MS, host));
    // 0.1 m in 50 ms is 2 m/s, which a hand can do; within the millisecond that has passed it is not.
    let jumps = |k, time_ns| {
        let still = sample(25, time_ns);
        let [x, y, z] = still.position;
        PortSample { position: [if k < 300 { x } else { x + 0.1 }, y, z], ..still }
    };
    let reports = run(&folder.path().join("jump.mcap"), &moments, jumps);
    assert!(!reports[299].record.flags.contains(TickFlags::JUMPED));
    assert!(reports[300].record.flags.contains(TickFlags::JUMPED), "{:?}", reports[300].record);
    assert_eq!(reports[300].clock, ClockEvent::Unsteady, "the driver is told");
}
