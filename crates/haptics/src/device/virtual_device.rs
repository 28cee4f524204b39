//! A haptic device that exists in arithmetic only, held by a virtual hand.
//!
//! Between two ticks, per axis,
//! ```text
//! (m + m_h) ẍ + (b + b_h) ẋ + k_h x = F + k_h x_d + b_h ẋ_d − f_c ẋ/|ẋ|          N
//! ```
//! with the motor force F held constant (zero-order hold) and delayed by n ticks, Coulomb friction f_c, and a
//! measured position that is rounded to the encoder step. Each tick is split into sub-steps. Within one, the linear
//! part is integrated *exactly* for a constant input, so the stability edge of the sampled loop is that of its
//! eigenvalues and not of an integrator, and friction is the constant force of at most f_c that brings the end velocity
//! nearest to zero (maximum dissipation), which makes sticking exact: a held load below f_c moves nothing.
//!
//! The motion is a function of the sequence of ticks and wrenches, and of nothing else: real time and lockstep agree
//! to the bit. Rotation and gripper have no dynamics: they follow the script exactly, also while the hand has let go, and
//! torques are ignored.

use nalgebra::{Isometry3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

use super::{DeviceError, DeviceSample, DeviceSetup, DeviceSpec, HapticDevice, Opened, Registration, TickTime};
use crate::SetupError;
use crate::error::{non_negative, positive};
use crate::hand::Hand;
use crate::script::{HandScript, Intent};
use crate::wrench::{Twist, Wrench};

/// Line in the register of devices.
pub const REGISTRATION: Registration = Registration {
    name: "virtual",
    summary: "mass, friction and encoder, held by a virtual hand (virtual:none|fingertip|stylus|arm|firm)",
    open,
};

/// Largest delay \[ticks\].
pub const MAX_DELAY: usize = 15;

/// Mechanics and electronics of the virtual device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VirtualDeviceConfig {
    /// Mass felt at the end effector \[kg\], > 0 (0.1).
    pub mass: f64,
    /// Viscous damping \[N s/m\], ≥ 0 (0.2).
    pub damping: f64,
    /// Coulomb friction \[N\], ≥ 0 (0.06).
    pub friction: f64,
    /// Step of the measured position \[m\], ≥ 0; 0: exact (30e-6).
    pub encoder_step: f64,
    /// Ticks from a wrench being written to the motor's rendering it, 0 to [`MAX_DELAY`] (1).
    pub delay_ticks: usize,
    /// Cut-off of the low-pass on the measured velocity \[Hz\], > 0 (100).
    pub velocity_cutoff: f64,
    /// Sub-steps of a tick, 1 to 1000 (10): they resolve friction and the script, the rest is exact.
    pub substeps: u32,
}

impl Default for VirtualDeviceConfig {
    fn default() -> Self {
        Self {
            mass: 0.1,
            damping: 0.2,
            friction: 0.06,
            encoder_step: 30e-6,
            delay_ticks: 1,
            velocity_cutoff: 100.0,
            substeps: 10,
        }
    }
}

