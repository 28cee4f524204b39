//! The factor stage (10 Hz): takes the latest system matrix, refactors it into kept memory, hands the factor over.
//!
//! Matrices and factors go round in triple buffers, so nothing is allocated or freed while a run lasts, and the step
//! never waits: it uses the latest good factor, however old.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use nalgebra::Vector3;
use palpate_fem::assembly::assemble;
use palpate_fem::factor::{Factor, FactorStatus, SymbolicFactor};
use palpate_fem::model::FemState;
use palpate_fem::sparse::SystemMatrix;
use palpate_haptics::exchange::{Reader, Writer, latest};

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
    /// `A = Pᵀ L Lᵀ P`.
    pub factor: Factor,
}

impl FactorSample {
    /// Factors the matrix of a step at `time` (s) and configuration `q` (m) into memory of its own.
    ///
    /// # Errors
    /// The status of the factorisation where it fails.
    pub fn new(
        symbolic: &Arc<SymbolicFactor>,
        epoch: u64,
        step: u64,
        time: f64,
        q: &[Vector3<f64>],
        system: &SystemMatrix,
    ) -> Result<Self, FactorStatus> {
        let mut factor = Factor::new(Arc::clone(symbolic));
        match factor.refactor(system).status {
            FactorStatus::Ok => Ok(Self { epoch, step, time, q: q.into(), factor }),
            status => Err(status),
        }
    }

    /// The factor that exists before the first step, of the matrix of the settled body.
    pub(crate) fn first(world: &World, rest: &FemState, ws: &mut StepWorkspace) -> Result<Self, RunError> {
        assemble(world.model(), rest, world.dt(), &[], &mut ws.fem);
        Self::new(world.symbolic(), 0, 0, 0.0, &rest.q, &ws.fem.system)
            .map_err(|status| RunError::Factorization { status: format!("{status:?}") })
    }
}

/// What one refresh did.
#[derive(Clone, Copy, Debug)]
pub struct RefreshReport {
    /// Epoch of the factor that was made, or would have been.
    pub epoch: u64,
    /// Step whose matrix was taken.
    pub step: u64,
    /// Time of that step (s).
    pub time: f64,
    /// Time at which the factor was handed over (s).
    pub handed_over: f64,
    /// Work (s).
    pub work: f64,
    /// Whether the matrix could be factored; if not, the last good factor stays in use.
    pub status: FactorStatus,
}

impl RefreshReport {
    /// True where there is a new factor.
    pub fn is_ok(&self) -> bool {
        self.status == FactorStatus::Ok
    }
}

/// The step's side: offers matrices when they are wanted, reads factors.
pub struct RefreshPort {
    matrices: Writer<MatrixSample>,
    factors: Reader<FactorSample>,
    wanted: Arc<AtomicBool>,
}

/// The factor stage itself.
pub struct Refresh {
    matrices: Reader<MatrixSample>,
    factors: Writer<FactorSample>,
    wanted: Arc<AtomicBool>,
    epoch: u64,
}

/// Both sides, with the first factor and the matrix that it is of already in place.
pub fn refresh(first: &FactorSample, system: &SystemMatrix) -> (RefreshPort, Refresh) {
    let matrix = MatrixSample { step: first.step, time: first.time, q: first.q.clone(), system: system.clone() };
    let (matrix_writer, matrix_reader) = latest(&matrix);
    let (factor_writer, factor_reader) = latest(first);
    let wanted = Arc::new(AtomicBool::new(false));
    let port = RefreshPort { matrices: matrix_writer, factors: factor_reader, wanted: Arc::clone(&wanted) };
    (port, Refresh { matrices: matrix_reader, factors: factor_writer, wanted, epoch: first.epoch })
}

impl RefreshPort {
    /// The latest factor.
    pub fn factor(&mut self) -> &FactorSample {
        self.factors.latest()
    }

    /// Hands a matrix over if the factor stage waits for one; copies it only then.
    pub fn offer(&mut self, step: u64, time: f64, q: &[Vector3<f64>], system: &SystemMatrix) {
        if !self.wanted.swap(false, Ordering::AcqRel) {
            return;
        }
        let sample = self.matrices.value_mut();
        (sample.step, sample.time) = (step, time);
        sample.q.copy_from_slice(q);
        sample.system.blocks.copy_from_slice(&system.blocks);
        self.matrices.publish();
    }
}

impl Refresh {
    /// Asks the step for its next matrix.
    pub fn want(&self) {
        self.wanted.store(true, Ordering::Release);
    }

    /// Factors the matrix that was asked for, if it has arrived, and hands the factor over if it is good.
    /// `now` answers the time (s) when it is done.
    pub fn refresh(&mut self, now: impl FnOnce() -> f64) -> Option<RefreshReport> {
        if !self.matrices.refresh() {
            return None;
        }
        let sample = self.matrices.current();
        let start = Instant::now();
        let epoch = self.epoch + 1;
        let slot = self.factors.value_mut();
        let status = slot.factor.refactor(&sample.system).status;
        if status == FactorStatus::Ok {
            (slot.epoch, slot.step, slot.time) = (epoch, sample.step, sample.time);
            slot.q.copy_from_slice(&sample.q);
            self.factors.publish();
            self.epoch = epoch;
        }
        let work = start.elapsed().as_secs_f64();
        let handed_over = now();
        Some(RefreshReport { epoch, step: sample.step, time: sample.time, handed_over, work, status })
    }
}
