//! What a tick hands back to a driver.

use std::mem::{offset_of, size_of};

use palpate::haptics::wrench::Wrench;
use palpate::session::clock::ClockEvent;
use palpate::session::{Phase, PortReport};
use palpate::tick::TickFlags;

use crate::layout::Layout;

/// A new step of the tissue was taken over.
pub const PALPATE_TICK_NEW_STEP: u32 = 1 << 0;
/// The tissue has not made a step yet: no force.
pub const PALPATE_TICK_NO_STEP: u32 = 1 << 1;
/// The tissue stands still or has failed: the force comes down to zero.
pub const PALPATE_TICK_AT_REST: u32 = 1 << 2;
/// The tissue's latest step is old: the force fades, or is zero.
pub const PALPATE_TICK_STALE: u32 = 1 << 3;
/// The force is rising after a start or an interruption.
pub const PALPATE_TICK_FADE_IN: u32 = 1 << 4;
/// The force was cut to its limit.
pub const PALPATE_TICK_FORCE_LIMITED: u32 = 1 << 5;
/// The torque was cut to its limit.
pub const PALPATE_TICK_TORQUE_LIMITED: u32 = 1 << 6;
/// The change of the force or torque was cut to its limit.
pub const PALPATE_TICK_SLEW_LIMITED: u32 = 1 << 7;
/// A number of the tissue's answer was not finite: no force.
pub const PALPATE_TICK_NON_FINITE: u32 = 1 << 8;
/// The time since the tick before was an interruption: the force comes back as a ramp.
pub const PALPATE_TICK_GAP: u32 = 1 << 10;
/// The contact solver stopped above its tolerance.
pub const PALPATE_TICK_NOT_CONVERGED: u32 = 1 << 11;
/// Contacts were left out because there was no room for them.
pub const PALPATE_TICK_TRUNCATED: u32 = 1 << 12;
/// The input's pose, velocity or gripper was not finite, not a rotation, or beyond 1 km or 1e6 m/s: no force.
pub const PALPATE_TICK_BAD_POSE: u32 = 1 << 13;
/// The tool has moved so far since the tissue's latest step that skin which the tick does not know could touch it unseen.
pub const PALPATE_TICK_BEYOND_PATCH: u32 = 1 << 15;
/// The contact would have given out more energy than it took in: the force, or the gripper's torque, was reduced along the
/// motion.
pub const PALPATE_TICK_PASSIVITY: u32 = 1 << 16;
/// The power given to the hand was cut to its limit.
pub const PALPATE_TICK_POWER_LIMITED: u32 = 1 << 17;
/// The tick came later than half a period after its time.
pub const PALPATE_TICK_LATE: u32 = 1 << 18;
/// The device's pose has jumped: no force until the tool is out of contact or back where it was.
pub const PALPATE_TICK_JUMPED: u32 = 1 << 19;
/// The device's clock stood still, ran backwards, leapt ahead, or did not keep pace: the library's own was used.
pub const PALPATE_TICK_CLOCK: u32 = 1 << 30;
/// The call itself was refused: see the status.
pub const PALPATE_TICK_REFUSED: u32 = 1 << 31;

const _: () = {
    assert!(PALPATE_TICK_NEW_STEP == TickFlags::NEW_SNAPSHOT.bits());
    assert!(PALPATE_TICK_NO_STEP == TickFlags::NO_SNAPSHOT.bits());
    assert!(PALPATE_TICK_AT_REST == TickFlags::INVALID_SNAPSHOT.bits());
    assert!(PALPATE_TICK_STALE == TickFlags::STALE.bits());
    assert!(PALPATE_TICK_FADE_IN == TickFlags::FADE_IN.bits());
    assert!(PALPATE_TICK_FORCE_LIMITED == TickFlags::FORCE_LIMITED.bits());
    assert!(PALPATE_TICK_TORQUE_LIMITED == TickFlags::TORQUE_LIMITED.bits());
    assert!(PALPATE_TICK_SLEW_LIMITED == TickFlags::SLEW_LIMITED.bits());
    assert!(PALPATE_TICK_NON_FINITE == TickFlags::NON_FINITE.bits());
    assert!(PALPATE_TICK_GAP == TickFlags::GAP.bits());
    assert!(PALPATE_TICK_NOT_CONVERGED == TickFlags::NOT_CONVERGED.bits());
    assert!(PALPATE_TICK_TRUNCATED == TickFlags::TRUNCATED.bits());
    assert!(PALPATE_TICK_BAD_POSE == TickFlags::BAD_POSE.bits());
    assert!(PALPATE_TICK_BEYOND_PATCH == TickFlags::BEYOND_PATCH.bits());
    assert!(PALPATE_TICK_PASSIVITY == TickFlags::PASSIVITY.bits());
    assert!(PALPATE_TICK_POWER_LIMITED == TickFlags::POWER_LIMITED.bits());
    assert!(PALPATE_TICK_LATE == TickFlags::LATE.bits());
    assert!(PALPATE_TICK_JUMPED == TickFlags::JUMPED.bits());
};

/// Flags of a tick that a driver is not told: that contacts are those of the tick itself is no news, and a device that does
/// not answer is the driver's own.
const UNTOLD: u32 = TickFlags::LOCAL.bits() | TickFlags::DEVICE_ERROR.bits();

