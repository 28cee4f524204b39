//! Haptic devices, one file each, behind one trait in SI units.
//!
//! A device is pulled: read a pose, write a wrench, once a tick, on one thread. A device is opened by a URI
//! `name[:argument]` through the register [`DEVICES`]; to add one, write its file and its line there.

mod mechanics;
mod motion;
pub mod scripted;
pub mod spec;
pub mod virtual_device;

use nalgebra::Isometry3;
use thiserror::Error;

use crate::SetupError;
use crate::hand::Hand;
use crate::record::TickFlags;
use crate::script::HandScript;
use crate::wrench::{Twist, Wrench};

pub use scripted::ScriptedDevice;
pub use spec::{DEVICE_PRESETS, DeviceSpec, Freedoms};
pub use virtual_device::{VirtualDevice, VirtualDeviceConfig};

/// The moment of a tick, in virtual time: the same numbers in real time and in lockstep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickTime {
    /// Number of the tick, from 0.
    pub index: u64,
    /// Its time since the start \[s\].
    pub time: f64,
    /// Time since the tick before \[s\].
    pub dt: f64,
    /// What this machine's clock says beyond `dt` \[s\], where that is by a device's: negative where the device's has run
    /// ahead. The limits go by the smaller of both times. `None`: there is one clock.
    pub host_lead: Option<f64>,
}

impl TickTime {
    /// Tick `index` of a regular clock with period `dt` \[s\].
    #[must_use]
    pub fn regular(index: u64, dt: f64) -> Self {
        Self { index, time: index as f64 * dt, dt, host_lead: None }
    }
}

/// What a device measured at one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceSample {
    /// Time of the measurement on the device's clock \[s\]. Informative: nothing in the tick divides by it.
    pub time: f64,
    /// Pose of the end effector in the world \[m\].
    pub pose: Isometry3<f64>,
    /// Its velocity as the device estimates it \[m/s, rad/s\].
    pub velocity: Twist,
    /// Switches, one bit each.
    pub buttons: u32,
    /// How far its gripper is open, 0 closed to 1 open; 1 for a device without.
    pub gripper: f64,
}

impl DeviceSample {
    /// A sample at rest.
    #[must_use]
    pub fn at_rest(time: f64, pose: Isometry3<f64>) -> Self {
        Self { time, pose, velocity: Twist::default(), buttons: 0, gripper: 1.0 }
    }
}

/// Why a device did not answer. `Copy`, so that it crosses the tick without an allocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DeviceError {
    /// The device is gone.
    #[error("the device is not connected")]
    Disconnected,
    /// No answer in time.
    #[error("the device did not answer in time")]
    Timeout,
    /// An answer that cannot be understood.
    #[error("the device's answer cannot be understood")]
    Malformed,
    /// The device is closed.
    #[error("the device is closed")]
    Closed,
    /// The driver's own error code.
    #[error("the device's driver reports error {0}")]
    Driver(i32),
}

/// A haptic device. One thread calls it; `read` and `write` once a tick, without allocating.
pub trait HapticDevice: Send {
    /// What the device can do.
    fn spec(&self) -> &DeviceSpec;

    /// What a user should know of how it was opened, where its record is not certain.
    fn note(&self) -> Option<&str> {
        None
    }

    /// What a user should know of it whatever the scene states: what it has lost of what it was to do.
    fn warning(&self) -> Option<&str> {
        None
    }

    /// Measures pose and switches.
    ///
    /// # Errors
    /// The device does not answer; the tick then sends no force.
    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError>;

    /// Asks for a wrench on the hand, in world axes \[N, N m\]; it is held until the next one.
    ///
    /// # Errors
    /// The device does not answer.
    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError>;

    /// Asks for a force of the gripper, with the next [`write`](Self::write): the work of a whole opening \[J\], positive
    /// opens ([`crate::gripper`]). A device without motors there passes it over.
    fn write_gripper(&mut self, _effort: f64) {}

    /// What limits of the device's own have cut of what the last [`write`](Self::write) asked for:
    /// [`TickFlags::FORCE_LIMITED`] of the wrench, [`TickFlags::TORQUE_LIMITED`] of the gripper. The tick's record shows
    /// them beside its own.
    fn limited(&self) -> TickFlags {
        TickFlags::default()
    }

    /// Takes force off and ends the connection. Calls after it answer [`DeviceError::Closed`].
    fn close(&mut self);
}

/// What the devices that need no hardware are made from; drivers of hardware ignore it.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceSetup {
    /// Path of the hand.
    pub script: HandScript,
    /// The hand, unless the URI names one (`virtual:stylus`).
    pub hand: Hand,
    /// Mechanics of the virtual device.
    pub mechanics: VirtualDeviceConfig,
}

/// An open device, or what its set-up refused.
pub type Opened = Result<Box<dyn HapticDevice>, SetupError>;

/// One line of the register.
#[derive(Clone, Copy, Debug)]
pub struct Registration {
    /// Name: the URI's part before the colon.
    pub name: &'static str,
    /// One line for listings.
    pub summary: &'static str,
    /// Opens the device; the argument is the URI's part after the colon, or empty.
    pub open: fn(argument: &str, setup: &DeviceSetup) -> Opened,
}

/// The register of devices.
pub const DEVICES: &[Registration] = &[virtual_device::REGISTRATION, scripted::REGISTRATION];

/// Opens the device of a URI `name[:argument]`.
///
/// # Errors
/// A name that [`DEVICES`] does not hold, or what the device's own set-up refuses.
pub fn open(uri: &str, setup: &DeviceSetup) -> Opened {
    let (name, argument) = uri.split_once(':').unwrap_or((uri, ""));
    let found = DEVICES.iter().find(|registration| registration.name == name).ok_or_else(|| {
        let known: Vec<_> = DEVICES.iter().map(|registration| registration.name).collect();
        SetupError::UnknownName { kind: "device", name: name.to_owned(), known: known.join(", ") }
    })?;
    (found.open)(argument, setup)
}
