//! The tissue around the tool for the tick: skin, nodal compliance, and the shape without the step's own forces.
//!
//! A patch reaches as far as the tool may touch until two more steps have passed, at the speed that it has now, and from
//! rest at [`START`]. Its compliance is that of the step's own inverse, in which rows that do not touch the tool and carry
//! force are held ([`condense`]): all of a contact that sticks, the normal of one that slides. Its free shape is the step's
//! without the forces of the tool, and with those of the others; its drift is that of the step after it ([`super::drift`]), by the
//! same rows held.
//!
//! Contacts of the tool with fixed and rigid bodies, and of tissue and rigid bodies with fixed ones, are a part of the patch
//! ([`body_contacts`](super::body_contacts)). While the tool's have no room, the tick has the step's rows.

mod rows;

use nalgebra::{DMatrixViewMut, Vector3};
use palpate_collision::tool::Tool;
use palpate_collision::{PatchConfig, PatchGathering, ToolPose};
use palpate_constraints::condensed::condense;
use palpate_constraints::rows::ContactRows;
use palpate_fem::sparse::FIXED;
use palpate_haptics::patch::HapticPatch;

use super::body_contacts::{BodyContactStage, push_bodies};
use super::{StepInput, StepReport, StepState, StepWorkspace, drift, stages};
use crate::world::World;

/// Steps until the next patch is there at the latest: the one at hand, and the one after it, which begins with it.
const STEPS: f64 = 2.0;

/// How far (m) a tool at rest may get meanwhile: at 2 m/s², a brisk hand, within two steps at 30 Hz.
const START: f64 = 4e-3;

/// Memory for patches, sized at set-up.
pub(super) struct PatchStage {
    gathering: PatchGathering,
    bodies: BodyContactStage,
    /// Three rows for each node that can move, then the rows that are held.
    rows: ContactRows,
    /// Their compliance, where some are held.
    w: Vec<f64>,
    /// Their drift, and their way at the velocity that they have, in a step (m).
    drift: Vec<f64>,
    way: Vec<f64>,
    max_rows: usize,
}

impl PatchStage {
    /// Memory for patches of so many nodes and contacts of bodies that yield, and as many rows in all as compliance has memory for.
    pub(super) fn new(world: &World, places: usize, max_rows: usize) -> Self {
        Self {
            bodies: BodyContactStage::new(world),
            gathering: PatchGathering::new(world.geometry()),
            rows: ContactRows::with_capacity(max_rows.max(3 * places).div_ceil(3)),
            w: Vec::with_capacity(max_rows * max_rows),
            drift: Vec::with_capacity(max_rows.max(3 * places)),
            way: Vec::with_capacity(max_rows.max(3 * places)),
            max_rows,
        }
    }
}

/// How far (m) a tool that has come from `before` in a step may get until a snapshot is replaced.
pub(super) fn travel(tool: &Tool, before: Option<&ToolPose>, pose: &ToolPose) -> f64 {
    let path = before.map_or(0.0, |before| tool.path(before, pose));
    START + STEPS * path
}

/// Fills the patch, or leaves it not valid: the tick then has the step's rows, and the report says why.
pub(super) fn fill(
    world: &World,
    input: &StepInput<'_>,
    before: Option<&ToolPose>,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    patch: &mut HapticPatch,
) {
    patch.clear();
    let Some(mut stage) = ws.patch.take() else { return };
    patch.law = world.description().contact.contact_law();
    report.patch = gather(world, input, before, state, ws, &mut stage, patch);
    patch.left_out = report.patch.left_out as u32;
    let reach = travel(world.tool(), before, &input.tool);
    stage.bodies.find(world, input, (reach, !patch.is_empty()), state, ws, report);
    report.frozen_at_rigid = !push_bodies(world, input, ws, &stage.bodies, patch);
    if !report.frozen_at_rigid {
        report.bodies.handed_over = patch.bodies.all().len() as u32;
        patch.valid = patch.degrees_of_freedom() == 0 || compliance(world, input, state, ws, &mut stage, report, patch);
    }
    if patch.valid {
        shape(world, state, ws, patch);
    }
    ws.patch = Some(stage);
}

/// The skin near the tool where the step left it.
fn gather(
    world: &World,
    input: &StepInput<'_>,
    before: Option<&ToolPose>,
    state: &StepState,
    ws: &StepWorkspace,
    stage: &mut PatchStage,
    patch: &mut HapticPatch,
) -> palpate_collision::PatchReport {
    let (tool, pose) = (world.tool(), &input.tool);
    let travel = travel(tool, before, pose);
    let config = PatchConfig { margin: world.detection().margin, travel, side: state.contacts.side };
    let free = world.model().free_of_node();
    let movable = |node: u32| free.get(node as usize).is_some_and(|&free| free != FIXED);
    let skin = patch.skin_mut();
    let report = stage.gathering.gather_tool(&ws.geometry, &state.fem.q, (tool, pose), &config, movable, skin);
    skin.set_other_sides(&state.contacts.other_sides);
    report
}

