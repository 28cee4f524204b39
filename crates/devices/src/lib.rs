//! Haptic hardware: vendors' libraries loaded at run time, local services, and recorded traces.
//!
//! Each driver is a file and a line in [`DRIVERS`]. Nothing of a vendor is linked or shipped: a library is found on the
//! machine where the program runs, and a driver whose library is missing says so. A device speaks its own frame;
//! [`place::Placed`] turns it into the world.
//!
//! A device that does not answer, or not what it should, is a [`DeviceError`](palpate_haptics::device::DeviceError) of
//! that tick: the tick sends no force, and goes on when the device does.

mod error;
pub mod force_dimension;
pub mod haply;
mod library;
pub mod openhaptics;
pub mod place;
pub mod replay;

use std::path::PathBuf;

use palpate_haptics::device::HapticDevice;

pub use error::DriverError;

/// What a scene says about the way to its device.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriverConfig {
    /// The vendor's library, where it is not found by its own name.
    pub library: Option<PathBuf>,
    /// Address of the service, where it is not the usual one.
    pub url: Option<String>,
    /// Trace to replay.
    pub trace: Option<PathBuf>,
    /// How far the fingers of the gripper open (m), > 0, where the driver's own figure is not the device's.
    pub gripper_range: Option<f64>,
}

/// An open device, or why there is none.
pub type Opened = Result<Box<dyn HapticDevice>, DriverError>;

/// One line of the register.
#[derive(Clone, Copy, Debug)]
pub struct Driver {
    /// Name in scenes.
    pub name: &'static str,
    /// One line for listings.
    pub summary: &'static str,
    /// Whether the device moves by itself: such a one has no virtual time.
    pub real_time: bool,
    /// Whether its poses are in a frame of its own, which a scene places in the world.
    pub own_frame: bool,
    /// Keys of [`DriverConfig`] that it reads.
    pub keys: &'static [&'static str],
    /// Opens the device.
    pub open: fn(&DriverConfig) -> Opened,
    /// Looks whether the device is there, and answers what was found.
    pub probe: fn(&DriverConfig) -> Result<String, DriverError>,
}

/// The register of drivers.
pub const DRIVERS: &[Driver] = &[force_dimension::DRIVER, openhaptics::DRIVER, haply::DRIVER, replay::DRIVER];

/// The driver of this name.
#[must_use]
pub fn driver(name: &str) -> Option<&'static Driver> {
    DRIVERS.iter().find(|driver| driver.name == name)
}
