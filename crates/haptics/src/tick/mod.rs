//! One tick of the haptic loop: from the newest pose and the latest snapshot to a wrench.
//!
//! 1. The tool's pose without contact is predicted from the device's ([`crate::coupling`]).
//! 2. δ = δ_free + J · (predicted pose − reference pose), the rotation as a rotation vector. The linearisation in the
//!    rotation is exact to first order in the angle turned since the step.
//! 3. (δ, λ) is solved on W + c J_f J_fᵀ by at most `sweeps` sweeps of block Gauss-Seidel from the last tick's λ
//!    [Saupin, Duriez and Cotin, ISBMS 2008].
//!
//! Where the tick was given a tool and the snapshot carries a patch of tissue, contacts and rows are found anew in place of
//! 2, on the patch and at the newest pose ([`PatchTickConfig`]).
//!
//! 4. The wrench Jᵀ λ goes through the fades, the energy account of the port ([`crate::passivity`]) and the limits
//!    ([`crate::limits`]) to the device.
//!
//! A tick allocates nothing, takes no lock, makes no system call, has no panic path, and its work is bounded by the
//! capacity and the number of sweeps: O(rows²) a sweep, and as much again when a snapshot is taken over.

mod config;
mod contact;
mod course;
mod grip;
mod jump;
mod local;
mod patch;
mod soundness;
mod state;
mod warm_start;

use nalgebra::{Isometry3, Vector3};
use palpate_solver::gauss_seidel::GaussSeidelConfig;

use crate::SetupError;
use crate::coupling::Coupling;
use crate::device::{DeviceError, DeviceSample, DeviceSpec, TickTime};
use crate::error::positive;
use crate::gripper::{Gripper, GripperRecord};
use crate::limits::Limits;
use crate::passivity::Passivity;
use crate::record::{TickFlags, TickRecord};
use crate::snapshot::HapticSnapshot;
use crate::wrench::{Twist, Wrench, all_finite};

pub use config::TickConfig;
pub use local::TickWorkspace;
pub use patch::PatchTickConfig;
pub use state::TickState;

use course::TickMoment;
use grip::is_sound;
use local::Local;
use patch::PatchMemory;

/// Largest coordinate that a device pose may have \[m\]; beyond it the pose is an error of the driver.
pub const MAX_COORDINATE: f64 = 1e3;

/// Largest velocity that a device may tell \[m/s, rad/s\]; beyond it the sample is an error of the driver.
pub const MAX_VELOCITY: f64 = 1e6;

/// The tick of one tool: description.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    period: f64,
    solver: GaussSeidelConfig,
    coupling: Coupling,
    passivity: Passivity,
    limits: Limits,
    patch: Option<PatchTickConfig>,
    gripper: Option<Gripper>,
}

