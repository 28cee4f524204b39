//! A haptic device that exists in arithmetic only, held by a virtual hand.
//!
//! Between two ticks, per axis,
//! ```text
//! m ẍ + b ẋ = F − f_c ẋ/|ẋ| − P          N, P on the hand that holds it
//! ```
//! with the motor force F held constant (zero-order hold) and delayed by n ticks, Coulomb friction f_c, and a
//! measured position that is rounded to the encoder step. Each tick is split into sub-steps. Within one, the linear
//! part is integrated *exactly* for a constant input, so the stability edge of the sampled loop is that of its
//! eigenvalues and not of an integrator, and friction is the constant force of at most f_c that brings the end velocity
//! nearest to zero (maximum dissipation), which makes sticking exact: a held load below f_c moves nothing.
//!
//! With a jitter, tick k samples the device and changes its force late, by a share of the jitter that a generator of
//! pseudo-random numbers draws from seed and k: the period of the hold varies by up to the jitter either way, while the
//! loop that reads the device believes in a regular clock. The device measures its velocity with its own clock.
//!
//! The motion is a function of the sequence of ticks and wrenches, and of nothing else: real time and lockstep agree
//! to the bit. Rotation and gripper have no dynamics: they follow the script exactly, also while the hand has let go, and
//! torques are ignored.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::motion::{Drive, Motion, Propagator};
use super::{DeviceError, DeviceSample, DeviceSetup, DeviceSpec, HapticDevice, Opened, Registration, TickTime};
use crate::SetupError;
use crate::hand::Hand;
use crate::script::{HandScript, Intent};
use crate::wrench::{Twist, Wrench};

pub use super::mechanics::{MAX_DELAY, VirtualDeviceConfig};

/// Line in the register of devices.
pub const REGISTRATION: Registration = Registration {
    name: "virtual",
    summary: "mass, friction and encoder, held by a virtual hand (virtual:none|loose|normal|firm|fingertip|stylus|arm)",
    open,
};

