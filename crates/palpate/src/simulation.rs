//! A scene stepped by its caller: the tool goes where it is told, one step at a time, on the caller's thread.

use std::time::Instant;

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_fem::factor::FactorStatus;
use palpate_fem::integrator::equilibrium::EquilibriumReport;
use palpate_haptics::snapshot::HapticSnapshot;

use crate::changes::ChangeQueue;
use crate::refresh::FactorSample;
use crate::refresh_watch::RefreshWatch;
use crate::run::RunError;
use crate::step::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, pass_events, pass_next_event, step};
use crate::world::{ChangeError, ChangeRequest, World};

/// A body and a tool without device, threads and trace: for programs that bring their own loop, and for measuring.
///
/// Where the plan has a factor thread, the factor is refreshed on the caller's instead, every `refresh_every` steps, from
/// the matrix of the step before.
pub struct Simulation<'w> {
    world: &'w World,
    state: StepState,
    ws: StepWorkspace,
    pub(crate) factor: FactorSample,
    /// The memory of the next factor, or that factor where it is not ready yet.
    spare: FactorSample,
    /// When the factor in `spare` is ready (s).
    ready: Option<f64>,
    refresh_takes: f64,
    snapshot: HapticSnapshot,
    refresh_every: u64,
    settled: Option<EquilibriumReport>,
    watch: Option<RefreshWatch>,
    changes: ChangeQueue,
    /// Nodes that are solved for with each new factor.
    nodes: Vec<u32>,
}

impl<'w> Simulation<'w> {
    /// Takes the body as it begins and factors its first matrix. Call it on the thread (or in the rayon pool) that will step.
    ///
    /// # Errors
    /// A body whose first matrix is not positive definite.
    pub fn new(world: &'w World) -> Result<Self, RunError> {
        let (rest, settled) = (world.start().clone(), world.settled());
        let mut ws = StepWorkspace::new(world);
        let factor = FactorSample::first(world, &rest, &mut ws)?;
        let changes = ChangeQueue::new(world, &mut ws);
        let nodes = Vec::with_capacity(factor.room_for_nodes());
        Ok(Self {
            world,
            state: StepState::new(world, rest),
            ws,
            spare: factor.clone(),
            factor,
            ready: None,
            refresh_takes: 0.0,
            snapshot: world.empty_snapshot(),
            refresh_every: 1,
            settled: settled.copied(),
            watch: None,
            changes,
            nodes,
        })
    }

    /// How the body came to rest under its weight before the first step; `None` where it began as its mesh.
    pub fn settled(&self) -> Option<&EquilibriumReport> {
        self.settled.as_ref()
    }

    /// Refreshes the factor after every `steps` steps; 0 never refreshes it.
    #[must_use]
    pub fn refresh_every(mut self, steps: u64) -> Self {
        self.refresh_every = steps;
        self
    }

    /// Refreshes the factor also where it has aged before its turn, as a run does.
    #[must_use]
    pub fn refresh_early(mut self) -> Self {
        self.watch = Some(RefreshWatch::new(self.world.plan()));
        self
    }

    /// Hands a new factor over only when `seconds` have passed since the step whose matrix it factors, as a factor thread
    /// that takes so long does, and begins no other before; 0, at once, by default.
    #[must_use]
    pub fn refresh_takes(mut self, seconds: f64) -> Self {
        self.refresh_takes = seconds.max(0.0);
        self
    }

    /// When the next steps are to be done, for a loop in real time: see [`StepWorkspace::end_by`].
    pub fn end_by(&mut self, end: Instant) {
        self.ws.end_by(end);
    }

    /// One step with the tool at `tool`, and the refresh that is due after it.
    pub fn step(&mut self, tool: &(impl Into<ToolPose> + Clone)) -> StepReport {
        let report = self.step_alone(tool);
        self.refresh_if_due(&report);
        report
    }

    /// One step without the refresh after it: [`Self::refresh_if_due`] does that, and is to be called before the next.
    pub fn step_alone(&mut self, tool: &(impl Into<ToolPose> + Clone)) -> StepReport {
        let time = self.state.step as f64 * self.world.dt();
        self.take_over(time);
        pass_events(self.world, time, &mut self.factor, &mut self.state, &mut self.ws);
        let input = StepInput { time, tool: tool.clone().into(), factor: &self.factor };
        step(self.world, &input, &mut self.state, &mut self.ws, &mut self.snapshot)
    }

    /// Refreshes the factor where the step of this report was the last before its turn, or found it too old.
    pub fn refresh_if_due(&mut self, report: &StepReport) {
        let early = self.watch.as_mut().is_some_and(|watch| watch.is_too_old(report));
        let due = early || self.refresh_every > 0 && self.state.step.is_multiple_of(self.refresh_every);
        if due && self.world.plan().has_factor_thread() && report.status == StepStatus::Advanced {
            self.refresh(report);
        }
    }

    /// Lets the next of the scene's events happen now, whatever its time; false where all have happened.
    pub fn pass_next_event(&mut self) -> bool {
        pass_next_event(self.world, &mut self.state, &mut self.ws)
    }

    /// Changes the body from the next step on, or where the scene has events from the first after the last of them: nodes
    /// released or held, elements removed. Made at once, on this thread; what happens, in words.
    ///
    /// # Errors
    /// A scene without room for changes, or for no more; selections that do not fit the body.
    pub fn change(&mut self, request: &ChangeRequest) -> Result<String, ChangeError> {
        self.changes.change(self.world, request, |_| ())
    }

    /// Factors the matrix of the step that was just done; the old factor stays where that fails.
    fn refresh(&mut self, report: &StepReport) {
        if self.ready.is_some() || self.spare.factor.refactor(&self.ws.fem.system).status != FactorStatus::Ok {
            return;
        }
        self.spare.epoch = self.factor.epoch + 1;
        (self.spare.step, self.spare.time) = (report.step, report.time);
        self.spare.q.copy_from_slice(self.state.before());
        if self.world.changes_ever() {
            self.spare.remember(&self.state.state_before().memory);
        }
        self.ws.latest_nodes(&mut self.nodes);
        self.spare.prepare(&self.nodes);
        self.ready = Some(report.time + self.refresh_takes);
        self.take_over(report.time);
    }

    /// Puts a factor that is ready in the place of the latest.
    fn take_over(&mut self, time: f64) {
        if self.ready.take_if(|ready| *ready <= time).is_some() {
            std::mem::swap(&mut self.spare, &mut self.factor);
        }
    }

    /// The world that it simulates: after events, that of the body that they left.
    pub fn world(&self) -> &World {
        self.state.world(self.world)
    }

    /// Body, tool, remembered forces.
    pub fn state(&self) -> &StepState {
        &self.state
    }

    /// The same, to set up an experiment.
    pub fn state_mut(&mut self) -> &mut StepState {
        &mut self.state
    }

    /// Positions of all nodes (m).
    pub fn positions(&self) -> &[Vector3<f64>] {
        &self.state.fem.q
    }

    /// The local problem of the last step, as the tick gets it.
    pub fn snapshot(&self) -> &HapticSnapshot {
        &self.snapshot
    }

    /// The factor that serves the steps.
    pub fn factor(&self) -> &FactorSample {
        &self.factor
    }

    /// Contact forces of the last step (N), one per row.
    pub fn forces(&self) -> &[f64] {
        self.ws.forces()
    }

    /// Scratch of the last step: matrix, rows, compliance.
    pub fn workspace(&self) -> &StepWorkspace {
        &self.ws
    }
}
