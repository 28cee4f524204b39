//! State of the step: what is the simulation.

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_collision::contact::ContactSet;
use palpate_constraints::warm_start::WarmStart;
use palpate_fem::model::FemState;
use palpate_rigid::RigidState;
use std::sync::Arc;

use super::climb::Climb;
use super::pair_state::PairState;
use super::prediction::Prediction;
use super::tangle::Trouble;
use crate::refresh::FactorSample;
use crate::world::{Change, World};

/// The simulation: everything that a later step depends on.
pub struct StepState {
    /// Number of the next step, from 0.
    pub step: u64,
    /// Positions and velocities of all nodes.
    pub fem: FemState,
    /// Pose of the tool in the last step.
    pub tool: Option<ToolPose>,
    /// Forces of the last step by surface feature.
    pub warm_start: WarmStart,
    /// Where the run stands on its ladder of methods, where it has one.
    pub climb: Climb,
    /// Steps in which linear or averaged tissue rested inside out, until it is open again.
    pub(super) stuck: u32,
    /// Whether and how the body is in a tangle.
    pub(super) trouble: Trouble,
    /// Contacts of the last step; they carry the side from which the tool came.
    pub contacts: ContactSet,
    /// The rigid bodies, in the order of the scene.
    pub rigid: Vec<RigidState>,
    /// What is remembered of each pair of bodies besides tissue and tool.
    pub(super) pairs: Vec<PairState>,
    /// The state before the last step, to which a failed step returns.
    pub(super) before: FemState,
    rigid_before: Vec<RigidState>,
    /// Where the next free motion begins.
    pub(super) prediction: Prediction,
    /// Events and changes from outside so far.
    pub(super) phase: usize,
    /// Those of them that cut, and with that number the skin's edges and triangles anew.
    pub(super) cuts: u32,
    /// The changes from outside among them.
    pub(super) outside: Vec<Arc<Change>>,
    /// For each phase the step at which it began.
    pub(super) began: Vec<u64>,
    /// Where the body was when the run began: indentation is measured from here (m).
    pub(super) rest: Vec<Vector3<f64>>,
}

impl StepState {
    /// The state before the first step, with the body as `rest`.
    pub fn new(world: &World, rest: FemState) -> Self {
        let capacity = world.detection().max_contacts;
        let mut began = Vec::with_capacity(world.changes().len() + 1 + world.changes_from_outside());
        began.resize(world.changes().len() + 1, 0);
        Self {
            step: 0,
            tool: None,
            climb: Climb::default(),
            stuck: 0,
            trouble: Trouble::UNKNOWN,
            warm_start: WarmStart::with_capacity(capacity),
            contacts: ContactSet::with_capacity(capacity),
            rigid: world.bodies().rigid.iter().map(|body| body.start).collect(),
            rigid_before: world.bodies().rigid.iter().map(|body| body.start).collect(),
            pairs: world.bodies().pairs.iter().map(PairState::new).collect(),
            before: rest.clone(),
            prediction: Prediction::new(world.model().free_nodes()),
            phase: 0,
            cuts: 0,
            outside: Vec::with_capacity(world.changes_from_outside()),
            began,
            rest: rest.q.clone(),
            fem: rest,
        }
    }

    /// Positions of all nodes before the last step (m): the configuration that its system matrix belongs to.
    pub fn before(&self) -> &[Vector3<f64>] {
        &self.before.q
    }

    /// Where the body was when the run began (m).
    pub fn rest(&self) -> &[Vector3<f64>] {
        &self.rest
    }

    /// The state before the last step: what its system matrix was assembled at.
    pub fn state_before(&self) -> &FemState {
        &self.before
    }

    /// The world of the body at hand: after events and changes from outside, that of what they left.
    pub fn world<'a>(&'a self, world: &'a World) -> &'a World {
        self.outside.last().map_or_else(|| world.phase(self.phase), |change| change.world())
    }

    /// The way to the body of a phase, where it is not the first.
    pub(crate) fn change<'a>(&'a self, world: &'a World, phase: usize) -> Option<&'a Change> {
        let last = phase.checked_sub(1)?;
        let of_scene = world.changes().len();
        world.changes().get(last).or_else(|| self.outside.get(last.checked_sub(of_scene)?).map(|change| &**change))
    }

    /// The changes from outside so far.
    pub(crate) fn outside(&self) -> impl Iterator<Item = &Change> {
        self.outside.iter().map(|change| &**change)
    }

    /// Events and changes from outside so far. Without the latter the body is that of [`World::phase`] of this number.
    pub fn phase(&self) -> usize {
        self.phase
    }

    /// The phase whose matrix a factor is of. The first factor is made before the first event, even one at time 0.
    pub(super) fn phase_of(&self, factor: &FactorSample) -> usize {
        let since = |phase: &usize| self.began.get(*phase).is_some_and(|began| *began <= factor.step);
        match factor.renewed {
            0 if factor.epoch == 0 => 0,
            0 => (0..=self.phase).rev().find(since).unwrap_or(0),
            renewed => renewed,
        }
    }

    pub(super) fn remember(&mut self) {
        self.before.q.copy_from_slice(&self.fem.q);
        self.before.v.copy_from_slice(&self.fem.v);
        self.before.memory.copy_from_slice(&self.fem.memory);
        self.rigid_before.copy_from_slice(&self.rigid);
    }

    /// Puts all bodies back to the state before the step, at rest.
    pub(super) fn roll_back(&mut self) {
        self.fem.q.copy_from_slice(&self.before.q);
        self.fem.memory.copy_from_slice(&self.before.memory);
        self.fem.v.fill(Vector3::zeros());
        self.prediction.forget();
        self.warm_start.clear();
        self.rigid.iter_mut().zip(&self.rigid_before).for_each(|(now, before)| *now = before.at_rest());
        self.pairs.iter_mut().for_each(PairState::forget);
        self.contacts.held.clear();
    }
}
