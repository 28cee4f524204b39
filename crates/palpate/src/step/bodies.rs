//! The part of fixed and rigid bodies in a step: their contacts, rows and warm start. Their motion is in `rigid`.
//!
//! A contact between tissue and such a body has two sides in one row: nodes of the tissue and the twist of the body
//! ([`palpate_constraints::rows`]). `W` is the sum over all bodies ([`palpate_constraints::body`]), each with its own `A`:
//! `h² M⁻¹` for a rigid one, nothing for a fixed one. The rows of the tool come first, on the skin and then on rigid bodies,
//! so that what the tick needs is the leading block of the problem; towards the tick the other contacts keep the forces
//! that the step found for them.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::contact::ContactSet;
use palpate_collision::solid_contact::{Placed, meet};
use palpate_collision::tool::{Jaw, ToolPose};
use palpate_collision::{Solid, detect_solid};
use palpate_constraints::law::Law;
use palpate_constraints::rows::{Counterpart, RowInput, RowReport, ToolMotion, append_rows, append_solid_rows};
use palpate_rigid::RigidState;

use super::pair_state::PairContacts;
use super::{StepReport, StepState, StepWorkspace};
use crate::world::{Far, MOST_PAIRS, Near, World};

/// Contacts of fixed and rigid bodies in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodiesReport {
    /// Contacts found.
    pub contacts: u32,
    /// Those that carry a force.
    pub active: u32,
    /// Contacts that found no room.
    pub dropped: u32,
    /// Contacts of bodies that the tick solves with those of the skin.
    pub handed_over: u32,
    /// Contacts for which there was no room among them: the tick does without.
    pub left_to_step: u32,
    /// Those of them that are the tool's with rigid bodies, of which the tick has the deepest.
    pub left_of_tool: u32,
    /// Numbers that are not finite, in poses or surfaces.
    pub non_finite: u32,
    /// Least gap at the begin of the step (m); infinite without contacts.
    pub deepest_gap: f64,
    /// Digest of where the rigid bodies are at the end of the step, to the bit; 0 without them.
    pub digest: u64,
}

impl BodiesReport {
    /// No contact.
    pub const NONE: Self = Self {
        contacts: 0,
        active: 0,
        dropped: 0,
        handed_over: 0,
        left_to_step: 0,
        left_of_tool: 0,
        non_finite: 0,
        deepest_gap: f64::INFINITY,
        digest: 0,
    };
}

/// What the contacts of one pair of bodies did in the last step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairForce {
    /// Contacts with rows.
    pub contacts: usize,
    /// Those that carry a force.
    pub active: usize,
    /// Sum of the normal forces (N).
    pub normal: f64,
    /// Force on the body that the normals point to (N); the other gets the opposite.
    pub force: Vector3<f64>,
}

/// What the pair `k` of [`Bodies::pairs`](crate::world::Bodies) did in the last step; none where there is no such pair.
pub(super) fn pair_force(ws: &StepWorkspace, k: usize) -> Option<PairForce> {
    let blocks = ws.rigid.blocks.get(k)?.clone();
    let mut sum = PairForce { contacts: blocks.len(), active: 0, normal: 0.0, force: Vector3::zeros() };
    for (block, frame) in ws.rows.blocks.get(blocks.clone())?.iter().zip(ws.rows.frames.get(blocks)?) {
        let force = ws.lambda.get(block.range()).filter(|force| force[0] > 0.0);
        let Some(force) = force else { continue };
        sum.active += 1;
        sum.normal += force[0];
        sum.force += frame.to_world(force);
    }
    Some(sum)
}

/// Shape and place of a body that is not soft; for the tool its pose of the step's end.
pub(super) fn placed<'a>(
    world: &'a World,
    rigid: &[RigidState],
    far: Far,
    tool: &ToolPose,
) -> Option<(&'a Solid, Isometry3<f64>)> {
    match far {
        Far::Tool(part) => Some((world.tool_solid(part)?, world.tool().part_pose(part, tool))),
        Far::Fixed(k) => world.bodies().fixed.get(k).map(|body| (&body.solid, body.pose)),
        Far::Rigid(k) => {
            let body = world.bodies().rigid.get(k)?;
            Some((&body.solid, body.shape_pose(rigid.get(k)?)))
        }
    }
}

