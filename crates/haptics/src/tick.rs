//! One tick of the haptic loop: from the newest pose and the latest snapshot to a wrench.
//!
//! 1. The tool's pose without contact is predicted from the device's ([`crate::coupling`]).
//! 2. δ = δ_free + J · (predicted pose − reference pose), the rotation as a rotation vector. The linearisation in the
//!    rotation is exact to first order in the angle turned since the step.
//! 3. (δ, λ) is solved on W + c J_f J_fᵀ by at most `sweeps` sweeps of block Gauss-Seidel from the last tick's λ
//!    [Saupin, Duriez and Cotin, ISBMS 2008].
//! 4. The wrench Jᵀ λ goes through the limits ([`crate::limits`]) to the device.
//!
//! A tick allocates nothing, takes no lock, makes no system call, has no panic path, and its work is bounded by the
//! capacity and the number of sweeps: O(rows²) a sweep, and as much again when a snapshot is taken over.

use nalgebra::{Isometry3, Vector3};
use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, GaussSeidelWorkspace};
use palpate_solver::problem::ProblemView;
use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::coupling::{Coupling, CouplingConfig, CouplingState};
use crate::device::{DeviceError, DeviceSample, DeviceSpec, TickTime};
use crate::error::positive;
use crate::limits::{Limits, LimitsConfig, LimitsState};
use crate::record::{TickFlags, TickRecord};
use crate::snapshot::{HapticSnapshot, ROWS_PER_CONTACT};
use crate::warm_start::WarmStart;
use crate::wrench::{Wrench, all_finite};

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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    period: f64,
    solver: GaussSeidelConfig,
    coupling: Coupling,
    limits: Limits,
}

/// What a tick remembers: state.
#[derive(Clone, Debug)]
pub struct TickState {
    coupling: CouplingState,
    limits: LimitsState,
    warm_start: WarmStart,
    /// The step whose snapshot is in use.
    step: Option<u64>,
    age: f64,
    /// Contact force of the snapshot that is about to be replaced, at the pose of this tick \[N\].
    outgoing: Option<Vector3<f64>>,
    device_pose: Isometry3<f64>,
}

impl TickState {
    /// The state before the first tick, for snapshots of up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        Self {
            coupling: CouplingState::default(),
            limits: LimitsState::default(),
            warm_start: WarmStart::new(max_contacts),
            step: None,
            age: f64::INFINITY,
            outgoing: None,
            device_pose: Isometry3::identity(),
        }
    }

    /// Takes the force off and forgets everything but the capacity.
    pub fn reset(&mut self) {
        self.coupling = CouplingState::default();
        self.limits.cut();
        self.warm_start.clear();
        self.step = None;
        self.age = f64::INFINITY;
        self.outgoing = None;
    }

    /// Takes the force off at once, lets its return be a ramp, and forgets the stretch of the coupling.
    pub(crate) fn cut(&mut self) {
        self.coupling = CouplingState::default();
        self.limits.cut();
    }
}

/// Scratch of a tick, which may be thrown away between any two.
#[derive(Clone, Debug)]
pub struct TickWorkspace {
    /// Snapshot that `w` was made from.
    step: Option<u64>,
    /// W + c J_f J_fᵀ \[m/N\].
    w: Vec<f64>,
    /// Whether all of `w` is.
    finite: bool,
    delta: Vec<f64>,
    solver: GaussSeidelWorkspace,
}

impl TickWorkspace {
    /// Scratch for snapshots of up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_contacts: usize) -> Self {
        let rows = ROWS_PER_CONTACT * max_contacts;
        let solver = GaussSeidelWorkspace::with_capacity(rows);
        Self { step: None, w: vec![0.0; rows * rows], finite: true, delta: vec![0.0; rows], solver }
    }

    fn max_contacts(&self) -> usize {
        self.delta.len() / ROWS_PER_CONTACT
    }
}

/// Answer of the local problem.
#[derive(Clone, Copy, Debug)]
struct Local {
    wrench: Wrench,
    contacts: u32,
    active: u32,
    sweeps: u32,
    residual: f64,
    converged: bool,
    truncated: bool,
    /// Whether all that went in and came out was finite.
    finite: bool,
}

