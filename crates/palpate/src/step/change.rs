//! From one body to the next where an event changes it, and a factor that serves the new one until one of its own is made.
//!
//! The state is carried over: places and velocities of all nodes, what viscous tissue remembers, forces of contacts that
//! stay. A factor of a body before the event is changed by what differs between the matrices of the two bodies at the
//! configuration of the factor and with what its tissue remembered there, so that it is what a factorisation there would be,
//! and warps as that one would:
//! ```text
//! A_now(q_f) = A_then(q_f) + S N Sᵀ       q_f: where the factor was taken
//! ```
//! That is done once for each factor and body ([`Factor::change`](palpate_fem::factor::Factor::change)). A change that touches more nodes than there is room for leaves the factor as preconditioner
//! alone. Until the next is made every step then factors its own matrix before anything else; where the plan makes no other, the
//! first of them makes one that stays.

use palpate_fem::assembly::assemble;
use palpate_fem::factor::{ChangeStatus, FactorStatus, MatrixChange, UpdateStatus};
use palpate_fem::model::FemState;
use serde::Serialize;
use std::sync::mpsc::Receiver;

use super::prepared::{PhaseScratch, Prepared, next_from_outside};
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
    /// It could not follow an event: the step has made one anew.
    Renewed,
    /// It is one of a body before an event, and the step's own matrix could not be factored: a preconditioner, but no
    /// compliance.
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
    /// The state of the factor, in the body that it is of and carried to the present one; the other is scratch.
    at: [FemState; 2],
    /// Changes from outside, on their way.
    pub(super) incoming: Option<Receiver<Prepared>>,
    change: MatrixChange,
    newly_held: Vec<bool>,
    /// Epoch and body for which a factor was changed last.
    adapted: Option<(u64, usize)>,
}

impl ChangeStage {
    pub(super) fn new(world: &World) -> Self {
        let (free, room) = (world.model().free_nodes(), world.symbolic().change_capacity());
        let at = || if world.changes_ever() { world.model().rest_state() } else { FemState::default() };
        let mut others = Vec::with_capacity(world.changes().len() + world.changes_from_outside());
        others.extend(world.changes().iter().map(PhaseScratch::new));
        Self {
            report: ChangeReport::default(),
            others,
            at: [at(), at()],
            incoming: None,
            change: MatrixChange::with_capacity(free, room),
            newly_held: vec![false; free],
            adapted: None,
        }
    }
}

/// Brings body and factor up to the step that begins at `time` (s): takes over what was prepared with the factor, passes the
/// events whose time has come and makes the factor serve the body. Called before every [`step`](super::step()); allocates nothing.
pub fn pass_events(world: &World, time: f64, factor: &mut FactorSample, state: &mut StepState, ws: &mut StepWorkspace) {
    ws.take_prepared(factor);
    if !world.changes_ever() {
        return;
    }
    let before = state.phase;
    while let Some(change) = world.changes().get(state.phase).filter(|change| change.time() <= time + SAME_TIME) {
        begin(world, change, state, ws);
    }
    while let Some(prepared) = next_from_outside(world, state, ws) {
        // Both have room for as many as a run may see.
        ws.change.others.push(prepared.scratch);
        state.began.push(0);
        begin(world, &prepared.change, state, ws);
        state.outside.push(prepared.change);
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
    let outside = state.outside.last().cloned();
    let from = outside.as_deref().map_or_else(|| world.phase(state.phase), Change::world).model();
    let to = change.world().model();
    // The state before the last step serves as the place to carry to: it is of no use after a change.
    state.before.memory.resize(change.memory().len(), Default::default());
    state.before.carry(&state.fem, from, to, change.memory());
    std::mem::swap(&mut state.fem, &mut state.before);
    state.before.memory.resize(change.memory().len(), Default::default());
    state.remember();
    ws.trial.memory.resize(change.memory().len(), Default::default());
    ws.trial.q.copy_from_slice(&state.fem.q);
    // Learned of another body: nodes that are held from now on would begin where they were driven.
    state.prediction.forget();
    state.warm_start.renumber(|feature| change.feature(feature));
    // Points of a skin that is not there any more.
    state.contacts.held.clear();
    state.pairs.iter_mut().for_each(|pair| pair.renumber(change));
    if let Some(other) = ws.change.others.get_mut(state.phase) {
        std::mem::swap(&mut ws.fem, &mut other.fem);
        std::mem::swap(&mut ws.geometry, &mut other.geometry);
        std::mem::swap(&mut ws.detection, &mut other.detection);
        std::mem::swap(&mut ws.windings, &mut other.windings);
    }
    state.phase += 1;
    state.cuts += u32::from(change.cuts());
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
    let body = |phase: usize| state.change(world, phase).map_or(world, Change::world).model();
    let (before, now, h) = (body(then), body(state.phase), world.dt());
    let stage = &mut ws.change;
    stage.report.touched = 0;
    stage.report.factor = FactorFit::Outdated;
    if let Some(other) = stage.others.get_mut(then).filter(|_| stage.change.capacity() > 0) {
        let [at, next] = &mut stage.at;
        at.q.copy_from_slice(&factor.q);
        at.memory.resize(before.memory(), Default::default());
        at.memory.copy_from_slice(factor.memory.get(..before.memory()).unwrap_or(&[]));
        let _ = assemble(before, at, h, &[], &mut other.fem);
        for phase in then..state.phase {
            let Some(change) = state.change(world, phase + 1) else { break };
            next.memory.resize(change.memory().len(), Default::default());
            next.carry(at, body(phase), body(phase + 1), change.memory());
            std::mem::swap(at, next);
        }
        let _ = assemble(now, at, h, &[], &mut ws.fem);
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
            factor.remember(&state.fem.memory);
            ws.change.report.factor = FactorFit::Renewed;
        }
    }
}

