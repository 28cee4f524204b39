//! The tick's way into the trace.

use palpate_haptics::record::TickFlags;
use palpate_trace as trace;
use palpate_trace::TickTrace;

use super::{nanoseconds, signed_nanoseconds};
use crate::tick::TickReport;

/// The tick's way into the trace.
pub(crate) struct TickLine(pub(super) Option<TickTrace>);

impl TickLine {
    /// A line that leads nowhere.
    pub(crate) fn none() -> Self {
        Self(None)
    }

    /// Hands a report over.
    pub(crate) fn push(&mut self, report: &TickReport) {
        let Some(line) = &mut self.0 else { return };
        let r = &report.record;
        let mut flags = trace::TickFlags::default();
        flags.set(trace::TickFlags::FORCE_LIMITED, r.flags.contains(TickFlags::FORCE_LIMITED));
        flags.set(trace::TickFlags::SLEW_LIMITED, r.flags.contains(TickFlags::SLEW_LIMITED));
        flags.set(trace::TickFlags::FADING, r.gain < 1.0);
        flags.set(trace::TickFlags::STALE_SNAPSHOT, r.flags.contains(TickFlags::STALE));
        flags.set(trace::TickFlags::NON_FINITE, r.flags.contains(TickFlags::NON_FINITE));
        flags.set(trace::TickFlags::DEVICE_MISSING, r.flags.contains(TickFlags::DEVICE_ERROR));
        flags.set(trace::TickFlags::WRITE_FAILED, r.sampled && r.device_error.is_some());
        flags.set(trace::TickFlags::OVERRUN, report.overruns > 0);
        flags.set(trace::TickFlags::CONTACTS_DROPPED, r.flags.contains(TickFlags::TRUNCATED));
        // In ticks without a sound sample too: a replay must know when a rest was taken over.
        flags.set(trace::TickFlags::NO_SNAPSHOT, !r.snapshot_valid);
        flags.set(trace::TickFlags::BAD_POSE, r.flags.contains(TickFlags::BAD_POSE));
        flags.set(trace::TickFlags::NEW_SNAPSHOT, r.flags.contains(TickFlags::NEW_SNAPSHOT));
        flags.set(trace::TickFlags::UNCONVERGED, r.flags.contains(TickFlags::NOT_CONVERGED));
        flags.set(trace::TickFlags::LOCAL, r.flags.contains(TickFlags::LOCAL));
        flags.set(trace::TickFlags::BEYOND_PATCH, r.flags.contains(TickFlags::BEYOND_PATCH));
        flags.set(trace::TickFlags::PASSIVITY, r.flags.contains(TickFlags::PASSIVITY));
        flags.set(trace::TickFlags::POWER_LIMITED, r.flags.contains(TickFlags::POWER_LIMITED));
        flags.set(trace::TickFlags::LATE, r.flags.contains(TickFlags::LATE));
        flags.set(trace::TickFlags::JUMPED, r.flags.contains(TickFlags::JUMPED));
        flags.set(trace::TickFlags::TORQUE_LIMITED, r.flags.contains(TickFlags::TORQUE_LIMITED));
        line.push(trace::TickRecord {
            tick: r.index,
            time_ns: nanoseconds(r.time),
            device_position: r.device_pose.translation.vector.into(),
            device_orientation: r.device_pose.rotation.coords.into(),
            device_velocity: r.device_velocity.linear.into(),
            device_angular_velocity: r.device_velocity.angular.into(),
            tool_position: r.tool_pose.translation.vector.into(),
            tool_orientation: r.tool_pose.rotation.coords.into(),
            force: r.wrench.force.into(),
            torque: r.wrench.torque.into(),
            force_unlimited: r.contact_wrench.force.into(),
            gap: if r.contacts > 0 { r.gap } else { f64::NAN },
            contacts: r.active,
            sweeps: r.sweeps,
            residual: r.residual,
            snapshot_step: r.snapshot_step,
            snapshot_age: r.snapshot_age,
            flags,
            wake_latency_ns: nanoseconds(report.latency),
            work_ns: nanoseconds(report.work),
            force_jump: r.force_jump,
            device_gripper: r.gripper.device,
            tool_opening: r.gripper.opening,
            gripper_torque: r.gripper.torque,
            gripper_torque_unlimited: r.gripper.contact_torque,
            gripper_energy: r.gripper.energy,
            gripper_account: r.gripper.account,
            gripper_withheld: r.gripper.withheld,
            torque_unlimited: r.contact_wrench.torque.into(),
            energy: r.energy.account,
            host_lead_ns: signed_nanoseconds(r.host_lead),
        });
    }
}