/// Contacts of all pairs at the begin of the step, on the surface that is refitted already.
pub(super) fn detection(
    world: &World,
    tool: &ToolPose,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    report.bodies = BodiesReport::NONE;
    let (q, rigid) = (&state.fem.q, &state.rigid);
    let total = &mut report.bodies;
    for (pair, found) in world.bodies().pairs.iter().zip(&mut state.pairs) {
        let Some((far, far_pose)) = placed(world, rigid, pair.far, tool) else { continue };
        match (&mut found.contacts, pair.near) {
            (PairContacts::Tissue(contacts), _) => {
                let seen = detect_solid(&ws.geometry, q, far, &far_pose, &pair.detection, &mut ws.detection, contacts);
                total.contacts += seen.contacts as u32;
                total.dropped += seen.dropped as u32;
                total.non_finite += seen.non_finite as u32;
                total.deepest_gap = total.deepest_gap.min(seen.deepest_gap);
            }
            (PairContacts::Solids(contacts), Near::Rigid(k)) => {
                let Some((near, near_pose)) = placed(world, rigid, Far::Rigid(k), tool) else { continue };
                let near = Placed { solid: near, pose: &near_pose };
                let seen = meet(near, Placed { solid: far, pose: &far_pose }, &pair.detection, contacts);
                total.contacts += seen.contacts as u32;
                total.dropped += seen.dropped as u32;
                total.non_finite += u32::from(seen.non_finite);
                total.deepest_gap = contacts.iter().fold(total.deepest_gap, |least, c| least.min(c.gap));
            }
            (PairContacts::Solids(_), Near::Soft | Near::Fixed(_)) => {}
        }
    }
}

/// Appends the rows of all pairs to those of the tool.
pub(super) fn rows(
    world: &World,
    tool: &ToolPose,
    motion: &ToolMotion,
    state: &StepState,
    ws: &mut StepWorkspace,
) -> RowReport {
    let mut report = RowReport::default();
    ws.rigid.skin_blocks = ws.rows.blocks.len();
    ws.rigid.tool_blocks = ws.rigid.skin_blocks;
    ws.rigid.blocks.clear();
    for (pair, found) in world.bodies().pairs.iter().zip(&state.pairs) {
        let from = ws.rows.blocks.len();
        let counterpart = match pair.far {
            Far::Tool(part) => {
                let motion = motion.of(world.tool().parts().get(part).and_then(|part| part.jaw));
                Some(Counterpart::Tool { reference: tool.frame.translation.vector, motion })
            }
            Far::Fixed(_) => Some(Counterpart::Fixed),
            Far::Rigid(k) => ws.rigid.side(k, &state.rigid).map(Counterpart::Rigid),
        };
        let near = match pair.near {
            Near::Soft | Near::Fixed(_) => None,
            Near::Rigid(k) => ws.rigid.side(k, &state.rigid),
        };
        let friction = pair.law.rows() > 1;
        report = report.and(match (&found.contacts, counterpart, near) {
            (PairContacts::Tissue(set), Some(counterpart), _) => {
                let free_of_node = world.model().free_of_node();
                let input = RowInput { free_of_node, v_free: &ws.v_free, dt: ws.dt, counterpart, friction };
                append_rows(&set.contacts, &input, &mut ws.rows)
            }
            (PairContacts::Solids(contacts), Some(counterpart), Some(near)) => {
                append_solid_rows(contacts, &near, &counterpart, ws.dt, friction, &mut ws.rows)
            }
            _ => RowReport::default(),
        });
        let to = ws.rows.blocks.len();
        ws.rigid.blocks.push(from..to);
        if matches!(pair.far, Far::Tool(_)) {
            ws.rigid.tool_blocks = to;
        }
    }
    report
}

/// Pushes the law of every block, in their order.
pub(super) fn push_laws(world: &World, of_tool: Law, ws: &mut StepWorkspace) {
    (0..ws.rigid.skin_blocks).for_each(|_| ws.problem.push_block(of_tool));
    for (pair, blocks) in world.bodies().pairs.iter().zip(&ws.rigid.blocks) {
        blocks.clone().for_each(|_| ws.problem.push_block(pair.law));
    }
}

/// How the tick knows a contact of a pair: with the pair's number in the bits that features leave free.
pub(super) fn identity(feature: u64, pair: usize) -> u64 {
    feature | (pair as u64 % MOST_PAIRS as u64) << 52
}

