//! Time-domain passivity: an account of the energy at the device's port, and a damper that acts when it is overdrawn.
//!
//! # Observer
//! The motors hold the wrench (f, τ) of a tick until the next, while the hand moves by Δx and turns by Δθ. What goes
//! through the port in between is, whatever the motion was,
//! ```text
//! E ← E − f · Δx − τ · Δθ            J; positive: the hand has put it in
//! ```
//! No velocity enters, so neither its noise nor its lag [Ryu, Kim and Hannaford, IEEE T-RO 20 (2004) 772]. f and τ are
//! those in effect, after all limits and behind the device's delay. Forces and torques share one account: a lever that
//! the hand pushes at one end may turn it at the other. Departures from an account per axis are on the side of
//! transparency: an axis may give out what another took in.
//!
//! # Controller
//! With the account, the motion v, ω that goes on, and the wrenches that are on their way, the account at the end of the
//! next T is predicted, and what it lacks is taken along the motion by a damper [Hannaford and Ryu, IEEE TRA 18 (2002) 1]:
//! ```text
//! D = T (f + f_on_the_way) · v + T (τ + …) · ω − E − allowance         J, acts where D > 0
//! f ← f − s α v ,  α = min(max(f · v, 0)/|v|² + B, b)                  N s/m;  τ likewise, with b r²
//! b = m / (2 ((n + ½) T + t_v))                                        m of the device, n its ticks of delay
//! s = min(1, D / what s = 1 takes)
//! ```
//! T is the measured time since the tick before, and the period at least. The damper withholds what pushes the hand on and
//! dissipates by B beyond that, but by no more than b. One that took the whole push from a slow hand, f/|v|, would be a switch, and
//! behind the delay, the low-pass on v (t_v = 1.6 ms) and the slew limit a switch feeds the swing that it is to end. A damper on a
//! mass m behind a delay t is stable up to π m / (2 t); b is a third of that. So an account may stay overdrawn where more power goes
//! out than b takes, and is paid back while the hand moves: the controller withholds what a device of that mass bears, which in
//! the entries and couplings of `tests/hand/hand_entries.rs` never gave the hand more than there was without it. Where the mass is unknown, b is the largest damping of the device's record.
//! The force never grows by more than B |v|. Below `least_speed` it does nothing, up to twice that it comes in linearly:
//! the encoder's noise is not amplified. It acts in contact only: a free hand is not held.
//!
//! # Reset
//! Without contact for `reset_after` the account is closed at 0. An account that never closed would let a long slide
//! with friction pay for any later oscillation, and would charge one contact for another's debts. Within a contact it
//! stays within ± `memory` for the same reason. Each contact may give out `allowance`, which is above the energy of an
//! encoder step under the usual forces, so that nothing acts in a palpation that is stable by itself.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::coupling::UNKNOWN_DELAY;
use crate::damper::{Bearable, GYRATION, Motion};
use crate::device::DeviceSpec;
use crate::device::virtual_device::MAX_DELAY;
use crate::error::{non_negative, positive};
use crate::record::{PortEnergy, TickFlags};
use crate::wrench::{Twist, Wrench};

/// The passivity layer as described by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PassivityConfig {
    /// Whether the controller acts (true). The observer always keeps its account.
    pub control: bool,
    /// Energy that a contact may give out beyond what it took in \[J\], ≥ 0 (5e-4).
    pub allowance: f64,
    /// Most energy that the account holds, either way \[J\], > 0 (0.3: what tissue of 250 N/m stores under 12 N).
    pub memory: f64,
    /// Largest damping B beyond what pushes the hand \[N s/m\], ≥ 0; `None`: half of what the device renders, and at most 5.
    /// Never more than the device's mass bears.
    pub damping: Option<f64>,
    /// Largest damping of the rotation \[N m s/rad\], ≥ 0 (0.01). Without torque motors it does nothing.
    pub rotational_damping: f64,
    /// Speed below which nothing is taken from the force \[m/s\], > 0 (0.01).
    pub least_speed: f64,
    /// Turning speed below which nothing is taken from the torque \[rad/s\], > 0 (0.2).
    pub least_turn: f64,
    /// Time without contact after which the account is closed \[s\], > 0 (0.1).
    pub reset_after: f64,
}

impl Default for PassivityConfig {
    fn default() -> Self {
        Self {
            control: true,
            allowance: 5e-4,
            memory: 0.3,
            damping: None,
            rotational_damping: 0.01,
            least_speed: 0.01,
            least_turn: 0.2,
            reset_after: 0.1,
        }
    }
}

/// Largest default of the damping \[N s/m\]: above it a device of 0.1 kg with the usual filters of its velocity buzzes.
const MAX_DEFAULT_DAMPING: f64 = 5.0;

/// The passivity layer of one scene on one device: description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passivity {
    config: PassivityConfig,
    damping: f64,
    rotational_damping: f64,
    bearable: Bearable,
    /// Of b, along x, y, z and about them \[-, m²\].
    bearable_by: [f64; 2],
    delay: usize,
    period: f64,
}

/// The account: state.
#[derive(Clone, Copy, Debug)]
pub struct PassivityState {
    energy: PortEnergy,
    /// The last sound pose.
    before: Option<Isometry3<f64>>,
    /// Wrenches sent: `[0]` in the tick before, `[n]` n ticks before that.
    sent: [Wrench; MAX_DELAY + 1],
    /// Time without contact \[s\].
    apart: f64,
}

impl Default for PassivityState {
    fn default() -> Self {
        Self {
            energy: PortEnergy::default(),
            before: None,
            sent: [Wrench::zero(); MAX_DELAY + 1],
            apart: f64::INFINITY,
        }
    }
}

