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
//!
//! The gripper is a port of its own: what goes through it, −Q Δθ_d, is on an account of its own, by the same rules and with
//! the same allowance, memory and reset as that of the tool's pose ([`crate::passivity`]), so that neither pays for the
//! other. The controller's motion is the rate of θ_d, smoothed over 5 ms, for devices measure no such rate.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::tool::Hinge;
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::error::{non_negative, positive};
use crate::passivity::{Passivity, PassivityState};
use crate::record::TickFlags;
use crate::wrench::{Twist, Wrench};

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

/// Time over which the rate of the device's opening is smoothed \[s\].
const SMOOTHING: f64 = 5e-3;

/// The gripper of a tool at a fixed period: description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    hinge: Hinge,
    compliance: f64,
    memory: f64,
    max_torque: f64,
    torque_slew: f64,
    /// The port's account, with angles for ways along x.
    passivity: Passivity,
}

/// What a gripper remembers between ticks: state.
#[derive(Clone, Copy, Debug, Default)]
pub struct GripperState {
    /// Opening of the device less that of the tool \[rad\].
    stretch: f64,
    /// Torque last sent \[N m\].
    sent: f64,
    /// Opening that the device asked for \[rad\].
    device: f64,
    /// The same in the tick before, and the rate of it \[rad/s\].
    before: Option<f64>,
    rate: f64,
    passivity: PassivityState,
}

/// The gripper in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GripperRecord {
    /// What the device measured, 0 closed to 1 open.
    pub device: f64,
    /// Opening of the tool's jaws behind the coupling \[rad\]; 0 for a tool without.
    pub opening: f64,
    /// Torque on the opening that was sent, after all limits but those of the device's own driver, which
    /// [`TickFlags::TORQUE_LIMITED`] tells; positive opens \[N m\].
    pub torque: f64,
    /// The same of the contacts before limits \[N m\].
    pub contact_torque: f64,
    /// Work of the sent torque over a whole opening of the gripper \[J\].
    pub effort: f64,
    /// Energy that has gone through the gripper since the start; positive: the hand has put it in \[J\].
    pub energy: f64,
    /// The same of the contact that lasts \[J\].
    pub account: f64,
    /// What the passivity controller took from the torque \[N m\].
    pub withheld: f64,
}

impl Gripper {
    /// The gripper of jaws on this hinge, for ticks of `period` \[s\], its energy kept by the rules of `passivity`.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(config: &GripConfig, hinge: Hinge, passivity: &Passivity, period: f64) -> Result<Self, SetupError> {
        config.validate()?;
        positive("tick period [s]", period)?;
        let compliance = 1.0 / (config.stiffness + config.damping / period);
        let memory = config.damping / period * compliance;
        let GripConfig { max_torque, torque_slew, .. } = *config;
        let passivity = passivity.of_one_angle(config.damping);
        Ok(Self { hinge, compliance, memory, max_torque, torque_slew, passivity })
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

    /// Books what went through the gripper since the tick before, `dt` \[s\] ago, > 0. Once a tick, after [`Self::read`].
    pub(crate) fn observe(&self, state: &mut GripperState, dt: f64) {
        let before = state.before.replace(state.device).unwrap_or(state.device);
        // Backward Euler of the low-pass.
        state.rate += (state.device - before - state.rate * dt) / (dt + SMOOTHING);
        self.passivity.observe(&mut state.passivity, &Isometry3::translation(state.device, 0.0, 0.0));
    }

    /// What of a torque the account lets through \[N m\].
    fn passive(&self, state: &GripperState, torque: f64, dt: f64, flags: &mut TickFlags) -> f64 {
        let along = |x: f64| Vector3::new(x, 0.0, 0.0);
        let wanted = Wrench { force: along(torque), torque: Vector3::zeros() };
        let motion = Twist { linear: along(state.rate), angular: Vector3::zeros() };
        self.passivity.act(&state.passivity, &wanted, &motion, dt, flags).force.x
    }

    /// Remembers the torque that was sent, `dt` \[s\] after the tick before.
    fn keep(&self, state: &mut GripperState, in_contact: bool, dt: f64) {
        let sent = Wrench { force: Vector3::new(state.sent, 0.0, 0.0), torque: Vector3::zeros() };
        self.passivity.keep(&mut state.passivity, &sent, in_contact, dt);
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

    /// The torque to send for this one of the contacts, `gain` of it let through, and what the account took from it \[N m\].
    /// Finite and within the limits, whatever the arguments.
    pub(crate) fn send(
        &self,
        state: &mut GripperState,
        torque: f64,
        gain: f64,
        dt: f64,
        flags: &mut TickFlags,
    ) -> (f64, f64) {
        let wanted = torque * gain;
        if !wanted.is_finite() {
            state.sent = 0.0;
            self.keep(state, false, dt);
            return (0.0, 0.0);
        }
        let target = self.passive(state, wanted, dt, flags);
        let cut = target.clamp(-self.max_torque, self.max_torque);
        flags.set_if(cut != target && self.max_torque > 0.0, TickFlags::TORQUE_LIMITED);
        let step = self.torque_slew * dt.max(0.0);
        let slewed = cut.clamp(state.sent - step, state.sent + step);
        flags.set_if(slewed != cut, TickFlags::SLEW_LIMITED);
        state.sent = slewed;
        self.keep(state, torque != 0.0, dt);
        (slewed, wanted - target)
    }

    /// Work of a torque over a whole opening \[J\].
    pub(crate) fn effort(&self, torque: f64) -> f64 {
        torque * (self.hinge.open - self.hinge.closed)
    }
}

impl GripperState {
    /// Takes the torque off and forgets the stretch and how the device moves, not what it measured.
    pub(crate) fn cut(&mut self) {
        (self.stretch, self.sent, self.before, self.rate) = (0.0, 0.0, None, 0.0);
        self.passivity.cut();
    }