/// Flags of a tick that a driver is told.
const TOLD: u32 = PALPATE_TICK_NEW_STEP
    | PALPATE_TICK_NO_STEP
    | PALPATE_TICK_AT_REST
    | PALPATE_TICK_STALE
    | PALPATE_TICK_FADE_IN
    | PALPATE_TICK_FORCE_LIMITED
    | PALPATE_TICK_TORQUE_LIMITED
    | PALPATE_TICK_SLEW_LIMITED
    | PALPATE_TICK_NON_FINITE
    | PALPATE_TICK_GAP
    | PALPATE_TICK_NOT_CONVERGED
    | PALPATE_TICK_TRUNCATED
    | PALPATE_TICK_BAD_POSE
    | PALPATE_TICK_BEYOND_PATCH
    | PALPATE_TICK_PASSIVITY
    | PALPATE_TICK_POWER_LIMITED
    | PALPATE_TICK_LATE
    | PALPATE_TICK_JUMPED;

// A new flag is named in the header, or said to be untold.
const _: () = assert!(TOLD ^ UNTOLD == (1 << TickFlags::COUNT) - 1 && TOLD & UNTOLD == 0);

/// What a tick answers, in the device's frame. Set struct_size once; the library fills in the rest at every call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// sizeof(palpate_output).
    pub struct_size: u32,
    /// PALPATE_TICK_... of what happened.
    pub flags: u32,
    /// Number of the tick since the start.
    pub tick: u64,
    /// Force on the hand, for the motors (N): after all limits, zero after every error.
    pub force: [f64; 3],
    /// Torque on the hand about the tool's origin, for the motors (N m).
    pub torque: [f64; 3],
    /// Contact force before limits and fades (N).
    pub contact_force: [f64; 3],
    /// Position of the tool behind the coupling, on the skin where there is contact (m): what to draw.
    pub tool_position: [f64; 3],
    /// Its orientation: quaternion w, x, y, z.
    pub tool_orientation: [f64; 4],
    /// Smallest gap between tool and skin (m); +infinity where none is watched.
    pub gap: f64,
    /// Share of the contact force that is let through, 0 to 1.
    pub gain: f64,
    /// Age of the tissue's latest step (s); +infinity before the first, and where the call is refused.
    pub step_age: f64,
    /// Time since the tick before that the force was given to change (s): no more than the device's clock says, nor the
    /// library's.
    pub dt: f64,
    /// Work of this tick (s).
    pub work: f64,
    /// Contacts that carry force.
    pub contacts: u32,
    /// One of PALPATE_PHASE_...; where port is NULL, or a mistake inside the library has ended it, PALPATE_PHASE_FAILED.
    pub phase: u32,
    /// Energy that went through the port in the contact that lasts (J); positive: the hand has put it in.
    pub energy: f64,
    /// Contact torque about the tool's origin, before limits and fades (N m).
    pub contact_torque: [f64; 3],
    /// Force on the gripper, for its motor, after all limits, as the work of a whole opening from closed to open (J):
    /// divide by the range of the device's gripper, in rad for a torque in N m, in m for a force in N. Positive opens.
    pub gripper_effort: f64,
    /// Torque on the angle between the tool's jaws, after all limits (N m); positive opens.
    pub gripper_torque: f64,
    /// Angle between the tool's jaws behind the coupling (rad): what to draw. 0 for a tool without.
    pub tool_opening: f64,
}

// SAFETY: repr(C), plain numbers; LEAST is the offset of a field.
unsafe impl Layout for Output {
    const LEAST: usize = offset_of!(Self, contact_force);

    fn absent() -> Self {
        Self {
            struct_size: 0,
            flags: PALPATE_TICK_REFUSED,
            tick: 0,
            force: [0.0; 3],
            torque: [0.0; 3],
            contact_force: [0.0; 3],
            tool_position: [0.0; 3],
            tool_orientation: [1.0, 0.0, 0.0, 0.0],
            gap: f64::INFINITY,
            gain: 0.0,
            step_age: f64::INFINITY,
            dt: 0.0,
            work: 0.0,
            contacts: 0,
            phase: Phase::Failed as u32,
            energy: 0.0,
            contact_torque: [0.0; 3],
            gripper_effort: 0.0,
            gripper_torque: 0.0,
            tool_opening: 0.0,
        }
    }
}

impl Output {
    pub(crate) fn new(report: &PortReport, contact: &Wrench) -> Self {
        let r = &report.record;
        let clock = if report.clock == ClockEvent::Sound { 0 } else { PALPATE_TICK_CLOCK };
        let [x, y, z, w]: [f64; 4] = report.tool.rotation.coords.into();
        Self {
            struct_size: size_of::<Self>() as u32,
            flags: r.flags.bits() & TOLD | clock,
            tick: r.index,
            force: report.wrench.force.into(),
            torque: report.wrench.torque.into(),
            contact_force: contact.force.into(),
            tool_position: report.tool.translation.vector.into(),
            tool_orientation: [w, x, y, z],
            gap: if r.contacts > 0 { r.gap } else { f64::INFINITY },
            gain: r.gain,
            step_age: r.snapshot_age,
            dt: report.dt,
            work: report.work,
            contacts: r.active,
            phase: report.phase as u32,
            energy: r.energy.account,
            contact_torque: contact.torque.into(),
            gripper_effort: r.gripper.effort,
            gripper_torque: r.gripper.torque,
            tool_opening: r.gripper.opening,
        }
    }
}
