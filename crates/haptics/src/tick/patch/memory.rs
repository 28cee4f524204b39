//! What a tick on a patch remembers: the shape and the forces of its end, by the names of nodes and features.
//!
//! When a new snapshot comes, forces stay and the shape goes on from where it was and as fast as it was
//! ([`super::creep`]): an offset o is what would else be another shape or another velocity, and it fades,
//! ```text
//! o s(t),   s falls from 1 to 0 within `hand_over`
//! ```
//! so at the first tick of a snapshot shape and forces solve the new problem as they solved the old, whatever changed
//! in q_free *and* in C, and what the new snapshot knows better comes in over a stated time. A time that is over within
//! a tick is none: s is 0 at once, for where each tick has its own snapshot nothing else would ever come in. A node
//! that is new to the patch starts at its place, without force; in a patch that nothing is remembered of, with the
//! force that the step found. The drift d ends where the next step should have come, and so does what it can do in a
//! run whose steps are late.
//!
//! A snapshot is of the tool in the tick before, so the first tick of it is one tick, T, on its way.
//!
//! Where friction holds, step and tick each remember how the tissue lies on the tool, and what they remember drifts
//! apart: ticks slide on between two steps, and steps hold what they find at their begin. The step's tissue lives on,
//! so it is right: with X and q_end tool and shape at the step's end, X' and x the same at the end of the tick before,
//! ```text
//! d = (x − q_end) − (X' − X) p,     p the place of the contact on the tool
//! ```
//! a contact that stuck when the step looked at the tool, and since, is led by `-d` along its tangents as s falls. Then
//! a tool that is where the step had it feels the friction that the step found.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::ToolPose;

use super::PatchWorkspace;
use super::bodies::BodyMemory;
use super::creep::{CreepLaw, Moment, Place, TouchAge};
use super::known::{Known, Owed, STUCK};
use super::node::Node;
use super::rows::Rows;
use crate::patch::HapticPatch;
use crate::wrench::all_finite;

/// Share of the way to the shape of its forces that the place where contacts are found goes in a tick.
const FOLLOWS: f64 = 0.3;

const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// State of ticks on patches, of fixed size.
#[derive(Clone, Debug)]
pub(in crate::tick) struct PatchMemory {
    nodes: Vec<Node>,
    /// f \[N\], one a place: of bodies' contacts that yield, then of nodes.
    force: Vec<Vector3<f64>>,
    count: usize,
    yielding: usize,
    bodies: Vec<BodyMemory>,
    next_bodies: Vec<BodyMemory>,
    max_bodies: usize,
    /// The next of `nodes` and `force`, while a snapshot is taken over.
    next: Vec<Node>,
    next_force: Vec<Vector3<f64>>,
    moved: Vec<Vector3<f64>>,
    sum: Vec<f64>,
    pub(super) contacts: Vec<Known>,
    max_contacts: usize,
    /// The tool at the end of the tick before.
    tool: Option<ToolPose>,
    /// Where the snapshot has the tool, and where it was when the snapshot came.
    led: [ToolPose; 2],
    /// s at the end of the tick before.
    fade: f64,
    /// Time since the snapshot in use was taken over \[s\].
    since: f64,
    /// T: time of the tick \[s\].
    tick: f64,
    /// h: the time that its drift takes \[s\], and β.
    step: f64,
    viscosity: f64,
    /// Age of the touch, and the share of β that it left when the snapshot came.
    touch: TouchAge,
    share: f64,
}

impl PatchMemory {
    pub(in crate::tick) fn new(max_nodes: usize, max_contacts: usize, max_bodies: usize) -> Self {
        let places = max_bodies + max_nodes;
        Self {
            nodes: vec![Node::NEW; max_nodes],
            force: vec![ZERO; places],
            count: 0,
            yielding: 0,
            bodies: Vec::with_capacity(max_bodies),
            next_bodies: Vec::with_capacity(max_bodies),
            max_bodies,
            next: vec![Node::NEW; max_nodes],
            next_force: vec![ZERO; places],
            moved: vec![ZERO; places],
            sum: vec![0.0; 3 * places],
            contacts: Vec::with_capacity(max_contacts),
            max_contacts,
            tool: None,
            led: [Isometry3::identity().into(); 2],
            fade: 0.0,
            since: 0.0,
            tick: 0.0,
            step: 0.0,
            viscosity: 0.0,
            touch: TouchAge::NEW,
            share: 0.0,
        }
    }

    /// Forgets everything.
    pub(in crate::tick) fn forget(&mut self) {
        (self.count, self.yielding) = (0, 0);
        self.bodies.clear();
        self.contacts.clear();
        self.tool = None;
        self.touch = TouchAge::NEW;
    }

    /// Whether the patch is the one whose shape it remembers.
    pub(in crate::tick) fn is_of(&self, patch: &HapticPatch) -> bool {
        self.count == patch.len() && self.bodies.len() == patch.bodies.all().len()
    }

