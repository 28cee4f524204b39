//! One step of the tissue (30 Hz), as the lecture's algorithm: free motion, detection, rows, compliance, solve, correct.
//!
//! ```text
//! A = M + h C + h² K(q),  A dv = b             free motion by conjugate gradients,
//!                                              preconditioned by the latest factor, warped by nodal rotations
//! delta_free = delta(q) + H h (v + dv)         gap if nothing touched (m)
//! W = h² H A⁻¹ Hᵀ                              compliance (m/N) by half solves of the latest (warped) or this step's factor
//! delta = W lambda + delta_free, Coulomb       the scene's solver, warm-started by contact feature
//! v+ = v + dv + h A⁻¹ Hᵀ lambda, q+ = q + h v+
//! ```
//!
//! Contacts are found at the configuration of the step's begin, where the last correction left the skin outside the
//! tool; `q_free` would show the tool deep in tissue that has already sprung back.

mod report;
mod stages;
mod workspace;

use std::time::Instant;

use nalgebra::Isometry3;
use palpate_fem::assembly::assemble;
use palpate_haptics::snapshot::HapticSnapshot;

use crate::refresh::FactorSample;
use crate::world::World;

pub use report::{StepReport, StepStatus, StepTimes};
pub use workspace::{StepState, StepWorkspace};

/// What a step reads from the other threads.
#[derive(Clone, Copy)]
pub struct StepInput<'a> {
    /// Time at the begin of the step (s).
    pub time: f64,
    /// Pose of the tool.
    pub tool: Isometry3<f64>,
    /// The latest factor.
    pub factor: &'a FactorSample,
}

/// Advances the body by one step and fills the snapshot for the tick.
///
/// Allocates nothing, whatever happens. A body that turns non-finite or is torn apart is put back to the state before
/// the step, at rest, and the report and the snapshot say so.
pub fn step(
    world: &World,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    snapshot: &mut HapticSnapshot,
) -> StepReport {
    let mut report = StepReport::begin(state.step, input, world.dt());
    let mut clock = Clock::start();

    report.assembly = assemble(world.model(), &state.fem, world.dt(), &[], &mut ws.fem);
    report.times.assembly = clock.lap();

    stages::free_motion(world, input.factor, state, ws, &mut report);
    report.times.free_motion = clock.lap();

    stages::detection(world, &input.tool, state, ws, &mut report);
    report.times.detection = clock.lap();

    stages::rows(world, &input.tool, state, ws, &mut report);
    stages::compliance(world, input.factor, ws, &mut report);
    report.times.compliance = clock.lap();

    stages::solve(state, ws, &mut report);
    report.times.solve = clock.lap();

    stages::correct(world, input.factor, state, ws, &mut report);
    report.times.correction = clock.lap();

    stages::hand_over(world, input, state, ws, &report, snapshot);
    state.tool = Some(input.tool);
    state.step += 1;
    report.times.hand_over = clock.lap();
    report.times.total = report.times.sum();
    report
}

/// Laps of the stages.
struct Clock(Instant);

impl Clock {
    fn start() -> Self {
        Self(Instant::now())
    }

    /// Seconds since the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        now.duration_since(std::mem::replace(&mut self.0, now)).as_secs_f64()
    }
}
