//! Where a rigid body is at the end of a step.

use super::record;

record! {
    /// One rigid body at the end of one step.
    RigidRecord = "RigidBody" {
        /// Step that moved it.
        1 => step: u64, "";
        /// Time since the start of the run at the begin of that step (ns).
        2 => time_ns: u64, "ns";
        /// Number of the body, in the order of `TraceConfig::solids` that move.
        3 => body: u32, "";
        /// Origin of its shape (m).
        4 => position: [f64; 3], "m";
        /// Orientation of its shape `[x, y, z, w]`.
        5 => orientation: [f64; 4], "";
        /// Velocity of its centre of mass (m/s).
        6 => velocity: [f64; 3], "m/s";
        /// Angular velocity (rad/s).
        7 => angular_velocity: [f64; 3], "rad/s";
    }
}
