//! The three stages of a run and what lies between them: made once, then moved to threads or driven in lockstep.

use std::time::Instant;

use palpate_collision::ToolPose;
use palpate_haptics::device::DeviceSpec;
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::snapshot::HapticSnapshot;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::changes::ChangeQueue;
use crate::factor_thread::FactorThreadDeath;
use crate::gathering::Gathering;
use crate::problem_files::ProblemFiles;
use crate::record::{FactorLine, NoTrace, StepLine, TickLine, TraceLines};
use crate::refresh::{FactorSample, Refresh, RefreshPort, refresh};
use crate::refresh_watch::RefreshWatch;
use crate::run::{MOST_THREADS, RunError, RunOptions, RunOutcome};
use crate::scene::{Staleness, staleness};
use crate::session::{Shape, ShapeWriter};
use crate::step::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, pass_events, step};
use crate::summary::RigidEnd;
use crate::tick::Ticker;
use crate::world::{Change, World};

/// All stages of a run. `T` is the tick: with its device, or () where it has been split off.
pub(crate) struct Engine<'w, T = Ticker> {
    pub(crate) world: &'w World,
    pub(crate) stage: StepStage<'w>,
    /// None where the plan starts no factor stage.
    pub(crate) refresh: Option<Refresh>,
    pub(crate) refresh_trace: FactorLine,
    pub(crate) ticker: T,
    pub(crate) trace: Option<TraceLines>,
    pub(crate) notes: Vec<String>,
    /// Where changes come in from outside; taken by whoever may ask for them.
    pub(crate) changes: Option<ChangeQueue>,
}

/// What the tick reads and writes: snapshots, tool poses, the trace.
pub(crate) struct TickEnds {
    pub(crate) snapshots: Reader<HapticSnapshot>,
    pub(crate) poses: Writer<ToolPose>,
    pub(crate) line: TickLine,
}

impl<'w> Engine<'w> {
    /// Takes the body as it begins, factors its first matrix, opens device and trace.
    pub(crate) fn new(world: &'w World, options: &RunOptions) -> Result<Self, RunError> {
        let mut device = crate::devices::device(world.scene())?;
        let spec = device.spec().clone();
        let scene = &world.description().device;
        // A record that the scene states is what counts.
        let note = device.note().filter(|_| scene.record.is_none() && scene.preset.is_none()).map(String::from);
        let warning = device.warning().map(String::from);
        let first = crate::devices::first_pose(world, device.as_mut());
        let mut engine = Self::with_tick(world, options, &spec, first, NoTrace::GoesOn, |ends| {
            Ticker::new(world, device, ends.snapshots, ends.poses, ends.line)
        })?;
        engine.notes.extend(warning.into_iter().chain(note));
        Ok(engine)
    }
}

impl<'w, T> Engine<'w, T> {
    /// Takes the body as it begins, factors its first matrix, opens the trace; `make` makes the tick on a device of
    /// this record. The first step has the tool at `first`.
    pub(crate) fn with_tick(
        world: &'w World,
        options: &RunOptions,
        device: &DeviceSpec,
        first: ToolPose,
        no_trace: NoTrace,
        make: impl FnOnce(TickEnds) -> Result<T, RunError>,
    ) -> Result<Self, RunError> {
        if let Some((Staleness::Gone, sentence)) = staleness(world.description()) {
            return Err(RunError::Rates(sentence));
        }
        let mut notes = Vec::new();
        let (rest, settled) = (world.start().clone(), world.settled());
        if let Some(report) = settled.filter(|report| !report.is_converged()) {
            let share = 100.0 * report.reached;
            notes.push(format!("the body did not settle under gravity; it begins at rest under {share:.1} % of it"));
        }
        let mut ws = StepWorkspace::new(world);
        let factor = FactorSample::first(world, &rest, &mut ws)?;
        let room = factor.room_for_nodes();
        let (port, refresh) = if world.plan().has_factor_thread() {
            let (port, refresh) = refresh(&factor, &ws.fem.system);
            (port, Some(refresh))
        } else {
            (RefreshPort::fixed(factor), None)
        };
        let mut changes = (world.changes_from_outside() > 0).then(|| ChangeQueue::new(world, &mut ws));
        let (pose_writer, poses) = latest(&first);
        let (snapshots, snapshot_reader) = latest(&world.empty_snapshot());
        let (line, tick_line, refresh_trace, trace) = TraceLines::open(world, options, device, no_trace, &mut notes)?;
        if let (Some(changes), Some(trace)) = (&mut changes, &trace) {
            changes.trace(trace.metadata());
        }
        let ticker = make(TickEnds { snapshots: snapshot_reader, poses: pose_writer, line: tick_line })?;
        let state = StepState::new(world, rest);
        ws.problem_files = options.problems.clone().map(ProblemFiles::new);
        let (watch, nodes) = (RefreshWatch::new(world.plan()), Vec::with_capacity(room));
        let stage =
            StepStage { world, state, ws, port, watch, urged: false, nodes, snapshots, poses, line, shape: None };
        Ok(Self { world, stage, refresh, refresh_trace, ticker, trace, notes, changes })
    }

    /// The tick, and all the rest.
    pub(crate) fn split(self) -> (T, Engine<'w, ()>) {
        let Self { world, stage, refresh, refresh_trace, ticker, trace, notes, changes } = self;
        (ticker, Engine { world, stage, refresh, refresh_trace, ticker: (), trace, notes, changes })
    }

