//! The factor stage (10 Hz): takes the latest system matrix, refactors it into kept memory, hands the factor over.
//!
//! Matrices and factors go round in triple buffers, so nothing is allocated or freed while a run lasts, and the step
//! never waits: it uses the latest good factor, however old.
//!
//! A matrix is asked for at the factor rate. Where the step finds that the factor has aged faster than that, it urges:
//! the matrix of that step is taken at once, unless a factor is being made already.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::Thread;
use std::time::Instant;

use nalgebra::{Vector3, Vector6};
use palpate_fem::assembly::assemble;
use palpate_fem::factor::{Factor, FactorStatus, NodalCompliance};
use palpate_fem::model::FemState;
use palpate_fem::sparse::SystemMatrix;
use palpate_haptics::exchange::{Reader, Writer, latest};

pub use crate::refresh_report::RefreshReport;
use crate::run::RunError;
use crate::step::StepWorkspace;
use crate::world::World;

/// A system matrix on its way to the factor stage.
#[derive(Clone)]
pub struct MatrixSample {
    /// Step that assembled it.
    pub step: u64,
    /// Time of that step (s).
    pub time: f64,
    /// Configuration of all nodes that it belongs to (m).
    pub q: Vec<Vector3<f64>>,
    /// What its viscous tissue remembered, as [`FemState::memory`]; kept where the body may change.
    pub(crate) memory: Vec<Vector6<f64>>,
    /// Free nodes whose half solves the next steps are expected to want.
    pub(crate) nodes: Vec<u32>,
    /// The matrix `A` (kg).
    pub system: SystemMatrix,
}

/// A factor on its way to the step.
#[derive(Clone)]
pub struct FactorSample {
    /// Counts the factors handed over; the one made at set-up is 0.
    pub epoch: u64,
    /// Step whose matrix it factors.
    pub step: u64,
    /// Time of that step (s).
    pub time: f64,
    /// Configuration of all nodes that it belongs to (m).
    pub q: Vec<Vector3<f64>>,
    /// What its viscous tissue remembered, as [`FemState::memory`]; kept where the body may change.
    pub(crate) memory: Vec<Vector6<f64>>,
    /// Events before the step that made it anew where no factor stage does; 0 where none has.
    pub(crate) renewed: usize,
    /// `A = Pᵀ L Lᵀ P`, with a copy in 16 bits as the preconditioner of later steps.
    pub factor: Factor,
    /// Half solves with it, where there is a factor stage to make them.
    pub(crate) prepared: Option<Box<NodalCompliance>>,
}

impl FactorSample {
    /// Factors the matrix of a step at `time` (s) and configuration `q` (m) into memory of its own, in the precision of the
    /// plan.
    ///
    /// # Errors
    /// The status of the factorisation where it fails.
    pub fn new(
        world: &World,
        epoch: u64,
        step: u64,
        time: f64,
        q: &[Vector3<f64>],
        system: &SystemMatrix,
    ) -> Result<Self, FactorStatus> {
        let symbolic = Arc::clone(world.symbolic());
        let mut factor = Factor::with_packed_copy(symbolic).computed_in(world.plan().precision);
        let status = factor.refactor(system).status;
        let (q, memory, renewed, prepared) = (q.into(), Vec::new(), 0, None);
        let sample = Self { epoch, step, time, q, memory, renewed, factor, prepared };
        if status == FactorStatus::Ok { Ok(sample) } else { Err(status) }
    }

    /// Nodes that it has room to solve for.
    pub(crate) fn room_for_nodes(&self) -> usize {
        self.prepared.as_ref().map_or(0, |prepared| prepared.capacity())
    }

    /// Solves for the nodes that the next steps are expected to want, where there is room for that.
    pub(crate) fn prepare(&mut self, nodes: &[u32]) {
        if let Some(prepared) = &mut self.prepared {
            prepared.prepare(&self.factor, nodes);
        }
    }

    /// Keeps what the tissue remembered at the factor's configuration.
    pub(crate) fn remember(&mut self, memory: &[Vector6<f64>]) {
        self.memory.clear();
        self.memory.extend_from_slice(memory);
    }

    /// The factor that exists before the first step, of the matrix of the settled body, and what is precomputed from it.
    pub(crate) fn first(world: &World, rest: &FemState, ws: &mut StepWorkspace) -> Result<Self, RunError> {
        assemble(world.model(), rest, world.dt(), &[], &mut ws.fem);
        let mut first = Self::new(world, 0, 0, 0.0, &rest.q, &ws.fem.system)
            .map_err(|status| RunError::Factorization { status: format!("{status:?}") })?;
        if world.changes_ever() {
            first.remember(&rest.memory);
        }
        ws.precompute(world, &first);
        first.prepared = ws.room_for_prepared(world);
        Ok(first)
    }
}

/// What both sides see.
#[derive(Default)]
struct Signals {
    /// The factor stage waits for a matrix.
    wanted: AtomicBool,
    /// A matrix is asked for, on its way or being factored.
    busy: AtomicBool,
    /// The step has urged.
    urged: AtomicBool,
    /// The thread to wake, where there is one.
    thread: OnceLock<Thread>,
}

/// The step's side: offers matrices when they are wanted, reads factors.
pub struct RefreshPort {
    link: Link,
    /// Whether the memory of viscous tissue goes along.
    remembers: bool,
}

enum Link {
    /// To a factor stage.
    Stage { matrices: Writer<MatrixSample>, factors: Reader<FactorSample>, signals: Arc<Signals> },
    /// The first factor serves the whole run.
    Fixed(Box<FactorSample>),
}

