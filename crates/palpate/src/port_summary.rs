//! What went through the device's port in a run, and how often something stood between the contact force and the hand.

use serde::Serialize;

use crate::tick::{TickFlags, TickRecord};
use crate::world::World;

/// Ticks in which something acted on the force, by what it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ForceCounts {
    /// The passivity layer reduced the wrench along the motion.
    pub passivity: u64,
    /// The force was cut to its limit.
    pub force_limited: u64,
    /// The torque was cut to its limit.
    pub torque_limited: u64,
    /// The power given to the hand was cut to its limit.
    pub power_limited: u64,
    /// The change of the wrench was cut to its limit.
    pub slew_limited: u64,
    /// The force was rising after a start or an interruption.
    pub fading_in: u64,
    /// The snapshot was old, and the force faded or was zero.
    pub stale: u64,
    /// The time since the tick before was a gap: the force came back as a ramp.
    pub gaps: u64,
    /// The tick came later than half a period after its time.
    pub late: u64,
    /// The device's pose had jumped, and the force was taken off.
    pub jumped: u64,
    /// A number or a pose was not sound: no force.
    pub refused: u64,
}

impl ForceCounts {
    /// Names of the counts, for tables.
    pub const NAMES: [&'static str; 11] = [
        "passivity",
        "force_limited",
        "torque_limited",
        "power_limited",
        "slew_limited",
        "fading_in",
        "stale",
        "gaps",
        "late",
        "jumped",
        "refused",
    ];

    /// Counts a tick.
    pub fn add(&mut self, flags: TickFlags) {
        let count = |n: &mut u64, flag| *n += u64::from(flags.contains(flag));
        count(&mut self.passivity, TickFlags::PASSIVITY);
        count(&mut self.force_limited, TickFlags::FORCE_LIMITED);
        count(&mut self.torque_limited, TickFlags::TORQUE_LIMITED);
        count(&mut self.power_limited, TickFlags::POWER_LIMITED);
        count(&mut self.slew_limited, TickFlags::SLEW_LIMITED);
        count(&mut self.fading_in, TickFlags::FADE_IN);
        count(&mut self.stale, TickFlags::STALE);
        count(&mut self.gaps, TickFlags::GAP);
        count(&mut self.late, TickFlags::LATE);
        count(&mut self.jumped, TickFlags::JUMPED);
        let refused = flags.contains(TickFlags::NON_FINITE) || flags.contains(TickFlags::BAD_POSE);
        self.refused += u64::from(refused);
    }

    /// The counts in the order of [`Self::NAMES`].
    pub fn values(&self) -> [u64; 11] {
        [
            self.passivity,
            self.force_limited,
            self.torque_limited,
            self.power_limited,
            self.slew_limited,
            self.fading_in,
            self.stale,
            self.gaps,
            self.late,
            self.jumped,
            self.refused,
        ]
    }
}

/// Ticks whose contact force is not that of the whole contact problem, by why not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ContactCounts {
    /// There were more contacts than the tick had room for: the force is that of the deepest.
    pub truncated: u64,
    /// The sweeps ended above their tolerance: the force is the one that they had reached.
    pub not_converged: u64,
}

impl ContactCounts {
    /// Names of the counts, for tables.
    pub const NAMES: [&'static str; 2] = ["truncated", "not_converged"];

    /// Counts a tick.
    pub fn add(&mut self, flags: TickFlags) {
        self.truncated += u64::from(flags.contains(TickFlags::TRUNCATED));
        self.not_converged += u64::from(flags.contains(TickFlags::NOT_CONVERGED));
    }

    /// The counts in the order of [`Self::NAMES`].
    pub fn values(&self) -> [u64; 2] {
        [self.truncated, self.not_converged]
    }
}

/// The device's port over a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PortSummary {
    /// Ticks in which something acted on the force.
    pub counts: ForceCounts,
    /// Ticks whose contact force is not that of the whole contact problem.
    pub contact: ContactCounts,
    /// Energy that has gone through, by forces and by torques (J); positive: from the hand.
    pub energy: [f64; 2],
    /// Lowest account of a contact (J): what it gave out beyond what it had taken in.
    pub least_account: f64,
    /// The same of the gripper; `None` for a tool without jaws.
    pub gripper: Option<GripperSummary>,
}

/// The gripper of a device over a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GripperSummary {
    /// Energy that has gone through (J); positive: from the hand.
    pub energy: f64,
    /// Lowest account of a contact (J).
    pub least_account: f64,
    /// Ticks in which the passivity controller took from its torque.
    pub withheld: u64,
}

impl PortSummary {
    /// Before the first tick of a world.
    pub(crate) fn new(world: &World) -> Self {
        Self { gripper: world.tool().hinge().map(|_| GripperSummary::default()), ..Self::default() }
    }

    /// Counts a tick.
    pub(crate) fn add(&mut self, record: &TickRecord) {
        self.counts.add(record.flags);
        self.contact.add(record.flags);
        self.energy = [record.energy.translation, record.energy.rotation];
        self.least_account = self.least_account.min(record.energy.account);
        if let Some(gripper) = &mut self.gripper {
            gripper.energy = record.gripper.energy;
            gripper.least_account = gripper.least_account.min(record.gripper.account);
            gripper.withheld += u64::from(record.gripper.withheld != 0.0);
        }
    }
}
