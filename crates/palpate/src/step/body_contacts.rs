//! Contacts of fixed and rigid bodies that the tick is to solve: tissue and rigid bodies at walls, and the tool at both.
//!
//! They are found anew where the step has left everything, as far as tissue and tool may get until two more steps have passed:
//! so a wall that is met between two steps is there. Their forces are those of the step's contacts of the same name.
//!
//! There is room for [`BODY_CONTACTS`] that yield. The tool's come first, those that press most and then the deepest; of the
//! others the deepest have what room is left. What finds none is counted.
//!
//! A wall that presses and goes on pressing is condensed into the compliance of the patch, as contacts between two bodies that
//! move are. With such walls as rows of their own the sweeps of a tick would have to find out again how stiff a body on a table
//! is, whose compliance without the table is that of its mass: measured, 700 sweeps where there is time for 30, and a tick that
//! pulls at a block which the step presses down. So the walls of the tick are those that tissue is about to meet or to leave:
//! those without force, and those whose force, going on as from the step before to this one, ends within [`STEPS`] more.

use std::cmp::Ordering;

use nalgebra::{Matrix3, Vector3};
use palpate_collision::contact::ContactSet;
use palpate_collision::detect_solid;
use palpate_collision::detection::DetectionConfig;
use palpate_collision::solid_contact::{Placed, SolidContact, meet};
use palpate_collision::tool::Jaw;
use palpate_constraints::law::Law;
use palpate_constraints::rows::{
    ContactRows, Counterpart, RigidSide, RowBlock, RowInput, ToolMotion, ToolRow, Twist, append_rows, append_solid_rows,
};
use palpate_haptics::body_contact::{BodyContact, ToolPart};
use palpate_haptics::patch::HapticPatch;

use super::bodies::{force_of, identity, placed};
use super::{StepInput, StepReport, StepState, StepWorkspace};
use crate::world::{Far, Near, Pair, World};

/// Most contacts of bodies in a patch that yield: 72 rows beside those of the skin.
pub(crate) const BODY_CONTACTS: usize = 24;

/// Steps for which the forces of walls are foretold: until a snapshot is replaced.
const STEPS: f64 = 2.0;

/// One that was found.
#[derive(Clone, Copy)]
struct Found {
    /// Number of the pair, and of the block in `rows`.
    pair: usize,
    block: usize,
    feature: u64,
    gap: f64,
    /// Block of the step where it carries force, and that force in the world (N).
    step: Option<usize>,
    force: Vector3<f64>,
}

/// Memory for them.
pub(super) struct BodyContactStage {
    room: usize,
    skin: ContactSet,
    solids: Vec<SolidContact>,
    pub(super) rows: ContactRows,
    found: Vec<Found>,
    /// Forces (N) of the walls in this step and in the step before, by their names.
    now: Vec<(u64, f64)>,
    before: Vec<(u64, f64)>,
    /// How many of `found` are kept, from the first.
    count: usize,
}

impl BodyContactStage {
    pub(super) fn new(world: &World) -> Self {
        let pairs = || world.bodies().pairs.iter().filter(|pair| is_seen(pair));
        let all = pairs().map(|pair| pair.detection.max_contacts).sum();
        let most = pairs().map(|pair| pair.detection.max_contacts).max().unwrap_or(0);
        Self {
            room: world.yielding_contacts(),
            skin: ContactSet::with_capacity(most),
            solids: Vec::with_capacity(most),
            rows: ContactRows::with_capacity(all),
            found: Vec::with_capacity(all),
            now: Vec::with_capacity(all),
            before: Vec::with_capacity(all),
            count: 0,
        }
    }

