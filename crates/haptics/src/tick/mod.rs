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
//! 4. The wrench Jᵀ λ goes through the limits ([`crate::limits`]) to the device.
//!
//! A tick allocates nothing, takes no lock, makes no system call, has no panic path, and its work is bounded by the
//! capacity and the number of sweeps: O(rows²) a sweep, and as much again when a snapshot is taken over.

mod grip;
mod local;
mod patch;
mod warm_start;

use nalgebra::{Isometry3, Vector3};
use palpate_collision::ToolPose;
use palpate_solver::gauss_seidel::GaussSeidelConfig;
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::coupling::{Coupling, CouplingConfig, CouplingState};
use crate::device::{DeviceError, DeviceSample, DeviceSpec, TickTime};
use crate::error::positive;
use crate::gripper::{Gripper, GripperRecord, GripperState};
use crate::limits::{Limits, LimitsConfig, LimitsState};
use crate::record::{TickFlags, TickRecord};
use crate::snapshot::HapticSnapshot;
use crate::wrench::{Twist, Wrench, all_finite};

pub use local::TickWorkspace;
pub use patch::PatchTickConfig;

use grip::is_sound;
use local::{Local, Problem};
use patch::{PatchMemory, PatchProblem, ToolPoses};
use warm_start::WarmStart;

/// The tick as described by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TickConfig {
    /// Nominal time between ticks \[s\], > 0 (0.001).
    pub period: f64,
    /// Most Gauss-Seidel sweeps of a tick, > 0 (30).
    pub sweeps: u32,
    /// Relative natural-map residual at which the sweeps stop, > 0 (1e-6).
    pub tolerance: f64,
    /// Spring and damper between device and tool.
    pub coupling: CouplingConfig,
    /// Limits of force.
    pub limits: LimitsConfig,
}

impl TickConfig {
    /// The defaults for a device, at the device's rate.
    #[must_use]
    pub fn for_device(spec: &DeviceSpec) -> Self {
        Self {
            period: 1.0 / spec.rate,
            sweeps: 30,
            tolerance: 1e-6,
            coupling: CouplingConfig::for_device(spec),
            limits: LimitsConfig::default(),
        }
    }
}

/// Largest coordinate that a device pose may have \[m\]; beyond it the pose is an error of the driver.
pub const MAX_COORDINATE: f64 = 1e3;

/// The tick of one tool: description.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    period: f64,
    solver: GaussSeidelConfig,
    coupling: Coupling,
    limits: Limits,
    patch: Option<PatchTickConfig>,
    gripper: Option<Gripper>,
}

/// What a tick remembers: state.
#[derive(Clone, Debug)]
pub struct TickState {
    coupling: CouplingState,
    limits: LimitsState,
    warm_start: WarmStart,
    /// For ticks on patches.
    patch: Option<PatchMemory>,
    /// The step whose snapshot is in use.
    step: Option<u64>,
    age: f64,
    /// Contact force of the snapshot that is about to be replaced, at the pose of this tick \[N\].
    outgoing: Option<Vector3<f64>>,
    device_pose: Isometry3<f64>,
    device_velocity: Twist,
    gripper: GripperState,
    device_gripper: f64,
}

impl TickState {
    /// The state before the first tick, for snapshots of up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        Self {
            coupling: CouplingState::default(),
            limits: LimitsState::default(),
            warm_start: WarmStart::new(max_contacts),
            patch: None,
            step: None,
            age: f64::INFINITY,
            outgoing: None,
            device_pose: Isometry3::identity(),
            device_velocity: Twist::default(),
            gripper: GripperState::default(),
            device_gripper: 1.0,
        }
    }

    /// Takes the force off and forgets everything but the capacity.
    pub fn reset(&mut self) {
        self.coupling = CouplingState::default();
        self.gripper.cut();
        self.limits.cut();
        self.warm_start.clear();
        self.forget_patch();
        self.step = None;
        self.age = f64::INFINITY;
        self.outgoing = None;
    }

    /// Takes the force off at once, lets its return be a ramp, and forgets the stretch of the coupling.
    pub(crate) fn cut(&mut self) {
        self.coupling = CouplingState::default();
        self.gripper.cut();
        self.limits.cut();
        self.forget_patch();
    }

    /// The next tick on a patch begins with the shape and the forces of the step.
    fn forget_patch(&mut self) {
        self.patch.iter_mut().for_each(PatchMemory::forget);
    }
}

