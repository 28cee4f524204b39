//! Poses that no hand can have brought about: a driver that starts anew, an encoder that slips, a tracker that errs.
//!
//! After a jump the tool may lie deep in the tissue or on its other side, and the contact problem would hold it there
//! with all the force that the limits grant. So the force is taken off, and comes back as a ramp when nothing touches the
//! tool any more on snapshots that steps have made since, or when the device is back where it jumped from.

use nalgebra::Vector3;

use crate::limits::Limits;

/// Distance \[m\] from where the device jumped at which it is back.
const BACK: f64 = 5e-3;

/// Snapshots to wait for: the first may be of a step that had begun before the jump.
const SNAPSHOTS: u32 = 2;

/// A force that has been taken off.
#[derive(Clone, Copy, Debug)]
struct Withdrawal {
    /// Where the device was before it jumped \[m\].
    from: Vector3<f64>,
    /// Snapshots still to wait for.
    awaited: u32,
}

/// Where the device was, and whether it has jumped: state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct JumpState {
    before: Option<Vector3<f64>>,
    /// Time since then \[s\].
    since: f64,
    /// Length of the inhuman motion that goes on \[m\], and where it began.
    length: f64,
    begin: Vector3<f64>,
    withdrawal: Option<Withdrawal>,
}

impl JumpState {
    /// Time goes by, with or without a pose.
    pub(super) fn pass(&mut self, dt: f64) {
        self.since += dt;
    }

    /// Takes the next sound position; whether it is reached by a jump, so that nothing in between can be believed.
    pub(super) fn watch(&mut self, limits: &Limits, position: &Vector3<f64>) -> bool {
        let before = self.before.replace(*position).unwrap_or(*position);
        let distance = (position - before).norm();
        if limits.is_inhuman(distance, self.since) {
            self.begin = if self.length == 0.0 { before } else { self.begin };
            self.length += distance;
        } else {
            self.length = 0.0;
        }
        self.since = 0.0;
        let jumped = limits.is_jump(self.length);
        if jumped {
            let from = self.withdrawal.map_or(self.begin, |withdrawal| withdrawal.from);
            self.withdrawal = Some(Withdrawal { from, awaited: SNAPSHOTS });
        }
        if self.withdrawal.is_some_and(|withdrawal| (position - withdrawal.from).norm() <= BACK) {
            self.withdrawal = None;
        }
        jumped
    }

    /// A new snapshot is in use.
    pub(super) fn take_over(&mut self) {
        if let Some(withdrawal) = &mut self.withdrawal {
            withdrawal.awaited = withdrawal.awaited.saturating_sub(1);
        }
    }

    /// Whether the force is taken off in this tick, in which the tool is `free` of contact or not.
    pub(super) fn withdraws(&mut self, free: bool) -> bool {
        if free && self.withdrawal.is_some_and(|withdrawal| withdrawal.awaited == 0) {
            self.withdrawal = None;
        }
        self.withdrawal.is_some()
    }
}
