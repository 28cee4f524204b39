//! Real time: step, factor and tick each on its own thread against the clock; the caller's thread watches.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use palpate_haptics::exchange::{Receiver, Sender, every};
use thread_priority::{RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy};

use rayon::ThreadPool;

use crate::engine::{Engine, StepStage};
use crate::factor_thread::refresh_until;
use crate::gathering::Gathering;
use crate::pace::Pacer;
use crate::refresh::RefreshReport;
use crate::run::{Observer, RunError, RunOptions, RunOutcome};
use crate::step::{StepReport, StepStatus};
use crate::summary::RunEnd;
use crate::tick::{TickReport, Ticker};
use crate::watch::Watch;
use crate::world::World;

/// SCHED_FIFO priority of the tick thread: above ordinary work, below the kernel's own threads.
const TICK_PRIORITY: u8 = 60;

/// What a user can do where real-time priority is not granted.
const PRIORITY_REMEDY: &str = "the tick thread runs without real-time priority; grant it with \
     `sudo setcap cap_sys_nice+ep <program>` or a line `@group - rtprio 80` in /etc/security/limits.conf";

/// Who ticks.
pub(crate) enum TickThread<'a> {
    /// A thread of this run.
    Own { ticker: &'a mut Ticker, reports: Sender<TickReport>, real_time_priority: bool },
    /// A thread of the caller, through a [`Port`](crate::session::Port).
    Elsewhere,
}

/// The ticks of a run: who makes them, and the ring in which they are told.
pub(crate) struct Ticks<'a> {
    pub(crate) thread: TickThread<'a>,
    pub(crate) told: Receiver<TickReport>,
}

/// What others may do to a run while it lasts.
#[derive(Clone, Copy)]
pub(crate) struct Switches<'a> {
    /// Ends the run.
    pub(crate) stop: &'a AtomicBool,
    /// The tissue does not move and gives no force while this is set.
    pub(crate) paused: &'a AtomicBool,
}

