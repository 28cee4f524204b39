//! What a tick on a patch remembers: the shape and the forces of its end, by the names of nodes and features.
//!
//! When a new snapshot comes, forces stay and the shape goes on from where it was: with x the shape at the end of the tick
//! before and f its forces,
//! ```text
//! q = q_free + d t/h + o s(t),   o = x − C f − q_free,   s falls from 1 to 0 within `hand_over`
//! ```
//! so at the first tick of a snapshot shape and forces solve the new problem as they solved the old, whatever changed in
//! q_free *and* in C, and what the new snapshot knows better comes in over a stated time. A time that is over within a tick is
//! none, s = 0: where each tick has a snapshot of its own, nothing that the snapshots know would ever come in else. A node that is new to the patch
//! starts at its place, without force; in a patch that nothing is remembered of, with the force that the step found. The
//! drift d ends where the next step should have come, and so does what it can do in a run whose steps are late.
//!
//! Where friction holds, step and tick each remember how the tissue lies on the tool, and what they remember drifts apart:
//! ticks slide on between two steps, and steps hold what they find at their begin. The step's tissue lives on, so it is right:
//! with X and q_end tool and shape at the step's end, X' and x the same at the end of the tick before,
//! ```text
//! d = (x − q_end) − (X' − X) p,     p the place of the contact on the tool
//! ```
//! a contact that stuck when the step looked at the tool, and since, is led by `-d` along its tangents as s falls. Then a tool
//! that is where the step had it feels the friction that the step found.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::ToolPose;

use super::PatchWorkspace;
use super::bodies::BodyMemory;
use super::known::{Known, STUCK};
use super::rows::Rows;
use crate::patch::HapticPatch;
use crate::wrench::all_finite;

/// A node of the patch in use.
#[derive(Clone, Copy, Debug)]
struct Node {
    name: u32,
    /// Whether the patch before had it.
    known: bool,
    /// Where it was at the end of the tick before \[m\].
    shape: Vector3<f64>,
    /// o \[m\].
    offset: Vector3<f64>,
    /// From the shape to the place where contacts are found \[m\].
    lag: Vector3<f64>,
    /// From q to the place where contacts are found \[m\]: C f, which it follows by [`FOLLOWS`].
    yielded: Vector3<f64>,
    /// x − q_end \[m\].
    drift: Vector3<f64>,
}

/// Share of the way to the shape of its forces that the place where contacts are found goes in a tick.
const FOLLOWS: f64 = 0.3;

const NOWHERE: Node =
    Node { name: u32::MAX, known: false, shape: ZERO, offset: ZERO, lag: ZERO, yielded: ZERO, drift: ZERO };
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
    contacts: Vec<Known>,
    max_contacts: usize,
    /// The tool at the end of the tick before.
    tool: Option<ToolPose>,
    /// Where the snapshot has the tool, and where it was when the snapshot came.
    led: [ToolPose; 2],
    /// s at the end of the tick before.
    fade: f64,
    /// Time since the snapshot in use was taken over \[s\].
    since: f64,
    /// h: the time that its drift takes \[s\].
    step: f64,
    /// Time of the tick \[s\].
    tick: f64,
}

impl PatchMemory {
    pub(in crate::tick) fn new(max_nodes: usize, max_contacts: usize, max_bodies: usize) -> Self {
        let places = max_bodies + max_nodes;
        Self {
            nodes: vec![NOWHERE; max_nodes],
            force: vec![ZERO; places],
            count: 0,
            yielding: 0,
            bodies: Vec::with_capacity(max_bodies),
            next_bodies: Vec::with_capacity(max_bodies),
            max_bodies,
            next: vec![NOWHERE; max_nodes],
            next_force: vec![ZERO; places],
            moved: vec![ZERO; places],
            contacts: Vec::with_capacity(max_contacts),
            max_contacts,
            tool: None,
            led: [Isometry3::identity().into(); 2],
            fade: 0.0,
            since: 0.0,
            step: 0.0,
            tick: 0.0,
        }
    }

    /// Forgets everything.
    pub(in crate::tick) fn forget(&mut self) {
        (self.count, self.yielding) = (0, 0);
        self.bodies.clear();
        self.contacts.clear();
        self.tool = None;
    }

    /// Whether the patch is the one whose shape it remembers.
    pub(in crate::tick) fn is_of(&self, patch: &HapticPatch) -> bool {
        self.count == patch.len() && self.bodies.len() == patch.bodies.all().len()
    }

    /// Lets time pass.
    pub(in crate::tick) fn age(&mut self, dt: f64) {
        self.since += dt;
        self.tick = dt;
    }

