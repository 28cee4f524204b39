//! Does a run on threads keep all three alive, lose nothing, and leave a readable trace however it ends?
//!
//! No time is asserted: a shared machine keeps none.

#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

mod block;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use palpate::run::{Length, Observer, Progress, RunOptions, run};
use palpate::scene::SceneDescription;
use palpate::step::StepReport;
use palpate::summary::RunEnd;
use palpate::tick::TickReport;
use palpate::trace::Trace;

use block::{Recorder, record, world};

fn no_change(_: &mut SceneDescription) {}

fn with_a_factor_thread(scene: &mut palpate::scene::SceneDescription) {
    scene.bodies[0].compliance = palpate::constraints::compliance::ComplianceMethod::Asynchronous;
}

fn real_time(trace: Option<&Path>) -> RunOptions {
    RunOptions {
        length: Length::Seconds(1.5),
        lockstep: false,
        threads: Some(1),
        trace: trace.map(Into::into),
        ..RunOptions::default()
    }
}

#[test]
fn three_threads_work_and_every_record_arrives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let (outcome, recorder) = record(&world(with_a_factor_thread), &real_time(Some(&path)));
    let s = &outcome.summary;
    println!("{} steps, {} factors, {} ticks in {:.2} s", s.steps, s.factors, s.ticks, s.wall);
    assert_eq!((s.end, s.mode), (RunEnd::Completed, "real time"));
    assert!(
        s.steps > 1 && s.factors > 1 && s.ticks > 10,
        "{} steps, {} factors, {} ticks",
        s.steps,
        s.factors,
        s.ticks
    );
    assert!(s.wall >= 1.5, "{}", s.wall);
    assert!(s.largest_force > 0.0, "the ball must have touched");

    // No record is lost on the way to the observer, and each comes once and in order.
    assert_eq!(s.records_missed, 0);
    assert_eq!((s.steps, s.ticks), (recorder.steps.len() as u64, recorder.ticks.len() as u64));
    assert!(recorder.steps.iter().enumerate().all(|(k, r)| r.step == k as u64));
    assert!(recorder.ticks.iter().enumerate().all(|(k, t)| t.record.index == k as u64));
    assert!(recorder.ticks.windows(2).all(|w| w[0].record.time < w[1].record.time));

    // What the summary says is what the records say.
    let largest = recorder.forces().iter().map(|f| f.norm()).fold(0.0, f64::max);
    assert_eq!(largest.to_bits(), s.largest_force.to_bits());
    assert_eq!(recorder.ticks.iter().map(|t| u64::from(t.overruns)).sum::<u64>(), s.tick_overruns);
    assert_eq!(recorder.steps.iter().map(|r| u64::from(r.overruns)).sum::<u64>(), s.step_overruns);
    for (rate, count) in [(s.step_rate, s.steps), (s.factor_rate, s.factors), (s.tick_rate, s.ticks)] {
        assert!((rate * s.wall - count as f64).abs() < 1e-6, "{rate} Hz over {} s is not {count}", s.wall);
    }
    for tail in [s.step_work, s.factor_work, s.tick_work, s.tick_latency] {
        assert!(tail.p50 <= tail.p99 && tail.p99 <= tail.p999 && tail.p999 <= tail.max, "{tail:?}");
    }
    // Every period was either used or counted as missed.
    let last = recorder.ticks.last().unwrap();
    let periods = s.ticks + s.tick_overruns;
    assert!((last.record.time * 1e3 - periods as f64).abs() < 2.0 + last.latency * 1e3, "{periods} periods");

    // The trace holds the same records.
    let told = s.trace.as_ref().unwrap();
    assert!(told.error.is_none() && told.dropped == 0, "{told:?}");
    assert_eq!(told.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(s.files, std::slice::from_ref(&path));
    let trace = Trace::load(&path).unwrap();
    assert_eq!((trace.steps.len(), trace.ticks.len()), (recorder.steps.len(), recorder.ticks.len()));
    assert_eq!(trace.factors.len() as u64, s.factors);
    for (read, sent) in trace.ticks.iter().zip(&recorder.ticks) {
        let force: [f64; 3] = sent.record.wrench.force.into();
        assert_eq!((read.tick, read.force.map(f64::to_bits)), (sent.record.index, force.map(f64::to_bits)));
    }
    for (read, sent) in trace.steps.iter().zip(&recorder.steps) {
        assert_eq!((read.step, read.factor_epoch), (sent.step, sent.factor_epoch));
    }
    assert!(trace.factors.iter().zip(1..).all(|(f, epoch)| f.epoch == epoch), "epochs count from 1");
}

