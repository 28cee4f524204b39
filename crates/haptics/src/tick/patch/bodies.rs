//! Contacts of fixed and rigid bodies in a tick: what is remembered of them, and their rows.
//!
//! ```text
//! normal:   δ_free = gap(t) + J (X_predicted − X_step)                                                  m
//! tangents: δ_free = (u(t) − u₋) + J (X_predicted − X₋) + slip + J (X' − X_step) led
//! ```
//! with u(t) the coordinates without the forces of the tick, as nodes have them ([`super::creep`]), u₋ and X₋
//! coordinates and tool at the end of the tick before, X' the tool when the snapshot came. A wall stays where it is, so
//! what is remembered of sticking at one begins anew at the end of each step, and only the tool's way since then is
//! left to be led.

use nalgebra::{Matrix3, Vector3};
use palpate_collision::ToolPose;
use palpate_solver::problem::Block;

use super::ToolPoses;
use super::creep::{Creep, Moment, Place};
use super::known::{Owed, STUCK};
use super::memory::PatchMemory;
use super::rows::{Row, Rows};
use crate::body_contact::{BodyContact, ToolPart};
use crate::patch::HapticPatch;
use crate::wrench::all_finite;

const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// A contact of a body in the tick before.
#[derive(Clone, Copy, Debug)]
pub(super) struct BodyMemory {
    feature: u64,
    frame: Matrix3<f64>,
    /// Force on what the normal points to \[N\].
    force: Vector3<f64>,
    /// What is left of a sticking contact's displacement \[m\].
    slip: Vector3<f64>,
    creep: Creep,
    /// u at the end of the tick before, without the way of the tool, and the gap with it \[m\].
    end: Vector3<f64>,
    gap: f64,
    /// What the forces of then do to u \[m\].
    moved: Vector3<f64>,
    known: bool,
    /// Snapshots that came while it stuck.
    stuck: u32,
    /// What the sweeps left of its gap \[m\].
    rest: f64,
    owed: Owed,
}

impl BodyMemory {
    /// The contact of a new snapshot, and what is remembered of it: else it has the force of the step.
    pub(super) fn new(contact: &BodyContact, old: Option<&Self>, fade: f64) -> Self {
        let frame = contact.frame;
        match old.filter(|old| all_finite(&(old.force + old.slip))) {
            Some(old) => {
                let mut new = Self { frame, known: true, stuck: (old.stuck + 1).min(STUCK), ..*old };
                new.owed.defer(fade, new.rest, &mut new.slip);
                new
            }
            None => Self {
                feature: contact.feature,
                frame,
                force: frame * contact.force,
                slip: ZERO,
                creep: Creep::REST,
                end: ZERO,
                gap: f64::INFINITY,
                moved: ZERO,
                known: false,
                stuck: 0,
                rest: 0.0,
                owed: Owed::NONE,
            },
        }
    }

    pub(super) fn is_of(&self, contact: &BodyContact) -> bool {
        self.feature == contact.feature
    }

    /// Its force in its own frame \[N\].
    pub(super) fn local(&self) -> Vector3<f64> {
        self.frame.tr_mul(&self.force)
    }

    /// Begins on a snapshot in which the forces of the tick before move the contact by `moved` = C f.
    pub(super) fn begin(&mut self, contact: &BodyContact, now: &Moment, moved: &Vector3<f64>, led: &[ToolPose; 2]) {
        let place = place_of(contact);
        let way = contact.approach(&led[0], &led[1]);
        // One that is new begins where the step has it: under other forces than the step's it would be anywhere.
        let gap = if self.known { self.gap - way.x } else { contact.gap };
        self.end = Vector3::new(gap, 0.0, 0.0);
        self.creep.take_over(&place, now, &self.end, moved);
        self.moved = moved * now.law.yields();
        // What was not finite is forgotten.
        if !self.creep.is_finite() {
            (self.slip, self.stuck, self.owed) = (ZERO, 0, Owed::NONE);
            self.end = self.creep.begin(&place, now, moved);
        }
    }

    /// Remembers what a tick found: `moved` = C f by its forces, `way` of the tool since the step.
    pub(super) fn keep(&mut self, contact: &BodyContact, now: &Moment, moved: &Vector3<f64>, way: f64) {
        self.end = self.creep.keep(&place_of(contact), now, moved);
        self.moved = moved * now.law.yields();
        self.gap = self.end.x + way;
    }

    /// Its row in the tick.
    pub(super) fn note(&mut self, row: &Row) {
        (self.force, self.slip, self.stuck) = (row.force, row.slip, row.stuck);
        (self.rest, self.owed) = (row.rest(), row.owed);
    }
}

impl Rows {
    /// Appends the rows of the patch's contacts of bodies.
    pub(super) fn build_bodies(
        &mut self,
        memory: &PatchMemory,
        moment: &Moment,
        patch: &HapticPatch,
        poses: &ToolPoses,
    ) {
        let (led, before) = (memory.led(), memory.tool().unwrap_or(&poses.held));
        let yielding = patch.bodies.yielding();
        for (k, (contact, known)) in patch.bodies.all().iter().zip(memory.bodies()).enumerate() {
            let free = known.creep.unforced(&place_of(contact), moment);
            let gap = free.x + contact.approach(&led[0], &poses.predicted).x - known.owed.gap * moment.fade;
            let mut along = free - known.end + contact.approach(before, &poses.predicted);
            along += contact.frame.tr_mul(&(known.slip + known.owed.slip * moment.faded));
            if known.stuck >= STUCK {
                along += contact.approach(&led[0], &led[1]) * moment.faded;
            }
            self.blocks.push(Block { start: self.delta_free.len(), law: contact.law.at_free_gap(gap) });
            let held = known.moved - contact.approach(&poses.held, &poses.predicted);
            self.delta_free.push(gap);
            self.before.push(gap + held.x);
            if contact.law.rows() > 1 {
                self.delta_free.extend([along.y, along.z]);
                self.before.extend([along.y + held.y, along.z + held.z]);
            }
            let ToolPart { lever, opens } = contact.tool.unwrap_or(ToolPart { lever: ZERO, opens: ZERO });
            self.contact.push(Row {
                feature: contact.feature,
                body: Some(k),
                places: [(k, 1.0), (0, 0.0), (0, 0.0)],
                count: usize::from(k < yielding),
                touches: contact.tool.is_some(),
                frame: contact.frame,
                local: Matrix3::identity(),
                lever,
                opens,
                force: ZERO,
                load: ZERO,
                slip: ZERO,
                stuck: known.stuck,
                gap: f64::INFINITY,
                owed: known.owed,
            });
        }
    }
}

/// Coordinates of a contact as a place.
fn place_of(contact: &BodyContact) -> Place {
    let end = Vector3::new(contact.gap, 0.0, 0.0);
    Place { end, free: contact.free, drift: contact.drift, flow: contact.flow }
}
