//! What a device can do: the record that CHAI3D keeps of each, in SI units.
//!
//! The limits of force and the default coupling are taken from here, so that a scene runs on another device without a
//! change. The table of presets is CHAI3D's own (BSD-3, the `cHapticDeviceInfo` of each driver): "maximum
//! closed-loop stiffness" and "damping" are its authors' figures for a loop at 1 kHz, not vendor data. A torque limit
//! of 0 means that the record names none, and then no torque is sent. Apparent mass and backdrive friction of the
//! Touch, Omni, Desktop and Premium are those of their makers' data sheets (SensAble, 3D Systems). No maker states the
//! viscous damping of its device: it stays unknown, and what is tuned by it falls back on a caution that its use states.

use serde::{Deserialize, Serialize};

use super::virtual_device::{MAX_DELAY, VirtualDeviceConfig};
use crate::SetupError;
use crate::error::{non_negative, positive};

/// Which motions a device senses and drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Freedoms {
    /// Position is measured.
    pub senses_position: bool,
    /// Orientation is measured.
    pub senses_rotation: bool,
    /// Forces are rendered.
    pub drives_force: bool,
    /// Torques are rendered.
    pub drives_torque: bool,
    /// There is a gripper.
    pub gripper: bool,
}

/// The record of a device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceSpec {
    /// Name for listings and records.
    pub name: String,
    /// Largest force \[N\], > 0.
    pub max_force: f64,
    /// Largest torque \[N m\], ≥ 0; 0: none is sent.
    pub max_torque: f64,
    /// Largest closed-loop stiffness at `rate` \[N/m\], > 0.
    pub max_stiffness: f64,
    /// Largest closed-loop damping at `rate` \[N s/m\], ≥ 0.
    pub max_damping: f64,
    /// Radius of the workspace \[m\], > 0.
    pub workspace_radius: f64,
    /// Smallest change of position that is measured \[m\], where it is known.
    pub resolution: Option<f64>,
    /// Rate that the figures hold for \[Hz\], > 0.
    pub rate: f64,
    /// Largest power that it is to give to the hand \[W\], > 0, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_power: Option<f64>,
    /// Apparent mass at the end effector \[kg\], > 0, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// Its own viscous damping \[N s/m\], ≥ 0, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Its own Coulomb friction \[N\], ≥ 0, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Ticks from a wrench being written to its effect, where it is known; elsewhere one is assumed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_ticks: Option<usize>,
    /// Which motions are sensed and driven.
    pub freedoms: Freedoms,
}

/// Largest stiffness that the virtual device renders with nobody holding it, with 2 N s/m of coupling damping, one
/// tick of delay and no friction \[N/m\]: 1439 by the eigenvalues of the sampled loop, rounded down.
const VIRTUAL_MAX_STIFFNESS: f64 = 1400.0;

/// Largest power of the virtual device \[W\]: its largest force at 1 m/s, at which a hand that is pushed lets go.
const VIRTUAL_MAX_POWER: f64 = 12.0;

impl DeviceSpec {
    /// The record of the virtual device with this encoder step \[m\] and the mechanics of its default.
    #[must_use]
    pub fn virtual_device(encoder_step: f64) -> Self {
        Self::of_mechanics(&VirtualDeviceConfig { encoder_step, ..VirtualDeviceConfig::default() })
    }

    /// The record of a virtual device of these mechanics.
    #[must_use]
    pub fn of_mechanics(mechanics: &VirtualDeviceConfig) -> Self {
        Self {
            name: "virtual".to_owned(),
            max_force: 12.0,
            max_torque: 0.0,
            max_stiffness: VIRTUAL_MAX_STIFFNESS,
            max_damping: 5.0,
            workspace_radius: 0.15,
            resolution: (mechanics.encoder_step > 0.0).then_some(mechanics.encoder_step),
            rate: 1000.0,
            max_power: Some(VIRTUAL_MAX_POWER),
            mass: Some(mechanics.mass),
            damping: Some(mechanics.damping),
            friction: Some(mechanics.friction),
            delay_ticks: Some(mechanics.delay_ticks),
            freedoms: POSITION_ONLY,
        }
    }

