//! The three stages of a run and what lies between them: made once, then moved to threads or driven in lockstep.

use nalgebra::Isometry3;
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::snapshot::HapticSnapshot;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::gathering::Gathering;
use crate::problem_files::ProblemFiles;
use crate::record::{FactorLine, StepLine, TraceLines};
use crate::refresh::{FactorSample, Refresh, RefreshPort, RefreshWatch, refresh};
use crate::run::{RunError, RunOptions, RunOutcome};
use crate::settle::settle;
use crate::step::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, step};
use crate::tick::Ticker;
use crate::world::World;

/// All stages of a run.
pub(crate) struct Engine<'w> {
    pub(crate) world: &'w World,
    pub(crate) stage: StepStage<'w>,
    /// None where the plan starts no factor stage.
    pub(crate) refresh: Option<Refresh>,
    pub(crate) refresh_trace: FactorLine,
    pub(crate) ticker: Ticker,
    pub(crate) trace: Option<TraceLines>,
    pub(crate) notes: Vec<String>,
}

impl<'w> Engine<'w> {
    /// Settles the body, factors its first matrix, opens device and trace.
    pub(crate) fn new(world: &'w World, options: &RunOptions) -> Result<Self, RunError> {
        let mut notes = Vec::new();
        let (rest, settled) = settle(world);
        if let Some(report) = settled.filter(|report| !report.is_converged()) {
            let share = 100.0 * report.reached;
            notes.push(format!("the body did not settle under gravity; it begins at rest under {share:.1} % of it"));
        }
        let mut ws = StepWorkspace::new(world);
        let first = FactorSample::first(world, &rest, &mut ws)?;
        let (port, refresh) = if world.plan().has_factor_thread() {
            let (port, refresh) = refresh(&first, &ws.fem.system);
            (port, Some(refresh))
        } else {
            (RefreshPort::fixed(first), None)
        };
        let pose = world.first_pose();
        let (pose_writer, pose_reader) = latest(&pose);
        let (snapshot_writer, snapshot_reader) = latest(&world.empty_snapshot());
        let device = crate::devices::device(world.description()).map_err(|e| RunError::Device(e.to_string()))?;
        let (step_line, tick_line, refresh_trace, trace) = TraceLines::open(world, options, &mut notes)?;
        let ticker = Ticker::new(world, device, snapshot_reader, pose_writer, tick_line)?;
        let state = StepState::new(world, rest);
        let problems = options.problems.clone().map(ProblemFiles::new);
        let (snapshots, poses, line) = (snapshot_writer, pose_reader, step_line);
        let watch = RefreshWatch::new(world.plan().accuracy);
        let stage = StepStage { world, state, ws, port, watch, urged: false, snapshots, poses, line, problems };
        Ok(Self { world, stage, refresh, refresh_trace, ticker, trace, notes })
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
        gathering.notes.extend(self.stage.problems.as_ref().map(ProblemFiles::note));
        let trace = self.trace.map(|trace| trace.finish(&gathering));
        RunOutcome { summary: gathering.summary(self.world, wall, trace), state: self.stage.state.fem }
    }
}

/// The worker threads of the step.
pub(crate) fn workers(threads: Option<usize>) -> Result<ThreadPool, RunError> {
    ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .thread_name(|k| format!("palpate-worker-{k}"))
        .build()
        .map_err(|e| RunError::Threads(e.to_string()))
}

/// The step with everything that it reads and writes.
pub(crate) struct StepStage<'w> {
    world: &'w World,
    state: StepState,
    ws: StepWorkspace,
    port: RefreshPort,
    watch: RefreshWatch,
    urged: bool,
    snapshots: Writer<HapticSnapshot>,
    poses: Reader<Isometry3<f64>>,
    line: StepLine,
    problems: Option<ProblemFiles>,
}

impl StepStage<'_> {
    /// One step at `time` (s): latest pose and factor in, snapshot and (where wanted) matrix out.
    pub(crate) fn advance(&mut self, time: f64) -> StepReport {
        let input = StepInput { time, tool: *self.poses.latest(), factor: self.port.factor() };
        let report = step(self.world, &input, &mut self.state, &mut self.ws, self.snapshots.value_mut());
        self.snapshots.publish();
        if let Some(problems) = &mut self.problems {
            problems.save(&report, self.ws.problem());
        }
        self.urged = false;
        if report.status == StepStatus::Advanced {
            let (q, system) = (self.state.before(), &self.ws.fem.system);
            self.port.offer(report.step, time, q, system);
            self.urged = self.watch.is_too_old(&report) && self.port.urge(report.step, time, q, system);
        }
        report
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
        self.line.push(report, &self.state.fem, keep_times);
    }
}
