//! The haptic sample: one per tick.

use super::{flags, record};

flags! {
    /// What a tick met.
    TickFlags {
        /// The magnitude of the force was cut to the limit of device or scene.
        0 => FORCE_LIMITED;
        /// The change of the force since the last tick was cut.
        1 => SLEW_LIMITED;
        /// The force is being faded in or out.
        2 => FADING;
        /// The snapshot is older than its bound.
        3 => STALE_SNAPSHOT;
        /// A non-finite value was met and replaced by zero force.
        4 => NON_FINITE;
        /// The device did not answer.
        5 => DEVICE_MISSING;
        /// Deadlines were missed since the tick before.
        6 => OVERRUN;
        /// Contacts beyond the capacity were left out.
        7 => CONTACTS_DROPPED;
        /// The contact solver spent its sweeps before reaching its tolerance.
        8 => UNCONVERGED;
        /// The step marked its snapshot as not valid, or none has come yet: no force.
        9 => NO_SNAPSHOT;
        /// The device's pose was not finite, not a rotation, or beyond all bounds: no force.
        10 => BAD_POSE;
        /// A new snapshot was taken over.
        11 => NEW_SNAPSHOT;
        /// Contacts were found on the snapshot's patch of tissue; without it, the rows are those of the step.
        12 => LOCAL;
        /// The tool had gone so far that skin beyond the patch could touch it unseen.
        13 => BEYOND_PATCH;
        /// The energy account of the device's port was overdrawn, and the wrench was reduced along the motion.
        14 => PASSIVITY;
        /// The power given to the hand was cut to its limit.
        15 => POWER_LIMITED;
        /// The tick came later than half a period after its time.
        16 => LATE;
        /// The device's pose had jumped, and the force was taken off.
        17 => JUMPED;
        /// The magnitude of the torque was cut to the limit of device or scene.
        18 => TORQUE_LIMITED;
        /// The device told its pose and did not take the force; set beside `DEVICE_MISSING`.
        19 => WRITE_FAILED;
    }
}

record! {
    /// One tick of the 1 kHz side: what came from the device and what was sent to it.
    ///
    /// Positions and vectors are in the world frame; force and torque are those on the hand. Quaternions are
    /// `[x, y, z, w]` with unit norm, rotating from the body's frame to the world's.
    TickRecord = "HapticSample" {
        /// Number of the tick, from 0.
        1 => tick: u64, "";
        /// Time since the start of the run (ns): monotonic clock, or virtual time in lockstep.
        2 => time_ns: u64, "ns";
        /// Position of the device (m).
        3 => device_position: [f64; 3], "m";
        /// Orientation of the device.
        4 => device_orientation: [f64; 4], "";
        /// Linear velocity of the device (m/s).
        5 => device_velocity: [f64; 3], "m/s";
        /// Angular velocity of the device (rad/s).
        6 => device_angular_velocity: [f64; 3], "rad/s";
        /// Position of the tool (m).
        7 => tool_position: [f64; 3], "m";
        /// Orientation of the tool.
        8 => tool_orientation: [f64; 4], "";
        /// Force sent to the device, after all limits (N).
        9 => force: [f64; 3], "N";
        /// Torque sent to the device, after all limits (N m).
        10 => torque: [f64; 3], "N m";
        /// Force before limits and fading (N).
        11 => force_unlimited: [f64; 3], "N";
        /// Smallest gap that the contact problem leaves (m); negative where the solver has not closed it, NaN when
        /// nothing is near.
        12 => gap: f64, "m";
        /// Number of active contacts.
        13 => contacts: u32, "";
        /// Sweeps of the contact solver.
        14 => sweeps: u32, "";
        /// Natural-map residual of the contact problem, relative.
        15 => residual: f64, "";
        /// Number of the step that the snapshot in use came from, counted from 1; 0 before the first.
        16 => snapshot_step: u64, "";
        /// Age of that snapshot (s).
        17 => snapshot_age: f64, "s";
        /// What the tick met.
        18 => flags: TickFlags, "";
        /// Time between the planned and the real start of the tick (ns); 0 in lockstep.
        19 => wake_latency_ns: u64, "ns";
        /// Time the tick worked (ns); 0 in lockstep.
        20 => work_ns: u64, "ns";
        /// Change of the force before limits that a new snapshot brings at the same pose (N); 0 at other ticks.
        21 => force_jump: f64, "N";
        /// Account of the energy that went through the device's port in the contact that lasts (J); positive: the hand
        /// has put it in.
        22 => energy: f64, "J";
        /// How far the device's gripper is open: 0 closed, 1 open.
        23 => device_gripper: f64, "";
        /// Angle between the tool's jaws behind the coupling (rad); 0 for a tool without.
        24 => tool_opening: f64, "rad";
        /// Torque on the opening sent to the device, after all limits; positive opens (N m).
        25 => gripper_torque: f64, "N m";
        /// The same before limits and fading (N m).
        26 => gripper_torque_unlimited: f64, "N m";
        /// Torque before limits and fading, about the tool's origin (N m).
        27 => torque_unlimited: [f64; 3], "N m";
        /// Energy that has gone through the gripper since the start (J); positive: the hand has put it in.
        28 => gripper_energy: f64, "J";
        /// Account of the same in the contact that lasts (J).
        29 => gripper_account: f64, "J";
        /// What the passivity controller took from the torque on the opening (N m).
        30 => gripper_withheld: f64, "N m";
        /// How much more time this machine's clock saw pass since the tick before than `time_ns` says, which goes by the
        /// device's (ns). Limits of slew and fades go by the smaller of both. 0 where there is one clock.
        31 => host_lead_ns: i64, "ns";
    }
}
