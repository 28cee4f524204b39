//! What a program that embeds the library knows better than the scene: its device, its rate, its limits.

use palpate_devices::place::PlaceConfig;
use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::device::DeviceSpec;

use crate::devices::{PORT, spec};
use crate::scene::{Scene, SceneError};

/// Lowest rate of a driver (Hz): below it the coupling is so soft that contact is not felt as such.
pub const LOWEST_RATE: f64 = 100.0;

/// Highest rate of a driver (Hz).
pub const HIGHEST_RATE: f64 = 8000.0;

/// Changes to a scene for a driver that ticks; what is `None` stays as the scene says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PortConfig {
    /// Nominal rate of the ticks (Hz), [`LOWEST_RATE`] to [`HIGHEST_RATE`].
    pub rate: Option<f64>,
    /// Largest force of the device (N).
    pub max_force: Option<f64>,
    /// Largest torque of the device (N m); 0: none is sent.
    pub max_torque: Option<f64>,
    /// Largest power that is given to the hand (W).
    pub max_power: Option<f64>,
    /// Largest closed-loop stiffness of the device at 1 kHz (N/m).
    pub max_stiffness: Option<f64>,
    /// Largest closed-loop damping of the device at 1 kHz (N s/m).
    pub max_damping: Option<f64>,
    /// Largest change of force (N/s).
    pub force_slew: Option<f64>,
    /// Largest change of torque (N m/s).
    pub torque_slew: Option<f64>,
    /// Time from no force to full force (s).
    pub fade_in: Option<f64>,
    /// Age of the tissue's last step at which the force begins to fade (s).
    pub stale_after: Option<f64>,
    /// Age at which it is zero (s).
    pub stale_zero: Option<f64>,
    /// Time between two ticks after which the force comes back as a ramp (s).
    pub gap: Option<f64>,
    /// Energy that a contact may give out beyond what it took in (J).
    pub energy_allowance: Option<f64>,
    /// Whether the passivity layer acts on the force.
    pub passivity: Option<bool>,
    /// Speed above which a motion of the device is no hand's (m/s).
    pub jump_speed: Option<f64>,
    /// Length of such a motion at which the pose is taken to have jumped (m).
    pub jump_distance: Option<f64>,
    /// Apparent mass of the device (kg).
    pub device_mass: Option<f64>,
    /// Its own viscous damping (N s/m).
    pub device_damping: Option<f64>,
    /// Its own Coulomb friction (N).
    pub device_friction: Option<f64>,
    /// Smallest change of position that it measures (m).
    pub device_resolution: Option<f64>,
    /// Ticks from a wrench to its effect, at this rate.
    pub device_delay_ticks: Option<usize>,
    /// Where the device stands.
    pub place: Option<PlaceConfig>,
}

/// Options that a scene cannot be run with.
#[derive(Debug, thiserror::Error)]
pub enum PortConfigError {
    /// One of them, whatever the others are.
    #[error("{option}: {reason}")]
    Option {
        /// The field of [`PortConfig`].
        option: &'static str,
        /// What is wrong with its value, and the remedy.
        reason: String,
    },
    /// The scene, or all options together.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Takes one option over.
type Take = fn(&mut PortConfig, &PortConfig);

/// Every option by its name.
const OPTIONS: [(&str, Take); 23] = [
    ("rate", |to, from| to.rate = from.rate),
    ("max_force", |to, from| to.max_force = from.max_force),
    ("max_torque", |to, from| to.max_torque = from.max_torque),
    ("max_power", |to, from| to.max_power = from.max_power),
    ("max_stiffness", |to, from| to.max_stiffness = from.max_stiffness),
    ("max_damping", |to, from| to.max_damping = from.max_damping),
    ("force_slew", |to, from| to.force_slew = from.force_slew),
    ("torque_slew", |to, from| to.torque_slew = from.torque_slew),
    ("fade_in", |to, from| to.fade_in = from.fade_in),
    ("stale_after", |to, from| to.stale_after = from.stale_after),
    ("stale_zero", |to, from| to.stale_zero = from.stale_zero),
    ("gap", |to, from| to.gap = from.gap),
    ("energy_allowance", |to, from| to.energy_allowance = from.energy_allowance),
    ("passivity", |to, from| to.passivity = from.passivity),
    ("jump_speed", |to, from| to.jump_speed = from.jump_speed),
    ("jump_distance", |to, from| to.jump_distance = from.jump_distance),
    ("device_mass", |to, from| to.device_mass = from.device_mass),
    ("device_damping", |to, from| to.device_damping = from.device_damping),
    ("device_friction", |to, from| to.device_friction = from.device_friction),
    ("device_resolution", |to, from| to.device_resolution = from.device_resolution),
    ("device_delay_ticks", |to, from| to.device_delay_ticks = from.device_delay_ticks),
    ("origin", |to, from| {
        to.place = from.place.map(|place| PlaceConfig { axes: PlaceConfig::default().axes, ..place })
    }),
    ("axes", |to, from| to.place = from.place),
];

impl PortConfig {
    /// Writes them into the scene, so that its trace holds what a replay needs.
    ///
    /// Without a coupling of the scene's own, it is what suits the device at this rate ([`CouplingConfig::at_rate`]): the
    /// stable stiffness of a sampled loop is proportional to the rate, and a faster loop than the device's record speaks
    /// of is not trusted with more.
    ///
    /// # Errors
    /// A number out of its range, by the name of its option. The scene is unchanged then.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), PortConfigError> {
        let Err(error) = self.write(scene) else { return Ok(()) };
        // The text that the error speaks of is one that nobody has written.
        for (option, take) in OPTIONS {
            let mut alone = Self::default();
            take(&mut alone, self);
            if alone == Self::default() {
                continue;
            }
            if let Err(error) = alone.write(&mut scene.clone()) {
                return Err(PortConfigError::Option { option, reason: error.reason() });
            }
        }
        Err(error.into())
    }