/// Whether the tissue creeps under a force as springs with a damper do. Rigid bodies, and tissue that nothing holds, go by their
/// mass: they follow forces at once, and their whole motion is even.
fn creeps(world: &World) -> bool {
    let model = world.model();
    let is_held = model.free_of_node().contains(&FIXED) || model.held().contains(&true);
    is_held && world.bodies().rigid.is_empty()
}

/// C of the patch, and its drift; false where there is no C.
fn compliance(
    world: &World,
    input: &StepInput<'_>,
    state: &StepState,
    ws: &mut StepWorkspace,
    stage: &mut PatchStage,
    report: &mut StepReport,
    patch: &mut HapticPatch,
) -> bool {
    let n = patch.degrees_of_freedom();
    stage.rows.clear();
    stage.push_bodies();
    stage.push_nodes(world.model().free_of_node(), patch.skin());
    stage.push_held(ws);
    let all = stage.rows.len();
    stages::own_factor(world, ws, report);
    // What is held between two steps is held against the whole motion.
    let creeps = all == n && creeps(world);
    stage.drift.clear();
    stage.way.clear();
    if let Some((drift, way)) = drift::drift(world, input.factor, state, creeps, ws) {
        drift::along(&stage.rows, drift, &mut stage.drift);
        drift::along(&stage.rows, way, &mut stage.way);
        patch.viscosity = if creeps { world.model().rayleigh_stiffness() } else { 0.0 };
    }
    stage.drift.resize(all, 0.0);
    stage.way.resize(all, 0.0);
    let r = drift::held_back(world, ws.dt);
    let flows = if patch.viscosity > 0.0 { r } else { 0.0 };
    let usable = if all == n {
        stages::compliance_of(world, input.factor, &stage.rows, square(patch.compliance_mut(), n), ws).0.usable
    } else {
        stage.w.resize(all * all, 0.0);
        let usable = stages::compliance_of(world, input.factor, &stage.rows, square(&mut stage.w, all), ws).0.usable;
        let held = usable.then(|| condense(&mut stage.w, &mut stage.drift, n)).flatten();
        for (to, from) in patch.compliance_mut().chunks_exact_mut(n).zip(stage.w.chunks_exact(all)) {
            to.copy_from_slice(&from[..n]);
        }
        held.is_some()
    };
    carry_motions(&stage.drift[..n], &stage.way[..n], flows, patch);
    usable
}

/// Hands on how bodies that yield and nodes drift (m in a step), and what of the rest of their way flows.
fn carry_motions(drift: &[f64], way: &[f64], flows: f64, patch: &mut HapticPatch) {
    let motions = drift.chunks_exact(3).zip(way.chunks_exact(3)).map(|(d, way)| {
        let (d, way) = (Vector3::from_column_slice(d), Vector3::from_column_slice(way));
        (d, (way - d) * flows)
    });
    let yielding = patch.bodies.yielding();
    for (to, motion) in patch.bodies.all_mut().iter_mut().zip(motions.clone().take(yielding)) {
        (to.drift, to.flow) = motion;
    }
    for (k, (drift, flow)) in motions.skip(yielding).enumerate() {
        if let Some(to) = patch.drift_mut().get_mut(k) {
            *to = drift;
        }
        if let Some(to) = patch.flow_mut().get_mut(k) {
            *to = flow;
        }
    }
}

/// Forces of the tool on the patch's nodes in the step, and where the nodes are without them.
fn shape(world: &World, state: &StepState, ws: &mut StepWorkspace, patch: &mut HapticPatch) {
    ws.load.fill(0.0);
    for (r, lambda) in ws.lambda.iter().enumerate().take(ws.tool_rows()) {
        for (node, direction) in ws.rows.tissue.row(r) {
            let at = 3 * node as usize;
            if let Some(load) = ws.load.get_mut(at..at + 3) {
                load.iter_mut().zip(&direction).for_each(|(load, d)| *load += d * lambda);
            }
        }
    }
    let (load, free) = (&ws.load, world.model().free_of_node());
    let movable = patch.skin().movable();
    for k in 0..patch.len() {
        let node = patch.skin().nodes()[k] as usize;
        let at = 3 * free[node] as usize;
        let loaded = load.get(at..at.saturating_add(3)).filter(|_| k < movable);
        patch.force_mut()[k] = loaded.map_or(Vector3::zeros(), Vector3::from_column_slice);
    }
    for k in 0..patch.len() {
        let node = patch.skin().nodes()[k] as usize;
        patch.q_free_mut()[k] = state.fem.q[node];
    }
    patch.relieve();
}

/// A square matrix by columns.
fn square(w: &mut [f64], n: usize) -> DMatrixViewMut<'_, f64> {
    DMatrixViewMut::from_slice(w, n, n)
}

#[cfg(test)]
mod tests;
