//! What a driver hands to a tick.

use std::mem::{offset_of, size_of};

use palpate::session::PortSample;

use crate::layout::Layout;
use crate::status::Status;

/// The field velocity and angular_velocity of the input are measured. Without it the library finds them from the poses.
pub const PALPATE_INPUT_VELOCITY: u32 = 1 << 0;
/// The field gripper of the input is measured.
pub const PALPATE_INPUT_GRIPPER: u32 = 1 << 1;

/// What the device measured, in its own frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Input {
    /// sizeof(palpate_input).
    pub struct_size: u32,
    /// PALPATE_INPUT_... of what is measured beyond the pose, or 0. A bit that this library does not know is refused.
    pub fields: u32,
    /// Time of the measurement on the device's clock, which does not run backwards (ns). 0: the device has no clock, and
    /// the time of the call counts. Force and fades change no faster than both clocks allow, so call at even times.
    pub time_ns: u64,
    /// Position of the end effector (m).
    pub position: [f64; 3],
    /// Orientation of the end effector: a quaternion w, x, y, z of length 1. Four zeros: not turned, for devices that
    /// measure no orientation.
    pub orientation: [f64; 4],
    /// Velocity (m/s).
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
    /// Switches, one bit each.
    pub buttons: u32,
    /// Always 0.
    pub reserved: u32,
    /// How far the gripper is open: 0 closed, 1 open. Counts only with PALPATE_INPUT_GRIPPER; without it the gripper is
    /// open.
    pub gripper: f64,
}

// SAFETY: repr(C), plain numbers; LEAST is the offset of a field.
unsafe impl Layout for Input {
    const LEAST: usize = offset_of!(Self, velocity);

    fn absent() -> Self {
        Self {
            struct_size: 0,
            fields: 0,
            time_ns: 0,
            position: [0.0; 3],
            orientation: [0.0; 4],
            velocity: [0.0; 3],
            angular_velocity: [0.0; 3],
            buttons: 0,
            reserved: 0,
            gripper: 1.0,
        }
    }
}

/// Every bit of what is measured.
const FIELDS: u32 = PALPATE_INPUT_VELOCITY | PALPATE_INPUT_GRIPPER;

impl Input {
    /// Refuses what would be left aside in silence.
    pub(crate) fn checked(self) -> Result<Self, Status> {
        if self.fields & !FIELDS == 0 && self.reserved == 0 { Ok(self) } else { Err(Status::ErrorArgument) }
    }

    /// A struct of a caller that knows no velocity has none, whatever its flags say.
    fn has_velocity(&self) -> bool {
        let whole = self.struct_size as usize >= offset_of!(Self, buttons);
        whole && self.fields & PALPATE_INPUT_VELOCITY != 0
    }

    /// As with the velocity.
    fn has_gripper(&self) -> bool {
        self.struct_size as usize >= size_of::<Self>() && self.fields & PALPATE_INPUT_GRIPPER != 0
    }

    pub(crate) fn sample(&self) -> PortSample {
        PortSample {
            time_ns: (self.time_ns != 0).then_some(self.time_ns),
            position: self.position,
            orientation: if self.orientation == [0.0; 4] { [1.0, 0.0, 0.0, 0.0] } else { self.orientation },
            velocity: self.has_velocity().then_some([self.velocity, self.angular_velocity]),
            buttons: self.buttons,
            gripper: if self.has_gripper() { self.gripper } else { 1.0 },
        }
    }
}
