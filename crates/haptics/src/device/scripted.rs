//! A device that follows its script exactly and feels nothing: the same input for every method under test.

use nalgebra::{Isometry3, Translation3};

use super::{DeviceError, DeviceSample, DeviceSetup, DeviceSpec, HapticDevice, Opened, Registration, TickTime};
use crate::script::HandScript;
use crate::wrench::{Twist, Wrench};

/// Line in the register of devices.
pub const REGISTRATION: Registration =
    Registration { name: "scripted", summary: "follows a script exactly, ignores force", open };

/// A position device without mechanics.
#[derive(Clone, Debug)]
pub struct ScriptedDevice {
    spec: DeviceSpec,
    script: HandScript,
    wrench: Wrench,
    open: bool,
}

impl ScriptedDevice {
    /// A device on this path.
    #[must_use]
    pub fn new(script: HandScript) -> Self {
        let spec = DeviceSpec { name: "scripted".to_owned(), ..DeviceSpec::virtual_device(0.0) };
        Self { spec, script, wrench: Wrench::zero(), open: true }
    }

    /// The wrench last written.
    #[must_use]
    pub fn wrench(&self) -> Wrench {
        self.wrench
    }
}

fn open(_argument: &str, setup: &DeviceSetup) -> Opened {
    Ok(Box::new(ScriptedDevice::new(setup.script.clone())))
}

impl HapticDevice for ScriptedDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        let intent = self.script.intent(tick.time);
        let pose = Isometry3::from_parts(Translation3::from(intent.position), intent.rotation);
        let velocity = Twist { linear: intent.velocity, angular: intent.angular_velocity };
        Ok(DeviceSample { velocity, gripper: intent.gripper, ..DeviceSample::at_rest(tick.time, pose) })
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        self.wrench = wrench;
        Ok(())
    }

    fn close(&mut self) {
        self.wrench = Wrench::zero();
        self.open = false;
    }
}