    fn write(&self, scene: &mut Scene) -> Result<(), SceneError> {
        let rate = self.rate.unwrap_or(scene.description().rates.tick);
        if !(LOWEST_RATE..=HIGHEST_RATE).contains(&rate) {
            let message = format!("a driver that ticks at {rate} Hz is outside {LOWEST_RATE} to {HIGHEST_RATE} Hz");
            return Err(scene.at("rates.tick", message, "give the rate at which the driver calls"));
        }
        let refused = |e: palpate_haptics::SetupError| scene.at("device", e.to_string(), "correct the value");
        let record = self.record(&spec(&scene.description().device, None).map_err(refused)?);
        scene.edit(|d| {
            d.device.kind = PORT.into();
            (d.device.library, d.device.url, d.device.trace) = (None, None, None);
            d.device.gripper_range = None;
            d.rates.tick = rate;
            if d.coupling.is_none() {
                d.coupling = Some(CouplingConfig::at_rate(&record, rate));
            }
            (d.device.preset, d.device.record) = (None, Some(record));
            if let Some(place) = self.place {
                (d.device.origin, d.device.axes) = (place.origin, place.axes);
            }
            let set = |value: &mut f64, given: Option<f64>| *value = given.unwrap_or(*value);
            d.passivity.control = self.passivity.unwrap_or(d.passivity.control);
            d.passivity.allowance = self.energy_allowance.unwrap_or(d.passivity.allowance);
            d.limits.max_power = self.max_power.or(d.limits.max_power);
            set(&mut d.limits.force_slew, self.force_slew);
            set(&mut d.limits.torque_slew, self.torque_slew);
            set(&mut d.limits.fade_in, self.fade_in);
            set(&mut d.limits.stale_after, self.stale_after);
            set(&mut d.limits.stale_zero, self.stale_zero);
            set(&mut d.limits.gap, self.gap);
            set(&mut d.limits.jump_speed, self.jump_speed);
            set(&mut d.limits.jump_distance, self.jump_distance);
        })
    }

    fn record(&self, scene: &DeviceSpec) -> DeviceSpec {
        let mut record = scene.clone();
        record.max_force = self.max_force.unwrap_or(record.max_force);
        record.max_torque = self.max_torque.unwrap_or(record.max_torque);
        record.max_stiffness = self.max_stiffness.unwrap_or(record.max_stiffness);
        record.max_damping = self.max_damping.unwrap_or(record.max_damping);
        record.mass = self.device_mass.or(record.mass);
        record.damping = self.device_damping.or(record.damping);
        record.friction = self.device_friction.or(record.friction);
        record.resolution = self.device_resolution.or(record.resolution);
        record.delay_ticks = self.device_delay_ticks.or(record.delay_ticks);
        record.freedoms.drives_torque |= record.max_torque > 0.0;
        record
    }
}