    /// Lets somebody see where the bodies are.
    pub(crate) fn show(&mut self) -> Reader<Shape> {
        let (writer, reader) = ShapeWriter::new(self.world, &self.stage.state);
        self.stage.shape = Some(writer);
        reader
    }

    /// In lockstep, writes the records that wait for the trace.
    pub(crate) fn drain(&mut self) {
        if let Some(trace) = &mut self.trace {
            trace.drain();
        }
    }

    /// Ends the trace and sums the run up. `wall` is the time it took in real time (s).
    pub(crate) fn finish(self, mut gathering: Gathering, wall: Option<f64>) -> RunOutcome {
        gathering.notes.splice(0..0, self.notes);
        gathering.notes.extend(gathering.device_note());
        gathering.notes.extend(gathering.factor_thread_death.as_ref().map(FactorThreadDeath::note));
        gathering.notes.extend(gathering.unconverged.notes(self.world));
        gathering.notes.extend(self.stage.ws.problem_files.as_ref().map(ProblemFiles::note));
        let state = &self.stage.state;
        gathering.name_changes(state.outside().map(Change::text));
        let trace = self.trace.map(|trace| trace.finish(&gathering));
        let mut summary = gathering.summary(self.world, wall, trace);
        summary.rigid_bodies = RigidEnd::all(self.world, &self.stage.state.rigid);
        RunOutcome { summary, phase: self.stage.state.phase(), state: self.stage.state.fem }
    }
}

/// The worker threads of the step.
pub(crate) fn workers(threads: Option<usize>) -> Result<ThreadPool, RunError> {
    if let Some(given) = threads.filter(|n| !(1..=MOST_THREADS).contains(n)) {
        return Err(RunError::Threads(format!("{given} worker threads are outside 1 to {MOST_THREADS}")));
    }
    ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .thread_name(|k| format!("palpate-worker-{k}"))
        .build()
        .map_err(|e| RunError::Threads(e.to_string()))
}

/// Publishes a rest after `steps` steps. It has the number of the last one, 0 before the first; that it is not valid tells
/// the two apart, in a trace too.
pub(crate) fn publish_rest(snapshots: &mut Writer<HapticSnapshot>, steps: u64) {
    let snapshot = snapshots.value_mut();
    snapshot.clear();
    snapshot.step = steps;
    snapshots.publish();
}

/// The step with everything that it reads and writes.
pub(crate) struct StepStage<'w> {
    world: &'w World,
    state: StepState,
    ws: StepWorkspace,
    port: RefreshPort,
    watch: RefreshWatch,
    urged: bool,
    /// Free nodes whose half solves the next steps are expected to want.
    nodes: Vec<u32>,
    snapshots: Writer<HapticSnapshot>,
    poses: Reader<ToolPose>,
    line: StepLine,
    /// Who wants to draw.
    shape: Option<ShapeWriter>,
}

impl StepStage<'_> {
    /// One step at `time` (s): latest pose and factor in, snapshot and (where wanted) matrix out.
    pub(crate) fn advance(&mut self, time: f64) -> StepReport {
        let factor = self.port.factor();
        pass_events(self.world, time, factor, &mut self.state, &mut self.ws);
        let input = StepInput { time, tool: *self.poses.latest(), factor };
        let report = step(self.world, &input, &mut self.state, &mut self.ws, self.snapshots.value_mut());
        self.snapshots.publish();
        if let Some(shape) = &mut self.shape {
            shape.send(self.world, &self.state, time + self.world.dt());
        }
        self.urged = false;
        if report.status == StepStatus::Advanced {
            self.ws.latest_nodes(&mut self.nodes);
            let (before, system, nodes) = (self.state.state_before(), &self.ws.fem.system, &self.nodes);
            self.port.offer(report.step, time, before, system, nodes);
            self.urged = self.watch.is_too_old(&report) && self.port.urge(report.step, time, before, system, nodes);
        }
        report
    }

    /// When the next step is due, which the step after this call is to be done by as far as that is its choice.
    pub(crate) fn end_by(&mut self, end: Instant) {
        self.ws.end_by(end);
    }

    /// Hands the tick a snapshot without contacts that is marked as not valid: the force comes down to zero at the rate
    /// that the limits allow, and its return is a ramp.
    pub(crate) fn rest(&mut self) {
        publish_rest(&mut self.snapshots, self.state.step);
    }

    /// Whether the tick has told a pose since the last step.
    pub(crate) fn has_pose(&self) -> bool {
        self.poses.has_new()
    }

    /// Whether the last step has urged the factor stage, which has its matrix then.
    pub(crate) fn has_urged(&self) -> bool {
        self.urged
    }

    /// Makes the next step fail.
    #[cfg(test)]
    pub(crate) fn spoil(&mut self) {
        self.state.fem.v.fill(nalgebra::Vector3::repeat(f64::NAN));
    }

    /// Hands the report and the new shape to the trace; `keep_times` is false in lockstep, where wall times would make
    /// equal runs unequal.
    pub(crate) fn trace(&mut self, report: &StepReport, keep_times: bool) {
        self.line.push(report, self.world, &self.state, keep_times);
    }
}
