//! What the step hands to the tick.

use nalgebra::Isometry3;
use palpate_constraints::rows::ContactRows;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};

use super::stages::contact_law;
use super::{StepInput, StepReport, StepState, StepStatus, StepWorkspace, patch};
use crate::world::World;

/// The local problem for the tick: rows, compliance and forces as they were solved, and the tissue around the tool.
/// `before` is the tool's pose in the step before.
pub(super) fn hand_over(
    world: &World,
    input: &StepInput<'_>,
    before: Option<&Isometry3<f64>>,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    snapshot: &mut HapticSnapshot,
) {
    snapshot.clear();
    // The tick takes number 0 for "no step yet".
    snapshot.step = report.step + 1;
    snapshot.time = input.time + world.dt();
    snapshot.dt = ws.dt;
    snapshot.tool_pose = input.tool;
    snapshot.factor_epoch = input.factor.epoch;
    snapshot.factor_age = report.factor_age;
    let sound = report.status == StepStatus::Advanced && report.compliance.usable;
    if !sound {
        return;
    }
    let m = ws.rows.len();
    let lambda = ws.lambda.get(..m).unwrap_or(&[]);
    let of_tissue = push_rows(world, &ws.rows, lambda, state, snapshot);
    // Fixed skin gives way to nothing: its rows and columns of W are zero, and the tick adds the compliance of the tool.
    let all = of_tissue && push_rows(world, &ws.fixed_rows, &[], state, snapshot);
    let view = ws.problem.view();
    let n = snapshot.rows();
    if all && n == m + ws.fixed_rows.len() {
        for (j, column) in snapshot.compliance_mut().chunks_exact_mut(n.max(1)).enumerate() {
            column.fill(0.0);
            if j < m {
                column[..m].copy_from_slice(view.column(j));
            }
        }
        snapshot.valid = true;
    }
    if snapshot.valid && snapshot.patch.max_nodes() > 0 {
        patch::fill(world, input, before, state, ws, report, &mut snapshot.patch);
    }
}

/// Pushes all contacts that have rows, with zero force where `lambda` has none; false where one found no room.
fn push_rows(
    world: &World,
    rows: &ContactRows,
    lambda: &[f64],
    state: &StepState,
    snapshot: &mut HapticSnapshot,
) -> bool {
    rows.blocks.iter().all(|block| {
        let range = block.range();
        let mut tool_rows = [[0.0; 6]; 3];
        let count = range.len().min(tool_rows.len());
        for (to, from) in tool_rows.iter_mut().zip(&rows.tool[range.clone()]) {
            *to = [from.force.x, from.force.y, from.force.z, from.torque.x, from.torque.y, from.torque.z];
        }
        let Some(contact) = state.contacts.contacts.get(block.contact as usize) else { return false };
        snapshot.push(&SnapshotContact {
            law: contact_law(world),
            feature: contact.feature,
            tool_rows: &tool_rows[..count],
            delta_free: &rows.delta_free[range.clone()],
            lambda: lambda.get(range).unwrap_or(&[0.0; 3][..count]),
        })
    })
}
