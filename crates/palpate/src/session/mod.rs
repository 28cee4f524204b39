//! A scene that runs on threads of its own while a driver ticks: for programs that embed the library.
//!
//! ```text
//! Session::open ── Ready ── start ── Running ⇄ Paused ── stop, or a body that fails ── Stopped, Failed
//!                    port ticks: no force     force         no force       the force comes down, then none
//! ```
//! The tissue begins to move when the first tick has told where the tool is. The session owns the step, the factor
//! stage and the trace; the driver owns the [`Port`] and ticks it in its own thread. Either may be dropped first.

pub mod clock;
mod config;
mod ledger;
mod motion;
mod port;
mod shape;
mod skins;

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use palpate_devices::place::Place;
use palpate_haptics::exchange::{Reader, Receiver as Ring, Sender};

use crate::changes::ChangeQueue;
use crate::engine::{Engine, workers};
use crate::gathering::Gathering;
use crate::realtime::{Switches, TickThread, Ticks, attend, tick_reports};
use crate::record::NoTrace;
use crate::run::{Length, RunError, RunOptions, RunOutcome};
use crate::summary::RunEnd;
use crate::tick::{TickReport, TickStage};
use crate::world::{Change, ChangeError, ChangeRequest, World};
use ledger::Ledger;

pub use crate::realtime::raise_priority;
pub use config::{HIGHEST_RATE, LOWEST_RATE, PortConfig, PortConfigError};
pub use ledger::Statistics;
pub use port::{PhaseReader, Port, PortReport, PortSample};
pub use shape::Shape;
pub(crate) use shape::ShapeWriter;
pub use skins::Skins;

/// What a session is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Set up; nothing moves yet.
    Ready = 0,
    /// The tissue moves.
    Running = 1,
    /// The tissue stands still and gives no force.
    Paused = 2,
    /// Ended by its owner.
    Stopped = 3,
    /// Ended by itself: the body became non-finite or was torn apart, or a thread failed.
    Failed = 4,
}

impl Phase {
    const ALL: [Self; 5] = [Self::Ready, Self::Running, Self::Paused, Self::Stopped, Self::Failed];

    /// Whether threads are at work.
    pub fn is_live(self) -> bool {
        matches!(self, Self::Running | Self::Paused)
    }
}

/// What the session's threads and the port both see.
pub(crate) struct Shared {
    phase: AtomicU8,
    paused: AtomicBool,
    stop: AtomicBool,
    has_port: AtomicBool,
    /// When the threads started.
    start: OnceLock<Instant>,
}

impl Shared {
    fn phase(&self) -> Phase {
        let phase = Phase::ALL.get(usize::from(self.phase.load(Ordering::Acquire))).copied();
        match phase.unwrap_or(Phase::Failed) {
            Phase::Running if self.paused.load(Ordering::Acquire) => Phase::Paused,
            phase => phase,
        }
    }

    fn enter(&self, phase: Phase) {
        self.phase.store(phase as u8, Ordering::Release);
    }
}

/// Marks a session as failed unless its thread ended in order.
struct FailedUnlessEnded<'a>(&'a Shared);

impl Drop for FailedUnlessEnded<'_> {
    fn drop(&mut self) {
        if !matches!(self.0.phase(), Phase::Stopped) {
            self.0.enter(Phase::Failed);
        }
    }
}

/// A scene that runs until it is stopped. Dropping it stops it.
pub struct Session {
    world: Arc<World>,
    shared: Arc<Shared>,
    ledger: Ledger,
    shapes: Reader<Shape>,
    /// Taken when the threads are told to start.
    starter: Option<SyncSender<()>>,
    runner: Option<JoinHandle<Result<RunOutcome, RunError>>>,
    changes: Mutex<Option<ChangeQueue>>,
    skins: Arc<Skins>,
}

/// What a set-up thread answers.
type SetUp = Result<(TickStage, Sender<TickReport>, Option<ChangeQueue>, Reader<Shape>), RunError>;

impl Session {
    /// Settles the body, factors its first matrix, opens the trace. Of `options`, `threads`, `trace` and `problems` are used.
    ///
    /// # Errors
    /// As [`run`](crate::run::run), but for the device: the scene's kind of device is not looked at. A trace that cannot be
    /// made: nobody watches who could be warned.
    pub fn open(world: Arc<World>, options: &RunOptions) -> Result<(Self, Port), RunError> {
        let scene = world.description();
        let device = |e: palpate_haptics::SetupError| RunError::Device(e.to_string());
        let place = Place::new(&scene.device.place()).map_err(device)?;
        let spec = crate::devices::spec(&scene.device, None).map_err(device)?;
        let shared = Arc::new(Shared {
            phase: AtomicU8::new(Phase::Ready as u8),
            paused: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            has_port: AtomicBool::new(true),
            start: OnceLock::new(),
        });
        let ledger = Ledger::new(&world);
        let (answer, set_up) = sync_channel::<SetUp>(1);
        let (starter, started) = sync_channel::<()>(1);
        let options = RunOptions { length: Length::Seconds(f64::INFINITY), lockstep: false, ..options.clone() };
        let runner = {
            let (world, shared, ledger) = (Arc::clone(&world), Arc::clone(&shared), ledger.clone());
            std::thread::Builder::new()
                .name("palpate-session".into())
                .spawn(move || live(&world, &options, &shared, ledger, &answer, &started))
                .map_err(|e| RunError::Threads(e.to_string()))?
        };
        match set_up.recv() {
            Ok(Ok((stage, reports, changes, shapes))) => {
                let port = Port::new(stage, spec, place, reports, Arc::clone(&shared));
                let (starter, runner, changes) = (Some(starter), Some(runner), Mutex::new(changes));
                let skins = Skins::new(&world);
                Ok((Self { world, shared, ledger, shapes, starter, runner, changes, skins }, port))
            }
            Ok(Err(error)) => Err(error),
            Err(_) => Err(RunError::Threads("the thread that sets the session up has failed".into())),
        }
    }