    /// The record of a real device in [`DEVICE_PRESETS`].
    ///
    /// # Errors
    /// A name that the table does not hold.
    pub fn preset(name: &str) -> Result<Self, SetupError> {
        DEVICE_PRESETS.iter().find(|preset| preset.name == name).map(DevicePreset::spec).ok_or_else(|| {
            let known: Vec<_> = DEVICE_PRESETS.iter().map(|preset| preset.name).collect();
            SetupError::UnknownName { kind: "device record", name: name.to_owned(), known: known.join(", ") }
        })
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number that is negative, zero where it must not be, or not finite.
    pub fn validate(&self) -> Result<(), SetupError> {
        positive("device maximum force [N]", self.max_force)?;
        non_negative("device maximum torque [N m]", self.max_torque)?;
        positive("device maximum stiffness [N/m]", self.max_stiffness)?;
        non_negative("device maximum damping [N s/m]", self.max_damping)?;
        positive("device workspace radius [m]", self.workspace_radius)?;
        positive("device rate [Hz]", self.rate)?;
        let given = |value: Option<f64>, check: fn(&'static str, f64) -> Result<(), SetupError>, what| {
            value.map_or(Ok(()), |value| check(what, value))
        };
        given(self.resolution, positive, "device resolution [m]")?;
        given(self.max_power, positive, "device maximum power [W]")?;
        given(self.mass, positive, "device mass [kg]")?;
        given(self.damping, non_negative, "device damping [N s/m]")?;
        given(self.friction, non_negative, "device friction [N]")?;
        match self.delay_ticks {
            Some(delay) if delay > MAX_DELAY => {
                Err(SetupError::OutOfRange { what: "device delay_ticks", value: delay as f64, range: "0 to 15" })
            }
            _ => Ok(()),
        }
    }
}

/// One row of CHAI3D's table.
#[derive(Clone, Copy, Debug)]
pub struct DevicePreset {
    /// Name in scenes.
    pub name: &'static str,
    /// \[N\]
    pub max_force: f64,
    /// \[N m\]
    pub max_torque: f64,
    /// \[N/m\]
    pub max_stiffness: f64,
    /// \[N s/m\]
    pub max_damping: f64,
    /// \[m\]
    pub workspace_radius: f64,
    /// Motions.
    pub freedoms: Freedoms,
    /// Apparent mass at the tip \[kg\], where its maker states one.
    pub mass: Option<f64>,
    /// Friction felt when it is driven back \[N\], where its maker states one.
    pub friction: Option<f64>,
}

impl DevicePreset {
    fn spec(&self) -> DeviceSpec {
        DeviceSpec {
            name: self.name.to_owned(),
            max_force: self.max_force,
            max_torque: self.max_torque,
            max_stiffness: self.max_stiffness,
            max_damping: self.max_damping,
            workspace_radius: self.workspace_radius,
            resolution: None,
            rate: 1000.0,
            max_power: None,
            mass: self.mass,
            damping: None,
            friction: self.friction,
            delay_ticks: None,
            freedoms: self.freedoms,
        }
    }
}

const POSITION_ONLY: Freedoms = Freedoms {
    senses_position: true,
    senses_rotation: false,
    drives_force: true,
    drives_torque: false,
    gripper: false,
};
const WITH_ROTATION: Freedoms = Freedoms { senses_rotation: true, ..POSITION_ONLY };
const WITH_GRIPPER: Freedoms = Freedoms { gripper: true, ..WITH_ROTATION };
const WITH_TORQUE: Freedoms = Freedoms { drives_torque: true, ..WITH_GRIPPER };

const fn row(
    name: &'static str,
    [max_force, max_torque]: [f64; 2],
    [max_stiffness, max_damping]: [f64; 2],
    workspace_radius: f64,
    freedoms: Freedoms,
) -> DevicePreset {
    let (mass, friction) = (None, None);
    DevicePreset { name, max_force, max_torque, max_stiffness, max_damping, workspace_radius, freedoms, mass, friction }
}

/// The same device with what its maker states of its mechanics.
const fn with(preset: DevicePreset, mass: f64, friction: f64) -> DevicePreset {
    DevicePreset { mass: Some(mass), friction: Some(friction), ..preset }
}

/// Records of real devices.
pub const DEVICE_PRESETS: &[DevicePreset] = &[
    row("omega.3", [12.0, 0.0], [5000.0, 30.0], 0.075, POSITION_ONLY),
    row("omega.6", [12.0, 0.0], [5000.0, 30.0], 0.075, WITH_ROTATION),
    row("omega.7", [12.0, 0.0], [5000.0, 30.0], 0.075, WITH_GRIPPER),
    row("delta.3", [20.0, 0.0], [5000.0, 30.0], 0.15, POSITION_ONLY),
    row("sigma.7", [12.0, 0.2], [4000.0, 30.0], 0.075, WITH_TORQUE),
    row("lambda.7", [12.0, 0.0], [8000.0, 30.0], 0.1125, WITH_GRIPPER),
    row("falcon", [8.0, 0.0], [3000.0, 20.0], 0.04, POSITION_ONLY),
    with(row("touch", [3.3, 0.0], [400.0, 4.0], 0.075, WITH_ROTATION), 0.045, 0.26),
    with(row("phantom-omni", [3.3, 0.0], [700.0, 5.0], 0.1, WITH_ROTATION), 0.045, 0.26),
    with(row("phantom-desktop", [7.9, 0.0], [1000.0, 5.0], 0.1, WITH_ROTATION), 0.045, 0.06),
    with(row("phantom-premium-1.5", [8.5, 0.0], [800.0, 5.0], 0.12, WITH_ROTATION), 0.075, 0.04),
    with(row("phantom-premium-3.0", [22.0, 0.0], [1000.0, 5.0], 0.25, WITH_ROTATION), 0.159, 0.2),
    row("haply-pantograph", [5.0, 0.0], [300.0, 2.0], 0.1, POSITION_ONLY),
];
