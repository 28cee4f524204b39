//! The tick as described by a scene.

use serde::{Deserialize, Serialize};

use crate::coupling::CouplingConfig;
use crate::device::DeviceSpec;
use crate::limits::LimitsConfig;
use crate::passivity::PassivityConfig;

/// The tick as described by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TickConfig {
    /// Nominal time between ticks \[s\], > 0 (0.001).
    pub period: f64,
    /// Most Gauss-Seidel sweeps of a tick, > 0 (30).
    pub sweeps: u32,
    /// Relative natural-map residual at which the sweeps stop, > 0 (1e-6).
    pub tolerance: f64,
    /// Spring and damper between device and tool.
    pub coupling: CouplingConfig,
    /// Energy of the device's port.
    pub passivity: PassivityConfig,
    /// Limits of force.
    pub limits: LimitsConfig,
}

impl TickConfig {
    /// The defaults for a device, at the device's rate.
    #[must_use]
    pub fn for_device(spec: &DeviceSpec) -> Self {
        Self {
            period: 1.0 / spec.rate,
            sweeps: 30,
            tolerance: 1e-6,
            coupling: CouplingConfig::for_device(spec),
            passivity: PassivityConfig::default(),
            limits: LimitsConfig::default(),
        }
    }
}
