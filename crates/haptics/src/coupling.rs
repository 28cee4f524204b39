//! Virtual coupling: a spring and damper between the device and the tool, inside the contact problem.
//!
//! The tool has no mass. With e = x_device − x_tool, the tick T and the contact force F_c on the tool, its balance is
//! ```text
//! K e + B (e − e₋) / T + F_c = 0          N, e₋ of the tick before
//! e      = β e₋ − c F_c                   c = 1 / (K + B/T)  m/N,   β = (B/T) / (K + B/T)
//! x_tool = (x_device − β e₋) + c F_c
//! ```
//! The bracket is the *predicted* tool, where it would be without contact; contact moves it by c F_c. So with the rows
//! J of the tool (gap rate = J · twist, wrench on the tool F_c = Jᵀ λ) the problem of the tick is that of the snapshot
//! with two changes, and stays of the same kind:
//! ```text
//! W_tick = W + c J_f J_fᵀ + c_rot J_τ J_τᵀ                 m/N
//! δ_tick = δ_free + J (predicted pose − reference pose)      m
//! ```
//! The hand feels −(K e + B ė) = F_c: exactly the contact force, zero in free space, where e decays by β each tick.
//! [Colgate, Stanley and Brown, IROS 1995]; the coupling as compliance of the constraint problem follows
//! [Peterlík et al., IEEE ToH 4 (2011) 175].
//!
//! Rotation is coupled in the same way by its own spring (e_rot is the rotation vector from tool to device), or, as
//! by default, rigidly: the tool turns with the device. A device without motors for torque cannot feel the difference.
//!
//! # What is guaranteed
//! For a device of damping b, delay n ticks, the sampled loop against a rigid wall is stable for
//! K (n + ½) T < b + B, and against a spring K_w in series with the coupling, with u = K_w/(K + K_w), for
//! ```text
//! K u (n + ½) T  <  b + B u²          (first order in T, no friction, no hand)
//! ```
//! which holds for *every* K_w when K (n + ½) T < 2 √(b B) (and b < B): [`stiffness_for_any_wall`]. A hand adds its own damping to b.
//! These bounds are for the linear loop; a contact that opens and closes, and the encoder, are held by tests. The first
//! is Colgate and Schenkel's b + B > K (T/2 + t_d) [J. Robotic Systems 14 (1997) 37; with delay: Hulin, Albu-Schäffer
//! and Hirzinger, IEEE TCST 22 (2014) 1297]. An encoder step Δ is dissipated by Coulomb friction f_c up to
//! K = 2 f_c / Δ [Abbott and Okamura, IEEE T-RO 21 (2005) 952].

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::device::DeviceSpec;
use crate::error::{non_negative, positive};
use crate::wrench::Wrench;

/// Largest default stiffness of the coupling \[N/m\].
const MAX_DEFAULT_STIFFNESS: f64 = 1000.0;

/// Largest default damping of the coupling \[N s/m\].
const MAX_DEFAULT_DAMPING: f64 = 2.0;

/// What the bound of the stiffness is divided by.
pub const MARGIN: f64 = 1.2;

/// Damping of a hand that holds a device lightly \[N s/m\]: the low end of what is measured (1 to 5).
pub const LIGHT_GRIP: f64 = 1.0;

/// Ticks from a wrench to its effect where a device does not state them.
pub const UNKNOWN_DELAY: usize = 1;

/// A spring and a damper, in N/m and N s/m, or in N m/rad and N m s/rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Stiffness, > 0.
    pub stiffness: f64,
    /// Damping, ≥ 0.
    pub damping: f64,
}

/// The coupling as described by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingConfig {
    /// Between the positions: K \[N/m\], B \[N s/m\].
    pub translation: Spring,
    /// Between the orientations: K \[N m/rad\], B \[N m s/rad\]; `None`: rigid.
    #[serde(default)]
    pub rotation: Option<Spring>,
}

impl CouplingConfig {
    /// What suits a device at its own rate: [`CouplingConfig::at_rate`].
    #[must_use]
    pub fn for_device(spec: &DeviceSpec) -> Self {
        Self::at_rate(spec, spec.rate)
    }

