//! The last word before the motors: magnitude, slew, fade-in and fade-out.
//!
//! In order: a value that is not finite ends the force at once; the contact wrench is scaled by a gain in 0..1; what the
//! port's energy allows is left of it ([`crate::passivity`]); its force and torque are cut to their largest magnitude; the
//! power f · v + τ · ω that it gives to the hand is cut to its limit, by scaling it; its change from the tick before is
//! cut to the slew rate. Magnitude and slew commute safely: both the old force and the new target lie in the same ball,
//! and so does any point between. A power that is too large because the hand has sped up comes down at the slew rate.
//!
//! One gain serves every reason to fade,
//! ```text
//! gain = min(gain₋ + dt / fade_in, s(age))
//! s = 1 up to stale_after, 0 from stale_zero on, linear between
//! ```
//! It starts at 0 and falls back to 0 after a gap between ticks, a device error, a value that is not finite, a jump of
//! the pose, or a snapshot that is not valid, and so every return of the force is a ramp.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::device::DeviceSpec;
use crate::error::{non_negative, positive};
use crate::record::TickFlags;
use crate::wrench::{Twist, Wrench};

/// Limits as described by a scene; the device's own are taken from its record.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsConfig {
    /// Largest force, if below the device's \[N\], > 0 (none).
    pub max_force: Option<f64>,
    /// Largest torque, if below the device's \[N m\], ≥ 0 (none).
    pub max_torque: Option<f64>,
    /// Largest power given to the hand, if below the device's \[W\], > 0 (none).
    pub max_power: Option<f64>,
    /// Largest change of force \[N/s\], > 0 (2000: 2 N in a tick, a damper of 2 N s/m met at 1 m/s).
    pub force_slew: f64,
    /// Largest change of torque \[N m/s\], > 0 (40).
    pub torque_slew: f64,
    /// Time from no force to full force \[s\], > 0 (0.3).
    pub fade_in: f64,
    /// Age of the snapshot at which the force begins to fade \[s\], > 0 (0.2).
    pub stale_after: f64,
    /// Age at which it is zero \[s\], > `stale_after` (0.5).
    pub stale_zero: f64,
    /// Time between two ticks that counts as a gap \[s\], > 0 (0.05).
    pub gap: f64,
    /// Speed above which a motion of the device is no hand's \[m/s\], > 0 (5).
    pub jump_speed: f64,
    /// Length of such a motion, in one tick or several, at which the pose is taken to have jumped \[m\], > 0 (0.02).
    pub jump_distance: f64,
}

impl Default for LimitsConfig {
    fn default() -> Self {
        Self {
            max_force: None,
            max_torque: None,
            max_power: None,
            force_slew: 2000.0,
            torque_slew: 40.0,
            fade_in: 0.3,
            stale_after: 0.2,
            stale_zero: 0.5,
            gap: 0.05,
            jump_speed: 5.0,
            jump_distance: 0.02,
        }
    }
}

/// Limits of one scene on one device: description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    max_force: f64,
    max_torque: f64,
    max_power: f64,
    config: LimitsConfig,
}

/// What the limits remember between ticks: state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LimitsState {
    /// Share of the contact wrench that is sent, 0 to 1.
    pub gain: f64,
    /// The wrench last sent.
    pub sent: Wrench,
}

impl LimitsState {
    /// Takes the force off at once and makes its return a ramp.
    pub fn cut(&mut self) {
        *self = Self::default();
    }
}