/// The virtual device with its hand.
#[derive(Clone, Debug)]
pub struct VirtualDevice {
    spec: DeviceSpec,
    config: VirtualDeviceConfig,
    hand: Hand,
    script: HandScript,
    motion: Motion,
    /// Time that the motion has come to \[s\]; the tick's own without jitter.
    now: f64,
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
            spec: DeviceSpec::of_mechanics(&config),
            config,
            hand,
            script,
            motion: Motion::at(begin.position),
            now: 0.0,
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
        (self.motion.velocity, self.motion.hand_velocity) = (velocity, velocity);
        self
    }

    /// The same, held by its hand at `position` \[m\] in place of the script's begin.
    #[must_use]
    pub fn at(mut self, position: Vector3<f64>) -> Self {
        self.motion = Motion { velocity: self.motion.velocity, ..Motion::at(position) };
        self.measured = position;
        self
    }

    /// Fills the line of delayed forces with this one, as if it had been written for long.
    pub fn hold(&mut self, wrench: Wrench) {
        self.written = if wrench.is_finite() { wrench.force } else { Vector3::zeros() };
        self.forces.fill(self.written);
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
        self.motion.position
    }

    /// True velocity \[m/s\].
    #[must_use]
    pub fn velocity(&self) -> Vector3<f64> {
        self.motion.velocity
    }

    /// Energy of the moving masses, of the grasp and, against the script's position at `time` \[s\], of the hand's spring \[J\].
    #[must_use]
    pub fn energy(&self, time: f64) -> f64 {
        let (hand, Motion { position, velocity, hand_position, hand_velocity }) = (self.hand(), self.motion);
        let device = 0.5 * self.config.mass * velocity.norm_squared();
        let (held, moved) = if hand.grasp.is_some() { (hand_position, hand_velocity) } else { (position, velocity) };
        let stretch = held - self.script.intent(time).position;
        let grasp = hand.grasp.map_or(0.0, |grasp| 0.5 * grasp.stiffness * (position - held).norm_squared());
        device + grasp + 0.5 * hand.mass * moved.norm_squared() + 0.5 * hand.stiffness * stretch.norm_squared()
    }

    /// The hand while it holds the device.
    fn hand(&self) -> Hand {
        if self.grip { self.hand } else { NO_HAND }
    }

    /// Moves to the time of `tick` under the force held since the tick before; the time that passed \[s\].
    fn advance(&mut self, tick: TickTime) -> f64 {
        let (begin, span) = self.span(tick);
        self.now = if self.config.jitter > 0.0 { begin + span } else { tick.time };
        self.forces.rotate_right(1);
        self.forces[0] = self.written;
        let force = self.forces.get(self.config.delay_ticks).copied().unwrap_or_default();
        let h = span / f64::from(self.config.substeps);
        for i in 0..self.config.substeps {
            // The middle of the sub-step stands for the script over it.
            let intent = self.script.intent(begin + (f64::from(i) + 0.5) * h);
            self.take_or_let_go(&intent);
            self.substep(force, &intent, h);
        }
        span
    }

    /// From when, and how long \[s\], the device moves until `tick` reads it.
    fn span(&self, tick: TickTime) -> (f64, f64) {
        if self.config.jitter > 0.0 {
            let late = self.config.lateness(tick.index);
            // A tick whose device is later than the next one's finds it unmoved.
            (self.now, (tick.time + late - self.now).max(0.0))
        } else {
            (tick.time - tick.dt, tick.dt)
        }
    }

    fn take_or_let_go(&mut self, intent: &Intent) {
        if intent.grip && !self.grip {
            if self.hand.grasp.is_some() {
                // A hand that closes is where the device is, and moves with its script.
                (self.motion.hand_position, self.motion.hand_velocity) = (self.motion.position, intent.velocity);
            } else {
                // Rigidly, the masses join and momentum is kept.
                let (m, mh) = (self.config.mass, self.hand.mass);
                self.motion.velocity = (self.motion.velocity * m + intent.velocity * mh) / (m + mh);
            }
        }
        self.grip = intent.grip;
    }

    fn substep(&mut self, force: Vector3<f64>, intent: &Intent, h: f64) {
        let hand = self.hand();
        let propagator = match self.propagator {
            Some((step, grip, propagator)) if step == h && grip == self.grip => propagator,
            _ => {
                let propagator = Propagator::new(self.config.mass, self.config.damping, &hand, h);
                self.propagator = Some((h, self.grip, propagator));
                propagator
            }
        };
        let of_hand = intent.position * hand.stiffness + intent.velocity * hand.damping;
        propagator.advance(&mut self.motion, &Drive { force, hand: of_hand, friction: self.config.friction });
    }

    fn measure(&mut self, dt: f64) {
        let step = self.config.encoder_step;
        let position =
            if step > 0.0 { self.motion.position.map(|x| (x / step).round() * step) } else { self.motion.position };
        if dt > 0.0 {
            let smoothing = -(-std::f64::consts::TAU * self.config.velocity_cutoff * dt).exp_m1();
            let difference = (position - self.measured) / dt;
            self.measured_velocity += (difference - self.measured_velocity) * smoothing;
        }
        self.measured = position;
    }
}

const NO_HAND: Hand = Hand::rigid(0.0, 0.0, 0.0);

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
            let span = self.advance(tick);
            self.measure(span);
        } else {
            self.now = tick.time;
            self.measure(0.0);
        }
        self.started = true;
        let intent = self.script.intent(tick.time);
        let velocity = Twist { linear: self.measured_velocity, angular: intent.angular_velocity };
        let pose = Isometry3::from_parts(Translation3::from(self.measured), intent.rotation);
        Ok(DeviceSample { velocity, gripper: intent.gripper, ..DeviceSample::at_rest(self.now, pose) })
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