    /// Lets time pass.
    pub(in crate::tick) fn age(&mut self, dt: f64) {
        self.since += dt;
        self.tick = dt;
        self.touch.pass(dt, !self.contacts.is_empty());
    }

    /// Makes the memory belong to the patch of a new snapshot. At most `nodes²` comparisons and one product with C.
    ///
    /// `tool` is that of the step, `step` and `tick` are h and T \[s\]. Tissue creeps from snapshot to snapshot: not
    /// where nothing is handed over.
    pub(in crate::tick) fn take_over(
        &mut self,
        patch: &HapticPatch,
        tool: &ToolPose,
        (step, tick, hand_over): (f64, f64, f64),
    ) {
        let nodes = patch.len().min(self.nodes.len());
        self.take_over_bodies(patch);
        let fade = self.fade;
        self.contacts.iter_mut().for_each(|known| known.owed.defer(fade, known.rest, &mut known.slip));
        let yielding = patch.bodies.yielding().min(self.bodies.len());
        let fresh = self.count == 0;
        (self.since, self.fade, self.tick, self.step) = (0.0, 1.0, tick, step);
        self.touch.pass(tick, !self.contacts.is_empty());
        self.viscosity = patch.viscosity;
        self.share = if tick < hand_over { self.touch.share() } else { 0.0 };

        let now = self.moment(f64::INFINITY, 0.0);
        self.led = [*tool, self.tool.unwrap_or(*tool)];
        self.contacts.iter_mut().filter(|known| known.stuck < STUCK).for_each(|known| known.stuck += 1);
        for (k, &name) in patch.skin().nodes().iter().enumerate().take(nodes) {
            let old = self.nodes.iter().take(self.count).position(|node| node.name == name);
            self.next[k] = Node { name, known: old.is_some(), ..old.map_or(Node::NEW, |old| self.nodes[old]) };
            let found = if fresh { patch.force().get(k).copied() } else { None };
            self.next_force[yielding + k] = old.map_or(found.unwrap_or(ZERO), |old| self.force[self.yielding + old]);
        }
        let places = yielding + nodes;
        patch.yielding(&self.next_force[..places], &mut self.sum, &mut self.moved[..places]);
        let (of_bodies, of_nodes) = self.moved.split_at(yielding);
        let of_bodies = of_bodies.iter().chain(std::iter::repeat(&ZERO));
        for ((body, contact), moved) in self.bodies.iter_mut().zip(patch.bodies.all()).zip(of_bodies) {
            body.begin(contact, &now, moved, &self.led);
        }
        let yields = now.law.yields();
        for ((node, moved), place) in self.next.iter_mut().zip(of_nodes).zip(Place::nodes(patch)).take(nodes) {
            node.creep.take_over(&place, &now, &node.shape, moved);
            node.drift = node.shape - place.end;
            node.yielded = moved * yields + node.lag;
            // What was not finite is forgotten.
            if !node.known || !node.creep.is_finite() || !all_finite(&(node.lag + node.drift)) {
                (node.lag, node.yielded, node.drift) = (ZERO, moved * yields, ZERO);
                node.shape = node.creep.begin(&place, &now, moved);
            }
        }
        std::mem::swap(&mut self.nodes, &mut self.next);
        std::mem::swap(&mut self.force, &mut self.next_force);
        (self.count, self.yielding) = (nodes, yielding);
    }

    /// What is remembered of bodies' contacts, in the order of a new patch, and their forces. At most `bodies²` comparisons.
    fn take_over_bodies(&mut self, patch: &HapticPatch) {
        self.next_bodies.clear();
        for contact in patch.bodies.all().iter().take(self.max_bodies) {
            let old = self.bodies.iter().find(|body| body.is_of(contact));
            self.next_bodies.push(BodyMemory::new(contact, old, self.fade));
        }
        std::mem::swap(&mut self.bodies, &mut self.next_bodies);
        for (to, body) in self.next_force.iter_mut().zip(&self.bodies) {
            *to = body.local();
        }
    }

    /// Bodies' contacts, in the order of the patch.
    pub(super) fn bodies(&self) -> &[BodyMemory] {
        &self.bodies
    }

    /// When this tick is, or that so many later, in a hand-over of this length \[s\].
    pub(in crate::tick) fn moment(&self, hand_over: f64, later: f64) -> Moment {
        let (since, tick, step) = (self.since + later * self.tick, self.tick, self.step);
        // Nothing is handed over in no time; NaN of 0/0 does not come up.
        let fade = if since >= hand_over || tick >= hand_over { 0.0 } else { 1.0 - since / hand_over };
        let drifted = if step > 0.0 { (since.min(step) + tick) / step } else { 0.0 };
        let drifts = if since < step { 1.0 / step } else { 0.0 };
        let law = CreepLaw::new(self.viscosity, self.share, step, tick);
        Moment { fade, faded: self.fade - fade, drifted, drifts, law }
    }

