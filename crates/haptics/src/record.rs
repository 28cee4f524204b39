//! What one tick did: a small `Copy` record for rings, traces and tests.

use nalgebra::Isometry3;
use palpate_collision::ToolPose;

use crate::device::DeviceError;
use crate::gripper::GripperRecord;
use crate::wrench::{Twist, Wrench};

/// What happened in a tick, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickFlags(u32);

impl TickFlags {
    /// A new snapshot was taken over.
    pub const NEW_SNAPSHOT: Self = Self(1);
    /// No snapshot has come yet.
    pub const NO_SNAPSHOT: Self = Self(1 << 1);
    /// The step marked its snapshot as not valid.
    pub const INVALID_SNAPSHOT: Self = Self(1 << 2);
    /// The snapshot is old and the force fades, or is zero.
    pub const STALE: Self = Self(1 << 3);
    /// The force is rising after a start or an interruption.
    pub const FADE_IN: Self = Self(1 << 4);
    /// The force was cut to its limit, by the tick or by the device.
    pub const FORCE_LIMITED: Self = Self(1 << 5);
    /// The torque, or that of the gripper, was cut to its limit, by the tick or by the device.
    pub const TORQUE_LIMITED: Self = Self(1 << 6);
    /// The change of the wrench was cut to its limit.
    pub const SLEW_LIMITED: Self = Self(1 << 7);
    /// A number of the snapshot or of the answer was not finite, or the snapshot's tool pose or a law of it is none: no
    /// force.
    pub const NON_FINITE: Self = Self(1 << 8);
    /// The device did not answer: no force.
    pub const DEVICE_ERROR: Self = Self(1 << 9);
    /// The time since the tick before was a gap, or no time at all.
    pub const GAP: Self = Self(1 << 10);
    /// The sweeps ended above the tolerance.
    pub const NOT_CONVERGED: Self = Self(1 << 11);
    /// The snapshot holds more than the workspace: its last contacts were left out.
    pub const TRUNCATED: Self = Self(1 << 12);
    /// The device's pose, velocity or gripper was not finite, not a rotation, or beyond all bounds: no force.
    pub const BAD_POSE: Self = Self(1 << 13);
    /// The contacts are those of this tick on the snapshot's patch; without it, the snapshot's frozen rows.
    pub const LOCAL: Self = Self(1 << 14);
    /// The tool has gone so far since the snapshot that skin beyond its patch could touch it unseen.
    pub const BEYOND_PATCH: Self = Self(1 << 15);
    /// The energy account of the port, or of the gripper, was overdrawn, and what was sent was reduced along the motion.
    pub const PASSIVITY: Self = Self(1 << 16);
    /// The power given to the hand was cut to its limit.
    pub const POWER_LIMITED: Self = Self(1 << 17);
    /// The tick came later than half a period after its time.
    pub const LATE: Self = Self(1 << 18);
    /// The device's pose has jumped, and there is no force until the tool is out of contact or back where it was.
    pub const JUMPED: Self = Self(1 << 19);

    /// Number of flags, which are the lowest bits.
    pub const COUNT: usize = 20;

    const NAMES: [&'static str; Self::COUNT] = [
        "new_snapshot",
        "no_snapshot",
        "invalid_snapshot",
        "stale",
        "fade_in",
        "force_limited",
        "torque_limited",
        "slew_limited",
        "non_finite",
        "device_error",
        "gap",
        "not_converged",
        "truncated",
        "bad_pose",
        "local",
        "beyond_patch",
        "passivity",
        "power_limited",
        "late",
        "jumped",
    ];

    /// The bits.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Whether all of `other` are set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Sets all of `other`.
    pub fn set(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// Sets all of `other` if `condition` holds.
    pub fn set_if(&mut self, condition: bool, other: Self) {
        if condition {
            self.set(other);
        }
    }

    /// Names of the flags that are set, for listings.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().enumerate().filter(move |(bit, _)| self.0 >> bit & 1 == 1).map(|(_, name)| name)
    }
}

/// Energy \[J\] that has gone through the device's port; positive: from the hand into the simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PortEnergy {
    /// By forces, since the start.
    pub translation: f64,
    /// By torques, since the start.
    pub rotation: f64,
    /// By both, of the contact that lasts ([`crate::passivity`]).
    pub account: f64,
}

impl TickRecord {
    /// The tool behind the couplings: its pose and the opening of its jaws.
    #[must_use]
    pub fn tool(&self) -> ToolPose {
        ToolPose { frame: self.tool_pose, opening: self.gripper.opening }
    }
}

/// What one tick did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickRecord {
    /// Number of the tick.
    pub index: u64,
    /// Its time \[s\].
    pub time: f64,
    /// Time since the tick before, as measured \[s\].
    pub dt: f64,
    /// What this machine's clock said beyond the `dt` that the tick was given \[s\]; 0 where there is one clock.
    pub host_lead: f64,
    /// Time that the limits of slew and fade-in were given \[s\]: never more than either clock's.
    pub granted: f64,
    /// Pose that the device measured; the last good one if it did not answer.
    pub device_pose: Isometry3<f64>,
    /// Velocity of the device as it estimates it \[m/s, rad/s\]; zero if it did not answer.
    pub device_velocity: Twist,
    /// Pose of the tool behind the coupling, on the surface where there is contact. What the step is to work with.
    pub tool_pose: Isometry3<f64>,
    /// Wrench sent to the hand, after all limits \[N, N m\].
    pub wrench: Wrench,
    /// Contact wrench before limits \[N, N m\].
    pub contact_wrench: Wrench,
    /// Smallest gap that the local problem leaves \[m\]; infinite without contacts.
    pub gap: f64,
    /// Contacts in the local problem.
    pub contacts: u32,
    /// Contacts that carry force.
    pub active: u32,
    /// Gauss-Seidel sweeps done.
    pub sweeps: u32,
    /// Natural-map residual after them, relative.
    pub residual: f64,
    /// Number of the step that made the snapshot.
    pub snapshot_step: u64,
    /// Whether that snapshot was valid, whatever else kept the tick from its force.
    pub snapshot_valid: bool,
    /// Time since the snapshot was taken over, by this machine's clock \[s\]; infinite if none ever was.
    pub snapshot_age: f64,
    /// |F_new − F_old| \[N\] at the tick that takes over a snapshot: the contact force with the new against the old one
    /// at the same device pose. 0 at other ticks.
    pub force_jump: f64,
    /// Share of the contact wrench that was let through by the fades, 0 to 1.
    pub gain: f64,
    /// What has gone through the device's port until this tick.
    pub energy: PortEnergy,
    /// Gripper and jaws.
    pub gripper: GripperRecord,
    /// What happened.
    pub flags: TickFlags,
    /// Whether the device told its pose; if so, `device_error` is that of its force.
    pub sampled: bool,
    /// Why the device did not answer.
    pub device_error: Option<DeviceError>,
}
