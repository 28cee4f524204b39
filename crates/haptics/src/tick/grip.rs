//! The tick's part of the gripper: what the device measured, where the jaws are, and what is sent back.

use nalgebra::Isometry3;
use palpate_collision::ToolPose;
use palpate_collision::tool::Hinge;

use super::{Tick, TickState, is_pose, is_velocity};
use crate::SetupError;
use crate::device::DeviceSample;
use crate::gripper::{GripConfig, Gripper, GripperRecord};
use crate::record::TickFlags;

impl Tick {
    /// Lets the device's gripper turn the jaws of the tool on this hinge.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn with_gripper(self, config: &GripConfig, hinge: Hinge) -> Result<Self, SetupError> {
        Ok(Self { gripper: Some(Gripper::new(config, hinge, &self.passivity, self.period)?), ..self })
    }

    /// Takes a sound sample over.
    pub(super) fn read(&self, state: &mut TickState, sample: &DeviceSample) {
        (state.device_pose, state.device_velocity) = (sample.pose, sample.velocity);
        state.device_gripper = sample.gripper;
        if let Some(gripper) = &self.gripper {
            gripper.read(&mut state.gripper, sample.gripper);
        }
    }

    /// The tool behind the couplings, with the device at this pose.
    pub(super) fn tool(&self, state: &TickState, device: &Isometry3<f64>) -> ToolPose {
        let opening = self.gripper.as_ref().map_or(0.0, |gripper| gripper.opening(&state.gripper));
        ToolPose { frame: state.coupling.tool(device), opening }
    }

    pub(super) fn settle_gripper(&self, state: &mut TickState, torque: f64) {
        if let Some(gripper) = &self.gripper {
            gripper.settle(&mut state.gripper, torque);
        }
    }

    /// What is sent to the gripper for this torque of the contacts \[N m\].
    pub(super) fn grip(
        &self,
        state: &mut TickState,
        contact_torque: f64,
        dt: f64,
        flags: &mut TickFlags,
    ) -> GripperRecord {
        let device = state.device_gripper;
        let Some(gripper) = &self.gripper else { return GripperRecord { device, ..GripperRecord::default() } };
        let (torque, withheld) = gripper.send(&mut state.gripper, contact_torque, state.limits.gain, dt, flags);
        let (opening, effort) = (gripper.opening(&state.gripper), gripper.effort(torque));
        let (energy, account) = state.gripper.energy();
        GripperRecord { device, opening, torque, contact_torque, effort, energy, account, withheld }
    }
}

/// Whether pose, velocity and gripper of a sample can be ones.
pub(super) fn is_sound(sample: &DeviceSample) -> bool {
    is_pose(&sample.pose) && is_velocity(&sample.velocity) && sample.gripper.is_finite()
}
