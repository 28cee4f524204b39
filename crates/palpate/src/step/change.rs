//! From one body to the next where an event changes it, and a factor that serves the new one until one of its own is made.
//!
//! The state is carried over: places and velocities of all nodes, what viscous tissue remembers, forces of contacts that
//! stay. A factor of a body before the event is changed by what differs between the matrices of the two bodies at the
//! configuration of the factor, so that it is what a factorisation there would be, and warps as that one would:
//! ```text
//! A_now(q_f) = A_then(q_f) + S N Sᵀ       q_f: where the factor was taken
//! ```
//! That is done once for each factor and body ([`Factor::change`](palpate_fem::factor::Factor::change)). Viscous tissue
//! counts as relaxed there. A change that touches more nodes than there is room for leaves the factor as preconditioner
//! alone, until the next is made; where the plan makes no other, the step makes one at once.

use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::detection::DetectionWorkspace;
use palpate_fem::assembly::{FemWorkspace, assemble};
use palpate_fem::factor::{ChangeStatus, FactorStatus, MatrixChange, UpdateStatus};
use palpate_fem::model::FemState;
use serde::Serialize;

use super::{StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Change, World};

/// Seconds by which a step may begin before an event and still see it: rounding of times.
const SAME_TIME: f64 = 1e-9;

/// How the latest factor serves the body of the step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FactorFit {
    /// It is one of this body.
    #[default]
    Own,
    /// It is one of a body before an event, changed to be what a factorisation of this body would be.
    Updated,
    /// The step has made it anew, since nothing else does.
    Renewed,
    /// It is one of a body before an event: a preconditioner, but no compliance.
    Outdated,
}

/// What events did to the body of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangeReport {
    /// Events so far: the body is that of [`World::phase`] of this number.
    pub phase: u32,
    /// Whether this is the first step after an event.
    pub changed: bool,
    /// How the latest factor serves this body.
    pub factor: FactorFit,
    /// Nodes whose rows differ between the factor's body and this one, where that was worked out.
    pub touched: u32,
}

/// Scratch of changes, sized at set-up; empty without events.
pub(super) struct ChangeStage {
    /// What the step at hand found.
    pub(super) report: ChangeReport,
    /// What steps with each other body need: before the present one at their number, after it one place lower.
    others: Vec<PhaseScratch>,
    /// The configuration of the factor.
    at: FemState,
    change: MatrixChange,
    newly_held: Vec<bool>,
    /// Epoch and body for which a factor was changed last.
    adapted: Option<(u64, usize)>,
}

/// The part of the step's scratch that belongs to one body.
struct PhaseScratch {
    fem: FemWorkspace,
    geometry: SurfaceGeometry,
    detection: DetectionWorkspace,
}

impl ChangeStage {
    pub(super) fn new(world: &World) -> Self {
        let scratch = |change: &Change| PhaseScratch {
            fem: FemWorkspace::new(change.world().model()),
            geometry: change.world().geometry().clone(),
            detection: DetectionWorkspace::new(change.world().geometry()),
        };
        let (free, room) = (world.model().free_nodes(), world.symbolic().change_capacity());
        Self {
            report: ChangeReport::default(),
            others: world.changes().iter().map(scratch).collect(),
            at: if world.changes().is_empty() { FemState::default() } else { world.model().rest_state() },
            change: MatrixChange::with_capacity(free, room),
            newly_held: vec![false; free],
            adapted: None,
        }
    }
}

/// Brings body and factor up to the step that begins at `time` (s): passes the events whose time has come and makes the
/// factor serve the body. Called before every [`step`](super::step()); allocates nothing.
pub fn pass_events(world: &World, time: f64, factor: &mut FactorSample, state: &mut StepState, ws: &mut StepWorkspace) {
    if world.changes().is_empty() {
        return;
    }
    let before = state.phase;
    while let Some(change) = world.changes().get(state.phase).filter(|change| change.time() <= time + SAME_TIME) {
        begin(world, change, state, ws);
    }
    ws.change.report.changed |= state.phase != before;
    serve(world, time, factor, state, ws);
}

