//! A scene made ready: mesh, body, symbolic factorisation, tool. Nothing in it changes while a run lasts.

mod bodies;
mod build;
mod change;
mod course;
mod elements;
mod fixed;
mod geometry;
mod haptics;
mod integration;
mod ladder;
mod outside;
mod pairs;
mod plan;
mod precomputed;
mod sampling;
mod selection;
mod text;
mod tool;
mod units;

use std::sync::{Arc, OnceLock};

use nalgebra::Isometry3;
use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::detection::DetectionConfig;
use palpate_collision::solid::Solid;
use palpate_collision::tool::{Tool, ToolPose};
use palpate_fem::factor::SymbolicFactor;
use palpate_fem::integrator::equilibrium::EquilibriumReport;
use palpate_fem::mesh::{MeshQuality, TetMesh};
use palpate_fem::model::{FemModel, FemState};
use palpate_fem::surface::Surface;
use palpate_haptics::snapshot::HapticSnapshot;

use crate::scene::{Scene, SceneDescription};
use crate::settle::settle;
use crate::step::yielding_contacts;
use outside::Basis;

pub(crate) use build::{build, build_on};

pub(crate) use bodies::MOST_PAIRS;
pub use bodies::{Bodies, FixedBody, RigidBody};
pub use change::Change;
pub use geometry::{is_surface, make};
pub use haptics::CouplingChoice;
pub use integration::{EXPLICIT_SAFETY, Integration};
pub(crate) use ladder::ROOM_FOR_EXACT_STEPS;
pub use ladder::{CALM_STEPS, LOWER_SHARE, Ladder, MOST_CALM_STEPS, Rung};
pub(crate) use outside::ChangeMaker;
pub use outside::{ChangeError, ChangeRequest};
pub use pairs::{Far, Near, Pair};
pub use plan::Plan;
pub(crate) use plan::is_constant;
pub use precomputed::Precomputed;
use precomputed::skin_nodes;
pub use sampling::Sampling;

/// Most contacts of fixed and rigid bodies in one step: their compliance then takes 72 MB.
const MOST_CONTACTS: usize = 1000;

/// A scene made ready to run.
#[derive(Clone)]
pub struct World {
    scene: Scene,
    mesh: TetMesh,
    quality: MeshQuality,
    surface: Surface,
    model: FemModel,
    symbolic: Arc<SymbolicFactor>,
    geometry: SurfaceGeometry,
    detection: DetectionConfig,
    /// The parts of the tool as other bodies meet them.
    tool: Vec<Solid>,
    bodies: Bodies,
    integration: Integration,
    plan: Plan,
    warnings: Vec<String>,
    changes: Vec<Change>,
    /// What changes from outside are made from, where there is room for them.
    basis: Option<Arc<Basis>>,
    /// The body as a run begins, and how it came to rest where it settles; found when it is first asked for.
    start: Arc<OnceLock<(FemState, Option<EquilibriumReport>)>>,
    /// After an event: the elements that are left of the scene's mesh.
    left: Option<Vec<u32>>,
}

impl World {
    /// The scene that it was built from.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The description of that scene.
    pub fn description(&self) -> &SceneDescription {
        self.scene.description()
    }

    /// The step (s).
    pub fn dt(&self) -> f64 {
        1.0 / self.description().rates.step
    }

    /// The mesh of the body (m).
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The boundary of that mesh.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The body.
    pub fn model(&self) -> &FemModel {
        &self.model
    }

    /// The symbolic factorisation of its system matrix.
    pub fn symbolic(&self) -> &Arc<SymbolicFactor> {
        &self.symbolic
    }

    /// The boundary as detection sees it, at rest.
    pub fn geometry(&self) -> &SurfaceGeometry {
        &self.geometry
    }

    /// The shape of the tool.
    pub fn tool(&self) -> &Tool {
        &self.description().tools[0].shape
    }

    /// A part of it as other bodies meet it.
    pub fn tool_solid(&self, part: usize) -> Option<&Solid> {
        self.tool.get(part)
    }