impl Limits {
    /// The stricter of the scene's and the device's limits.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(config: &LimitsConfig, spec: &DeviceSpec) -> Result<Self, SetupError> {
        spec.validate()?;
        config.max_force.map_or(Ok(()), |force| positive("limits max_force [N]", force))?;
        config.max_torque.map_or(Ok(()), |torque| non_negative("limits max_torque [N m]", torque))?;
        config.max_power.map_or(Ok(()), |power| positive("limits max_power [W]", power))?;
        positive("limits force_slew [N/s]", config.force_slew)?;
        positive("limits torque_slew [N m/s]", config.torque_slew)?;
        positive("limits fade_in [s]", config.fade_in)?;
        positive("limits stale_after [s]", config.stale_after)?;
        positive("limits gap [s]", config.gap)?;
        positive("limits jump_speed [m/s]", config.jump_speed)?;
        positive("limits jump_distance [m]", config.jump_distance)?;
        if !(config.stale_zero.is_finite() && config.stale_zero > config.stale_after) {
            let (value, range) = (config.stale_zero, "finite and above stale_after");
            return Err(SetupError::OutOfRange { what: "limits stale_zero [s]", value, range });
        }
        Ok(Self {
            max_force: config.max_force.map_or(spec.max_force, |force| force.min(spec.max_force)),
            max_torque: config.max_torque.map_or(spec.max_torque, |torque| torque.min(spec.max_torque)),
            max_power: config.max_power.unwrap_or(f64::INFINITY).min(spec.max_power.unwrap_or(f64::INFINITY)),
            config: *config,
        })
    }

    /// Largest force that is ever sent \[N\].
    #[must_use]
    pub fn max_force(&self) -> f64 {
        self.max_force
    }

    /// Largest torque that is ever sent \[N m\].
    #[must_use]
    pub fn max_torque(&self) -> f64 {
        self.max_torque
    }

    /// Largest power that is given to the hand, by the velocity that the device estimates \[W\]; infinite: no limit.
    #[must_use]
    pub fn max_power(&self) -> f64 {
        self.max_power
    }

    /// Whether no hand moves a device by `distance` \[m\] in `dt` \[s\].
    #[must_use]
    pub fn is_inhuman(&self, distance: f64, dt: f64) -> bool {
        distance > self.config.jump_speed * dt
    }

    /// Whether a motion of that kind and this length \[m\] is a jump of the pose.
    #[must_use]
    pub fn is_jump(&self, length: f64) -> bool {
        length > self.config.jump_distance
    }

    /// Whether `dt` \[s\] since the tick before is a gap.
    #[must_use]
    pub fn is_gap(&self, dt: f64) -> bool {
        dt.is_nan() || dt > self.config.gap
    }

    /// The share of this contact wrench \[N, N m\] that the fades let through; `None`, and no force, where it is not
    /// finite.
    ///
    /// `age` of the snapshot and `dt` since the tick before in s, `dt` finite and at least 0. Sets the flags of fades.
    pub fn fade(
        &self,
        state: &mut LimitsState,
        target: &Wrench,
        age: f64,
        dt: f64,
        flags: &mut TickFlags,
    ) -> Option<Wrench> {
        if !target.is_finite() {
            flags.set(TickFlags::NON_FINITE);
            state.cut();
            return None;
        }
        let fresh = self.freshness(age);
        if fresh < 1.0 {
            flags.set(TickFlags::STALE);
        }
        let rising = state.gain + dt / self.config.fade_in;
        if rising < fresh {
            flags.set(TickFlags::FADE_IN);
        }
        state.gain = rising.min(fresh);
        Some(Wrench { force: target.force * state.gain, torque: target.torque * state.gain })
    }

    /// What of this wrench \[N, N m\] is sent to a hand that moves like this.
    ///
    /// `target` is finite. Sets the flag of each limit that acted. The result is finite and within the limits.
    pub fn bound(
        &self,
        state: &mut LimitsState,
        target: &Wrench,
        velocity: &Twist,
        dt: f64,
        flags: &mut TickFlags,
    ) -> Wrench {
        let (mut force, force_cut) = cut_norm(target.force, self.max_force);
        let (mut torque, torque_cut) = cut_norm(target.torque, self.max_torque);
        let power = force.dot(&velocity.linear) + torque.dot(&velocity.angular);
        // A power that is no number, of a velocity that is none, is more than any limit allows.
        if self.max_power.is_finite() && (power.is_nan() || power > self.max_power) {
            flags.set(TickFlags::POWER_LIMITED);
            let share = if power.is_finite() { self.max_power / power } else { 0.0 };
            (force, torque) = (force * share, torque * share);
        }
        let (force_step, force_slewed) = cut_norm(force - state.sent.force, self.config.force_slew * dt);
        let (torque_step, torque_slewed) = cut_norm(torque - state.sent.torque, self.config.torque_slew * dt);
        flags.set_if(force_cut, TickFlags::FORCE_LIMITED);
        flags.set_if(torque_cut && self.max_torque > 0.0, TickFlags::TORQUE_LIMITED);
        flags.set_if(force_slewed || torque_slewed, TickFlags::SLEW_LIMITED);
        // Without a cut the target itself, not old + (target − old), which differs from it by rounding.
        state.sent = Wrench {
            force: if force_slewed { state.sent.force + force_step } else { force },
            torque: if torque_slewed { state.sent.torque + torque_step } else { torque },
        };
        // Rounding may leave the ball by an ulp.
        state.sent.force = cut_norm(state.sent.force, self.max_force).0;
        state.sent.torque = cut_norm(state.sent.torque, self.max_torque).0;
        state.sent
    }

    /// Brings the force to zero at the slew rate and makes its return a ramp: for a contact problem that is not there.
    pub fn release(&self, state: &mut LimitsState, dt: f64, flags: &mut TickFlags) -> Wrench {
        state.gain = 0.0;
        self.bound(state, &Wrench::zero(), &Twist::default(), dt, flags)
    }

    /// s(age); 0 for an age that is not a number.
    fn freshness(&self, age: f64) -> f64 {
        let LimitsConfig { stale_after, stale_zero, .. } = self.config;
        let left = (stale_zero - age) / (stale_zero - stale_after);
        if left.is_nan() { 0.0 } else { left.clamp(0.0, 1.0) }
    }
}

/// `v` cut to norm `limit`, and whether it was. Scaled by the largest entry first, so that the square does not overflow.
fn cut_norm(v: Vector3<f64>, limit: f64) -> (Vector3<f64>, bool) {
    let largest = v.amax();
    if largest == 0.0 {
        return (v, false);
    }
    let unit = v / largest;
    let unit_norm = unit.norm();
    if largest <= limit / unit_norm { (v, false) } else { (unit * (limit / unit_norm), true) }
}
