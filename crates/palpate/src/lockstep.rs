//! Lockstep: step, factor and tick on one thread in virtual time. The same bits on every run, whatever the load of the
//! machine and the number of worker threads.
//!
//! Step `k` begins at the first tick at or after `k / step_rate`. The factor stage asks for a matrix every
//! `1 / factor_rate` seconds and hands the factor over `factor_delay` seconds later, at the begin of a step.

use std::sync::atomic::{AtomicBool, Ordering};

use palpate_haptics::wrench::Wrench;
use rayon::ThreadPool;

use crate::engine::Engine;
use crate::gathering::Gathering;
use crate::run::{Length, Observer, Progress, RunError, RunOptions, RunOutcome};
use crate::step::StepStatus;
use crate::summary::RunEnd;
use crate::tick::{TickRecord, TickReport};

/// Ticks between two calls of [`Observer::progress`].
const PROGRESS_EVERY: u64 = 250;

/// Ticks after which a force that still falls is cut off: the device is let go then.
const RELEASE_TICKS: u64 = 1000;

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
        if time * rates.step >= clock.step as f64 - 1e-9 && clock.step < last_step {
            refresh(engine, &mut clock, time, gathering);
            let report = engine.stage.advance(time);
            clock.step += 1;
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
            observer.progress(&Progress { rates: None, ..gathering.progress() });
        }
    }
    RunEnd::Completed
}

/// Ticks from `index` on until the invalid snapshot of a failed body has taken the force off, as fast as the limits let
/// it fall.
fn release(engine: &mut Engine<'_>, index: u64, observer: &mut dyn Observer, gathering: &mut Gathering) {
    let rate = engine.world.description().rates.tick;
    for later in index..index + RELEASE_TICKS {
        let record = tick(engine, later as f64 / rate, observer, gathering);
        if record.wrench == Wrench::zero() {
            break;
        }
    }
    engine.drain();
}

/// One tick in virtual time.
fn tick(engine: &mut Engine<'_>, time: f64, observer: &mut dyn Observer, gathering: &mut Gathering) -> TickRecord {
    let record = engine.ticker.tick(time, engine.ticker.period());
    let report = TickReport { record, latency: 0.0, work: 0.0, overruns: 0 };
    engine.ticker.trace(&report);
    gathering.tick(&report, observer);
    record
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
    if clock.due.is_some_and(|due| time >= due - 1e-9) {
        if let Some(report) = engine.refresh.refresh(|| time) {
            gathering.refresh(&report);
            engine.refresh_trace.push(&report, false);
        }
        clock.due = None;
    }
    if clock.due.is_none() && time * rates.factor >= clock.asked as f64 - 1e-9 {
        engine.refresh.want();
        clock.asked = (time * rates.factor + 1e-9) as u64 + 1;
        clock.due = Some(time + rates.factor_delay);
    }
}