    /// The shape under the forces of the tick before, at this moment \[m\].
    pub(super) fn shape_now(&self, patch: &HapticPatch, now: &Moment, shape: &mut [Vector3<f64>]) {
        for ((to, node), place) in shape.iter_mut().zip(&self.nodes).zip(Place::nodes(patch)) {
            *to = node.creep.unforced(&place, now) + node.yielded;
        }
    }

    /// What the forces of the tick before do at a node \[m\].
    pub(super) fn yielded(&self, node: usize) -> Option<Vector3<f64>> {
        self.nodes.get(node).map(|node| node.yielded)
    }

    /// The same, all of it at once \[m\].
    pub(super) fn moved(&self, node: usize) -> Vector3<f64> {
        self.nodes.get(node).map_or(ZERO, |node| node.yielded - node.lag)
    }

    /// Where a node was at the end of the tick before \[m\].
    pub(super) fn shape(&self, node: usize) -> Option<Vector3<f64>> {
        self.nodes.get(node).map(|node| node.shape)
    }

    /// x − q_end of a node when the snapshot came \[m\].
    pub(super) fn drift(&self, node: usize) -> Option<Vector3<f64>> {
        self.nodes.get(node).map(|node| node.drift)
    }

    /// Where the snapshot has the tool, and where it was when the snapshot came.
    pub(super) fn led(&self) -> &[ToolPose; 2] {
        &self.led
    }

    /// What s has fallen by since the tick before, for a contact that is led; 0 for others.
    pub(super) fn leads(&self, feature: u64, now: &Moment) -> f64 {
        let stuck = self.known(feature).is_some_and(|known| known.stuck >= STUCK);
        if stuck { now.faded } else { 0.0 }
    }

    /// Where the tool was at the end of the tick before.
    pub(super) fn tool(&self) -> Option<&ToolPose> {
        self.tool.as_ref()
    }

    fn known(&self, feature: u64) -> Option<&Known> {
        self.contacts.binary_search_by_key(&feature, |known| known.feature).ok().and_then(|k| self.contacts.get(k))
    }

    /// What the ticks before left of a sticking contact's displacement \[m\], the snapshots that came while it stuck,
    /// and what is owed.
    pub(super) fn slip(&self, feature: u64) -> (Vector3<f64>, u32, Owed) {
        self.known(feature).map_or((ZERO, 0, Owed::NONE), |known| (known.slip, known.stuck, known.owed))
    }

    /// Starts each contact from the force that its feature had.
    pub(super) fn warm_start(&self, rows: &mut Rows) {
        for (row, block) in rows.contact.iter().zip(&rows.blocks) {
            let local = match row.body {
                Some(k) => self.bodies.get(k).map(BodyMemory::local),
                None => self.known(row.feature).map(|known| row.frame.tr_mul(&known.force)),
            };
            let Some(local) = local else { continue };
            let lambda = rows.lambda.iter_mut().skip(block.start).take(block.law.rows());
            lambda.zip(local.iter()).for_each(|(l, x)| *l = *x);
        }
    }

    /// Remembers what a tick found, and where the tool is at its end.
    pub(in crate::tick) fn keep(&mut self, patch: &HapticPatch, hand_over: f64, tool: &ToolPose, ws: &PatchWorkspace) {
        let now = self.moment(hand_over, 0.0);
        let (y, yields) = (self.yielding, now.law.yields());
        self.force.iter_mut().zip(&ws.force).for_each(|(kept, force)| *kept = *force);
        let of_nodes = ws.moved.get(y..).unwrap_or_default();
        for ((node, place), moved) in self.nodes.iter_mut().zip(Place::nodes(patch)).zip(of_nodes) {
            node.shape = node.creep.keep(&place, &now, moved);
            let moved = moved * yields;
            node.yielded += (moved - node.yielded) * FOLLOWS;
            node.lag = node.yielded - moved;
        }
        (self.tool, self.fade) = (Some(*tool), now.fade);
        self.contacts.clear();
        let (rows, names) = (ws.rows.contact.iter().filter(|row| row.body.is_none()), patch.skin().nodes());
        let kept = rows.take(self.max_contacts).filter(|row| row.is_worth_knowing());
        self.contacts.extend(kept.map(|row| Known::new(row, (names, y))));
        let of_bodies = ws.moved.iter().take(y).chain(std::iter::repeat(&ZERO));
        for ((body, contact), moved) in self.bodies.iter_mut().zip(patch.bodies.all()).zip(of_bodies) {
            body.keep(contact, &now, moved, contact.approach(&self.led[0], tool).x);
        }
        for row in &ws.rows.contact {
            if let Some(body) = row.body.and_then(|k| self.bodies.get_mut(k)) {
                body.note(row);
            }
        }
    }
}