impl PassivityState {
    /// Closes the account where the force has been cut or the pose is lost; the sums since the start remain.
    pub fn cut(&mut self) {
        let energy = PortEnergy { account: 0.0, ..self.energy };
        *self = Self { energy, ..Self::default() };
    }

    /// What has gone through the port.
    #[must_use]
    pub fn energy(&self) -> PortEnergy {
        self.energy
    }
}

impl Passivity {
    /// The layer at ticks of `period` \[s\].
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(config: &PassivityConfig, spec: &DeviceSpec, period: f64) -> Result<Self, SetupError> {
        positive("tick period [s]", period)?;
        non_negative("passivity allowance [J]", config.allowance)?;
        positive("passivity memory [J]", config.memory)?;
        config.damping.map_or(Ok(()), |damping| non_negative("passivity damping [N s/m]", damping))?;
        non_negative("passivity rotational_damping [N m s/rad]", config.rotational_damping)?;
        positive("passivity least_speed [m/s]", config.least_speed)?;
        positive("passivity least_turn [rad/s]", config.least_turn)?;
        positive("passivity reset_after [s]", config.reset_after)?;
        let default = (0.5 * spec.max_damping).min(MAX_DEFAULT_DAMPING);
        Ok(Self {
            config: *config,
            damping: config.damping.unwrap_or(default),
            rotational_damping: if spec.max_torque > 0.0 { config.rotational_damping } else { 0.0 },
            bearable: Bearable::of(spec),
            bearable_by: [1.0, GYRATION * GYRATION],
            delay: spec.delay_ticks.unwrap_or(UNKNOWN_DELAY).min(MAX_DELAY),
            period,
        })
    }

    /// The same layer for a port of one number, along x: what is a force and a way here is there a torque and an angle. `damping`
    /// in N m s/rad is what it may dissipate by.
    pub(crate) fn of_one_angle(&self, damping: f64) -> Self {
        let config = PassivityConfig { least_speed: self.config.least_turn, ..self.config };
        Self { config, damping, rotational_damping: 0.0, bearable_by: [GYRATION * GYRATION, 0.0], ..*self }
    }

    /// Books what went through the port since the tick before. `pose` is finite.
    pub fn observe(&self, state: &mut PassivityState, pose: &Isometry3<f64>) {
        let Some(before) = state.before.replace(*pose) else { return };
        let in_effect = state.sent.get(self.delay).copied().unwrap_or_default();
        let moved = pose.translation.vector - before.translation.vector;
        let translation = -in_effect.force.dot(&moved);
        let rotation = if in_effect.torque == Vector3::zeros() {
            0.0
        } else {
            -in_effect.torque.dot(&(pose.rotation * before.rotation.inverse()).scaled_axis())
        };
        let energy = &mut state.energy;
        energy.translation += translation;
        energy.rotation += rotation;
        energy.account = (energy.account + translation + rotation).clamp(-self.config.memory, self.config.memory);
    }

    /// The wrench \[N, N m\] that is left of `wanted` where the hand moves like this, `dt` \[s\] after the tick before; sets the
    /// flag where it is another. Never larger than `wanted` by more than the damping's bound; equal to it where no number is
    /// wrong with the account.
    pub fn act(
        &self,
        state: &PassivityState,
        wanted: &Wrench,
        velocity: &Twist,
        dt: f64,
        flags: &mut TickFlags,
    ) -> Wrench {
        if !self.config.control || *wanted == Wrench::zero() {
            return *wanted;
        }
        // A tick that comes early says nothing of the next; one that is late, that the next may be.
        let dt = dt.max(self.period);
        let linear = Motion::new(velocity.linear, self.config.least_speed);
        let angular = Motion::new(velocity.angular, self.config.least_turn);
        let on_the_way = state
            .sent
            .iter()
            .take(self.delay)
            .fold(*wanted, |sum, w| Wrench { force: sum.force + w.force, torque: sum.torque + w.torque });
        let given_out = dt * (on_the_way.force.dot(&linear.v) + on_the_way.torque.dot(&angular.v));
        let lacking = given_out - state.energy.account - self.config.allowance;
        if lacking.is_nan() || lacking <= 0.0 {
            return *wanted;
        }
        let bearable = self.bearable_by.map(|share| share * self.bearable.damping(self.delay, dt));
        let damping = [
            linear.damping(&wanted.force, self.damping, bearable[0]),
            // Without motors there is no torque to withhold either.
            angular.damping(&wanted.torque, self.rotational_damping, bearable[1]),
        ];
        let taken = dt * (damping[0] * linear.square + damping[1] * angular.square);
        if taken.is_nan() || taken <= 0.0 {
            return *wanted;
        }
        let s = (lacking / taken).min(1.0);
        let left = Wrench {
            force: wanted.force - linear.v * (s * damping[0]),
            torque: wanted.torque - angular.v * (s * damping[1]),
        };
        if !left.is_finite() {
            return *wanted;
        }
        flags.set(TickFlags::PASSIVITY);
        left
    }

    /// Remembers what was sent, `dt` \[s\] after the tick before, and closes the account of a contact that is over.
    pub fn keep(&self, state: &mut PassivityState, sent: &Wrench, in_contact: bool, dt: f64) {
        state.sent.copy_within(..MAX_DELAY, 1);
        state.sent[0] = *sent;
        let rests = !in_contact && state.sent.iter().take(self.delay + 1).all(|w| *w == Wrench::zero());
        state.apart = if rests { state.apart + dt } else { 0.0 };
        if state.apart >= self.config.reset_after {
            state.energy.account = 0.0;
        }
    }
}