/// Sets the stop flag once ticks have come.
struct Stopper<'a>(&'a AtomicBool, Recorder);

impl Observer for Stopper<'_> {
    fn progress(&mut self, _: &Progress) {
        if self.1.ticks.len() > 20 && self.1.steps.len() > 1 {
            self.0.store(true, Ordering::Relaxed);
        }
    }
    fn step(&mut self, report: &StepReport) {
        self.1.step(report);
    }
    fn tick(&mut self, report: &TickReport) {
        self.1.tick(report);
    }
}

#[test]
fn a_run_that_is_stopped_leaves_a_readable_trace() {
    let folder = tempfile::tempdir().unwrap();
    for lockstep in [false, true] {
        let path = folder.path().join(format!("{lockstep}.mcap"));
        // An hour: it ends because it is stopped.
        let options = RunOptions { length: Length::Seconds(3600.0), lockstep, ..real_time(Some(&path)) };
        let stop = AtomicBool::new(false);
        let mut stopper = Stopper(&stop, Recorder::default());
        let outcome = run(&world(no_change), &options, &stop, &mut stopper).unwrap();
        assert_eq!(outcome.summary.end, RunEnd::Interrupted);
        let trace = Trace::load(&path).unwrap();
        assert_eq!(trace.ticks.len() as u64, outcome.summary.ticks, "lockstep: {lockstep}");
        assert_eq!(trace.steps.len() as u64, outcome.summary.steps, "lockstep: {lockstep}");
        assert!(outcome.summary.trace.unwrap().error.is_none());
    }
}

#[test]
fn a_run_whose_trace_cannot_be_created_says_so_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let world = world(no_change);
    for path in [folder.path().join("absent/run.mcap"), folder.path().to_path_buf()] {
        for lockstep in [false, true] {
            let mut recorder = Recorder::default();
            let options = RunOptions { lockstep, length: Length::Seconds(0.3), ..real_time(Some(&path)) };
            let outcome = run(&world, &options, &AtomicBool::new(false), &mut recorder).unwrap();
            let s = &outcome.summary;
            assert!(s.end == RunEnd::Completed && s.trace.is_none() && s.files.is_empty(), "{s:?}");
            assert!(!recorder.ticks.is_empty() && !recorder.steps.is_empty(), "every stage has run");
            let told = s.notes.iter().any(|n| n.contains(&path.display().to_string()) && n.contains("writable"));
            assert!(told, "{:?}", s.notes);
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_costs_the_trace_and_not_the_run() {
    let path = Path::new("/dev/full");
    if !path.exists() {
        println!("there is no /dev/full here: nothing refuses to be written");
        return;
    }
    for lockstep in [false, true] {
        let length = Length::Seconds(0.4);
        let (outcome, recorder) = record(&world(no_change), &RunOptions { length, lockstep, ..real_time(Some(path)) });
        assert_eq!(outcome.summary.end, RunEnd::Completed, "lockstep: {lockstep}");
        assert!(recorder.ticks.len() > 10 && recorder.steps.len() > 1);
        let trace = outcome.summary.trace.unwrap();
        let error = trace.error.expect("the summary says what failed");
        assert!(error.contains("No space left"), "{error}");
        assert_eq!((trace.messages, trace.bytes), (0, 0));
    }
}
