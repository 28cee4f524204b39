//! A driver goes on to tick while the thread that steps the tissue hangs: what does the hand feel then, and afterwards?
//!
//! A step that saves its contact problem waits for the disk. Here one file is a pipe that nobody reads, and the thread hangs
//! until somebody does.

#![cfg(unix)] // pipes with a name
#![allow(clippy::print_stdout)] // measured numbers

mod block;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate::run::RunOptions;
use palpate::session::{Phase, Port, PortReport, PortSample, Session};
use palpate::tick::TickFlags;

use block::{MAX_FORCE, RADIUS, SKIN, world};

/// Where the tool is pressed to: 5 mm below the skin.
const PRESSED: PortSample = PortSample {
    time_ns: None,
    position: [0.033, 0.037, SKIN + RADIUS - 5e-3],
    orientation: [1.0, 0.0, 0.0, 0.0],
    velocity: None,
    buttons: 0,
    gripper: 1.0,
};

/// What ends a test that would hang.
const LONGEST: Duration = Duration::from_secs(60);

/// The file of the first contact problem of a step.
fn file(folder: &Path, step: u64) -> PathBuf {
    folder.join(format!("step-{step:06}-pass-00001.json"))
}

/// Ticks some 1000 times a second until `enough`.
fn tick_until(port: &mut Port, enough: impl Fn(&PortReport) -> bool) -> Vec<PortReport> {
    let (begin, mut reports) = (Instant::now(), Vec::new());
    loop {
        let report = port.tick(&PRESSED);
        reports.push(report);
        if enough(&report) {
            return reports;
        }
        assert!(begin.elapsed() < LONGEST, "it did not come to that: {:?}", report.record);
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_step_that_hangs_fades_the_force_and_its_return_is_a_ramp() {
    let folder = tempfile::tempdir().unwrap();
    // The step that hangs, and for how long the tick is to miss it (s).
    let stalls = [(15_u64, 0.1), (35, 1.0)];
    for (step, _) in stalls {
        match Command::new("mkfifo").arg(file(folder.path(), step)).status() {
            Ok(status) => assert!(status.success()),
            Err(error) => return println!("skipped: there is no mkfifo here: {error}"),
        }
    }
    let world = Arc::new(world(|_| {}));
    let limits = world.description().limits;
    let options = RunOptions { threads: Some(1), problems: Some(folder.path().to_path_buf()), ..RunOptions::default() };
    let (mut session, mut port) = Session::open(world, &options).unwrap();
    assert!(session.start());

    let mut reports = Vec::new();
    for (step, seconds) in stalls {
        // Steps are counted from 0 and snapshots from 1; a problem is saved before the snapshot of its step is sent.
        let hangs = |report: &PortReport| report.record.snapshot_step == step && report.record.snapshot_age > seconds;
        let until_it_hangs = tick_until(&mut port, hangs);
        let last = until_it_hangs.last().unwrap().record;
        let stalled = until_it_hangs.iter().filter(|report| report.record.snapshot_step == last.snapshot_step).count();
        println!("{seconds} s without a step: {stalled} ticks, the last with {:.3} N", last.wrench.force.norm());
        assert!(stalled > 20, "the tick goes on: {stalled}");
        reports.extend(until_it_hangs);
        // The thread goes on when the pipe is read to its end.
        let text = std::fs::read_to_string(file(folder.path(), step)).unwrap();
        assert!(text.starts_with('{'), "a problem: {text}");
        let back = |report: &PortReport| report.record.snapshot_step > step && report.record.gain == 1.0;
        reports.extend(tick_until(&mut port, back));
    }
    assert_eq!(session.phase(), Phase::Running);
    session.stop().unwrap().unwrap();

    let fresh = |age: f64| ((limits.stale_zero - age) / (limits.stale_zero - limits.stale_after)).clamp(0.0, 1.0);
    let mut before = (Vector3::zeros(), 0.0);
    let (mut faded, mut absent, mut rising, mut largest) = (0, 0, 0, 0.0_f64);
    for PortReport { record, .. } in &reports {
        let force = record.wrench.force;
        assert!(force.iter().all(|f| f.is_finite()) && force.norm() <= MAX_FORCE, "{record:?}");
        largest = largest.max(force.norm());
        let cut = [TickFlags::NO_SNAPSHOT, TickFlags::INVALID_SNAPSHOT, TickFlags::GAP, TickFlags::JUMPED];
        // A machine that let this thread wait for 50 ms has a gap, after which the force begins from zero.
        if !cut.iter().any(|&flag| record.flags.contains(flag)) {
            let due = f64::min(before.1 + record.granted / limits.fade_in, fresh(record.snapshot_age));
            assert!((record.gain - due).abs() < 1e-9, "{due}: {record:?}");
            let change = (force - before.0).norm();
            assert!(change <= limits.force_slew * record.granted + 1e-9, "{change} N: {record:?}");
            faded += u32::from(record.gain < before.1);
            rising += u32::from(record.gain > before.1 && before.1 > 0.0);
            absent += u32::from(record.snapshot_age > limits.stale_zero + 0.1 && force == Vector3::zeros());
        }
        before = (force, record.gain);
    }
    println!("up to {largest:.3} N; {faded} ticks of fading, {absent} without force, {rising} of rising");
    assert!(largest > 0.1, "it presses: {largest} N");
    // 0.3 s of fading, 0.4 s without, and two or three times 0.3 s of rising, were no tick late.
    assert!(faded > 5 && absent > 5 && rising > 5);
    let old = reports.iter().filter(|report| report.record.snapshot_age > limits.stale_zero + 0.1);
    assert!(old.clone().all(|report| report.record.wrench.force == Vector3::zeros()), "none is left of an old force");
}