    /// Finds them around the end of the step. `reach` (m): how far things may get. Where the tool has nothing but walls in
    /// reach, `skin` being none of it, nothing of what it does gets to the others.
    pub(super) fn find(
        &mut self,
        world: &World,
        input: &StepInput<'_>,
        (reach, skin): (f64, bool),
        state: &StepState,
        ws: &mut StepWorkspace,
        report: &mut StepReport,
    ) {
        self.rows.clear();
        self.found.clear();
        std::mem::swap(&mut self.now, &mut self.before);
        self.now.clear();
        self.count = 0;
        if self.room == 0 {
            return;
        }
        let mut of_tool = 0;
        for (k, pair) in world.bodies().pairs.iter().enumerate().filter(|(_, pair)| is_seen(pair)) {
            let at_tool = matches!(pair.far, Far::Tool(_));
            if at_tool || skin || of_tool > 0 {
                self.find_pair(world, input, reach, (k, pair), state, ws);
            }
            if at_tool {
                of_tool = self.found.len();
            }
        }
        // The pairs of the tool come first of all.
        let (at_tool, of_walls) = self.found.split_at_mut(of_tool);
        if at_tool.len() > self.room {
            at_tool.sort_unstable_by(by_force);
        }
        of_walls.sort_unstable_by(by_gap);
        self.count = self.found.len().min(self.room);
        report.bodies.left_to_step = (self.found.len() - self.count) as u32;
        report.bodies.left_of_tool = of_tool.saturating_sub(self.room) as u32;
    }

    /// The contacts of one pair, at the end of the step.
    fn find_pair(
        &mut self,
        world: &World,
        input: &StepInput<'_>,
        reach: f64,
        (k, pair): (usize, &Pair),
        state: &StepState,
        ws: &mut StepWorkspace,
    ) {
        let Some((far, far_pose)) = placed(world, &state.rigid, pair.far, &input.tool) else { return };
        let config = DetectionConfig { margin: pair.detection.margin + reach, ..pair.detection };
        let (first, friction) = (self.rows.blocks.len(), pair.law.rows() > 1);
        let counterpart = match pair.far {
            Far::Tool(_) => {
                let reference = input.tool.frame.translation.vector;
                Counterpart::Tool { reference, motion: ToolMotion::none() }
            }
            _ => Counterpart::Fixed,
        };
        match pair.near {
            Near::Soft => {
                let (q, found) = (&state.fem.q, &mut self.skin);
                found.clear();
                super::bodies::recall_sides(state, k, found);
                detect_solid(&ws.geometry, q, far, &far_pose, &config, &mut ws.detection, found);
                let free_of_node = world.model().free_of_node();
                let input = RowInput { free_of_node, v_free: &ws.v_free, dt: ws.dt, counterpart, friction };
                append_rows(&found.contacts, &input, &mut self.rows);
            }
            Near::Rigid(body) => {
                let near = placed(world, &state.rigid, Far::Rigid(body), &input.tool);
                let (Some((near, near_pose)), Some(at)) = (near, state.rigid.get(body)) else { return };
                let centre = at.pose.translation.vector;
                let side = RigidSide { body: body as u32, centre, free: Twist::default() };
                let (near, far) = (Placed { solid: near, pose: &near_pose }, Placed { solid: far, pose: &far_pose });
                meet(near, far, &config, &mut self.solids);
                append_solid_rows(&self.solids, &side, &counterpart, ws.dt, friction, &mut self.rows);
            }
            Near::Fixed(_) => {}
        }
        for (block, at) in self.rows.blocks.iter().enumerate().skip(first) {
            let index = at.contact as usize;
            let known = match pair.near {
                Near::Soft => self.skin.contacts.get(index).map(|contact| (contact.feature, contact.gap)),
                _ => self.solids.get(index).map(|contact| (contact.feature, contact.gap)),
            };
            let Some((feature, gap)) = known else { continue };
            let (name, carried) = (identity(feature, k), force_of(state, ws, k, feature));
            let (step, force) = carried.map_or((None, Vector3::zeros()), |(step, force)| (Some(step), force));
            let before = self.before.iter().find(|(known, _)| *known == name).map_or(0.0, |(_, force)| *force);
            let normal = force.norm();
            if normal > 0.0 && self.now.len() < self.now.capacity() {
                self.now.push((name, normal));
            }
            if matches!(pair.far, Far::Tool(_)) || normal + STEPS * (normal - before) <= 0.0 {
                self.found.push(Found { pair: k, block, feature: name, gap, step, force });
            }
        }
    }

    /// Rows of those that are kept, in their order.
    pub(super) fn blocks(&self) -> impl Iterator<Item = &RowBlock> {
        self.found.iter().take(self.count).filter_map(|found| self.rows.blocks.get(found.block))
    }

    /// Whether a block of the step that carries force is one of them.
    pub(super) fn keeps(&self, block: usize) -> bool {
        self.found.iter().take(self.count).any(|found| found.step == Some(block))
    }