/// Passes the next event, whenever its time is; false where there is none.
pub(crate) fn pass_next_event(world: &World, state: &mut StepState, ws: &mut StepWorkspace) -> bool {
    let Some(change) = world.changes().get(state.phase) else { return false };
    begin(world, change, state, ws);
    ws.change.report.changed = true;
    true
}

/// The body after `change` takes over.
fn begin(world: &World, change: &Change, state: &mut StepState, ws: &mut StepWorkspace) {
    let (from, to) = (world.phase(state.phase).model(), change.world().model());
    // The state before the last step serves as the place to carry to: it is of no use after a change.
    state.before.memory.resize(change.memory().len(), Default::default());
    state.before.carry(&state.fem, from, to, change.memory());
    std::mem::swap(&mut state.fem, &mut state.before);
    state.before.memory.resize(change.memory().len(), Default::default());
    state.remember();
    ws.trial.memory.resize(change.memory().len(), Default::default());
    ws.trial.q.copy_from_slice(&state.fem.q);
    state.warm_start.renumber(|feature| change.feature(feature));
    // Points of a skin that is not there any more.
    state.contacts.held.clear();
    state.pairs.iter_mut().for_each(|pair| pair.renumber(change));
    if let Some(other) = ws.change.others.get_mut(state.phase) {
        std::mem::swap(&mut ws.fem, &mut other.fem);
        std::mem::swap(&mut ws.geometry, &mut other.geometry);
        std::mem::swap(&mut ws.detection, &mut other.detection);
    }
    state.phase += 1;
    if let Some(began) = state.began.get_mut(state.phase) {
        *began = state.step;
    }
}

/// Makes a factor of a body before an event serve the present one.
fn serve(world: &World, time: f64, factor: &mut FactorSample, state: &StepState, ws: &mut StepWorkspace) {
    ws.change.report.phase = state.phase as u32;
    let then = state.phase_of(factor);
    if then == state.phase {
        ws.change.report.factor = FactorFit::Own;
        ws.change.report.touched = 0;
        return;
    }
    if ws.change.adapted.replace((factor.epoch, state.phase)) == Some((factor.epoch, state.phase)) {
        return;
    }
    let (before, now, h) = (world.phase(then).model(), world.phase(state.phase).model(), world.dt());
    let stage = &mut ws.change;
    stage.report.touched = 0;
    stage.report.factor = FactorFit::Outdated;
    if let Some(other) = stage.others.get_mut(then).filter(|_| stage.change.capacity() > 0) {
        stage.at.q.copy_from_slice(&factor.q);
        for (model, fem) in [(before, &mut other.fem), (now, &mut ws.fem)] {
            stage.at.memory.clear();
            stage.at.memory.resize(model.memory(), Default::default());
            let _ = assemble(model, &stage.at, h, &[], fem);
        }
        let held = now.held().iter().zip(before.held());
        stage.newly_held.iter_mut().zip(held).for_each(|(newly, (now, then))| *newly = *now && !*then);
        let status = stage.change.between(&other.fem.system, &ws.fem.system, &stage.newly_held);
        if status == ChangeStatus::Ok && factor.factor.change(&stage.change) == UpdateStatus::Ok {
            stage.report.factor = FactorFit::Updated;
            stage.report.touched = stage.change.nodes().len() as u32;
            return;
        }
    }
    if world.plan().refactor == Refactor::Once {
        let _ = assemble(now, &state.fem, h, &[], &mut ws.fem);
        if factor.factor.refactor(&ws.fem.system).status == FactorStatus::Ok {
            (factor.step, factor.time, factor.renewed) = (state.step, time, state.phase);
            factor.q.copy_from_slice(&state.fem.q);
            ws.change.report.factor = FactorFit::Renewed;
        }
    }
}
