//! Lockstep: step, factor and tick on one thread in virtual time. The same bits on every run, whatever the load of the
//! machine and the number of worker threads.
//!
//! Step `k` begins at the first tick at or after `k / step_rate`. The factor stage asks for a matrix every
//! `1 / factor_rate` seconds and hands the factor over `factor_delay` seconds later, at the begin of a step: by default the time
//! that the plan predicts for a factorisation. A step that urges it has its matrix taken at once, if no other is on its way.

use std::sync::atomic::{AtomicBool, Ordering};

use palpate_haptics::wrench::Wrench;
use rayon::ThreadPool;

use crate::engine::Engine;
use crate::gathering::Gathering;
use crate::run::{Length, Observer, Progress, RunError, RunOptions, RunOutcome};
use crate::step::StepStatus;
use crate::summary::RunEnd;
use crate::tick::TickReport;

/// Ticks between two calls of [`Observer::progress`].
const PROGRESS_EVERY: u64 = 250;

/// Ticks after which a force that still comes down is cut: a second at 1 kHz.
const MOST_RELEASE_TICKS: u64 = 1000;

pub(crate) fn run(
    mut engine: Engine<'_>,
    pool: &ThreadPool,
    options: &RunOptions,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<RunOutcome, RunError> {
    let mut gathering = Gathering::new(engine.world);
    // Inside the pool the parallel loops of the step find their workers without a queue that allocates.
    let end = pool.install(|| beat(&mut engine, options, stop, observer, &mut gathering));
    gathering.end = end;
    engine.ticker.rest();
    Ok(engine.finish(gathering, None))
}

fn beat(
    engine: &mut Engine<'_>,
    options: &RunOptions,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
    gathering: &mut Gathering,
) -> RunEnd {
    let rates = engine.world.description().rates;
    let last_step = match options.length {
        Length::Steps(n) => n,
        Length::Seconds(_) => u64::MAX,
    };
    let seconds = options.length.seconds(engine.world.dt());
    let mut clock = Clock { step: 0, asked: 0, due: None };
    for index in 0_u64.. {
        let time = index as f64 / rates.tick;
        if time >= seconds - 0.5 / rates.tick {
            break;
        }
        if stop.load(Ordering::Relaxed) {
            return RunEnd::Interrupted;
        }
        if is_due(time, rates.step, clock.step) && clock.step < last_step {
            refresh(engine, &mut clock, time, gathering);
            let report = engine.stage.advance(time);
            clock.step += 1;
            if engine.stage.has_urged() {
                clock.due = Some(time + engine.world.factor_delay());
            }
            gathering.step(&report, observer);
            engine.stage.trace(&report, false);
            engine.drain();
            if report.status == StepStatus::RolledBack {
                release(engine, index, observer, gathering);
                return RunEnd::BodyFailed;
            }
        }
        tick(engine, time, observer, gathering);
        if index % PROGRESS_EVERY == 0 {
            // Slow steps must not let the ring of ticks fill up.
            engine.drain();
            observer.progress(&Progress { rates: None, ..gathering.progress() });
        }
    }
    RunEnd::Completed
}

/// Ticks on the invalid snapshot of a failed step, from tick `index` on, until the force has come down to zero at the
/// rate that the limits allow.
fn release(engine: &mut Engine<'_>, index: u64, observer: &mut dyn Observer, gathering: &mut Gathering) {
    let rate = engine.world.description().rates.tick;
    for k in 0..MOST_RELEASE_TICKS {
        let sent = tick(engine, (index + k) as f64 / rate, observer, gathering);
        if sent == Wrench::zero() {
            return;
        }
    }
}

/// Share of a period that passes for none: far above the rounding of a day's count, far below a tick.
const ROUNDING: f64 = 1e-6;

/// Whether event `count`, from 0, of a stage at `rate` (Hz) begins at `time` (s) or before. Counts are integers, and each
/// time is derived from one, so nothing adds up over a run.
fn is_due(time: f64, rate: f64, count: u64) -> bool {
    time * rate >= count as f64 - ROUNDING
}

/// One tick in virtual time; the wrench that it sent.
fn tick(engine: &mut Engine<'_>, time: f64, observer: &mut dyn Observer, gathering: &mut Gathering) -> Wrench {
    let record = engine.ticker.tick(time, engine.ticker.period());
    let report = TickReport { record, latency: 0.0, work: 0.0, overruns: 0 };
    engine.ticker.trace(&report);
    gathering.tick(&report, observer);
    record.wrench
}

/// Where virtual time stands.
struct Clock {
    /// Next step.
    step: u64,
    /// Matrices asked for so far.
    asked: u64,
    /// When the matrix that was asked for has become a factor (s).
    due: Option<f64>,
}

/// The factor stage's part of a step's begin: hand over what is due, ask for the next matrix.
fn refresh(engine: &mut Engine<'_>, clock: &mut Clock, time: f64, gathering: &mut Gathering) {
    let rates = engine.world.description().rates;
    let Some(stage) = &mut engine.refresh else { return };
    if clock.due.is_some_and(|due| time >= due - 1e-9) {
        if let Some(report) = stage.refresh(|| time) {
            gathering.refresh(&report);
            engine.refresh_trace.push(&report, false);
        }
        clock.due = None;
    }
    if clock.due.is_none() && is_due(time, rates.factor, clock.asked) {
        stage.want();
        clock.asked = (time * rates.factor + ROUNDING) as u64 + 1;
        clock.due = Some(time + engine.world.factor_delay());
    }
}

#[cfg(test)]
mod tests {
    use palpate_trace::Trace;

    use super::*;
    use crate::replay::replay;
    use crate::run::Unobserved;
    use crate::scene::Scene;
    use crate::world::World;

    /// A ball that is pressed 4 mm into a block within 0.4 s and stays there.
    const PRESS: &str = r#"
        name = "press"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [3, 3, 3] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.008 }
        [contact]
        at = "faces"
        [device]
        kind = "scripted"
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.05] }, { time = 0.4, position = [0.02, 0.02, 0.044] }]
    "#;

    fn world() -> World {
        Scene::from_toml(PRESS, std::path::Path::new("")).unwrap().build().unwrap()
    }

    #[test]
    fn a_day_of_ticks_has_all_its_steps_each_in_its_tick() {
        const DAY: u64 = 24 * 3600;
        for (step, tick) in [(30_u64, 1000_u64), (60, 1000), (100, 1000)] {
            let mut steps = 0;
            for index in 0..DAY * tick {
                let time = index as f64 / tick as f64;
                if is_due(time, step as f64, steps) {
                    // The first tick at or after steps/step seconds, in integers.
                    assert_eq!(index, (steps * tick).div_ceil(step), "step {steps}");
                    steps += 1;
                }
            }
            assert_eq!(steps, DAY * step);
        }
    }

    #[test]
    fn a_failed_step_brings_the_force_down_to_zero_within_the_slew_limit() {
        let world = world();
        let mut engine = Engine::new(&world, &RunOptions::default()).unwrap();
        let mut gathering = Gathering::new(&world);
        let mut sent = Wrench::zero();
        for index in 0..500_u64 {
            let time = index as f64 * 1e-3;
            if index % 33 == 0 {
                assert_eq!(engine.stage.advance(time).status, StepStatus::Advanced);
            }
            sent = tick(&mut engine, time, &mut Unobserved, &mut gathering);
        }
        let slew = world.description().limits.force_slew * 1e-3;
        assert!(sent.force.norm() > 0.1, "the ball presses with {} N", sent.force.norm());

        engine.stage.spoil();
        assert_eq!(engine.stage.advance(0.5).status, StepStatus::RolledBack);
        let ticks = gathering.counts()[2];
        release(&mut engine, 500, &mut Unobserved, &mut gathering);
        let needed = (sent.force.norm() / slew).ceil().max(1.0) as u64;
        assert_eq!(gathering.counts()[2] - ticks, needed);
        assert_eq!(gathering.progress().force, 0.0);
    }

    #[test]
    fn a_run_that_failed_has_a_readable_trace_that_says_so_and_replays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("failed.mcap");
        let mut scene = Scene::from_toml(PRESS, std::path::Path::new("")).unwrap();
        // The square of such a weight is infinite.
        scene.edit(|d| (d.gravity, d.bodies[0].settle) = ([0.0, 0.0, -1e200], false)).unwrap();
        let options = RunOptions { lockstep: true, trace: Some(path.clone()), ..RunOptions::default() };
        let world = scene.build().unwrap();
        let outcome = crate::run::run(&world, &options, &AtomicBool::new(false), &mut Unobserved).unwrap();
        assert_eq!(outcome.summary.end, RunEnd::BodyFailed);
        assert_eq!(outcome.state.q, world.mesh().nodes, "the body is back where it was");
        let trace = Trace::load(&path).unwrap();
        assert_eq!(trace.metadata["end"]["end"], "body_failed");
        assert!(trace.log.iter().any(|line| line.message().contains("rolled back")), "{:?}", trace.log);
        assert!(trace.steps[0].flags.contains(palpate_trace::StepFlags::ROLLED_BACK));
        assert!(replay(&path).unwrap().is_identical());
    }

    #[test]
    fn an_interrupted_run_replays_as_far_as_it_came() {
        struct Stop<'a>(&'a AtomicBool);
        impl Observer for Stop<'_> {
            fn tick(&mut self, report: &TickReport) {
                self.0.fetch_or(report.record.index == 456, Ordering::Relaxed);
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("interrupted.mcap");
        let options = RunOptions { lockstep: true, trace: Some(path.clone()), ..RunOptions::default() };
        let stop = AtomicBool::new(false);
        let outcome = crate::run::run(&world(), &options, &stop, &mut Stop(&stop)).unwrap();
        assert_eq!((outcome.summary.end, outcome.summary.ticks), (RunEnd::Interrupted, 457));
        let report = replay(&path).unwrap();
        assert!(report.is_identical() && report.ticks == 457, "{report:?}");
    }
}