    /// What suits a device at `rate` \[Hz\], > 0; rotation rigid.
    ///
    /// K is the least of 1000 N/m, half of the stiffness that the record states for its rate (in proportion at a lower
    /// one; a higher one is not trusted with more), and the bound for any wall ([`stiffness_bound`]) over 1.2, for the
    /// bound is of first order in T and right within a tenth. B is 2 N s/m, or less where the device renders less, or
    /// where the damper would be fast against the loop's lag: B ≤ m / (4 (n + ½) T), a sixth of its own stable limit.
    #[must_use]
    pub fn at_rate(spec: &DeviceSpec, rate: f64) -> Self {
        let damping = damping_of(spec, rate);
        let recorded = 0.5 * spec.max_stiffness * (rate / spec.rate).min(1.0);
        let bound = stiffness_bound(spec, damping, rate).stiffness / MARGIN;
        let stiffness = recorded.min(MAX_DEFAULT_STIFFNESS).min(bound);
        Self { translation: Spring { stiffness, damping }, rotation: None }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A stiffness that is not positive, a damping that is negative, or either not finite.
    pub fn validate(&self) -> Result<(), SetupError> {
        positive("coupling stiffness [N/m]", self.translation.stiffness)?;
        non_negative("coupling damping [N s/m]", self.translation.damping)?;
        if let Some(rotation) = &self.rotation {
            positive("coupling rotational stiffness [N m/rad]", rotation.stiffness)?;
            non_negative("coupling rotational damping [N m s/rad]", rotation.damping)?;
        }
        Ok(())
    }
}

/// Largest K \[N/m\] that is stable against a wall of any stiffness, without friction and with nobody holding the
/// device, to first order: 2 √(b B) / ((n + ½) T), or (b + B) / ((n + ½) T) where b ≥ B.
///
/// `device_damping` b and `coupling_damping` B in N s/m, `period` T in s, `delay_ticks` n.
#[must_use]
pub fn stiffness_for_any_wall(device_damping: f64, coupling_damping: f64, period: f64, delay_ticks: usize) -> f64 {
    let lag = (delay_ticks as f64 + 0.5) * period;
    if device_damping < coupling_damping {
        2.0 * (device_damping * coupling_damping).sqrt() / lag
    } else {
        (device_damping + coupling_damping) / lag
    }
}

/// Whose damping a bound of the stiffness rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundGrounds {
    /// The device's own: stable with nobody holding it.
    Device,
    /// Unknown for the device, so that of a hand that holds it lightly: 1 N s/m. What a released device does is left to
    /// its friction and to the passivity layer.
    LightGrip,
    /// The device's Coulomb friction against its encoder step.
    Encoder,
}

/// The largest stiffness of a coupling that theory grants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StiffnessBound {
    /// \[N/m\]
    pub stiffness: f64,
    /// What it rests on.
    pub grounds: BoundGrounds,
}

/// Largest K \[N/m\] on this device at `rate` \[Hz\] with the coupling's damping B \[N s/m\], against a wall of any
/// stiffness: [`stiffness_for_any_wall`], or 2 f_c / Δ where friction and resolution are known and that is less. A delay
/// that the record does not state is taken as one tick.
#[must_use]
pub fn stiffness_bound(spec: &DeviceSpec, coupling_damping: f64, rate: f64) -> StiffnessBound {
    let (damping, grounds) = match spec.damping {
        Some(damping) => (damping, BoundGrounds::Device),
        None => (LIGHT_GRIP, BoundGrounds::LightGrip),
    };
    let delay = spec.delay_ticks.unwrap_or(UNKNOWN_DELAY);
    let loop_bound =
        StiffnessBound { stiffness: stiffness_for_any_wall(damping, coupling_damping, 1.0 / rate, delay), grounds };
    // Without friction an encoder buzzes by its own step at any stiffness: no bound follows.
    let friction = spec.friction.filter(|friction| *friction > 0.0);
    let quantised = friction.zip(spec.resolution).map(|(friction, step)| 2.0 * friction / step);
    match quantised {
        Some(stiffness) if stiffness < loop_bound.stiffness => {
            StiffnessBound { stiffness, grounds: BoundGrounds::Encoder }
        }
        _ => loop_bound,
    }
}

