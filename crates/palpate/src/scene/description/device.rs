//! The haptic device and the hand that holds it.

use palpate_devices::place::{Direction, PlaceConfig};
use palpate_haptics::device::{DeviceSpec, VirtualDeviceConfig};
use palpate_haptics::script::ScriptKey;
use serde::{Deserialize, Serialize};

/// The haptic device.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceDescription {
    /// Register name of the device: `virtual` (held by the virtual hand), `scripted` (follows the path exactly), a driver
    /// of hardware (`palpate devices` lists them), or `port`, where the program that embeds the library ticks.
    pub kind: String,
    /// Published limits of a real device, such as `omega.3`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Limits of a device that has no preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record: Option<DeviceSpec>,
    /// The vendor's library, where it is not found by its own name; for `force_dimension` and `openhaptics`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub library: Option<String>,
    /// Address of the service, where it is not the usual one; for `haply`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub url: Option<String>,
    /// Trace whose device poses are repeated, relative to the scene file; for `replay`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<String>,
    /// How far the fingers of the device's gripper open (m), > 0, where that is not 25 mm; for `force_dimension`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gripper_range: Option<f64>,
    /// Where the origin of the device's frame lies in the world (m); for hardware and `port`.
    pub origin: [f64; 3],
    /// Which way the device's x, y and z point in the world, such as `["y", "-x", "z"]`; for hardware and `port`.
    pub axes: [Direction; 3],
    /// Mass, damping, friction, encoder, delay and jitter of the virtual device.
    pub mechanics: VirtualDeviceConfig,
}

impl Default for DeviceDescription {
    fn default() -> Self {
        let PlaceConfig { origin, axes } = PlaceConfig::default();
        let mechanics = VirtualDeviceConfig::default();
        let (preset, record, library, url, trace, gripper_range) = (None, None, None, None, None, None);
        Self { kind: "virtual".into(), preset, record, library, url, trace, gripper_range, origin, axes, mechanics }
    }
}

impl DeviceDescription {
    /// Where the device stands.
    pub fn place(&self) -> PlaceConfig {
        PlaceConfig { origin: self.origin, axes: self.axes }
    }
}

/// The virtual hand and the path that it follows.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandDescription {
    /// Mass, damping and stiffness of a grip: `none`; a stylus held `loose`, `normal` or `firm`, as published; `fingertip`,
    /// `stylus` or `arm`.
    pub preset: String,
    /// Times (s) and positions (m), joined by minimum-jerk motions. A real hand holds hardware: there the path may be
    /// left out, and the tool begins at the device's origin.
    pub path: Vec<ScriptKey>,
}

impl Default for HandDescription {
    fn default() -> Self {
        Self { preset: "arm".into(), path: Vec::new() }
    }
}