    /// Those that are kept, as the tick has them, at the end of the step.
    pub(super) fn contacts(&self, world: &World, input: &StepInput<'_>) -> impl Iterator<Item = BodyContact> {
        self.found.iter().take(self.count).filter_map(move |found| {
            let pair = world.bodies().pairs.get(found.pair)?;
            let jaw = match pair.far {
                Far::Tool(part) => Some(world.tool().parts().get(part).and_then(|part| part.jaw)),
                _ => None,
            };
            let (law, feature) = (pair.law, found.feature);
            let contact = contact(world, input, &self.rows, found.block, (law, feature, found.gap), jaw)?;
            Some(BodyContact { force: contact.frame.tr_mul(&found.force), ..contact })
        })
    }
}

/// By gap, and by name where two are as deep.
fn by_gap(a: &Found, b: &Found) -> Ordering {
    a.gap.total_cmp(&b.gap).then(a.pair.cmp(&b.pair)).then(a.feature.cmp(&b.feature))
}

/// By force, then by gap: all that carry a force are as deep, to the tolerance of the solver, and what those carry that are
/// left out is missing at the hand.
fn by_force(a: &Found, b: &Found) -> Ordering {
    b.force.norm_squared().total_cmp(&a.force.norm_squared()).then_with(|| by_gap(a, b))
}

/// Whether the tick has the contacts of a pair.
fn is_seen(pair: &Pair) -> bool {
    matches!((pair.near, pair.far), (Near::Soft | Near::Rigid(_), Far::Fixed(_)) | (Near::Rigid(_), Far::Tool(_)))
}

/// Most contacts of bodies that yield in a patch.
pub(crate) fn capacity(pairs: &[Pair]) -> usize {
    pairs.iter().filter(|pair| is_seen(pair)).map(|pair| pair.detection.max_contacts).sum::<usize>().min(BODY_CONTACTS)
}

/// Contacts of bodies at the end of the step, those that yield first; false where one found no room.
pub(super) fn push_bodies(
    world: &World,
    input: &StepInput<'_>,
    ws: &StepWorkspace,
    stage: &BodyContactStage,
    patch: &mut HapticPatch,
) -> bool {
    let yielding = stage.contacts(world, input).all(|contact| patch.bodies.push(contact, true));
    let walls = &ws.obstacles.rows;
    yielding
        && (0..walls.blocks.len()).all(|k| {
            let gap = walls.blocks.get(k).and_then(|block| walls.delta_free.get(block.first_row as usize));
            let (Some((law, feature)), Some(&gap)) = (ws.obstacles.block(k), gap) else { return false };
            let contact = contact(world, input, walls, k, (law, feature, gap), Some(ws.obstacles.jaw(k)));
            contact.is_some_and(|contact| patch.bodies.push(contact, false))
        })
}

/// A block of rows as the tick has it, without force. `jaw`: of the tool, where it is a part of the contact.
fn contact(
    world: &World,
    input: &StepInput<'_>,
    rows: &ContactRows,
    block: usize,
    (law, feature, gap): (Law, u64, f64),
    jaw: Option<Option<Jaw>>,
) -> Option<BodyContact> {
    let directions = rows.frames.get(block)?.directions();
    let of_tool = rows.tool.get(rows.blocks.get(block)?.range())?;
    let tool = jaw.map(|jaw| {
        let reference = &input.tool.frame.translation.vector;
        // r = Σ d x (r x d) / 2 over a whole frame; a normal alone gives what acts of r.
        let share = if of_tool.len() > 1 { 0.5 } else { 1.0 };
        let lever = directions.iter().zip(of_tool).map(|(d, row)| -d.cross(&row.torque) * share).sum();
        let opens = world.tool().hinge().map_or(Vector3::zeros(), |hinge| {
            let rate = |row: &ToolRow| hinge.torque(&input.tool, jaw, reference, &row.force, &row.torque);
            directions.iter().zip(of_tool).map(|(d, row)| -d * rate(row)).sum()
        });
        ToolPart { lever, opens }
    });
    Some(BodyContact {
        feature,
        law,
        frame: Matrix3::from_columns(&directions),
        tool,
        gap,
        free: Vector3::new(gap, 0.0, 0.0),
        drift: Vector3::zeros(),
        flow: Vector3::zeros(),
        force: Vector3::zeros(),
    })
}
