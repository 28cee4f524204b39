//! What the step hands to the tick.

use palpate_constraints::rows::ContactRows;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};

use super::{StepInput, StepReport, StepState, StepStatus, StepWorkspace};
use crate::world::World;

/// The local problem for the tick: rows, compliance and forces as they were solved.
pub(super) fn hand_over(
    world: &World,
    input: &StepInput<'_>,
    state: &StepState,
    ws: &StepWorkspace,
    report: &StepReport,
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
    let m = ws.tool_rows();
    let lambda = ws.lambda.get(..m).unwrap_or(&[]);
    let of_tissue = push_rows(world, &ws.rows, ws.rigid.tool_blocks, &ws.rigid.tool_delta, lambda, state, snapshot);
    // Fixed skin gives way to nothing: its rows and columns of W are zero, and the tick adds the compliance of the tool.
    let fixed = &ws.fixed_rows;
    let all = of_tissue && push_rows(world, fixed, fixed.blocks.len(), &fixed.delta_free, &[], state, snapshot);
    let view = ws.problem.view();
    let n = snapshot.rows();
    if all && n == m + ws.fixed_rows.len() {
        for (j, column) in snapshot.compliance_mut().chunks_exact_mut(n.max(1)).enumerate() {
            column.fill(0.0);
            if j < m {
                column[..m].copy_from_slice(&view.column(j)[..m]);
            }
        }
        snapshot.valid = true;
    }
}

/// Pushes the first `blocks` contacts that have rows, with zero force where `lambda` has none; false where one found no
/// room.
fn push_rows(
    world: &World,
    rows: &ContactRows,
    blocks: usize,
    delta_free: &[f64],
    lambda: &[f64],
    state: &StepState,
    snapshot: &mut HapticSnapshot,
) -> bool {
    rows.blocks.iter().take(blocks).all(|block| {
        let range = block.range();
        let mut tool_rows = [[0.0; 6]; 3];
        let count = range.len().min(tool_rows.len());
        for (to, from) in tool_rows.iter_mut().zip(&rows.tool[range.clone()]) {
            *to = [from.force.x, from.force.y, from.force.z, from.torque.x, from.torque.y, from.torque.z];
        }
        let Some(contact) = state.contacts.contacts.get(block.contact as usize) else { return false };
        let Some(delta_free) = delta_free.get(range.clone()) else { return false };
        snapshot.push(&SnapshotContact {
            law: world.description().contact.contact_law(),
            feature: contact.feature,
            tool_rows: &tool_rows[..count],
            delta_free,
            lambda: lambda.get(range).unwrap_or(&[0.0; 3][..count]),
        })
    })
}