    /// Makes the memory belong to the patch of a new snapshot. At most `nodes²` comparisons and one product with C.
    ///
    /// `tool` is that of the step, `step` is h and `tick` the time of the tick \[s\].
    pub(in crate::tick) fn take_over(&mut self, patch: &HapticPatch, tool: &ToolPose, (step, tick): (f64, f64)) {
        let nodes = patch.len().min(self.nodes.len());
        self.take_over_bodies(patch);
        let yielding = patch.bodies.yielding().min(self.bodies.len());
        let fresh = self.count == 0;
        (self.since, self.fade, self.step, self.tick) = (0.0, 1.0, step, tick);
        self.led = [*tool, self.tool.unwrap_or(*tool)];
        self.contacts.iter_mut().filter(|known| known.stuck < STUCK).for_each(|known| known.stuck += 1);
        for (k, &name) in patch.skin().nodes().iter().enumerate().take(nodes) {
            let old = self.nodes.iter().take(self.count).position(|node| node.name == name);
            self.next[k] = Node { name, known: old.is_some(), ..old.map_or(NOWHERE, |old| self.nodes[old]) };
            let found = if fresh { patch.force().get(k).copied() } else { None };
            self.next_force[yielding + k] = old.map_or(found.unwrap_or(ZERO), |old| self.force[self.yielding + old]);
        }
        let places = yielding + nodes;
        patch.yielding(&self.next_force[..places], &mut self.moved[..places]);
        let (of_bodies, of_nodes) = self.moved.split_at(yielding);
        let of_bodies = of_bodies.iter().chain(std::iter::repeat(&ZERO));
        for ((body, contact), moved) in self.bodies.iter_mut().zip(patch.bodies.all()).zip(of_bodies) {
            body.begin(contact, moved, &self.led);
        }
        let shapes = patch.q_free().iter().zip(patch.q_end());
        for ((node, moved), (q_free, q_end)) in self.next.iter_mut().zip(of_nodes).zip(shapes).take(nodes) {
            node.offset = node.shape - moved - q_free;
            node.drift = node.shape - q_end;
            node.yielded = moved + node.lag;
            // What was not finite is forgotten.
            if !node.known || !all_finite(&(node.offset + node.lag + node.drift)) {
                (node.lag, node.yielded) = (ZERO, *moved);
                (node.offset, node.drift) = (ZERO, ZERO);
                node.shape = q_free + moved;
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
            self.next_bodies.push(BodyMemory::new(contact, old));
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

    /// What s has fallen by since the tick before.
    pub(super) fn faded(&self, hand_over: f64) -> f64 {
        self.fade - self.fade(hand_over)
    }

    /// s at this time.
    pub(super) fn fade(&self, hand_over: f64) -> f64 {
        // Nothing is handed over in no time; NaN of 0/0 does not come up.
        if self.since >= hand_over || self.tick >= hand_over { 0.0 } else { 1.0 - self.since / hand_over }
    }

    /// t/h: the snapshot is of the tool in the tick before, so the first tick of it is one tick on its way.
    pub(super) fn drifted(&self) -> f64 {
        if self.step > 0.0 { (self.since.min(self.step) + self.tick) / self.step } else { 0.0 }
    }

    /// The shape under the forces of the tick before, at this place in the hand-over \[m\].
    pub(super) fn shape_now(&self, patch: &HapticPatch, fade: f64, shape: &mut [Vector3<f64>]) {
        let drifted = self.drifted();
        for (((to, node), q_free), drift) in shape.iter_mut().zip(&self.nodes).zip(patch.q_free()).zip(patch.drift()) {
            *to = q_free + drift * drifted + node.offset * fade + node.yielded;
        }
    }

    /// C f at a node \[m\].
    pub(super) fn yielded(&self, node: usize) -> Option<Vector3<f64>> {
        self.nodes.get(node).map(|node| node.yielded)
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
    pub(super) fn leads(&self, feature: u64, hand_over: f64) -> f64 {
        let stuck = self.known(feature).is_some_and(|known| known.stuck >= STUCK);
        if stuck { self.faded(hand_over) } else { 0.0 }
    }

    /// Where the tool was at the end of the tick before.
    pub(super) fn tool(&self) -> Option<&ToolPose> {
        self.tool.as_ref()
    }

    fn known(&self, feature: u64) -> Option<&Known> {
        self.contacts.binary_search_by_key(&feature, |known| known.feature).ok().and_then(|k| self.contacts.get(k))
    }

    /// What the ticks before left of a sticking contact's displacement \[m\], and the snapshots that came while it stuck.
    pub(super) fn slip(&self, feature: u64) -> (Vector3<f64>, u32) {
        self.known(feature).map_or((ZERO, 0), |known| (known.slip, known.stuck))
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
        let fade = self.fade(hand_over);
        let (y, drifted) = (self.yielding, self.drifted());
        self.force.iter_mut().zip(&ws.force).for_each(|(kept, force)| *kept = *force);
        let of_nodes = ws.moved.get(y..).unwrap_or_default();
        let free = patch.q_free().iter().zip(patch.drift()).map(|(q, drift)| q + drift * drifted);
        for ((node, q_free), moved) in self.nodes.iter_mut().zip(free).zip(of_nodes) {
            node.shape = q_free + node.offset * fade + moved;
            node.yielded += (moved - node.yielded) * FOLLOWS;
            node.lag = node.yielded - moved;
        }
        (self.tool, self.fade) = (Some(*tool), fade);
        self.contacts.clear();
        let rows = ws.rows.contact.iter().filter(|row| row.body.is_none()).take(self.max_contacts);
        self.contacts.extend(rows.filter(|row| row.force != ZERO).map(Known::new));
        let of_bodies = ws.moved.iter().take(y).chain(std::iter::repeat(&ZERO));
        for ((body, contact), moved) in self.bodies.iter_mut().zip(patch.bodies.all()).zip(of_bodies) {
            body.keep(contact, moved, (fade, drifted), contact.approach(&self.led[0], tool).x);
        }
        for row in &ws.rows.contact {
            if let Some(body) = row.body.and_then(|k| self.bodies.get_mut(k)) {
                body.note(row);
            }
        }
    }
}
