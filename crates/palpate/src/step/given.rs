//! A step whose contacts are given: for measuring methods side by side on the same rows.

use palpate_constraints::frame::ContactFrame;
use palpate_constraints::rows::{RowBlock, ToolRow};

use super::{StepInput, StepReport, StepState, StepWorkspace, correction, forces, free_motion, stages};
use crate::world::World;

/// A contact of a free node of the skin.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub struct GivenContact {
    /// Number among the free nodes.
    pub node: u32,
    /// Normal into the tissue, and tangents.
    pub frame: ContactFrame,
    /// Gap along each direction of the frame if nothing touched (m).
    pub delta_free: [f64; 3],
}

/// Free motion, compliance, forces and correction as in [`step`](super::step), at contacts in the place of those that the tool
/// would make; cold, without a warm start. The system of the step is assembled in `ws.fem` already.
#[doc(hidden)]
pub fn step_at(
    world: &World,
    input: &StepInput<'_>,
    contacts: &[GivenContact],
    state: &mut StepState,
    ws: &mut StepWorkspace,
) -> StepReport {
    let mut report = StepReport::begin(state.step, input, world.dt());
    ws.pcg.forget();
    ws.iterations_left = world.description().bodies[0].max_iterations;
    state.remember();
    free_motion::free_motion(world, input.factor, state, ws, &mut report);
    rows(world, contacts, ws);
    stages::compliance(world, input.factor, ws, &mut report);
    forces::solve(world, input, state, ws, &mut report);
    correction::correct(world, input.factor, state, ws, &mut report);
    report
}

fn rows(world: &World, contacts: &[GivenContact], ws: &mut StepWorkspace) {
    let law = world.description().contact.contact_law();
    ws.rows.clear();
    ws.rigid.clear_blocks();
    for (k, contact) in contacts.iter().take(world.detection().max_contacts).enumerate() {
        let block = RowBlock { contact: k as u32, first_row: ws.rows.len() as u32, rows: law.rows() as u32 };
        ws.rows.blocks.push(block);
        ws.rows.frames.push(contact.frame);
        for (direction, delta_free) in contact.frame.directions().into_iter().zip(contact.delta_free).take(law.rows()) {
            ws.rows.tissue.push_row([(contact.node, direction)]);
            ws.rows.rigid.push_row([]);
            ws.rows.tool.push(ToolRow::default());
            ws.rows.delta_free.push(delta_free);
        }
    }
    ws.rigid.skin_blocks = ws.rows.blocks.len();
    stages::pose_problem(world, ws);
}