    /// Energy since the start, and of the contact that lasts \[J\].
    pub(crate) fn energy(&self) -> (f64, f64) {
        let energy = self.passivity.energy();
        (energy.translation, energy.account)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::DeviceSpec;
    use crate::passivity::PassivityConfig;

    const TICK: f64 = 1e-3;
    const ALLOWANCE: f64 = 5e-4;

    fn gripper(control: bool) -> Gripper {
        let config = PassivityConfig { control, allowance: ALLOWANCE, ..PassivityConfig::default() };
        let spec = DeviceSpec { delay_ticks: Some(0), ..DeviceSpec::virtual_device(0.0) };
        let passivity = Passivity::new(&config, &spec, TICK).unwrap();
        let hinge = Hinge { pivot: Vector3::zeros(), axis: Vector3::x_axis(), closed: 0.0, open: 0.6 };
        Gripper::new(&GripConfig::default(), hinge, &passivity, TICK).unwrap()
    }

    /// Ticks of a second with the device at this share of the opening and under this torque (N m); the energy that the hand
    /// got (J), and the most that was withheld (N m).
    fn run(gripper: &Gripper, opening: impl Fn(f64) -> f64, torque: impl Fn(f64, f64) -> f64) -> (f64, f64) {
        let (mut state, mut got, mut most) = (GripperState::default(), 0.0, 0.0_f64);
        let mut before: Option<(f64, f64)> = None;
        for k in 0..1000 {
            let time = f64::from(k) * TICK;
            gripper.read(&mut state, opening(time));
            gripper.observe(&mut state, TICK);
            let angle = state.device;
            // No delay in this device's record: the torque of a tick acts until the next.
            got += before.map_or(0.0, |(then, sent)| sent * (angle - then));
            let mut flags = TickFlags::default();
            let (sent, withheld) = gripper.send(&mut state, torque(time, angle), 1.0, TICK, &mut flags);
            assert_eq!(flags.contains(TickFlags::PASSIVITY), withheld != 0.0, "{withheld} N m, {flags:?}");
            most = most.max(withheld.abs());
            before = Some((angle, sent));
        }
        let booked = -state.energy().0;
        assert!((booked - got).abs() < 1e-12, "{booked} J of {got} J");
        (got, most)
    }

    #[test]
    fn a_gripper_that_drives_the_hand_is_held_to_the_allowance_and_a_spring_between_the_jaws_is_not_touched() {
        // 4 Hz, the torque with the motion: it gives out 0.05 N m * 0.1 rad * pi a cycle.
        let swing = |time: f64| 0.5 + 0.1 / 0.6 * (8.0 * std::f64::consts::PI * time).sin();
        let drive = |time: f64, _: f64| 0.05 * (8.0 * std::f64::consts::PI * time).cos();
        let (free, none) = run(&gripper(false), swing, drive);
        assert!(free > 100.0 * ALLOWANCE && none == 0.0, "{free} J");
        let (held, most) = run(&gripper(true), swing, drive);
        // Beyond the allowance: what a rate that is smoothed lags behind, where the torque turns over.
        assert!(held < 4.0 * ALLOWANCE && most > 0.01, "{held} J of {free} J");

        // Jaws that close on a spring of 0.4 N m/rad from 0.35 rad on, and open again: the hand gets back what it put in.
        let spring = |_: f64, angle: f64| 0.4 * (0.35 - angle).max(0.0);
        // At 1 Hz: a spring that is held for each tick gives out half of k (Δθ)² in it, little where it is slow.
        let closes = |time: f64| 0.5 + 0.1 / 0.6 * (2.0 * std::f64::consts::PI * time).cos();
        let (back, withheld) = run(&gripper(true), closes, spring);
        assert_eq!(withheld, 0.0, "{back} J");
    }

    #[test]
    fn a_steady_rate_is_found_whatever_the_time_between_the_ticks() {
        for periods in [[1.0, 1.0], [3.0, 3.0], [0.5, 4.0]] {
            let (gripper, mut state) = (gripper(true), GripperState::default());
            let mut time = 0.0;
            for k in 0..100 {
                gripper.read(&mut state, 0.1 + time);
                gripper.observe(&mut state, TICK * periods[k % 2]);
                time += TICK * periods[(k + 1) % 2];
            }
            // 0.6 rad/s after ten time constants at the least.
            assert!((state.rate - 0.6).abs() < 1e-4, "{periods:?}: {} rad/s", state.rate);
        }
    }
}