impl Local {
    const EMPTY: Self = Self {
        wrench: Wrench { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::new(0.0, 0.0, 0.0) },
        contacts: 0,
        active: 0,
        sweeps: 0,
        residual: 0.0,
        converged: true,
        truncated: false,
        finite: true,
    };
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
        })
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
            let predicted = self.coupling.predict(&state.coupling, &sample.pose);
            let local = self.solve(&mut state.warm_start, outgoing, &predicted, ws);
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
        take_over(state, snapshot, aged, &mut flags);
        let outgoing = state.outgoing.take();

        let (sent, local) = if !is_pose(&sample.pose) {
            flags.set(TickFlags::BAD_POSE);
            state.cut();
            (Wrench::zero(), Local::EMPTY)
        } else if snapshot.valid {
            state.device_pose = sample.pose;
            let predicted = self.coupling.predict(&state.coupling, &sample.pose);
            let local = self.solve(&mut state.warm_start, snapshot, &predicted, ws);
            flags.set_if(local.truncated, TickFlags::TRUNCATED);
            flags.set_if(!local.converged, TickFlags::NOT_CONVERGED);
            state.coupling = self.coupling.settle(&state.coupling, &local.wrench);
            // Numbers in W or δ_free that are not finite end the force, even where λ is finite.
            let target = if local.finite { local.wrench } else { NOT_A_WRENCH };
            let sent = self.limits.apply(&mut state.limits, &target, state.age, dt, &mut flags);
            if flags.contains(TickFlags::NON_FINITE) {
                state.cut();
                state.warm_start.clear_forces();
                (sent, Local { wrench: Wrench::zero(), active: 0, ..local })
            } else {
                (sent, local)
            }
        } else {
            state.device_pose = sample.pose;
            flags.set(if snapshot.step == 0 { TickFlags::NO_SNAPSHOT } else { TickFlags::INVALID_SNAPSHOT });
            state.coupling = self.coupling.settle(&state.coupling, &Wrench::zero());
            (self.limits.release(&mut state.limits, dt, &mut flags), Local::EMPTY)
        };

        let swapped = flags.contains(TickFlags::NEW_SNAPSHOT);
        let jump = outgoing.filter(|_| swapped).map_or(0.0, |before| (local.wrench.force - before).norm());
        record(state, snapshot, time, sent, &local, jump, flags)
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
        take_over(state, snapshot, aged, &mut flags);
        state.cut();
        state.outgoing = None;
        let record = record(state, snapshot, time, Wrench::zero(), &Local::EMPTY, 0.0, flags);
        TickRecord { device_error: Some(error), ..record }
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

    /// The local problem with the tool predicted at this pose.
    fn solve(
        &self,
        warm_start: &mut WarmStart,
        snapshot: &HapticSnapshot,
        predicted: &Isometry3<f64>,
        ws: &mut TickWorkspace,
    ) -> Local {
        let contacts = snapshot.contacts().min(ws.max_contacts()).min(warm_start.max_contacts());
        let rows =
            snapshot.blocks().get(contacts).map_or(snapshot.rows(), |first_without_room| first_without_room.start);
        let truncated = contacts < snapshot.contacts();
        if rows == 0 {
            return Local { truncated, ..Local::EMPTY };
        }
        let tool_rows = &snapshot.tool_rows()[..rows];
        self.prepare(snapshot, rows, ws);
        move_tool(snapshot, tool_rows, predicted, &mut ws.delta);

        let lambda = warm_start.lambda_mut(rows);
        let blocks = &snapshot.blocks()[..contacts];
        let (compliance, delta_free) = (&ws.w[..rows * rows], &ws.delta[..rows]);
        let problem = ProblemView { compliance, stride: rows, delta_free, blocks };
        let report = gauss_seidel::solve(&problem, lambda, &self.solver, &mut ws.solver);

        let active = blocks.iter().filter(|block| lambda[block.start] != 0.0).count();
        let wrench = wrench_of(tool_rows, lambda);
        let finite = ws.finite && report.residual.is_finite() && delta_free.iter().all(|gap| gap.is_finite());
        Local {
            finite,
            wrench,
            contacts: contacts as u32,
            active: active as u32,
            sweeps: report.iterations,
            residual: report.residual,
            converged: report.is_solved(),
            truncated,
        }
    }

    /// W_tick, once a snapshot.
    fn prepare(&self, snapshot: &HapticSnapshot, rows: usize, ws: &mut TickWorkspace) {
        if ws.step == Some(snapshot.step) {
            return;
        }
        let w = &mut ws.w[..rows * rows];
        for (line, of_snapshot) in w.chunks_exact_mut(rows).zip(snapshot.compliance().chunks_exact(snapshot.rows())) {
            line.copy_from_slice(&of_snapshot[..rows]);
        }
        self.coupling.add_compliance(&snapshot.tool_rows()[..rows], w);
        ws.finite = w.iter().all(|w| w.is_finite());
        ws.step = Some(snapshot.step);
    }
}

/// Notices a new snapshot, or lets the one in use age.
fn take_over(state: &mut TickState, snapshot: &HapticSnapshot, dt: f64, flags: &mut TickFlags) {
    if snapshot.valid && state.step != Some(snapshot.step) {
        flags.set(TickFlags::NEW_SNAPSHOT);
        state.warm_start.take_over(snapshot);
        state.step = Some(snapshot.step);
        state.age = 0.0;
    } else {
        state.age += dt;
    }
}

/// δ at the predicted pose.
fn move_tool(snapshot: &HapticSnapshot, tool_rows: &[[f64; 6]], predicted: &Isometry3<f64>, delta: &mut [f64]) {
    let moved = predicted.translation.vector - snapshot.tool_pose.translation.vector;
    let turned = (predicted.rotation * snapshot.tool_pose.rotation.inverse()).scaled_axis();
    for ((delta, free), row) in delta.iter_mut().zip(snapshot.delta_free()).zip(tool_rows) {
        let rotation = row[3] * turned.x + row[4] * turned.y + row[5] * turned.z;
        *delta = free + row[0] * moved.x + row[1] * moved.y + row[2] * moved.z + rotation;
    }
}

/// Jᵀ λ.
fn wrench_of(tool_rows: &[[f64; 6]], lambda: &[f64]) -> Wrench {
    let mut wrench = Wrench::zero();
    for (row, lambda) in tool_rows.iter().zip(lambda) {
        wrench.force += Vector3::new(row[0], row[1], row[2]) * *lambda;
        wrench.torque += Vector3::new(row[3], row[4], row[5]) * *lambda;
    }
    wrench
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
        tool_pose: state.coupling.tool(&state.device_pose),
        wrench: sent,
        contact_wrench: local.wrench,
        contacts: local.contacts,
        active: local.active,
        sweeps: local.sweeps,
        residual: local.residual,
        snapshot_step: snapshot.step,
        snapshot_age: state.age,
        force_jump,
        gain: state.limits.gain,
        flags,
        device_error: None,
    }
}
