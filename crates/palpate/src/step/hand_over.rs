//! What the step hands to the tick.

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_collision::tool::jaw_of;
use palpate_constraints::law::Law;
use palpate_constraints::rows::{ContactRows, RowBlock};
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};

use super::bodies::{tool_block, tool_jaw};
use super::stages::is_of_another_body;
use super::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, patch};
use crate::world::World;

/// The local problem for the tick: the tool's rows, compliance and forces as they were solved, and the tissue around the
/// tool. `before` is the tool's pose in the step before.
pub(super) fn hand_over(
    world: &World,
    input: &StepInput<'_>,
    before: Option<&ToolPose>,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    snapshot: &mut HapticSnapshot,
) {
    snapshot.clear();
    // The tick takes number 0 for "no step yet".
    snapshot.step = report.step + 1;
    snapshot.time = input.time + world.dt();
    (snapshot.dt, snapshot.numbering) = (ws.dt, state.cuts);
    (snapshot.tool_pose, snapshot.opening) = (input.tool.frame, input.tool.opening);
    snapshot.factor_epoch = input.factor.epoch;
    snapshot.factor_age = report.factor_age;
    let sound = report.status == StepStatus::Advanced && report.compliance.usable;
    if !sound {
        return;
    }
    ws.obstacles.find(world, input, before, report);
    snapshot.valid = push_rows(world, state, ws, snapshot);
    gripper_rows(world, &input.tool, ws, snapshot);
    if snapshot.valid && snapshot.patch.max_nodes() > 0 && !is_of_another_body(ws, report) {
        patch::fill(world, input, before, state, ws, report, &mut snapshot.patch);
    }
}

/// Pushes all contacts of the tool, with their compliance; false where one on the skin found no room.
fn push_rows(world: &World, state: &StepState, ws: &StepWorkspace, snapshot: &mut HapticSnapshot) -> bool {
    let law = world.description().contact.contact_law();
    let contacts = &state.contacts.contacts;
    let of_skin = |block: &RowBlock| Some((law, contacts.get(block.contact as usize)?.feature));
    let (rigid, rows) = (&ws.rigid, &ws.rows);
    let all = (0..rigid.skin_blocks).all(|k| push(rows, k, &rigid.tool_delta, &ws.lambda, of_skin, snapshot));
    // A tick without room for rigid bodies goes on without them, and counts what it misses; what never yields comes first.
    let (fixed, obstacles) = (&ws.fixed_rows, &ws.obstacles);
    let kept = fixed.blocks.len() + obstacles.rows.blocks.len();
    let room = snapshot.max_contacts().saturating_sub(snapshot.contacts() + kept);
    let on_rigid = |k: usize| move |_: &RowBlock| tool_block(world, state, ws, k);
    let (first, end) = (rigid.skin_blocks, rigid.tool_blocks.min(rigid.skin_blocks + room));
    let _ = (first..end).all(|k| push(rows, k, &rigid.tool_delta, &ws.lambda, on_rigid(k), snapshot));
    snapshot.dropped += (rigid.tool_blocks - end) as u32;
    let m = snapshot.rows();
    // What gives way to nothing has rows and columns of zeros in W: the tick adds the compliance of the coupling.
    let all = all && (0..fixed.blocks.len()).all(|k| push(fixed, k, &fixed.delta_free, &[], of_skin, snapshot));
    let (walls, on_wall) = (&obstacles.rows, |k: usize| move |_: &RowBlock| obstacles.block(k));
    let all = all && (0..walls.blocks.len()).all(|k| push(walls, k, &walls.delta_free, &[], on_wall(k), snapshot));
    if !all {
        return false;
    }
    let (view, n) = (ws.problem.view(), snapshot.rows());
    for (j, column) in snapshot.compliance_mut().chunks_exact_mut(n.max(1)).enumerate() {
        column.fill(0.0);
        if j < m {
            column[..m].copy_from_slice(&view.column(j)[..m]);
        }
    }
    true
}

/// What each row does to the opening of the jaws: by the jaw of its contact, the torque of the tool's part of the row.
fn gripper_rows(world: &World, tool: &ToolPose, ws: &StepWorkspace, snapshot: &mut HapticSnapshot) {
    let Some(hinge) = world.tool().hinge() else { return };
    let reference = tool.frame.translation.vector;
    for k in 0..snapshot.contacts() {
        let (block, feature) = (snapshot.blocks()[k], snapshot.features()[k]);
        let on_rigid = (ws.rigid.skin_blocks..ws.rigid.tool_blocks).contains(&k);
        // Walls come last.
        let walls = snapshot.contacts() - ws.obstacles.rows.blocks.len().min(snapshot.contacts());
        let jaw = match k.checked_sub(walls) {
            Some(k) => ws.obstacles.jaw(k),
            None if on_rigid => tool_jaw(world, ws, k),
            None => jaw_of(feature),
        };
        for row in block.start..block.start + block.law.rows() {
            let Some([fx, fy, fz, tx, ty, tz]) = snapshot.tool_rows().get(row).copied() else { continue };
            let (force, torque) = (Vector3::new(fx, fy, fz), Vector3::new(tx, ty, tz));
            let rate = hinge.torque(tool, jaw, &reference, &force, &torque);
            if let Some(to) = snapshot.gripper_rows_mut().get_mut(row) {
                *to = rate;
            }
        }
    }
}

/// Pushes the contact of block `k`, whose law and identity `identity` knows, with zero force where `lambda` has none; false
/// where it found no room.
fn push(
    rows: &ContactRows,
    k: usize,
    delta_free: &[f64],
    lambda: &[f64],
    identity: impl Fn(&RowBlock) -> Option<(Law, u64)>,
    snapshot: &mut HapticSnapshot,
) -> bool {
    let Some(block) = rows.blocks.get(k) else { return false };
    let range = block.range();
    let mut tool_rows = [[0.0; 6]; 3];
    let count = range.len().min(tool_rows.len());
    for (to, from) in tool_rows.iter_mut().zip(&rows.tool[range.clone()]) {
        *to = [from.force.x, from.force.y, from.force.z, from.torque.x, from.torque.y, from.torque.z];
    }
    let (Some((law, feature)), Some(delta_free)) = (identity(block), delta_free.get(range.clone())) else {
        return false;
    };
    snapshot.push(&SnapshotContact {
        law,
        feature,
        tool_rows: &tool_rows[..count],
        delta_free,
        lambda: lambda.get(range).unwrap_or(&[0.0; 3][..count]),
    })
}