impl VirtualDeviceConfig {
    /// A device without friction and with exact measurement, where the theory of the sampled linear loop holds.
    #[must_use]
    pub fn ideal(delay_ticks: usize) -> Self {
        Self { friction: 0.0, encoder_step: 0.0, delay_ticks, ..Self::default() }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn validate(&self) -> Result<(), SetupError> {
        positive("virtual device mass [kg]", self.mass)?;
        non_negative("virtual device damping [N s/m]", self.damping)?;
        non_negative("virtual device friction [N]", self.friction)?;
        non_negative("virtual device encoder_step [m]", self.encoder_step)?;
        positive("virtual device velocity_cutoff [Hz]", self.velocity_cutoff)?;
        let range = |what, value: f64, range| Err(SetupError::OutOfRange { what, value, range });
        if self.delay_ticks > MAX_DELAY {
            return range("virtual device delay_ticks", self.delay_ticks as f64, "0 to 15");
        }
        if !(1..=1000).contains(&self.substeps) {
            return range("virtual device substeps", f64::from(self.substeps), "1 to 1000");
        }
        Ok(())
    }
}

/// Exact motion over one sub-step of m ẍ + b ẋ + k x = u for constant u:
/// `[x, v] <- transition [x, v] + input u`.
#[derive(Clone, Copy, Debug)]
struct Propagator {
    xx: f64,
    xv: f64,
    vx: f64,
    vv: f64,
    xu: f64,
    vu: f64,
}

impl Propagator {
    fn new(m: f64, b: f64, k: f64, h: f64) -> Self {
        if k > 0.0 {
            // Roots −a ± sqrt(d); c and s are cos and sin/ω below critical damping, cosh and sinh/ω above it.
            let (a, d) = (0.5 * b / m, 0.25 * (b / m) * (b / m) - k / m);
            let w = d.abs().sqrt();
            let (c, s) = if w * h < 1e-4 {
                (1.0 + 0.5 * d * h * h, h * (1.0 + d * h * h / 6.0))
            } else if d < 0.0 {
                ((w * h).cos(), (w * h).sin() / w)
            } else {
                ((w * h).cosh(), (w * h).sinh() / w)
            };
            let e = (-a * h).exp();
            let (xx, xv) = (e * (c + a * s), e * s);
            Self { xx, xv, vx: -k / m * e * s, vv: e * (c - a * s), xu: (1.0 - xx) / k, vu: xv / m }
        } else if b > 0.0 {
            let loss = -(-b / m * h).exp_m1();
            let xv = loss * m / b;
            Self { xx: 1.0, xv, vx: 0.0, vv: 1.0 - loss, xu: (h - xv) / b, vu: loss / b }
        } else {
            Self { xx: 1.0, xv: h, vx: 0.0, vv: 1.0, xu: 0.5 * h * h / m, vu: h / m }
        }
    }
}

/// The virtual device with its hand.
#[derive(Clone, Debug)]
pub struct VirtualDevice {
    spec: DeviceSpec,
    config: VirtualDeviceConfig,
    hand: Hand,
    script: HandScript,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    grip: bool,
    started: bool,
    open: bool,
    /// Motor forces: `[0]` as last written, `[n]` as written n ticks ago.
    forces: [Vector3<f64>; MAX_DELAY + 1],
    written: Vector3<f64>,
    measured: Vector3<f64>,
    measured_velocity: Vector3<f64>,
    /// Propagator and what it was made for: sub-step and grip.
    propagator: Option<(f64, bool, Propagator)>,
}

impl VirtualDevice {
    /// A device at rest where the script begins.
    ///
    /// # Errors
    /// A number of `config` or `hand` out of its range.
    pub fn new(config: VirtualDeviceConfig, hand: Hand, script: HandScript) -> Result<Self, SetupError> {
        config.validate()?;
        hand.validate()?;
        let begin = script.intent(0.0);
        Ok(Self {
            spec: DeviceSpec::virtual_device(config.encoder_step),
            config,
            hand,
            script,
            position: begin.position,
            velocity: Vector3::zeros(),
            grip: begin.grip,
            started: false,
            open: true,
            forces: [Vector3::zeros(); MAX_DELAY + 1],
            written: Vector3::zeros(),
            measured: begin.position,
            measured_velocity: Vector3::zeros(),
            propagator: None,
        })
    }

    /// The same, moving at `velocity` \[m/s\].
    #[must_use]
    pub fn with_velocity(mut self, velocity: Vector3<f64>) -> Self {
        self.velocity = velocity;
        self
    }

    /// The same with another record of limits.
    #[must_use]
    pub fn with_spec(mut self, spec: DeviceSpec) -> Self {
        self.spec = spec;
        self
    }

    /// True position \[m\], before the encoder.
    #[must_use]
    pub fn position(&self) -> Vector3<f64> {
        self.position
    }

    /// True velocity \[m/s\].
    #[must_use]
    pub fn velocity(&self) -> Vector3<f64> {
        self.velocity
    }

    /// Energy of the moving mass and, against the script's position at `time` \[s\], of the hand's spring \[J\].
    #[must_use]
    pub fn energy(&self, time: f64) -> f64 {
        let hand = if self.grip { self.hand } else { NO_HAND };
        let stretch = self.position - self.script.intent(time).position;
        0.5 * (self.config.mass + hand.mass) * self.velocity.norm_squared()
            + 0.5 * hand.stiffness * stretch.norm_squared()
    }

