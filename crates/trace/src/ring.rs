//! What the producing threads hold: rings that take a record or drop and count it, in bounded time, without
//! allocation, lock or system call.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rtrb::{Consumer, Producer, RingBuffer};

use crate::config::TraceConfig;
use crate::record::{FactorRecord, LogRecord, RigidRecord, StepRecord, TickRecord};
use crate::summary::Dropped;

/// Counters of dropped records, shared by the producers and the trace.
#[derive(Debug, Default)]
pub(crate) struct DropCounters {
    ticks: AtomicU64,
    steps: AtomicU64,
    rigid: AtomicU64,
    factors: AtomicU64,
    log: AtomicU64,
    geometry: AtomicU64,
}

impl DropCounters {
    pub(crate) fn read(&self) -> Dropped {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Dropped {
            ticks: read(&self.ticks),
            steps: read(&self.steps),
            rigid: read(&self.rigid),
            factors: read(&self.factors),
            log: read(&self.log),
            geometry: read(&self.geometry),
        }
    }
}

/// Pushes or drops and counts; whether the record was taken.
fn push<T>(ring: &mut Producer<T>, record: T, dropped: &AtomicU64) -> bool {
    let taken = ring.push(record).is_ok();
    if !taken {
        dropped.fetch_add(1, Ordering::Relaxed);
    }
    taken
}

/// Node positions on their way to the trace.
#[derive(Debug)]
pub(crate) struct GeometryFrame {
    pub(crate) time_ns: u64,
    pub(crate) positions: Vec<f64>,
    /// The skin of the first body from this frame on, where it has changed.
    pub(crate) skin: Option<Skin>,
}

/// Triangles of a body's skin, by node of the body, shared with whoever drew them.
pub type Skin = Arc<[[u32; 3]]>;

/// What became of positions that were offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// They are on their way into the trace.
    Taken,
    /// It was not their turn.
    NotDue,
    /// No buffer was free; they were dropped and counted.
    Dropped,
}

/// The tick thread's end.
#[derive(Debug)]
pub struct TickTrace {
    ring: Producer<TickRecord>,
    dropped: Arc<DropCounters>,
}

impl TickTrace {
    /// Hands over a record; `false` when the ring was full and the record was dropped and counted. Wait-free.
    pub fn push(&mut self, record: TickRecord) -> bool {
        push(&mut self.ring, record, &self.dropped.ticks)
    }
}

/// The factor thread's end.
#[derive(Debug)]
pub struct FactorTrace {
    ring: Producer<FactorRecord>,
    dropped: Arc<DropCounters>,
}

impl FactorTrace {
    /// Hands over a record; `false` when the ring was full and the record was dropped and counted. Wait-free.
    pub fn push(&mut self, record: FactorRecord) -> bool {
        push(&mut self.ring, record, &self.dropped.factors)
    }
}

/// The step thread's end.
#[derive(Debug)]
pub struct StepTrace {
    ring: Producer<StepRecord>,
    rigid: Producer<RigidRecord>,
    log: Producer<LogRecord>,
    geometry: Producer<GeometryFrame>,
    free: Consumer<GeometryFrame>,
    geometry_stride: u64,
    offered: u64,
    has_bodies: bool,
    dropped: Arc<DropCounters>,
}

impl StepTrace {
    /// Hands over a record; `false` when the ring was full and the record was dropped and counted. Wait-free.
    pub fn push(&mut self, record: StepRecord) -> bool {
        push(&mut self.ring, record, &self.dropped.steps)
    }

    /// Hands over where a rigid body is; `false` when it was dropped and counted. Wait-free.
    pub fn push_rigid(&mut self, record: RigidRecord) -> bool {
        push(&mut self.rigid, record, &self.dropped.rigid)
    }

    /// Hands over a line of the log; `false` when it was dropped and counted. Wait-free.
    pub fn log(&mut self, record: LogRecord) -> bool {
        push(&mut self.log, record, &self.dropped.log)
    }