/// B of the default coupling \[N s/m\].
fn damping_of(spec: &DeviceSpec, rate: f64) -> f64 {
    let lag = (spec.delay_ticks.unwrap_or(UNKNOWN_DELAY) as f64 + 0.5) / rate;
    let slow = spec.mass.map_or(f64::INFINITY, |mass| 0.25 * mass / lag);
    spec.max_damping.min(MAX_DEFAULT_DAMPING).min(slow)
}

/// One spring at a fixed period.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Relaxation {
    /// c = 1/(K + B/T), m/N or rad/(N m); 0: rigid.
    compliance: f64,
    /// β = (B/T)/(K + B/T); 0: rigid.
    memory: f64,
}

impl Relaxation {
    const RIGID: Self = Self { compliance: 0.0, memory: 0.0 };

    fn new(spring: &Spring, period: f64) -> Self {
        let compliance = 1.0 / (spring.stiffness + spring.damping / period);
        Self { compliance, memory: spring.damping / period * compliance }
    }
}

/// The coupling at a fixed period: description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    translation: Relaxation,
    rotation: Relaxation,
}

/// Stretch of the coupling: state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CouplingState {
    /// x_device − x_tool \[m\].
    pub translation: Vector3<f64>,
    /// Rotation vector from tool to device \[rad\].
    pub rotation: Vector3<f64>,
}

impl Coupling {
    /// The coupling for ticks of `period` \[s\].
    ///
    /// The nominal period is used throughout, whatever the clock does: c is then constant, so W_tick is made once a
    /// snapshot, and a late tick changes the damper's force by its lateness only.
    ///
    /// # Errors
    /// As [`CouplingConfig::validate`], or a period that is not positive.
    pub fn new(config: &CouplingConfig, period: f64) -> Result<Self, SetupError> {
        config.validate()?;
        positive("tick period [s]", period)?;
        let rotation = config.rotation.as_ref().map_or(Relaxation::RIGID, |spring| Relaxation::new(spring, period));
        Ok(Self { translation: Relaxation::new(&config.translation, period), rotation })
    }

    /// c = 1/(K + B/T) of the translation \[m/N\].
    #[must_use]
    pub fn compliance(&self) -> f64 {
        self.translation.compliance
    }

    /// The same of the rotation \[rad/(N m)\]; 0 where it is rigid.
    #[must_use]
    pub fn rotational_compliance(&self) -> f64 {
        self.rotation.compliance
    }

    /// Where the tool would be without contact.
    #[must_use]
    pub fn predict(&self, state: &CouplingState, device: &Isometry3<f64>) -> Isometry3<f64> {
        let kept = CouplingState {
            translation: state.translation * self.translation.memory,
            rotation: state.rotation * self.rotation.memory,
        };
        kept.tool(device)
    }

    /// The stretch after a tick with this contact wrench on the tool \[N, N m\].
    #[must_use]
    pub fn settle(&self, state: &CouplingState, contact: &Wrench) -> CouplingState {
        let (t, r) = (&self.translation, &self.rotation);
        CouplingState {
            translation: state.translation * t.memory - contact.force * t.compliance,
            rotation: state.rotation * r.memory - contact.torque * r.compliance,
        }
    }

    /// Adds c J_f J_fᵀ + c_rot J_τ J_τᵀ to the square matrix `w` (m/N, row-major, as many rows as `tool_rows`).
    pub fn add_compliance(&self, tool_rows: &[[f64; 6]], w: &mut [f64]) {
        let (c, cr) = (self.translation.compliance, self.rotation.compliance);
        for (line, a) in w.chunks_exact_mut(tool_rows.len().max(1)).zip(tool_rows) {
            let a = [c * a[0], c * a[1], c * a[2], cr * a[3], cr * a[4], cr * a[5]];
            for (w, b) in line.iter_mut().zip(tool_rows) {
                *w += a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5];
            }
        }
    }
}

impl CouplingState {
    /// The tool's pose, given the device's.
    #[must_use]
    pub fn tool(&self, device: &Isometry3<f64>) -> Isometry3<f64> {
        let mut pose = *device;
        pose.translation.vector -= self.translation;
        pose.rotation = UnitQuaternion::from_scaled_axis(-self.rotation) * device.rotation;
        pose
    }
}