    /// Moves to the time of `tick` under the force held since the tick before.
    fn advance(&mut self, tick: TickTime) {
        self.forces.rotate_right(1);
        self.forces[0] = self.written;
        let force = self.forces.get(self.config.delay_ticks).copied().unwrap_or_default();
        let h = tick.dt / f64::from(self.config.substeps);
        for i in 0..self.config.substeps {
            // The middle of the sub-step stands for the script over it.
            let time = tick.time - tick.dt + (f64::from(i) + 0.5) * h;
            let intent = self.script.intent(time);
            self.take_or_let_go(&intent);
            self.substep(force, &intent, h);
        }
    }

    fn take_or_let_go(&mut self, intent: &Intent) {
        if intent.grip && !self.grip {
            // A hand that closes moves with its script: the masses join and momentum is kept.
            let (m, mh) = (self.config.mass, self.hand.mass);
            self.velocity = (self.velocity * m + intent.velocity * mh) / (m + mh);
        }
        self.grip = intent.grip;
    }

    fn substep(&mut self, force: Vector3<f64>, intent: &Intent, h: f64) {
        let hand = if self.grip { self.hand } else { NO_HAND };
        let p = match self.propagator {
            Some((step, grip, propagator)) if step == h && grip == self.grip => propagator,
            _ => {
                let (m, b) = (self.config.mass + hand.mass, self.config.damping + hand.damping);
                let propagator = Propagator::new(m, b, hand.stiffness, h);
                self.propagator = Some((h, self.grip, propagator));
                propagator
            }
        };
        let push = force + intent.position * hand.stiffness + intent.velocity * hand.damping;
        let unhindered = self.position * p.vx + self.velocity * p.vv + push * p.vu;
        // The friction that would stop the motion, as far as there is so much.
        let stopping = -unhindered / p.vu;
        let needed = stopping.norm();
        let friction =
            if needed > self.config.friction { stopping * (self.config.friction / needed) } else { stopping };
        self.position = self.position * p.xx + self.velocity * p.xv + (push + friction) * p.xu;
        self.velocity = unhindered + friction * p.vu;
    }

    fn measure(&mut self, dt: f64) {
        let step = self.config.encoder_step;
        let position = if step > 0.0 { self.position.map(|x| (x / step).round() * step) } else { self.position };
        if dt > 0.0 {
            let smoothing = -(-std::f64::consts::TAU * self.config.velocity_cutoff * dt).exp_m1();
            let difference = (position - self.measured) / dt;
            self.measured_velocity += (difference - self.measured_velocity) * smoothing;
        }
        self.measured = position;
    }
}

const NO_HAND: Hand = Hand { mass: 0.0, damping: 0.0, stiffness: 0.0 };

fn open(argument: &str, setup: &DeviceSetup) -> Opened {
    let hand = if argument.is_empty() { setup.hand } else { Hand::preset(argument)? };
    Ok(Box::new(VirtualDevice::new(setup.mechanics, hand, setup.script.clone())?))
}

impl HapticDevice for VirtualDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    /// Moves the device by `tick.dt`, but for the first call, and measures it.
    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        if self.started && tick.dt > 0.0 {
            self.advance(tick);
            self.measure(tick.dt);
        } else {
            self.measure(0.0);
        }
        self.started = true;
        let intent = self.script.intent(tick.time);
        let velocity = Twist { linear: self.measured_velocity, angular: intent.angular_velocity };
        let pose = Isometry3::from_parts(Translation3::from(self.measured), intent.rotation);
        Ok(DeviceSample { velocity, gripper: intent.gripper, ..DeviceSample::at_rest(tick.time, pose) })
    }

    /// A force that is not finite is taken as zero, as a motor amplifier would refuse it.
    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        self.written = if wrench.is_finite() { wrench.force } else { Vector3::zeros() };
        Ok(())
    }

    fn close(&mut self) {
        self.written = Vector3::zeros();
        self.open = false;
    }
}