const NOT_A_WRENCH: Wrench =
    Wrench { force: Vector3::new(f64::NAN, f64::NAN, f64::NAN), torque: Vector3::new(f64::NAN, f64::NAN, f64::NAN) };

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
        let memory = |config: &PatchTickConfig| PatchMemory::new(config.max_nodes, config.detection.max_contacts);
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

    /// Solves the snapshot that is about to be replaced at the newest pose, so that the tick that follows can measure
    /// the jump of force which the new snapshot brings, and that alone. λ starts the new one.
    #[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
    pub fn weigh_outgoing(
        &self,
        state: &mut TickState,
        outgoing: &HapticSnapshot,
        sample: &DeviceSample,
        ws: &mut TickWorkspace,
    ) {
        if outgoing.valid && state.step == Some(outgoing.step) && is_sound(sample) {
            self.read(state, sample);
            let poses = self.poses(state, sample);
            let local = match (self.local(outgoing), &state.patch) {
                (Some(problem), Some(memory)) => problem.solve(memory, &outgoing.patch, &poses, ws),
                _ => self.problem().solve(&mut state.warm_start, outgoing, &poses.predicted, ws),
            };
            state.outgoing = Some(local.wrench.force);
        }
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
        let (dt, aged) = self.elapsed(state, time.dt, &mut flags);
        if self.take_over(state, snapshot, aged, &mut flags) {
            ws.forget();
        }
        let outgoing = state.outgoing.take();

        let (sent, local) = if !is_sound(sample) {
            flags.set(TickFlags::BAD_POSE);
            state.device_velocity = Twist::default();
            state.cut();
            (Wrench::zero(), Local::EMPTY)
        } else if snapshot.valid {
            self.read(state, sample);
            let poses = self.poses(state, sample);
            let local = self.solve(state, snapshot, &poses, ws, &mut flags);
            flags.set_if(local.truncated, TickFlags::TRUNCATED);
            flags.set_if(!local.converged, TickFlags::NOT_CONVERGED);
            state.coupling = self.coupling.settle(&state.coupling, &local.wrench);
            self.settle_gripper(state, local.gripper);
            self.keep(state, snapshot, &sample.pose, ws);
            // Numbers in W or δ_free that are not finite end the force, even where λ is finite.
            let target = if local.finite { local.wrench } else { NOT_A_WRENCH };
            let sent = self.limits.apply(&mut state.limits, &target, state.age, dt, &mut flags);
            if flags.contains(TickFlags::NON_FINITE) {
                state.cut();
                state.warm_start.clear_forces();
                (sent, Local { wrench: Wrench::zero(), gripper: 0.0, active: 0, ..local })
            } else {
                (sent, local)
            }
        } else {
            self.read(state, sample);
            flags.set(if snapshot.step == 0 { TickFlags::NO_SNAPSHOT } else { TickFlags::INVALID_SNAPSHOT });
            state.coupling = self.coupling.settle(&state.coupling, &Wrench::zero());
            self.settle_gripper(state, 0.0);
            state.forget_patch();
            (self.limits.release(&mut state.limits, dt, &mut flags), Local::EMPTY)
        };

        let gripper = self.grip(state, local.gripper, dt, &mut flags);
        let swapped = flags.contains(TickFlags::NEW_SNAPSHOT);
        let jump = outgoing.filter(|_| swapped).map_or(0.0, |before| (local.wrench.force - before).norm());
        let record = record(state, snapshot, time, sent, &local, jump, flags);
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
        let (_, aged) = self.elapsed(state, time.dt, &mut flags);
        self.take_over(state, snapshot, aged, &mut flags);
        state.device_velocity = Twist::default();
        state.cut();
        state.outgoing = None;
        let record = record(state, snapshot, time, Wrench::zero(), &Local::EMPTY, 0.0, flags);
        let gripper = self.grip(state, 0.0, time.dt, &mut TickFlags::default());
        TickRecord { device_error: Some(error), gripper, ..record }
    }

    fn problem(&self) -> Problem<'_> {
        Problem { solver: &self.solver, coupling: &self.coupling, gripper: self.gripper.as_ref() }
    }

    /// What solves on the snapshot's patch, where the tick works on patches and the snapshot has one.
    fn local(&self, snapshot: &HapticSnapshot) -> Option<PatchProblem<'_>> {
        let config = self.patch.as_ref().filter(|_| snapshot.patch.valid)?;
        Some(PatchProblem { solver: &self.solver, coupling: &self.coupling, gripper: self.gripper.as_ref(), config })
    }

    fn poses(&self, state: &TickState, sample: &DeviceSample) -> ToolPoses {
        let held = self.tool(state, &sample.pose);
        let frame = self.coupling.predict(&state.coupling, &sample.pose);
        let opening = self.gripper.as_ref().map_or(0.0, |gripper| gripper.predict(&state.gripper));
        ToolPoses { held, predicted: ToolPose { frame, opening } }
    }

    /// The contact problem of the tick: on the patch, or on the snapshot's own rows.
    fn solve(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        poses: &ToolPoses,
        ws: &mut TickWorkspace,
        flags: &mut TickFlags,
    ) -> Local {
        match (self.local(snapshot), &mut state.patch) {
            (Some(problem), Some(memory)) => {
                // Forgotten between two snapshots, after a fault: it begins anew on this one.
                if !memory.is_of(&snapshot.patch) {
                    memory.forget();
                    memory.take_over(&snapshot.patch);
                }
                flags.set(TickFlags::LOCAL);
                let beyond = problem.is_beyond(&snapshot.patch, &snapshot.tool(), &poses.held);
                flags.set_if(beyond, TickFlags::BEYOND_PATCH);
                problem.solve(memory, &snapshot.patch, poses, ws)
            }
            _ => self.problem().solve(&mut state.warm_start, snapshot, &poses.predicted, ws),
        }
    }

    /// Lets a tick on a patch be remembered.
    fn keep(&self, state: &mut TickState, snapshot: &HapticSnapshot, device: &Isometry3<f64>, ws: &TickWorkspace) {
        let tool = self.tool(state, device);
        if let (Some(problem), Some(memory), Some(ws)) = (self.local(snapshot), &mut state.patch, &ws.patch) {
            memory.keep(&snapshot.patch, problem.config.hand_over, &tool, ws);
        }
    }

    /// Notices a new snapshot, or lets the one in use age.
    fn take_over(&self, state: &mut TickState, snapshot: &HapticSnapshot, dt: f64, flags: &mut TickFlags) -> bool {
        let new = snapshot.valid && state.step != Some(snapshot.step);
        if new {
            flags.set(TickFlags::NEW_SNAPSHOT);
            state.warm_start.take_over(snapshot);
            state.step = Some(snapshot.step);
            state.age = 0.0;
        } else {
            state.age += dt;
        }
        if let Some(memory) = &mut state.patch {
            match (self.patch.is_some() && snapshot.patch.valid, new) {
                (true, true) => memory.take_over(&snapshot.patch),
                (true, false) => memory.age(dt),
                (false, _) => memory.forget(),
            }
        }
        new
    }

    /// Time since the tick before, for the limits and for the snapshot's age.
    ///
    /// A gap, or a time that cannot be, makes the force come back as a ramp: for the limits it counts as one period,
    /// so that the gap itself does not pass for time in which the force has risen.
    fn elapsed(&self, state: &mut TickState, dt: f64, flags: &mut TickFlags) -> (f64, f64) {
        let sound = dt > 0.0 && dt.is_finite();
        if sound && !self.limits.is_gap(dt) {
            return (dt, dt);
        }
        flags.set(TickFlags::GAP);
        state.limits.gain = 0.0;
        (self.period, if sound { dt } else { self.period })
    }
}

/// Whether a pose can be one: finite, within [`MAX_COORDINATE`], and with a rotation of unit length.
fn is_pose(pose: &Isometry3<f64>) -> bool {
    let position = &pose.translation.vector;
    let unit = (pose.rotation.coords.norm_squared() - 1.0).abs() < 1e-3;
    all_finite(position) && position.amax() <= MAX_COORDINATE && unit
}

fn record(
    state: &TickState,
    snapshot: &HapticSnapshot,
    time: TickTime,
    sent: Wrench,
    local: &Local,
    force_jump: f64,
    flags: TickFlags,
) -> TickRecord {
    TickRecord {
        index: time.index,
        time: time.time,
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
        snapshot_age: state.age,
        force_jump,
        gripper: GripperRecord::default(),
        gain: state.limits.gain,
        flags,
        device_error: None,
    }
}
