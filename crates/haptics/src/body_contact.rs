//! Contacts of fixed and rigid bodies that a step found, for the tick to solve with those that it finds on the skin.
//!
//! A wall that tissue or tool meets, and a rigid body that the tool meets, are seen by the step alone. What they do depends
//! on what the tick does: tissue that is pressed harder presses harder on its table, and a block that is set down meets it
//! between two steps. So the tick has their contacts as the step left them, in coordinates of their own frames,
//! ```text
//! u = (gap, displacement along t, along s) = free + drift + flow + (C f) + J (tool pose − the step's)      m, a step later
//! ```
//! with C over the nodes of the skin and the u of all these contacts, and f their forces too. The normal of a contact, and its
//! place on the tool, are those of the step's end; its gap is not.

use nalgebra::{Matrix3, Vector3};
use palpate_collision::ToolPose;
use palpate_constraints::law::Law;

/// Where a body touches the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPart {
    /// From the tool's origin in the step \[m\].
    pub lever: Vector3<f64>,
    /// Velocity of the tool's point per rad that the jaws open \[m\].
    pub opens: Vector3<f64>,
}

/// A contact of a fixed or rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyContact {
    /// Identity from step to step.
    pub feature: u64,
    /// Its law.
    pub law: Law,
    /// Columns: the normal, away from the tool or the fixed body, and the tangents.
    pub frame: Matrix3<f64>,
    /// What the tool has of it.
    pub tool: Option<ToolPart>,
    /// Gap at the step's end \[m\].
    pub gap: f64,
    /// u without the forces that the tick finds \[m\]; 0 along the tangents at the step's end.
    pub free: Vector3<f64>,
    /// Even part of the motion of u without forces from the end of the step to that of the next \[m\].
    pub drift: Vector3<f64>,
    /// The rest of that motion, which is held back by viscosity \[m\].
    pub flow: Vector3<f64>,
    /// Force of the step, in the frame \[N\].
    pub force: Vector3<f64>,
}

impl BodyContact {
    /// J times the way between two poses of the tool \[m\], in the frame; zero where the tool has no part.
    pub(crate) fn approach(&self, from: &ToolPose, to: &ToolPose) -> Vector3<f64> {
        let Some(ToolPart { lever, opens }) = &self.tool else { return Vector3::zeros() };
        let translation = to.frame.translation.vector - from.frame.translation.vector;
        let rotation = (to.frame.rotation * from.frame.rotation.inverse()).scaled_axis();
        -self.frame.tr_mul(&(translation + rotation.cross(lever) + opens * (to.opening - from.opening)))
    }
}

/// Bodies' contacts of a patch, those that yield first: in memory of fixed size.
#[derive(Debug, Default, PartialEq)]
pub struct BodyContacts {
    contacts: Vec<BodyContact>,
    /// How many have a part in C.
    yielding: usize,
    room: usize,
    /// Contacts that found no room.
    dropped: u32,
}

/// A copy with the same room.
impl Clone for BodyContacts {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.room);
        copy.copy_from(self);
        copy
    }
}

impl BodyContacts {
    /// None, with room for this many.
    #[must_use]
    pub fn new(room: usize) -> Self {
        Self { contacts: Vec::with_capacity(room), yielding: 0, room, dropped: 0 }
    }

    /// How many fit.
    #[must_use]
    pub fn room(&self) -> usize {
        self.room
    }

    /// How many found no room.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Takes all out.
    pub fn clear(&mut self) {
        self.contacts.clear();
        (self.yielding, self.dropped) = (0, 0);
    }

    /// Adds one; those that yield, which have rows in C, before those that do not. False, and counted, where there is no room.
    pub fn push(&mut self, contact: BodyContact, yields: bool) -> bool {
        let in_order = !yields || self.yielding == self.contacts.len();
        if self.contacts.len() >= self.room || !in_order {
            self.dropped = self.dropped.saturating_add(1);
            return false;
        }
        self.contacts.push(contact);
        self.yielding += usize::from(yields);
        true
    }

    /// All of them, those that yield first.
    #[must_use]
    pub fn all(&self) -> &[BodyContact] {
        &self.contacts
    }

    /// The same, to be changed.
    pub fn all_mut(&mut self) -> &mut [BodyContact] {
        &mut self.contacts
    }

    /// How many have a part in C.
    #[must_use]
    pub fn yielding(&self) -> usize {
        self.yielding
    }

    /// Makes this a copy without allocating; false, and left empty, where it does not fit.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        self.clear();
        if other.contacts.len() > self.room {
            return false;
        }
        self.contacts.extend_from_slice(&other.contacts);
        (self.yielding, self.dropped) = (other.yielding, other.dropped);
        true
    }
}
