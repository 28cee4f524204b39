//! The gripper: spring and damper between the device's gripper and the opening of the tool's jaws, and its limits.
//!
//! The coupling of the tool's pose ([`crate::coupling`]) once more, in one number. With θ_d the opening that the device's
//! gripper asks for, e = θ_d − θ, the tick T and Q the torque of the contacts on the opening (N m; positive opens),
//! ```text
//! K e + B (e − e₋) / T + Q = 0      e = β e₋ − c Q      c = 1 / (K + B/T)  rad/(N m),   β = c B/T
//! W_tick += c g gᵀ                                      g: rate of the gap per rad of opening, m/rad
//! ```
//! so two jaws that meet something hard squeeze it with the torque of the spring, and the hand feels Q. It is sent
//! as the work of a whole opening, Q (θ_open − θ_closed) in J, which a device divides by its own range: in rad for a
//! torque in N m, in m for a force in N.

use palpate_collision::tool::Hinge;
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::error::{non_negative, positive};
use crate::record::TickFlags;

/// The coupling of the jaws and the limits of their torque, as described by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GripConfig {
    /// K \[N m/rad\], > 0 (1: 1100 N/m at the tip of a jaw of 30 mm).
    pub stiffness: f64,
    /// B \[N m s/rad\], ≥ 0 (0.002).
    pub damping: f64,
    /// Largest torque on the opening that is sent \[N m\], ≥ 0 (0.3: 8 N at 40 mm, what grippers of devices render).
    pub max_torque: f64,
    /// Largest change of it \[N m/s\], > 0 (40).
    pub torque_slew: f64,
}

impl Default for GripConfig {
    fn default() -> Self {
        Self { stiffness: 1.0, damping: 0.002, max_torque: 0.3, torque_slew: 40.0 }
    }
}

impl GripConfig {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn validate(&self) -> Result<(), SetupError> {
        positive("grip stiffness [N m/rad]", self.stiffness)?;
        non_negative("grip damping [N m s/rad]", self.damping)?;
        non_negative("grip max_torque [N m]", self.max_torque)?;
        positive("grip torque_slew [N m/s]", self.torque_slew)
    }
}

/// The gripper of a tool at a fixed period: description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    hinge: Hinge,
    compliance: f64,
    memory: f64,
    max_torque: f64,
    torque_slew: f64,
}

/// What a gripper remembers between ticks: state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GripperState {
    /// Opening of the device less that of the tool \[rad\].
    stretch: f64,
    /// Torque last sent \[N m\].
    sent: f64,
    /// Opening that the device asked for \[rad\].
    device: f64,
}

/// The gripper in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GripperRecord {
    /// What the device measured, 0 closed to 1 open.
    pub device: f64,
    /// Opening of the tool's jaws behind the coupling \[rad\]; 0 for a tool without.
    pub opening: f64,
    /// Torque on the opening that was sent, after all limits; positive opens \[N m\].
    pub torque: f64,
    /// The same of the contacts before limits \[N m\].
    pub contact_torque: f64,
    /// Work of the sent torque over a whole opening of the gripper \[J\].
    pub effort: f64,
}

impl Gripper {
    /// The gripper of jaws on this hinge, for ticks of `period` \[s\].
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(config: &GripConfig, hinge: Hinge, period: f64) -> Result<Self, SetupError> {
        config.validate()?;
        positive("tick period [s]", period)?;
        let compliance = 1.0 / (config.stiffness + config.damping / period);
        let memory = config.damping / period * compliance;
        let GripConfig { max_torque, torque_slew, .. } = *config;
        Ok(Self { hinge, compliance, memory, max_torque, torque_slew })
    }

    /// Axis and range of its jaws.
    #[must_use]
    pub fn hinge(&self) -> &Hinge {
        &self.hinge
    }

    /// c \[rad/(N m)\].
    #[must_use]
    pub fn compliance(&self) -> f64 {
        self.compliance
    }

    /// Takes what the device measured, 0 to 1.
    pub(crate) fn read(&self, state: &mut GripperState, measured: f64) {
        state.device = self.hinge.opening(measured);
    }

    /// Opening of the jaws without contact \[rad\].
    pub(crate) fn predict(&self, state: &GripperState) -> f64 {
        state.device - state.stretch * self.memory
    }

    /// Opening of the jaws \[rad\].
    pub(crate) fn opening(&self, state: &GripperState) -> f64 {
        state.device - state.stretch
    }

    /// Lets the contacts' torque act \[N m\].
    pub(crate) fn settle(&self, state: &mut GripperState, torque: f64) {
        state.stretch = state.stretch * self.memory - torque * self.compliance;
    }

    /// The torque to send for this one of the contacts, `gain` of it let through \[N m\]. Finite and within the limits,
    /// whatever the arguments.
    pub(crate) fn send(&self, state: &mut GripperState, torque: f64, gain: f64, dt: f64, flags: &mut TickFlags) -> f64 {
        let target = torque * gain;
        if !target.is_finite() {
            state.sent = 0.0;
            return 0.0;
        }
        let cut = target.clamp(-self.max_torque, self.max_torque);
        flags.set_if(cut != target && self.max_torque > 0.0, TickFlags::TORQUE_LIMITED);
        let step = self.torque_slew * dt.max(0.0);
        let slewed = cut.clamp(state.sent - step, state.sent + step);
        flags.set_if(slewed != cut, TickFlags::SLEW_LIMITED);
        state.sent = slewed;
        slewed
    }

    /// Work of a torque over a whole opening \[J\].
    pub(crate) fn effort(&self, torque: f64) -> f64 {
        torque * (self.hinge.open - self.hinge.closed)
    }
}

impl GripperState {
    /// Takes the torque off and forgets the stretch, not what the device measured.
    pub(crate) fn cut(&mut self) {
        (self.stretch, self.sent) = (0.0, 0.0);
    }
}
