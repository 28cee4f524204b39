//! The rows whose compliance a patch carries: three for each contact of bodies that yields and for each node, then those
//! that are held.

use nalgebra::Vector3;
use palpate_collision::patch::SkinPatch;
use palpate_constraints::rows::{ContactRows, ToolRow};

use super::PatchStage;
use crate::step::StepWorkspace;

impl PatchStage {
    /// Rows of the contacts of bodies that yield.
    pub(super) fn push_bodies(&mut self) {
        let (from, rows) = (&self.bodies.rows, &mut self.rows);
        for block in self.bodies.blocks() {
            for r in block.range() {
                push(rows, from, r);
            }
            // A contact has three coordinates in C; without friction nothing acts along two.
            for _ in block.range().len()..3 {
                rows.tissue.push_row([]);
                rows.rigid.push_row([]);
                push_no_tool(rows);
            }
        }
    }

    /// Rows of the nodes that can move, of which `free` are the numbers among the unknowns.
    pub(super) fn push_nodes(&mut self, free: &[u32], skin: &SkinPatch) {
        let rows = &mut self.rows;
        for &node in &skin.nodes()[..skin.movable()] {
            for k in 0..3 {
                rows.tissue.push_row([(free[node as usize], Vector3::ith(k, 1.0))]);
                rows.rigid.push_row([]);
                push_no_tool(rows);
            }
        }
    }

    /// Rows of the step that are closed, do not touch the tool, and are no part of the patch; as many as have room.
    pub(super) fn push_held(&mut self, ws: &StepWorkspace) {
        let laws = ws.problem.view().blocks;
        for (k, block) in ws.rows.blocks.iter().enumerate().skip(ws.rigid.tool_blocks) {
            let Some(force) = ws.lambda.get(block.range()).filter(|force| force[0] > 0.0 && !self.bodies.keeps(k))
            else {
                continue;
            };
            let force = Vector3::from_fn(|i, _| force.get(i).copied().unwrap_or(0.0));
            let sticks = laws.get(k).is_none_or(|block| block.law.sticks(&force));
            let held = block.range().take(if sticks { block.range().len() } else { 1 });
            if self.rows.len() + held.len() <= self.max_rows {
                for r in held {
                    push(&mut self.rows, &ws.rows, r);
                }
            }
        }
    }
}

/// Copies row `r`.
fn push(rows: &mut ContactRows, from: &ContactRows, r: usize) {
    rows.tissue.push_row(from.tissue.row(r));
    rows.rigid.push_row(from.rigid.row(r).iter().copied());
    push_no_tool(rows);
}

/// The tool's part of a row that it does not touch, and a gap: compliance asks for neither.
pub(super) fn push_no_tool(rows: &mut ContactRows) {
    rows.tool.push(ToolRow { force: Vector3::zeros(), torque: Vector3::zeros() });
    rows.delta_free.push(0.0);
}
