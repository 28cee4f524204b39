//! The local problem of a tick on a patch of tissue: contacts at the newest pose, their rows, forces, wrench.
//!
//! Let x = q + k C f be the shape under the forces of the tick before, q that without, k the share of the step's
//! compliance that shows within a tick ([`creep`]), y = q + r a place that follows it (r goes 0.3 of its way to k C f
//! in each tick), and X the tool as the coupling would hold it if the force stayed. Contacts are found between y and X,
//! and everything is linearised there:
//! ```text
//! W      = B (k C + c) Bᵀ  (+ c_rot)          m/N     B: the rows' directions on the nodes; c: the coupling's compliance
//! normal:   δ_free = gap(y, X) − n · r + J (X_predicted − X)                           m
//! tangents: δ_free = t · (q − x₋) − t · (path of the tool's point since the tick before) + slip    m
//! ```
//! with x₋ the shape when the tick before ended. So normals follow the skin while the tool slides, a contact that begins
//! between two steps is felt at once, and one tick is one damped iteration of Newton's method on the geometry. Undamped
//! (y = x), a ball pressed deep into coarse skin goes round among sets of contacts, 7 % below the force of the step;
//! damped it agrees to a thousandth. Detection at q_free would see the tool deep in tissue that has sprung back.
//!
//! Friction holds the place, not the velocity: `slip`, what the solver's tolerance left of a sticking contact's
//! displacement, is added to the next tick's, so nothing creeps however loose the tolerance is.
//!
//! The steps' impulse and the tick's are not the same: the step solves its own contact with the tool where the tick left
//! it, at its own begin. Both are measured ([`crate::record::TickRecord::contact_wrench`], the step's report).

mod bodies;
mod compliance;
mod creep;
mod jaws;
mod known;
mod memory;
mod node;
mod rows;

use nalgebra::Vector3;
use palpate_collision::PatchDetection;
use palpate_collision::detection::DetectionConfig;
use palpate_collision::{Tool, ToolPose};
use palpate_solver::gauss_seidel::GaussSeidelConfig;
use palpate_solver::problem::ProblemView;
use palpate_solver::stepped_sweeps::{self, Steps};

use super::local::{Local, TickWorkspace};
use crate::SetupError;
use crate::coupling::Coupling;
use crate::error::non_negative;
use crate::gripper::Gripper;
use crate::patch::HapticPatch;
use crate::snapshot::ROWS_PER_CONTACT;

use creep::Moment;
use jaws::Jaws;
pub(super) use memory::PatchMemory;
use rows::Rows;

/// Gap \[m\] up to which a feature of the patch is a contact of the tick. Deep in coarse skin, contacts that let go
/// move it by a millimetre: what would then touch must be in the problem, or the ticks go round among sets of contacts.
const NEAR: f64 = 2e-3;

/// Unknowns of a step of Newton: more have no room, and are more than a tick has time for.
const MOST_UNKNOWNS: usize = 96;

/// How ticks work on patches.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchTickConfig {
    /// Shape of the tool.
    pub tool: Tool,
    /// How the step finds contacts; kind, reach, merging and capacity are the tick's too.
    pub detection: DetectionConfig,
    /// Nodes that a patch may have.
    pub max_nodes: usize,
    /// Contacts of fixed and rigid bodies that a patch may have.
    pub max_bodies: usize,
    /// Time over which the shape goes over from one snapshot's to the next's \[s\], ≥ 0; 0 lets it jump.
    pub hand_over: f64,
}

impl PatchTickConfig {
    /// Default of `hand_over` \[s\].
    pub const HAND_OVER: f64 = 10e-3;
    /// Default of `max_nodes`.
    pub const MAX_NODES: usize = 48;

    pub(super) fn validate(&self) -> Result<(), SetupError> {
        non_negative("tick hand_over [s]", self.hand_over)?;
        let (value, range) = (self.max_nodes as f64, "at least 3");
        if self.max_nodes < 3 {
            return Err(SetupError::OutOfRange { what: "tick patch_nodes", value, range });
        }
        Ok(())
    }
}

/// Scratch of ticks on patches.
#[derive(Clone, Debug)]
pub(super) struct PatchWorkspace {
    detection: PatchDetection,
    config: DetectionConfig,
    rows: Rows,
    steps: Steps,
    /// Nodes under the forces of the tick before, at this tick's place in the hand-over \[m\].
    shape: Vec<Vector3<f64>>,
    /// Nodal forces \[N\] that the tick found, and C times them \[m\].
    force: Vec<Vector3<f64>>,
    moved: Vec<Vector3<f64>>,
    sum: Vec<f64>,
}

