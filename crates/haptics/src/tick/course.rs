//! What has come since the tick before: time, and snapshots.
//!
//! A driver may tell time by its device's clock, T, which does not see how late this machine's threads wake up. But the motors
//! and the hand live by real time, T' = T + lead of this machine's clock. So each rule goes by the clock that is on the safe side:
//!
//! | rule                                | time                                             |
//! |-------------------------------------|--------------------------------------------------|
//! | slew, fade-in                       | the smaller; none where this machine's stands still |
//! | gap between ticks                   | the larger                                       |
//! | age of the snapshot                 | this machine's, by which steps come              |
//! | motion: hand-over, creep, jumps     | T                                                |
//!
//! A time that cannot be, such as one that is not positive, counts as a period, and as a gap. Two calls within the resolution of
//! this machine's clock are none: the limits stand still.

use super::{Tick, TickState};
use crate::device::TickTime;
use crate::record::TickFlags;
use crate::snapshot::HapticSnapshot;

/// Periods after which a tick is late: half a period of jitter is none.
const LATE: f64 = 1.5;

/// Ticks in a row within no time at which the force is cut: no force may rest on a clock that has stopped.
const MOST_IN_NO_TIME: u32 = 50;

/// Time since the tick before \[s\], by what it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Elapsed {
    /// For the limits.
    pub(super) granted: f64,
    /// For what moves.
    pub(super) motion: f64,
    /// For the age of the snapshot.
    pub(super) age: f64,
}

/// When a tick is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TickMoment {
    /// By the driver's clock.
    pub(super) time: TickTime,
    /// Since the tick before.
    pub(super) elapsed: Elapsed,
}

impl Tick {
    /// Notices a new snapshot, or lets the one in use age.
    pub(super) fn take_over(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        elapsed: &Elapsed,
        flags: &mut TickFlags,
    ) -> bool {
        let new = snapshot.valid && state.step != Some(snapshot.step);
        if new {
            flags.set(TickFlags::NEW_SNAPSHOT);
            if std::mem::replace(&mut state.numbering, snapshot.numbering) != snapshot.numbering {
                // Frozen rows begin anew from the forces of the step, which has found them by the new names.
                state.warm_start.clear();
                state.patch.iter_mut().for_each(|memory| memory.renumber(snapshot.patch.skin()));
            }
            state.believed = self.believes(snapshot);
            if state.believed {
                state.warm_start.take_over(snapshot);
            } else {
                state.warm_start.clear();
            }
            state.jump.take_over();
            state.step = Some(snapshot.step);
            state.age = 0.0;
        } else {
            state.age += elapsed.age;
        }
        let dt = elapsed.motion;
        if let Some(memory) = &mut state.patch {
            match (self.patch.as_ref().filter(|_| snapshot.patch.valid && state.believed), new) {
                (Some(config), true) => {
                    memory.take_over(&snapshot.patch, &snapshot.tool(), (snapshot.dt, dt, config.hand_over));
                }
                (Some(_), false) => memory.age(dt),
                (None, _) => memory.forget(),
            }
        }
        new
    }

    /// Time since the tick before.
    ///
    /// A gap, or a time that cannot be, makes the force come back as a ramp: for the limits it counts as one period at most,
    /// so that the gap itself does not pass for time in which the force has risen.
    pub(super) fn elapsed(&self, state: &mut TickState, time: &TickTime, flags: &mut TickFlags) -> Elapsed {
        let dt = time.dt;
        let sound = dt > 0.0 && dt.is_finite();
        let motion = if sound { dt } else { self.period };
        // NaN is no time: the other clock's counts.
        let host = time.host_lead.map(|lead| (dt + lead).max(0.0)).filter(|host| host.is_finite());
        flags.set_if(motion > LATE * self.period, TickFlags::LATE);
        state.jump.pass(motion);
        // Two calls within the resolution of this machine's clock.
        let at_once = dt == 0.0 && host == Some(0.0);
        let gap = !(sound || at_once) || self.limits.is_gap(dt) || host.is_some_and(|host| self.limits.is_gap(host));
        let granted = if gap { motion.min(self.period) } else { motion };
        let granted = host.map_or(granted, |host| granted.min(host));
        if gap {
            flags.set(TickFlags::GAP);
            state.limits.gain = 0.0;
        }
        state.in_no_time = if granted > 0.0 { 0 } else { state.in_no_time.saturating_add(1) };
        if state.in_no_time >= MOST_IN_NO_TIME {
            flags.set(TickFlags::GAP);
            state.cut();
        }
        Elapsed { granted, motion, age: host.unwrap_or(motion) }
    }
}
