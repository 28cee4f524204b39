//! The haptic device and the hand that holds it.

use palpate_haptics::device::VirtualDeviceConfig;
use palpate_haptics::script::ScriptKey;
use serde::{Deserialize, Serialize};

/// The haptic device.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceDescription {
    /// Register name of the device: `virtual` (held by the virtual hand) or `scripted` (follows the path exactly).
    pub kind: String,
    /// Published limits of a real device that the virtual one takes on, such as `omega.3`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Mass, damping, friction, encoder and delay of the virtual device.
    pub mechanics: VirtualDeviceConfig,
}

impl Default for DeviceDescription {
    fn default() -> Self {
        Self { kind: "virtual".into(), preset: None, mechanics: VirtualDeviceConfig::default() }
    }
}

/// The virtual hand and the path that it follows.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandDescription {
    /// Published mass, damping and stiffness of a grip: `none`, `fingertip`, `stylus`, `arm` or `firm`.
    pub preset: String,
    /// Times (s) and positions (m), joined by minimum-jerk motions.
    pub path: Vec<ScriptKey>,
}

impl Default for HandDescription {
    fn default() -> Self {
        Self { preset: "arm".into(), path: Vec::new() }
    }
}
