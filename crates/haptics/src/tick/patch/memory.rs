//! What a tick on a patch remembers: the shape and the forces of its end, by the names of nodes and features.
//!
//! When a new snapshot comes, forces stay and the shape goes on from where it was: with x the shape at the end of the tick
//! before and f its forces,
//! ```text
//! q = q_free + d t/h + o s(t),   o = x − C f − q_free,   s falls from 1 to 0 within `hand_over`
//! ```
//! so at the first tick of a snapshot shape and forces solve the new problem as they solved the old, whatever changed in
//! q_free *and* in C, and what the new snapshot knows better comes in over a stated time. A node that is new to the patch
//! starts at its place, without force; in a patch that nothing is remembered of, with the force that the step found. The
//! drift d ends where the next step should have come, and so does what it can do in a run whose steps are late.

use nalgebra::Vector3;
use palpate_collision::ToolPose;

use super::PatchWorkspace;
use super::rows::{Row, Rows};
use crate::patch::HapticPatch;
use crate::snapshot::ROWS_PER_CONTACT;
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
}

/// Share of the way to the shape of its forces that the place where contacts are found goes in a tick.
const FOLLOWS: f64 = 0.3;

const NOWHERE: Node = Node { name: u32::MAX, known: false, shape: ZERO, offset: ZERO, lag: ZERO, yielded: ZERO };
const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A contact of the tick before.
#[derive(Clone, Copy, Debug)]
struct Known {
    feature: u64,
    force: Vector3<f64>,
    slip: Vector3<f64>,
}

/// State of ticks on patches, of fixed size.
#[derive(Clone, Debug)]
pub(in crate::tick) struct PatchMemory {
    nodes: Vec<Node>,
    /// f \[N\], one a node.
    force: Vec<Vector3<f64>>,
    count: usize,
    /// The next of `nodes` and `force`, while a snapshot is taken over.
    next: Vec<Node>,
    next_force: Vec<Vector3<f64>>,
    moved: Vec<Vector3<f64>>,
    contacts: Vec<Known>,
    max_contacts: usize,
    /// The tool at the end of the tick before.
    tool: Option<ToolPose>,
    /// Time since the snapshot in use was taken over \[s\].
    since: f64,
    /// h: the time that its drift takes \[s\].
    step: f64,
}

impl PatchMemory {
    pub(in crate::tick) fn new(max_nodes: usize, max_contacts: usize) -> Self {
        Self {
            nodes: vec![NOWHERE; max_nodes],
            force: vec![ZERO; max_nodes],
            count: 0,
            next: vec![NOWHERE; max_nodes],
            next_force: vec![ZERO; max_nodes],
            moved: vec![ZERO; max_nodes],
            contacts: Vec::with_capacity(max_contacts),
            max_contacts,
            tool: None,
            since: 0.0,
            step: 0.0,
        }
    }

    /// Forgets everything.
    pub(in crate::tick) fn forget(&mut self) {
        self.count = 0;
        self.contacts.clear();
        self.tool = None;
    }

    /// Whether the patch is the one whose shape it remembers.
    pub(in crate::tick) fn is_of(&self, patch: &HapticPatch) -> bool {
        self.count == patch.len()
    }

    /// Lets time pass.
    pub(in crate::tick) fn age(&mut self, dt: f64) {
        self.since += dt;
    }

    /// Makes the memory belong to the patch of a new snapshot. At most `nodes²` comparisons and one product with C. `step` is h \[s\].
    pub(in crate::tick) fn take_over(&mut self, patch: &HapticPatch, step: f64) {
        let nodes = patch.len().min(self.nodes.len());
        let fresh = self.count == 0;
        (self.since, self.step) = (0.0, step);
        for (k, &name) in patch.skin().nodes().iter().enumerate().take(nodes) {
            let old = self.nodes.iter().take(self.count).position(|node| node.name == name);
            self.next[k] = Node { name, known: old.is_some(), ..old.map_or(NOWHERE, |old| self.nodes[old]) };
            let found = if fresh { patch.force().get(k).copied() } else { None };
            self.next_force[k] = old.map_or(found.unwrap_or(ZERO), |old| self.force[old]);
        }
        patch.yielding(&self.next_force[..nodes], &mut self.moved[..nodes]);
        for ((node, moved), q_free) in self.next.iter_mut().zip(&self.moved).zip(patch.q_free()).take(nodes) {
            node.offset = node.shape - moved - q_free;
            node.yielded = moved + node.lag;
            // What was not finite is forgotten.
            if !node.known || !all_finite(&(node.offset + node.lag)) {
                (node.lag, node.yielded) = (ZERO, *moved);
                node.offset = ZERO;
                node.shape = q_free + moved;
            }
        }
        std::mem::swap(&mut self.nodes, &mut self.next);
        std::mem::swap(&mut self.force, &mut self.next_force);
        self.count = nodes;
    }

    /// s at this time.
    pub(super) fn fade(&self, hand_over: f64) -> f64 {
        // Nothing is handed over in no time; NaN of 0/0 does not come up.
        if self.since >= hand_over { 0.0 } else { 1.0 - self.since / hand_over }
    }

    /// t/h, 0 to 1.
    fn drifted(&self) -> f64 {
        if self.step > 0.0 { (self.since / self.step).min(1.0) } else { 0.0 }
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

    /// Where the tool was at the end of the tick before.
    pub(super) fn tool(&self) -> Option<&ToolPose> {
        self.tool.as_ref()
    }

    fn known(&self, feature: u64) -> Option<&Known> {
        self.contacts.binary_search_by_key(&feature, |known| known.feature).ok().and_then(|k| self.contacts.get(k))
    }

    /// What the ticks before left of a sticking contact's displacement \[m\].
    pub(super) fn slip(&self, feature: u64) -> Vector3<f64> {
        self.known(feature).map_or(ZERO, |known| known.slip)
    }

    /// Starts each contact from the force that its feature had.
    pub(super) fn warm_start(&self, rows: &mut Rows) {
        let each = rows.len() / rows.contacts().max(1);
        for (k, row) in rows.contact.iter().enumerate() {
            let Some(known) = self.known(row.feature) else { continue };
            let local = row.frame.tr_mul(&known.force);
            let lambda = rows.lambda.iter_mut().skip(each * k).take(each.min(ROWS_PER_CONTACT));
            lambda.zip(local.iter()).for_each(|(l, x)| *l = *x);
        }
    }

    /// Remembers what a tick found, and where the tool is at its end.
    pub(in crate::tick) fn keep(&mut self, patch: &HapticPatch, hand_over: f64, tool: &ToolPose, ws: &PatchWorkspace) {
        let fade = self.fade(hand_over);
        let drifted = self.drifted();
        let found = ws.force.iter().zip(&ws.moved);
        let free = patch.q_free().iter().zip(patch.drift()).map(|(q, drift)| q + drift * drifted);
        for (((node, kept), q_free), (force, moved)) in self.nodes.iter_mut().zip(&mut self.force).zip(free).zip(found)
        {
            *kept = *force;
            node.shape = q_free + node.offset * fade + moved;
            node.yielded += (moved - node.yielded) * FOLLOWS;
            node.lag = node.yielded - moved;
        }
        self.tool = Some(*tool);
        self.contacts.clear();
        let rows = ws.rows.contact.iter().take(self.max_contacts);
        self.contacts.extend(rows.filter(|row| row.force != ZERO).map(Known::new));
    }
}

impl Known {
    fn new(row: &Row) -> Self {
        Self { feature: row.feature, force: row.force, slip: row.slip }
    }
}