    /// Offers the positions of the nodes; call it once a step. Every `geometry_stride`-th offer is taken: `fill` then
    /// gets the buffer to write, `x, y, z` (m) of each node in the order of `TraceConfig::bodies`; it holds older
    /// positions.
    ///
    /// `skin` is the skin of the first body, where a cut has changed it since the last frame that was taken; give it until
    /// one is taken, which the answer tells: [`Offer::Taken`].
    ///
    /// The buffers were allocated at set-up and go round; none is allocated or freed here.
    pub fn push_positions(&mut self, time_ns: u64, skin: Option<&Skin>, fill: impl FnOnce(&mut [f64])) -> Offer {
        let due = self.has_bodies && self.offered.is_multiple_of(self.geometry_stride);
        self.offered += 1;
        if !due {
            return Offer::NotDue;
        }
        let Ok(mut frame) = self.free.pop() else {
            self.dropped.geometry.fetch_add(1, Ordering::Relaxed);
            return Offer::Dropped;
        };
        frame.time_ns = time_ns;
        frame.skin = skin.cloned();
        fill(&mut frame.positions);
        // There are as many places as buffers, so this one always finds its place.
        if push(&mut self.geometry, frame, &self.dropped.geometry) { Offer::Taken } else { Offer::Dropped }
    }
}

/// The trace's ends of all rings.
pub(crate) struct Rings {
    pub(crate) ticks: Consumer<TickRecord>,
    pub(crate) steps: Consumer<StepRecord>,
    pub(crate) rigid: Consumer<RigidRecord>,
    pub(crate) factors: Consumer<FactorRecord>,
    pub(crate) step_log: Consumer<LogRecord>,
    pub(crate) log: Consumer<LogRecord>,
    pub(crate) geometry: Consumer<GeometryFrame>,
    pub(crate) free: Producer<GeometryFrame>,
    pub(crate) dropped: Arc<DropCounters>,
}

/// The end of whoever owns the trace: its log.
#[derive(Debug)]
pub(crate) struct LogTrace {
    ring: Producer<LogRecord>,
    dropped: Arc<DropCounters>,
}

impl LogTrace {
    pub(crate) fn push(&mut self, record: LogRecord) -> bool {
        push(&mut self.ring, record, &self.dropped.log)
    }
}

/// All producing ends.
pub(crate) struct Producers {
    pub(crate) tick: TickTrace,
    pub(crate) step: StepTrace,
    pub(crate) factor: FactorTrace,
    pub(crate) log: LogTrace,
}

/// Allocates the rings and buffers that `config` asks for.
pub(crate) fn rings(config: &TraceConfig) -> (Rings, Producers) {
    let dropped = Arc::new(DropCounters::default());
    let (tick, ticks) = RingBuffer::new(config.tick_capacity);
    let (step, steps) = RingBuffer::new(config.step_capacity);
    let (rigid, rigid_out) = RingBuffer::new(config.step_capacity * config.rigid_count());
    let (factor, factors) = RingBuffer::new(config.factor_capacity);
    let (step_log, step_log_out) = RingBuffer::new(config.log_capacity);
    let (log, log_out) = RingBuffer::new(config.log_capacity);
    let (geometry, geometry_out) = RingBuffer::new(config.geometry_buffers);
    let (mut free, free_out) = RingBuffer::new(config.geometry_buffers);
    let has_bodies = config.node_count() > 0;
    for _ in 0..config.geometry_buffers {
        let frame = GeometryFrame { time_ns: 0, positions: vec![0.0; 3 * config.node_count()], skin: None };
        // As many places as buffers.
        let _ = free.push(frame);
    }
    let shared = || Arc::clone(&dropped);
    let producers = Producers {
        tick: TickTrace { ring: tick, dropped: shared() },
        step: StepTrace {
            ring: step,
            rigid,
            log: step_log,
            geometry,
            free: free_out,
            geometry_stride: config.geometry_stride,
            offered: 0,
            has_bodies,
            dropped: shared(),
        },
        factor: FactorTrace { ring: factor, dropped: shared() },
        log: LogTrace { ring: log, dropped: shared() },
    };
    let rings = Rings {
        ticks,
        steps,
        rigid: rigid_out,
        factors,
        step_log: step_log_out,
        log: log_out,
        geometry: geometry_out,
        free,
        dropped,
    };
    (rings, producers)
}