    /// Fixed and rigid bodies, and the pairs of bodies that can touch.
    pub fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// Most contacts of one step, those of the tool among them.
    pub fn contact_capacity(&self) -> usize {
        let others = self.bodies.contact_capacity();
        self.detection.max_contacts + others.min(MOST_CONTACTS)
    }

    /// Most contacts of the tool with fixed bodies, which are the tick's alone.
    pub(crate) fn obstacle_capacity(&self) -> usize {
        self.bodies.obstacle_capacity(self.detection.max_contacts)
    }

    /// Most contacts of fixed and rigid bodies in a patch that yield.
    pub(crate) fn yielding_contacts(&self) -> usize {
        if self.patch_nodes() > 0 { yielding_contacts(&self.bodies.pairs) } else { 0 }
    }

    /// Most contacts of fixed and rigid bodies in a patch.
    pub fn body_contacts(&self) -> usize {
        if self.patch_nodes() > 0 { self.yielding_contacts() + self.obstacle_capacity() } else { 0 }
    }

    /// Most contacts of one snapshot: those of the tool.
    pub(crate) fn tool_capacity(&self) -> usize {
        self.detection.max_contacts + self.obstacle_capacity()
    }

    /// The body as a run begins.
    pub(crate) fn start(&self) -> &FemState {
        &self.start.get_or_init(|| settle(self)).0
    }

    /// How it came to rest under its own weight; none where a run begins with the mesh itself.
    pub(crate) fn settled(&self) -> Option<&EquilibriumReport> {
        self.start.get_or_init(|| settle(self)).1.as_ref()
    }

    /// The body at rest under its own weight, where that has been found.
    pub(crate) fn known_rest(&self) -> Option<(&FemState, &EquilibriumReport)> {
        self.start.get().and_then(|(state, report)| Some((state, report.as_ref()?)))
    }

    /// How contacts with the tool are found.
    pub fn detection(&self) -> &DetectionConfig {
        &self.detection
    }

    /// A snapshot with the room that this scene needs, for programs that bring their own loop.
    pub fn empty_snapshot(&self) -> HapticSnapshot {
        HapticSnapshot::with_bodies(self.tool_capacity(), self.patch_nodes(), self.body_contacts())
    }

    /// How the body moves in time.
    pub fn integration(&self) -> &Integration {
        &self.integration
    }

    /// Age (s) at which a refreshed factor reaches the step in lockstep: what the scene says, or the time that the plan
    /// predicts for a factorisation, rounded up to whole ticks. A function of the scene alone, the same on every machine.
    pub fn factor_delay(&self) -> f64 {
        let rates = &self.description().rates;
        rates.factor_delay.unwrap_or_else(|| (self.plan.refresh() * rates.tick).ceil() / rates.tick)
    }

    /// The methods of a run, and why.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The body after each event, in the order of their times.
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Most changes from outside in one run.
    pub fn changes_from_outside(&self) -> usize {
        if self.basis.is_some() { self.description().bodies[0].changes as usize } else { 0 }
    }

    /// Whether the body may change while it runs.
    pub(crate) fn changes_ever(&self) -> bool {
        !self.changes.is_empty() || self.basis.is_some()
    }

    /// The world after the first `phase` events: this one after none, the last one beyond.
    pub fn phase(&self, phase: usize) -> &World {
        let after = phase.min(self.changes.len()).checked_sub(1);
        after.and_then(|last| self.changes.get(last)).map_or(self, Change::world)
    }

    /// After an event: for each element its number in the scene's mesh. `None` for the whole body.
    pub fn left(&self) -> Option<&[u32]> {
        self.left.as_deref()
    }

    /// Free nodes of the skin, ascending: those between which the inverse of the first matrix is precomputed.
    pub fn free_skin(&self) -> Vec<u32> {
        skin_nodes(&self.model, &self.surface)
    }

    /// What is odd but no mistake.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The pose of the tool before the device has told one: where the hand's path begins, or without one the device's
    /// origin.
    pub fn first_pose(&self) -> Isometry3<f64> {
        self.first_tool().frame
    }

    /// The same with the opening of its jaws.
    pub fn first_tool(&self) -> ToolPose {
        tool::first(self.description())
    }
}