pub(crate) fn run(
    engine: Engine<'_>,
    pool: &ThreadPool,
    options: &RunOptions,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<RunOutcome, RunError> {
    let (mut ticker, engine) = engine.split();
    let (reports, told) = tick_reports(engine.world);
    let real_time_priority = options.real_time_priority;
    let ticks = Ticks { thread: TickThread::Own { ticker: &mut ticker, reports, real_time_priority }, told };
    let seconds = options.length.seconds(engine.world.dt());
    let switches = Switches { stop, paused: &AtomicBool::new(false) };
    attend(engine, pool, ticks, Instant::now(), seconds, switches, observer)
}

/// The ring from a tick thread to the watching one: a second of ticks.
pub(crate) fn tick_reports(world: &World) -> (Sender<TickReport>, Receiver<TickReport>) {
    every((world.description().rates.tick as usize).max(1024))
}

/// Starts the threads of a run that began at `start`, and watches them for `seconds`.
pub(crate) fn attend(
    engine: Engine<'_, ()>,
    pool: &ThreadPool,
    ticks: Ticks<'_>,
    start: Instant,
    seconds: f64,
    switches: Switches<'_>,
    observer: &mut dyn Observer,
) -> Result<RunOutcome, RunError> {
    let world = engine.world;
    let rates = world.description().rates;
    let Engine { mut stage, mut refresh, mut refresh_trace, trace, notes, changes, .. } = engine;
    let (step_sender, steps) = every::<StepReport>(256);
    let (refresh_sender, refreshes) = every::<RefreshReport>(64);
    let mut watch = Watch::new(Gathering::new(world), steps, ticks.told, refreshes);
    let end_all = AtomicBool::new(false);
    let granted = AtomicBool::new(true);
    let death = OnceLock::new();
    let outcome = std::thread::scope(|scope| -> std::io::Result<(RunEnd, f64)> {
        let spawn = |name: &str| std::thread::Builder::new().name(name.into());
        let (stage, refresh, refresh_trace) = (&mut stage, &mut refresh, &mut refresh_trace);
        let (end_all, granted, death, pool) = (&end_all, &granted, &death, pool);
        // The scope waits for its threads even where an observer panics, so they must be told.
        let _told = EndOnDrop(end_all);
        let elsewhere = matches!(ticks.thread, TickThread::Elsewhere);
        let ticking = match ticks.thread {
            TickThread::Own { ticker, reports, real_time_priority } => spawn("palpate-tick")
                .spawn_scoped(scope, move || {
                    granted.store(!real_time_priority || raise_priority(), Ordering::Relaxed);
                    let _ends = EndOnDrop(end_all);
                    tick_loop(ticker, Pacer::new(start, rates.tick), reports, end_all);
                })
                .map(drop),
            TickThread::Elsewhere => Ok(()),
        };
        let spawned = ticking
            .and_then(|()| match refresh {
                Some(refresh) => spawn("palpate-factor")
                    .spawn_scoped(scope, move || {
                        let pacer = Pacer::new(start, rates.factor);
                        refresh_until(end_all, refresh, refresh_trace, pacer, refresh_sender, death);
                    })
                    .map(drop),
                None => Ok(()),
            })
            .and_then(|()| {
                spawn("palpate-step").spawn_scoped(scope, move || {
                    let _ends = EndOnPanic(end_all);
                    let pacer = Pacer::new(start, rates.step);
                    pool.install(|| step_loop(stage, pacer, step_sender, end_all, switches.paused, elsewhere));
                })
            });
        let end = spawned.map(|_| watch.until(seconds, start, switches.stop, end_all, observer))?;
        // Before the last step has ended, which would pass for time without ticks.
        Ok((end, start.elapsed().as_secs_f64()))
    });
    // A tick thread of somebody else goes on.
    stage.rest();
    watch.drain(observer);
    let mut gathering = watch.gathering;
    let (end, wall) = outcome.map_err(|e| RunError::Threads(e.to_string()))?;
    gathering.end = end;
    gathering.missed = watch.steps.dropped() + watch.ticks.dropped() + watch.refreshes.dropped();
    gathering.factor_thread_death = death.into_inner();
    if !granted.load(Ordering::Relaxed) {
        gathering.notes.push(PRIORITY_REMEDY.into());
    }
    Ok(Engine { world, stage, refresh, ticker: (), refresh_trace, trace, notes, changes }.finish(gathering, Some(wall)))
}

/// Asks the system for a real-time policy for the calling thread, which must not wait for others then; true where it
/// was granted. Call it once, before a loop of ticks.
pub fn raise_priority() -> bool {
    let Ok(value) = ThreadPriorityValue::try_from(TICK_PRIORITY) else { return false };
    thread_priority::set_thread_priority_and_policy(
        thread_priority::thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .is_ok()
}

/// Ends all threads when it is dropped, in a panic too.
struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Ends all threads when its own panics; a thread that ends otherwise leaves them time to bring the force down.
struct EndOnPanic<'a>(&'a AtomicBool);

impl Drop for EndOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Release);
        }
    }
}

/// Takes the force off the device when it is dropped, in a panic too.
struct Resting<'a>(&'a mut Ticker);

impl Drop for Resting<'_> {
    fn drop(&mut self) {
        self.0.rest();
    }
}

fn tick_loop(ticker: &mut Ticker, mut pacer: Pacer, mut reports: Sender<TickReport>, end: &AtomicBool) {
    let resting = Resting(ticker);
    let ticker = &mut *resting.0;
    let mut before = None;
    while let Some(beat) = pacer.wait(end) {
        let start = Instant::now();
        let dt = ticker.since(before.replace(beat.time), beat.time);
        let record = ticker.tick(beat.time, dt);
        let work = start.elapsed().as_secs_f64();
        let report = TickReport { record, latency: beat.latency, work, overruns: beat.missed };
        ticker.trace(&report);
        reports.send(report);
    }
}

fn step_loop(
    stage: &mut StepStage<'_>,
    mut pacer: Pacer,
    mut reports: Sender<StepReport>,
    end: &AtomicBool,
    paused: &AtomicBool,
    mut awaits_pose: bool,
) {
    let mut resting = false;
    while let Some(beat) = pacer.wait(end) {
        // A driver that has not ticked yet may have its tool anywhere.
        awaits_pose &= !stage.has_pose();
        if awaits_pose {
            continue;
        }
        // Periods of a pause pass unused and are not missed.
        if paused.load(Ordering::Acquire) {
            if !resting {
                stage.rest();
            }
            resting = true;
            continue;
        }
        resting = false;
        stage.end_by(pacer.due());
        let mut report = stage.advance(beat.time);
        report.latency = beat.latency;
        report.overruns = beat.missed;
        stage.trace(&report, true);
        reports.send(report);
        if report.status == StepStatus::RolledBack {
            break;
        }
    }
}
