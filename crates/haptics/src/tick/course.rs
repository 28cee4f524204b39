//! What has come since the tick before: time, and snapshots.

use super::{Tick, TickState};
use crate::record::TickFlags;
use crate::snapshot::HapticSnapshot;

/// Periods after which a tick is late: half a period of jitter is none.
const LATE: f64 = 1.5;

impl Tick {
    /// Notices a new snapshot, or lets the one in use age.
    pub(super) fn take_over(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        dt: f64,
        flags: &mut TickFlags,
    ) -> bool {
        let new = snapshot.valid && state.step != Some(snapshot.step);
        if new {
            flags.set(TickFlags::NEW_SNAPSHOT);
            state.warm_start.take_over(snapshot);
            state.jump.take_over();
            state.step = Some(snapshot.step);
            state.age = 0.0;
        } else {
            state.age += dt;
        }
        if let Some(memory) = &mut state.patch {
            match (self.patch.as_ref().filter(|_| snapshot.patch.valid), new) {
                (Some(config), true) => {
                    memory.take_over(&snapshot.patch, &snapshot.tool(), (snapshot.dt, dt, config.hand_over));
                }
                (Some(_), false) => memory.age(dt),
                (None, _) => memory.forget(),
            }
        }
        new
    }

    /// Time since the tick before, for the limits and for the snapshot's age.
    ///
    /// A gap, or a time that cannot be, makes the force come back as a ramp: for the limits it counts as one period,
    /// so that the gap itself does not pass for time in which the force has risen.
    pub(super) fn elapsed(&self, state: &mut TickState, dt: f64, flags: &mut TickFlags) -> (f64, f64) {
        let sound = dt > 0.0 && dt.is_finite();
        let aged = if sound { dt } else { self.period };
        flags.set_if(aged > LATE * self.period, TickFlags::LATE);
        state.jump.pass(aged);
        if sound && !self.limits.is_gap(dt) {
            return (dt, dt);
        }
        flags.set(TickFlags::GAP);
        state.limits.gain = 0.0;
        (self.period, aged)
    }
}