impl Tick {
    /// The tick of a scene on a device.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(config: &TickConfig, spec: &DeviceSpec) -> Result<Self, SetupError> {
        positive("tick period [s]", config.period)?;
        positive("tick sweeps", f64::from(config.sweeps))?;
        positive("tick tolerance", config.tolerance)?;
        Ok(Self {
            period: config.period,
            solver: GaussSeidelConfig {
                tolerance: config.tolerance,
                max_sweeps: config.sweeps,
                ..GaussSeidelConfig::default()
            },
            coupling: Coupling::new(&config.coupling, config.period)?,
            passivity: Passivity::new(&config.passivity, spec, config.period)?,
            limits: Limits::new(&config.limits, spec)?,
            patch: None,
            gripper: None,
        })
    }

    /// Lets it find contacts anew in each tick, on snapshots that carry a patch; on others it goes on with their rows.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn on_patches(self, config: PatchTickConfig) -> Result<Self, SetupError> {
        config.validate()?;
        Ok(Self { patch: Some(config), ..self })
    }

    /// The state before its first tick, for snapshots of up to `max_contacts` contacts and, where it works on patches,
    /// of the nodes that it was given.
    #[must_use]
    pub fn state(&self, max_contacts: usize) -> TickState {
        let memory = |config: &PatchTickConfig| {
            PatchMemory::new(config.max_nodes, config.detection.max_contacts, config.max_bodies)
        };
        TickState { patch: self.patch.as_ref().map(memory), ..TickState::new(max_contacts) }
    }

    /// Scratch for its ticks, of the size of [`Tick::state`].
    #[must_use]
    pub fn workspace(&self, max_contacts: usize) -> TickWorkspace {
        let on_patches = |config| TickWorkspace::with_patch(max_contacts, config);
        self.patch.as_ref().map_or_else(|| TickWorkspace::new(max_contacts), on_patches)
    }

    /// The limits in force.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The coupling in force.
    #[must_use]
    pub fn coupling(&self) -> &Coupling {
        &self.coupling
    }

    /// Nominal time between ticks \[s\].
    #[must_use]
    pub fn period(&self) -> f64 {
        self.period
    }

    /// One tick.
    #[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
    pub fn tick(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        sample: &DeviceSample,
        time: TickTime,
        ws: &mut TickWorkspace,
    ) -> TickRecord {
        let mut flags = TickFlags::default();
        let elapsed = self.elapsed(state, &time, &mut flags);
        if self.take_over(state, snapshot, &elapsed, &mut flags) {
            ws.forget();
        }
        let (dt, motion) = (elapsed.granted, elapsed.motion);
        let outgoing = state.outgoing.take();

        let (sent, local) = if !is_sound(sample) {
            flags.set(TickFlags::BAD_POSE);
            state.device_velocity = Twist::default();
            state.cut();
            (Wrench::zero(), Local::EMPTY)
        } else {
            self.observe(state, sample, motion);
            if snapshot.valid && !state.believed {
                flags.set(TickFlags::NON_FINITE);
                state.cut();
                (Wrench::zero(), Local::EMPTY)
            } else if snapshot.valid {
                self.touch(state, snapshot, sample, dt, ws, &mut flags)
            } else {
                flags.set(if snapshot.step == 0 { TickFlags::NO_SNAPSHOT } else { TickFlags::INVALID_SNAPSHOT });
                state.coupling = self.coupling.settle(&state.coupling, &Wrench::zero());
                self.settle_gripper(state, 0.0);
                state.forget_patch();
                (self.limits.release(&mut state.limits, dt, &mut flags), Local::EMPTY)
            }
        };
        self.passivity.keep(&mut state.passivity, &sent, local.active > 0, motion);

        let gripper = self.grip(state, local.gripper, dt, &mut flags);
        let swapped = flags.contains(TickFlags::NEW_SNAPSHOT);
        let jump = outgoing.filter(|_| swapped).map_or(0.0, |before| (local.wrench.force - before).norm());
        // The square of what no force can be has no room.
        let jump = jump.min(f64::MAX);
        let record = record(state, snapshot, TickMoment { time, elapsed }, sent, &local, jump, flags);
        TickRecord { gripper, ..record }
    }

    /// A tick without a sample: no force, and a ramp when the device is back.
    #[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
    pub fn idle(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        time: TickTime,
        error: DeviceError,
    ) -> TickRecord {
        let mut flags = TickFlags::DEVICE_ERROR;
        let elapsed = self.elapsed(state, &time, &mut flags);
        self.take_over(state, snapshot, &elapsed, &mut flags);
        state.device_velocity = Twist::default();
        state.cut();
        state.outgoing = None;
        let record = record(state, snapshot, TickMoment { time, elapsed }, Wrench::zero(), &Local::EMPTY, 0.0, flags);
        let gripper = self.grip(state, 0.0, elapsed.motion, &mut TickFlags::default());
        TickRecord { sampled: false, device_error: Some(error), gripper, ..record }
    }

    /// Takes a sound sample, `dt` \[s\] after the tick before, and books what went through the port until now.
    fn observe(&self, state: &mut TickState, sample: &DeviceSample, dt: f64) {
        self.read(state, sample);
        if state.jump.watch(&self.limits, &sample.pose.translation.vector) {
            state.passivity.cut();
        }
        self.passivity.observe(&mut state.passivity, &sample.pose);
        if let Some(gripper) = &self.gripper {
            gripper.observe(&mut state.gripper, dt);
        }
    }
}

/// Whether a pose can be one: finite, within [`MAX_COORDINATE`], and with a rotation of unit length.
fn is_pose(pose: &Isometry3<f64>) -> bool {
    let position = &pose.translation.vector;
    let unit = (pose.rotation.coords.norm_squared() - 1.0).abs() < 1e-3;
    all_finite(position) && position.amax() <= MAX_COORDINATE && unit
}

/// Whether a velocity can be one: finite and within [`MAX_VELOCITY`]. The limit of power and the port's energy rest on it.
fn is_velocity(velocity: &Twist) -> bool {
    let within = |v: &Vector3<f64>| all_finite(v) && v.amax() <= MAX_VELOCITY;
    within(&velocity.linear) && within(&velocity.angular)
}

fn record(
    state: &TickState,
    snapshot: &HapticSnapshot,
    TickMoment { time, elapsed }: TickMoment,
    sent: Wrench,
    local: &Local,
    force_jump: f64,
    flags: TickFlags,
) -> TickRecord {
    TickRecord {
        index: time.index,
        time: time.time,
        dt: elapsed.motion,
        host_lead: time.host_lead.unwrap_or(0.0),
        granted: elapsed.granted,
        device_pose: state.device_pose,
        device_velocity: state.device_velocity,
        tool_pose: state.coupling.tool(&state.device_pose),
        wrench: sent,
        contact_wrench: local.wrench,
        gap: local.gap,
        contacts: local.contacts,
        active: local.active,
        sweeps: local.sweeps,
        residual: local.residual,
        snapshot_step: snapshot.step,
        snapshot_valid: snapshot.valid,
        snapshot_age: state.age,
        force_jump,
        gripper: GripperRecord::default(),
        gain: state.limits.gain,
        energy: state.passivity.energy(),
        flags,
        sampled: true,
        device_error: None,
    }
}