/// The factor stage itself.
pub struct Refresh {
    matrices: Reader<MatrixSample>,
    factors: Writer<FactorSample>,
    signals: Arc<Signals>,
    epoch: u64,
    /// Epoch after which the next refresh panics.
    #[cfg(test)]
    last: Option<u64>,
}

/// Both sides, with the first factor and the matrix that it is of already in place.
pub fn refresh(first: &FactorSample, system: &SystemMatrix) -> (RefreshPort, Refresh) {
    let matrix = MatrixSample {
        step: first.step,
        time: first.time,
        q: first.q.clone(),
        memory: first.memory.clone(),
        // Clones keep what is in them, not what there is room for.
        nodes: vec![0; first.room_for_nodes()],
        system: system.clone(),
    };
    let (matrix_writer, matrix_reader) = latest(&matrix);
    let (factor_writer, factor_reader) = latest(first);
    let signals = Arc::new(Signals::default());
    let link = Link::Stage { matrices: matrix_writer, factors: factor_reader, signals: Arc::clone(&signals) };
    (
        RefreshPort { link, remembers: !first.memory.is_empty() },
        Refresh {
            matrices: matrix_reader,
            factors: factor_writer,
            signals,
            epoch: first.epoch,
            #[cfg(test)]
            last: None,
        },
    )
}

impl RefreshPort {
    /// A port without a factor stage: the first factor stays.
    pub fn fixed(first: FactorSample) -> Self {
        Self { link: Link::Fixed(Box::new(first)), remembers: false }
    }

    /// The latest factor; what is done to it lasts until a newer one is there.
    pub fn factor(&mut self) -> &mut FactorSample {
        match &mut self.link {
            Link::Stage { factors, .. } => factors.latest_mut(),
            Link::Fixed(first) => first,
        }
    }

    /// Hands the matrix of a step over if the factor stage waits for one; copies it only then. The factor will come with half
    /// solves of the free `nodes`, as far as there is room for them.
    pub fn offer(&mut self, step: u64, time: f64, at: &FemState, system: &SystemMatrix, nodes: &[u32]) {
        let Link::Stage { matrices, signals, .. } = &mut self.link else { return };
        if !signals.wanted.swap(false, Ordering::AcqRel) {
            return;
        }
        let sample = matrices.value_mut();
        (sample.step, sample.time) = (step, time);
        sample.q.copy_from_slice(&at.q);
        // A body that has lost elements remembers less than the whole one, for which there is room.
        if self.remembers {
            sample.memory.clear();
            sample.memory.extend_from_slice(&at.memory);
        }
        sample.nodes.clear();
        sample.nodes.extend(nodes.iter().take(sample.nodes.capacity()));
        sample.system.blocks.copy_from_slice(&system.blocks);
        matrices.publish();
    }

    /// As [`Self::offer`], before the factor stage asks, and wakes its thread. False where it is at work already.
    pub fn urge(&mut self, step: u64, time: f64, at: &FemState, system: &SystemMatrix, nodes: &[u32]) -> bool {
        let Link::Stage { signals, .. } = &self.link else { return false };
        let signals = Arc::clone(signals);
        if signals.busy.swap(true, Ordering::AcqRel) {
            return false;
        }
        signals.wanted.store(true, Ordering::Release);
        self.offer(step, time, at, system, nodes);
        signals.urged.store(true, Ordering::Release);
        if let Some(thread) = signals.thread.get() {
            thread.unpark();
        }
        true
    }
}

impl Refresh {
    /// Asks the step for its next matrix, unless one is on its way.
    pub fn want(&self) {
        if !self.signals.busy.swap(true, Ordering::AcqRel) {
            self.signals.wanted.store(true, Ordering::Release);
        }
    }

    /// Lets the step wake the calling thread, which waits by [`std::thread::park_timeout`].
    pub(crate) fn wake_here(&self) {
        // A second thread would be a second run, which has signals of its own.
        let _ = self.signals.thread.set(std::thread::current());
    }

    /// Lets the thread die in the refresh after that of this epoch.
    #[cfg(test)]
    pub(crate) fn die_after(&mut self, epoch: u64) {
        self.last = Some(epoch);
    }

    /// Whether the step has urged since the last refresh.
    pub(crate) fn is_urged(&self) -> bool {
        self.signals.urged.load(Ordering::Acquire)
    }

    /// Factors the matrix that was asked for, if it has arrived, and hands the factor over if it is good.
    /// `now` answers the time (s) when it is done.
    pub fn refresh(&mut self, now: impl FnOnce() -> f64) -> Option<RefreshReport> {
        if !self.matrices.refresh() {
            return None;
        }
        let early = self.signals.urged.swap(false, Ordering::AcqRel);
        let sample = self.matrices.current();
        let start = Instant::now();
        let epoch = self.epoch + 1;
        let slot = self.factors.value_mut();
        let status = slot.factor.refactor(&sample.system).status;
        #[cfg(test)]
        assert!(self.last != Some(self.epoch), "the factor thread was to die");
        if status == FactorStatus::Ok {
            (slot.epoch, slot.step, slot.time) = (epoch, sample.step, sample.time);
            slot.q.copy_from_slice(&sample.q);
            slot.remember(&sample.memory);
            slot.prepare(&sample.nodes);
            self.factors.publish();
            self.epoch = epoch;
        }
        let work = start.elapsed().as_secs_f64();
        let (step, time) = (sample.step, sample.time);
        self.signals.busy.store(false, Ordering::Release);
        Some(RefreshReport { epoch, step, time, handed_over: now(), work, early, status })
    }
}