#[cfg(test)]
mod tests {
    use palpate_constraints::compliance::ComplianceMethod;
    use palpate_fem::factor::{Factor, SolveWorkspace};
    use palpate_fem::material::PronyTerm;

    use std::sync::Arc;

    use palpate_fem::assembly::FemWorkspace;

    use super::*;
    use crate::scene::{EventDescription, NodeSelection, Scene};
    use crate::simulation::Simulation;

    /// The tangent of viscous tissue depends on what it remembers, so that a change of its factor must know that: the solves
    /// of the changed factor are those of a factorisation of the new body at the factor's configuration and memory. The
    /// condition number of these matrices is about 1e4, which leaves eleven digits of a solve.
    #[test]
    fn the_changed_factor_of_viscous_tissue_is_a_refactorisation_with_what_it_remembers() {
        let mut scene = Scene::bundled("block").unwrap();
        let slit = NodeSelection::Box { min: [0.005, -0.02, 0.01], max: [0.025, 0.02, 0.04] };
        scene
            .edit(|d| {
                d.bodies[0].compliance = ComplianceMethod::Asynchronous;
                d.bodies[0].material.viscosity = vec![PronyTerm { modulus: 0.5, time: 0.3 }];
                let event = EventDescription { time: 11.5 / 30.0, release: None, hold: None, remove: Some(slit) };
                d.events = vec![event];
            })
            .unwrap();
        let world = scene.build().unwrap();
        let mut simulation = Simulation::new(&world).unwrap().refresh_every(4);
        let mut pose = world.first_pose();
        let mut report = simulation.step(&pose);
        let mut remembered = Vec::new();
        while report.change.phase == 0 {
            remembered = simulation.factor().memory.clone();
            pose.translation.vector.z -= 0.8e-3;
            report = simulation.step(&pose);
        }
        assert_eq!(report.change.factor, FactorFit::Updated, "{} nodes touched", report.change.touched);
        assert!(report.active > 0);
        let stress = remembered.iter().map(|m| m.norm()).fold(0.0, f64::max);
        assert!(stress > 10.0, "the tissue remembers up to {stress} Pa");

        let (before, now) = (world.model(), world.phase(1).model());
        let solve = |factor: &Factor| {
            let mut x: Vec<f64> = (0..3 * now.free_nodes()).map(|i| ((i * 37) % 19) as f64 - 9.0).collect();
            let held = now.held();
            x.chunks_exact_mut(3).zip(held).filter(|(_, held)| **held).for_each(|(x, _)| x.fill(0.0));
            let mut ws = SolveWorkspace::new(world.symbolic());
            assert!(factor.solve(&mut x, &mut ws).is_ok());
            x
        };
        let fresh = |memory: &[_]| {
            let mut then = FemState { q: simulation.factor().q.clone(), ..before.rest_state() };
            then.memory.copy_from_slice(memory);
            let mut at = now.rest_state();
            at.carry(&then, before, now, world.changes()[0].memory());
            let mut fem = FemWorkspace::new(now);
            assemble(now, &at, world.dt(), &[], &mut fem);
            let mut factor = Factor::new(Arc::clone(world.symbolic()));
            assert_eq!(factor.refactor(&fem.system).status, FactorStatus::Ok);
            solve(&factor)
        };
        let changed = solve(&simulation.factor().factor);
        let far = |x: &[f64]| {
            let size = x.iter().map(|x| x * x).sum::<f64>().sqrt();
            x.iter().zip(&changed).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt() / size
        };
        let exact = far(&fresh(&remembered));
        let relaxed = far(&fresh(&vec![Default::default(); remembered.len()]));
        println!("differs by {exact:.1e}; from one of relaxed tissue by {relaxed:.1e}");
        assert!(exact < 1e-9, "{exact:e}");
        assert!(relaxed > 1e-6, "{relaxed:e}: memory plays no part here");
    }
}