impl PatchWorkspace {
    pub(super) fn new(config: &PatchTickConfig) -> Self {
        let nodes = config.max_nodes;
        let (contacts, places) = (config.detection.max_contacts, config.max_bodies + config.max_nodes);
        let margin = config.detection.margin.min(NEAR);
        let zeros = |count| vec![Vector3::zeros(); count];
        Self {
            detection: PatchDetection::for_tool(nodes, contacts, &config.tool),
            config: DetectionConfig { margin, ..config.detection },
            rows: Rows::new(contacts, config.max_bodies),
            steps: Steps::with_capacity(ROWS_PER_CONTACT * (contacts + config.max_bodies), MOST_UNKNOWNS),
            shape: zeros(nodes),
            force: zeros(places),
            moved: zeros(places),
            sum: vec![0.0; 3 * places],
        }
    }
}

/// What a tick on a patch works with: description.
#[derive(Clone, Copy, Debug)]
pub(super) struct PatchProblem<'a> {
    pub(super) solver: &'a GaussSeidelConfig,
    pub(super) coupling: &'a Coupling,
    pub(super) gripper: Option<&'a Gripper>,
    pub(super) config: &'a PatchTickConfig,
}

/// Poses of the tool in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToolPoses {
    /// If the force stayed as in the tick before.
    pub(super) held: ToolPose,
    /// Without contact.
    pub(super) predicted: ToolPose,
}

impl PatchProblem<'_> {
    /// The local problem with the tool at these poses. Changes nothing but the workspace: [`PatchMemory::keep`] does.
    pub(super) fn solve(
        &self,
        memory: &PatchMemory,
        patch: &HapticPatch,
        poses: &ToolPoses,
        now: &Moment,
        ws: &mut TickWorkspace,
    ) -> Local {
        let TickWorkspace { patch: Some(scratch), w, solver, .. } = ws else { return Local::EMPTY };
        let (nodes, places) = (patch.len(), patch.places());
        if nodes > scratch.shape.len()
            || places > scratch.force.len()
            || patch.bodies.all().len() > self.config.max_bodies
        {
            return Local { truncated: true, ..Local::EMPTY };
        }
        memory.shape_now(patch, now, &mut scratch.shape[..nodes]);
        // A node that is nowhere would be no contact, and the others would carry on without it.
        if !scratch.shape[..nodes].iter().all(crate::wrench::all_finite) {
            return Local { finite: false, ..Local::EMPTY };
        }
        let dropped = scratch.detection.detect_tool(
            patch.skin(),
            &scratch.shape[..nodes],
            &self.config.tool,
            &poses.held,
            &scratch.config,
        );
        scratch.force[..places].fill(Vector3::zeros());
        scratch.moved[..places].fill(Vector3::zeros());
        let truncated = dropped > 0;
        let rows = &mut scratch.rows;
        let jaws = Jaws::new(&self.config.tool, poses, memory.tool(), memory.led());
        rows.build(scratch.detection.contacts(), &scratch.shape[..nodes], (memory, now), patch, (&jaws, poses));
        let m = rows.len();
        if m == 0 {
            return Local { truncated, ..Local::EMPTY };
        }
        let Some(w) = w.get_mut(..m * m) else { return Local { truncated: true, ..Local::EMPTY } };
        let opening = self.gripper.map_or(0.0, Gripper::compliance);
        let sound = rows.compliance_into(patch, now.law.yields(), (self.coupling, opening), w);

        memory.warm_start(rows);
        let view = ProblemView { compliance: w, stride: m, delta_free: &rows.delta_free, blocks: &rows.blocks };
        // Tissue that is held moves little for forces out of balance, and its sweeps are soon done.
        let before: &[f64] = if patch.viscosity > 0.0 { &[] } else { &rows.before };
        let report = stepped_sweeps::solve(&view, (&mut rows.lambda, before), self.solver, solver, &mut scratch.steps);
        rows.note_gaps(solver.delta());
        rows.spread(&mut scratch.force[..places]);
        patch.yielding(&scratch.force[..places], &mut scratch.sum, &mut scratch.moved[..places]);

        let wrench = rows.wrench();
        let finite = sound
            && report.residual.is_finite()
            && rows.delta_free.iter().all(|gap| gap.is_finite())
            && scratch.moved[..places].iter().all(crate::wrench::all_finite);
        Local {
            finite,
            wrench,
            gripper: rows.gripper_torque(),
            gap: rows.least_gap(),
            contacts: rows.contacts() as u32,
            active: rows.active() as u32,
            sweeps: report.iterations,
            residual: report.residual,
            converged: report.is_solved(),
            truncated,
        }
    }

    /// Whether skin that the patch lacks could touch the tool at this pose: it has gone farther from the pose of the
    /// snapshot than the patch was gathered for.
    pub(super) fn is_beyond(&self, patch: &HapticPatch, from: &ToolPose, pose: &ToolPose) -> bool {
        let moved = match self.config.tool.is_ball() {
            true => (pose.frame.translation.vector - from.frame.translation.vector).norm(),
            false => self.config.tool.path(from, pose),
        };
        moved > patch.skin().clearance()
    }
}
