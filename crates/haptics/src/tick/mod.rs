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
mod jump;
mod local;
mod patch;
mod state;
mod warm_start;

use nalgebra::{Isometry3, Vector3};
use palpate_solver::gauss_seidel::GaussSeidelConfig;

use crate::SetupError;
use crate::coupling::Coupling;
use crate::device::{DeviceError, DeviceSample, DeviceSpec, TickTime};
use crate::error::positive;
use crate::limits::Limits;
use crate::passivity::Passivity;
use crate::record::{TickFlags, TickRecord};
use crate::snapshot::HapticSnapshot;
use crate::wrench::{Twist, Wrench, all_finite};

pub use config::TickConfig;
pub use local::TickWorkspace;
pub use patch::PatchTickConfig;
pub use state::TickState;

use local::{Local, Problem};
use patch::{PatchMemory, PatchProblem, ToolPoses};

/// Periods after which a tick is late: half a period of jitter is none.
const LATE: f64 = 1.5;

/// Largest coordinate that a device pose may have \[m\]; beyond it the pose is an error of the driver.
pub const MAX_COORDINATE: f64 = 1e3;

/// The tick of one tool: description.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    period: f64,
    solver: GaussSeidelConfig,
    coupling: Coupling,
    passivity: Passivity,
    limits: Limits,
    patch: Option<PatchTickConfig>,
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
            passivity: Passivity::new(&config.passivity, spec, config.period)?,
            limits: Limits::new(&config.limits, spec)?,
            patch: None,
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
        if outgoing.valid && state.step == Some(outgoing.step) && is_pose(&sample.pose) {
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

        let (sent, local) = if !is_pose(&sample.pose) {
            flags.set(TickFlags::BAD_POSE);
            state.device_velocity = Twist::default();
            state.cut();
            (Wrench::zero(), Local::EMPTY)
        } else {
            self.observe(state, sample);
            if snapshot.valid {
                self.touch(state, snapshot, sample, dt, ws, &mut flags)
            } else {
                flags.set(if snapshot.step == 0 { TickFlags::NO_SNAPSHOT } else { TickFlags::INVALID_SNAPSHOT });
                state.coupling = self.coupling.settle(&state.coupling, &Wrench::zero());
                state.forget_patch();
                (self.limits.release(&mut state.limits, dt, &mut flags), Local::EMPTY)
            }
        };
        self.passivity.keep(&mut state.passivity, &sent, local.active > 0, aged);

        let swapped = flags.contains(TickFlags::NEW_SNAPSHOT);
        let jump = outgoing.filter(|_| swapped).map_or(0.0, |before| (local.wrench.force - before).norm());
        record(state, snapshot, TickTime { dt: aged, ..time }, sent, &local, jump, flags)
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
        let record = record(state, snapshot, TickTime { dt: aged, ..time }, Wrench::zero(), &Local::EMPTY, 0.0, flags);
        TickRecord { device_error: Some(error), ..record }
    }

    /// Takes a sound sample, and books what went through the port until now.
    fn observe(&self, state: &mut TickState, sample: &DeviceSample) {
        (state.device_pose, state.device_velocity) = (sample.pose, sample.velocity);
        if state.jump.watch(&self.limits, &sample.pose.translation.vector) {
            state.passivity.cut();
        }
        self.passivity.observe(&mut state.passivity, &sample.pose);
    }

    /// Contact at the newest pose, and what of its wrench is sent.
    fn touch(
        &self,
        state: &mut TickState,
        snapshot: &HapticSnapshot,
        sample: &DeviceSample,
        dt: f64,
        ws: &mut TickWorkspace,
        flags: &mut TickFlags,
    ) -> (Wrench, Local) {
        let poses = self.poses(state, sample);
        let local = self.solve(state, snapshot, &poses, ws, flags);
        flags.set_if(local.truncated, TickFlags::TRUNCATED);
        flags.set_if(!local.converged, TickFlags::NOT_CONVERGED);
        state.coupling = self.coupling.settle(&state.coupling, &local.wrench);
        self.keep(state, snapshot, &sample.pose, ws);
        let free = local.active == 0 && !flags.contains(TickFlags::BEYOND_PATCH);
        flags.set_if(state.jump.withdraws(free), TickFlags::JUMPED);
        // Numbers in W or δ_free that are not finite end the force, even where λ is finite.
        let target = if local.finite { local.wrench } else { NOT_A_WRENCH };
        let sent = self.send(state, &target, dt, flags);
        if flags.contains(TickFlags::NON_FINITE) {
            state.cut();
            state.warm_start.clear_forces();
            (sent, Local { wrench: Wrench::zero(), active: 0, ..local })
        } else {
            (sent, local)
        }
    }

    /// What is left of a contact wrench by the fades, by the energy of the port, and by the limits.
    fn send(&self, state: &mut TickState, target: &Wrench, dt: f64, flags: &mut TickFlags) -> Wrench {
        let Some(faded) = self.limits.fade(&mut state.limits, target, state.age, dt, flags) else {
            return Wrench::zero();
        };
        if flags.contains(TickFlags::JUMPED) {
            return self.limits.release(&mut state.limits, dt, flags);
        }
        let passive = self.passivity.act(&state.passivity, &faded, &state.device_velocity, flags);
        self.limits.bound(&mut state.limits, &passive, &state.device_velocity, dt, flags)
    }

    fn problem(&self) -> Problem<'_> {
        Problem { solver: &self.solver, coupling: &self.coupling }
    }

    /// What solves on the snapshot's patch, where the tick works on patches and the snapshot has one.
    fn local(&self, snapshot: &HapticSnapshot) -> Option<PatchProblem<'_>> {
        let config = self.patch.as_ref().filter(|_| snapshot.patch.valid)?;
        Some(PatchProblem { solver: &self.solver, coupling: &self.coupling, config })
    }

    fn poses(&self, state: &TickState, sample: &DeviceSample) -> ToolPoses {
        let held = state.coupling.tool(&sample.pose);
        ToolPoses { held, predicted: self.coupling.predict(&state.coupling, &sample.pose) }
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
                let beyond = problem.is_beyond(&snapshot.patch, &snapshot.tool_pose, &poses.held);
                flags.set_if(beyond, TickFlags::BEYOND_PATCH);
                problem.solve(memory, &snapshot.patch, poses, ws)
            }
            _ => self.problem().solve(&mut state.warm_start, snapshot, &poses.predicted, ws),
        }
    }

    /// Lets a tick on a patch be remembered.
    fn keep(&self, state: &mut TickState, snapshot: &HapticSnapshot, device: &Isometry3<f64>, ws: &TickWorkspace) {
        let tool = state.coupling.tool(device);
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
            state.jump.take_over();
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
        let aged = if sound { dt } else { self.period };
        flags.set_if(aged > LATE * self.period, TickFlags::LATE);
        state.jump.pass(aged);
        if sound && !self.limits.is_gap(dt) {
            return (dt, dt);
        }
        flags.set(TickFlags::GAP);
        state.limits.gain = 0.0;
        (self.period, aged)
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
        dt: time.dt,
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
        gain: state.limits.gain,
        energy: state.passivity.energy(),
        flags,
        device_error: None,
    }
}