    /// Starts the threads; false where the session is not [`Phase::Ready`].
    pub fn start(&mut self) -> bool {
        self.starter.take().is_some_and(|starter| {
            // The port must not take the time before the first step for a missing one.
            let _ = self.shared.start.set(Instant::now());
            self.shared.enter(Phase::Running);
            starter.send(()).is_ok()
        })
    }

    /// Halts the tissue or lets it go on: the force comes down to zero within the slew limit, and comes back as a ramp.
    /// False where no threads are at work.
    pub fn pause(&self, paused: bool) -> bool {
        let live = self.phase().is_live();
        if live {
            self.shared.paused.store(paused, Ordering::Release);
        }
        live
    }

    /// Changes the body while it runs: nodes released or held, elements removed. The changed body is made on the
    /// calling thread, in some ten milliseconds per thousand nodes, while steps and ticks go on; the first step that
    /// begins afterwards takes it, or where the scene has events the first after the last of them
    /// ([`Self::changes_wait_until`]). Calls from several threads are done one after another. What happens, in words.
    ///
    /// The trace keeps what was asked for and the step that took it, and a replay does it again.
    ///
    /// # Errors
    /// A session that does not run; a scene without room for changes, or for no more of them; selections that do not fit
    /// the body as earlier changes have left it.
    pub fn change(&self, request: &ChangeRequest) -> Result<String, ChangeError> {
        if !self.phase().is_live() {
            return Err(ChangeError::NotRunning);
        }
        let mut changes = self.changes.lock().unwrap_or_else(PoisonError::into_inner);
        let made = |change: &Change| self.skins.push(change);
        changes.as_mut().ok_or(ChangeError::NoRoom)?.change(&self.world, request, made)
    }

    /// What it is doing.
    pub fn phase(&self) -> Phase {
        self.shared.phase()
    }

    /// Whether its port is still there.
    pub fn has_port(&self) -> bool {
        self.shared.has_port.load(Ordering::Acquire)
    }

    /// Counts and tails so far, at most some 50 ms old.
    pub fn statistics(&self) -> Statistics {
        self.ledger.statistics()
    }

    /// Ends the threads and the trace; the answer is `None` the second time.
    ///
    /// # Errors
    /// Threads that could not be started, or that failed.
    pub fn stop(&mut self) -> Option<Result<RunOutcome, RunError>> {
        self.shared.stop.store(true, Ordering::Release);
        // Where it was never started, the set-up thread learns so.
        self.starter = None;
        let outcome = self.runner.take()?.join();
        Some(outcome.unwrap_or_else(|_| Err(RunError::Threads("a thread of the session has failed".into()))))
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // What remains of the session has been asked for, or nobody wants it.
        let _ = self.stop();
    }
}

/// The session's own thread: sets up, waits for the start, watches until the end.
fn live(
    world: &World,
    options: &RunOptions,
    shared: &Shared,
    mut ledger: Ledger,
    answer: &SyncSender<SetUp>,
    started: &Receiver<()>,
) -> Result<RunOutcome, RunError> {
    let _failed = FailedUnlessEnded(shared);
    let set_up = || -> Result<_, RunError> {
        let pool = workers(options.threads)?;
        // Made inside the pool: the workspace of the assembly is laid out for its number of threads.
        let engine = pool.install(|| {
            let spec = crate::devices::spec(&world.description().device, None);
            let spec = spec.map_err(|e| RunError::Device(e.to_string()))?;
            let config = TickStage::config(world, &spec);
            Engine::with_tick(world, options, &spec, world.first_tool(), NoTrace::Refused, |ends| {
                TickStage::new(world, &config, &spec, ends.snapshots, ends.poses, ends.line)
            })
        })?;
        Ok((pool, engine))
    };
    let (pool, engine) = match set_up() {
        Ok(parts) => parts,
        Err(error) => {
            // Who waits for the answer has the error; the thread's own result is not asked for.
            let told = RunError::Threads(error.to_string());
            let _ = answer.send(Err(error));
            return Err(told);
        }
    };
    let (stage, mut engine) = engine.split();
    let changes = engine.changes.take();
    let shapes = engine.show();
    let (reports, ticks) = tick_reports(world);
    // Nobody waits any more where the opener has gone.
    let _ = answer.send(Ok((stage, reports, changes, shapes)));
    let outcome = match (started.recv(), shared.start.get()) {
        (Ok(()), Some(&start)) => watch(engine, &pool, ticks, start, shared, &mut ledger),
        _ => {
            let mut gathering = Gathering::new(world);
            gathering.end = RunEnd::Interrupted;
            Ok(engine.finish(gathering, Some(0.0)))
        }
    };
    let failed = !matches!(&outcome, Ok(outcome) if outcome.summary.end != RunEnd::BodyFailed);
    shared.enter(if failed { Phase::Failed } else { Phase::Stopped });
    outcome
}

fn watch(
    engine: Engine<'_, ()>,
    pool: &rayon::ThreadPool,
    told: Ring<TickReport>,
    start: Instant,
    shared: &Shared,
    ledger: &mut Ledger,
) -> Result<RunOutcome, RunError> {
    let switches = Switches { stop: &shared.stop, paused: &shared.paused };
    let ticks = Ticks { thread: TickThread::Elsewhere, told };
    attend(engine, pool, ticks, start, f64::INFINITY, switches, ledger)
}