/// Law and identity of a block of the tool on a rigid body, as the tick knows contacts.
pub(super) fn tool_block(world: &World, state: &StepState, ws: &StepWorkspace, block: usize) -> Option<(Law, u64)> {
    let pair = ws.rigid.blocks.iter().position(|blocks| blocks.contains(&block))?;
    let contact = ws.rows.blocks.get(block)?.contact as usize;
    let PairContacts::Solids(contacts) = &state.pairs.get(pair)?.contacts else { return None };
    Some((world.bodies().pairs.get(pair)?.law, identity(contacts.get(contact)?.feature, pair)))
}

/// Block of the contact of pair `k` on this feature, and its force (N) on what its normal points to, in the world; none
/// without force.
pub(super) fn force_of(state: &StepState, ws: &StepWorkspace, k: usize, feature: u64) -> Option<(usize, Vector3<f64>)> {
    let contacts = &state.pairs.get(k)?.contacts;
    let is_of = |contact: u32| match contacts {
        PairContacts::Tissue(set) => set.contacts.get(contact as usize).is_some_and(|c| c.feature == feature),
        PairContacts::Solids(contacts) => contacts.get(contact as usize).is_some_and(|c| c.feature == feature),
    };
    let block = ws.rigid.blocks.get(k)?.clone().find(|&b| ws.rows.blocks.get(b).is_some_and(|b| is_of(b.contact)))?;
    let force = ws.lambda.get(ws.rows.blocks.get(block)?.range()).filter(|force| force[0] > 0.0)?;
    Some((block, ws.rows.frames.get(block)?.to_world(force)))
}

/// Notes the side from which the tissue came to the other body of pair `k`.
pub(super) fn recall_sides(state: &StepState, k: usize, set: &mut ContactSet) {
    if let Some(PairContacts::Tissue(known)) = state.pairs.get(k).map(|pair| &pair.contacts) {
        set.side = known.side;
    }
}

/// The jaw of the tool that a block on a rigid body is of.
pub(super) fn tool_jaw(world: &World, ws: &StepWorkspace, block: usize) -> Option<Jaw> {
    let pair = ws.rigid.blocks.iter().position(|blocks| blocks.contains(&block))?;
    let Far::Tool(part) = world.bodies().pairs.get(pair)?.far else { return None };
    world.tool().parts().get(part)?.jaw
}

/// First guesses of the forces of all pairs; a contact may have slid by `radius` (m).
pub(super) fn fetch(state: &mut StepState, ws: &mut StepWorkspace, radius: f64) {
    let m = ws.rows.len();
    for (pair, blocks) in state.pairs.iter_mut().zip(&ws.rigid.blocks) {
        let (warm, lambda) = (&mut pair.warm_start, &mut ws.lambda[..m]);
        match &pair.contacts {
            PairContacts::Tissue(set) => warm.fetch(&set.contacts, &ws.rows, blocks.clone(), radius, lambda),
            PairContacts::Solids(contacts) => warm.fetch(contacts, &ws.rows, blocks.clone(), radius, lambda),
        };
    }
}

/// Remembers the forces of all pairs, counts those that act, and finds the gaps that they leave to the tool.
pub(super) fn store(state: &mut StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let m = ws.rows.len();
    let lambda = &ws.lambda[..m];
    report.bodies.active = 0;
    for (pair, blocks) in state.pairs.iter_mut().zip(&ws.rigid.blocks) {
        let warm = &mut pair.warm_start;
        match &pair.contacts {
            PairContacts::Tissue(set) => warm.store(&set.contacts, &ws.rows, blocks.clone(), lambda),
            PairContacts::Solids(contacts) => warm.store(contacts, &ws.rows, blocks.clone(), lambda),
        };
        let of_pair = ws.rows.blocks.get(blocks.clone()).unwrap_or(&[]);
        let acts = |first: u32| lambda.get(first as usize).is_some_and(|normal| *normal > 0.0);
        report.bodies.active += of_pair.iter().filter(|block| acts(block.first_row)).count() as u32;
    }
    let of_tool = ws.tool_rows();
    ws.rigid.tool_delta.clear();
    ws.rigid.tool_delta.extend_from_slice(ws.rows.delta_free.get(..of_tool).unwrap_or(&[]));
    let view = ws.problem.view();
    for (j, l) in lambda.iter().enumerate().skip(of_tool).filter(|(_, l)| **l != 0.0) {
        ws.rigid.tool_delta.iter_mut().zip(view.column(j)).for_each(|(delta, w)| *delta += w * l);
    }
}
