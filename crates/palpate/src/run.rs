//! Running a scene: in real time on threads, or in lockstep in virtual time.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use palpate_fem::model::FemState;

use crate::engine::{Engine, workers};
use crate::step::StepReport;
use crate::summary::RunSummary;
use crate::tick::TickReport;
use crate::world::World;

/// How long a run lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Simulated seconds.
    Seconds(f64),
    /// Steps of the tissue.
    Steps(u64),
}

impl Length {
    /// The length in seconds for a step of `dt` seconds.
    pub fn seconds(self, dt: f64) -> f64 {
        match self {
            Self::Seconds(s) => s,
            Self::Steps(n) => n as f64 * dt,
        }
    }
}

/// Most worker threads of a step: beyond it, a mistake.
pub const MOST_THREADS: usize = 1024;

/// How to run a scene.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// When to end.
    pub length: Length,
    /// Virtual time on one thread in place of real time on three: the same bits on every run.
    pub lockstep: bool,
    /// Worker threads of the step, 1 to [`MOST_THREADS`]; all cores where `None`.
    pub threads: Option<usize>,
    /// Trace to write.
    pub trace: Option<PathBuf>,
    /// Existing folder for the contact problems of all steps, one file each (see [`crate::problem_files`]). Written by the
    /// step, which is slower for it and allocates; the tick is not and does not.
    pub problems: Option<PathBuf>,
    /// Asks the system for a real-time policy for the tick thread; without it, for comparison, ordinary scheduling.
    pub real_time_priority: bool,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self {
            length: Length::Seconds(10.0),
            lockstep: false,
            threads: None,
            trace: None,
            problems: None,
            real_time_priority: true,
        }
    }
}

/// The state of a run for a progress line.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Simulated time (s).
    pub time: f64,
    /// Rates of step, factor and tick over the last second (Hz); `None` in lockstep.
    pub rates: Option<[f64; 3]>,
    /// Contacts that carry a force.
    pub contacts: usize,
    /// Force on the device (N).
    pub force: f64,
}

/// Watches a run from an ordinary thread: it may allocate, print and write files.
pub trait Observer: Send {
    /// Several times a second.
    fn progress(&mut self, _progress: &Progress) {}
    /// After every step, in order.
    fn step(&mut self, _report: &StepReport) {}
    /// After every tick, in order.
    fn tick(&mut self, _report: &TickReport) {}
}

/// An observer that watches nothing.
pub struct Unobserved;

impl Observer for Unobserved {}

/// What remains of a run.
#[derive(Debug)]
pub struct RunOutcome {
    /// Rates, tails, iterations, residuals, files.
    pub summary: RunSummary,
    /// Positions and velocities of the body at the end.
    pub state: FemState,
    /// Events that had happened by then: the body is that of [`World::phase`] of this number.
    pub phase: usize,
}

/// Why a run could not begin.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The body at rest has no positive definite system matrix.
    #[error(
        "the body cannot be simulated: its system matrix at rest cannot be factored ({status}); check densities, materials and fixed nodes"
    )]
    Factorization {
        /// What the factorisation says.
        status: String,
    },
    /// The trace cannot be written.
    #[error(transparent)]
    Trace(#[from] palpate_trace::TraceError),
    /// The device cannot be opened.
    #[error("the device cannot be opened: {0}")]
    Device(String),
    /// The scene's rates leave no force at the hand.
    #[error("{0}")]
    Rates(String),
    /// The system refuses threads.
    #[error("threads cannot be started: {0}")]
    Threads(String),
}

/// Runs a scene until its length is reached, `stop` is set, or the body fails.
///
/// # Errors
/// Only at set-up. What goes wrong later is in the summary.
pub fn run(
    world: &World,
    options: &RunOptions,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<RunOutcome, RunError> {
    let kind = &world.description().device.kind;
    if options.lockstep && !crate::devices::has_virtual_time(kind) {
        return Err(RunError::Device(format!(
            "`{kind}` moves by itself and has no virtual time: run it in real time, without lockstep"
        )));
    }
    let pool = workers(options.threads)?;
    // Made inside the pool: the workspace of the assembly is laid out for its number of threads.
    let engine = pool.install(|| Engine::new(world, options))?;
    if options.lockstep {
        crate::lockstep::run(engine, &pool, options, stop, observer)
    } else {
        crate::realtime::run(engine, &pool, options, stop, observer)
    }
}
