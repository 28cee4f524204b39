//! One step of the tissue (30 Hz), as the lecture's algorithm: free motion, detection, rows, compliance, solve, correct.
//!
//! ```text
//! A = M + h C + h² K(q),  A dv = b             free motion by conjugate gradients,
//!                                              preconditioned by the latest factor, warped by nodal rotations
//! delta_free = delta(q) + H h (v + dv)         gap if nothing touched (m)
//! W = h² H A⁻¹ Hᵀ                              compliance (m/N) by half solves of the latest (warped) or this step's factor
//!                                              plus h² H M⁻¹ Hᵀ of rigid bodies
//! delta = W lambda + delta_free, law            the scene's solver, warm-started by contact feature
//! v+ = v + dv + h A⁻¹ Hᵀ lambda, q+ = q + h v+
//! ```
//!
//! By Newton's method motion and forces are repeated until the nonlinear balance holds, and `A` is that of its end.
//! Explicitly, the whole step is repeated in substeps with `A` the lumped mass; the tick then gets the compliance of a
//! substep, which is that of the touched nodes alone and stiffer than the tissue's.
//!
//! The direct approaches ([`ContactMethod`](crate::scene::ContactMethod)) put one solve over body and contacts in the
//! place of solve and correction; everything else, with the compliance for the tick, stays.
//!
//! Contacts are found at the configuration of the step's begin, where the last correction left the skin outside the
//! tool; `q_free` would show the tool deep in tissue that has already sprung back.

mod accuracy;
mod bodies;
mod body_contacts;
mod change;
mod climb;
mod column;
mod compliance_error;
mod correction;
mod coupled_system;
mod direct;
mod drift;
mod first_inverse;
mod forces;
mod free_motion;
mod given;
mod guard;
mod hand_over;
mod held_open;
mod lagrange;
mod newton;
mod obstacles;
mod pair_state;
mod patch;
mod penalty;
mod preconditioner;
mod prediction;
mod prepared;
mod prepared_nodes;
mod refinement;
mod report;
mod rigid;
mod stages;
mod state;
mod tangle;
mod times;
mod workspace;

use std::time::Instant;

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_constraints::compliance::ComplianceMethod;
use palpate_fem::assembly::assemble;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_solver::report::SolveStatus;

use self::guard::guard;
use self::held_open::hold_open;
use self::newton::newton_with_contact;
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Change, Integration, World};

pub use bodies::{BodiesReport, PairForce};
pub(crate) use body_contacts::{BODY_CONTACTS, capacity as yielding_contacts};
pub(crate) use change::pass_next_event;
pub use change::{ChangeReport, FactorFit, pass_events};
pub use climb::Climb;
pub use compliance_error::ComplianceError;
#[doc(hidden)]
pub use given::{GivenContact, step_at};
pub(crate) use prepared::Prepared;
pub use report::{FailedElement, StepReport, StepStatus, Tangle};
pub(crate) use rigid::{digest, placements};
pub use state::StepState;
pub use times::StepTimes;
pub use workspace::StepWorkspace;

/// What a step reads from the other threads.
#[derive(Clone, Copy)]
pub struct StepInput<'a> {
    /// Time at the begin of the step (s).
    pub time: f64,
    /// Pose of the tool, and the opening of its jaws.
    pub tool: ToolPose,
    /// The latest factor.
    pub factor: &'a FactorSample,
}

/// Advances the body by one step and fills the snapshot for the tick. Where the scene has events, [`pass_events`] comes
/// first.
///
/// Allocates nothing, whatever happens, unless contact is by Lagrange multipliers at other nodes than before. A body
/// that turns non-finite or is torn apart is put back to the state before the step, at rest, and the report and the
/// snapshot say so.
pub fn step(
    world: &World,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    snapshot: &mut HapticSnapshot,
) -> StepReport {
    let outside = state.outside.last().cloned();
    let world = outside.as_deref().map_or_else(|| world.phase(state.phase), Change::world);
    let mut report = StepReport::begin(state.step, input, world.dt());
    report.change = ws.change.report;
    ws.change.report.changed = false;
    report.rung = climb::begin(world, state);
    let mut clock = Clock::start();
    let before = state.tool;
    ws.pcg.forget();
    ws.carries = false;
    ws.iterations_left = world.description().bodies[0].max_iterations;
    state.remember();
    match world.integration() {
        Integration::BackwardEuler => {
            ws.fem.folds.clear();
            report.led = state.trouble.leads();
            ws.fem.led = report.led;
            report.assembly = assemble(world.model(), &state.fem, world.dt(), &[], &mut ws.fem);
            hold_open(world, state, ws, &mut report);
            tangle::look(world, state, ws, &mut report);
            report.times.assembly = clock.lap();
            free_motion::free_motion(world, input.factor, state, ws, &mut report);
            state.trouble.suspected |= guard(world, state, ws, &mut report);
            report.times.free_motion = clock.lap();
            contact(world, input, state, ws, &mut report, &mut clock);
            // Compliance may be older than a factor that the correction asked for.
            let exact = matches!(report.method, ComplianceMethod::Exact | ComplianceMethod::Automatic);
            if ws.own_is_current && exact {
                report.factor_age = 0.0;
                if world.plan().refactor == Refactor::Step {
                    report.change.factor = FactorFit::Own;
                }
            }
        }
        Integration::Newton(config) => {
            report.factor_age = 0.0;
            newton_with_contact(world, config, input, state, ws, &mut report, &mut clock);
        }
        Integration::Explicit { substeps, .. } => {
            report.factor_age = 0.0;
            explicit(world, input, *substeps, state, ws, &mut report, &mut clock);
        }
    }
    report.bodies.digest = digest(placements(world, &state.rigid));
    column::sample(world, input.factor, ws, &mut report);
    climb::choose_next(world, input.factor, state, ws, &mut report);
    report.times.sampling = clock.lap();
    hand_over::hand_over(world, input, before.as_ref(), state, ws, &mut report, snapshot);
    report.in_full = ws.solve.take_in_full() + ws.compliance.inverse_mut().take_in_full();
    state.tool = Some(input.tool);
    state.step += 1;
    report.times.hand_over = clock.lap();
    report.times.total = report.times.sum();
    report
}

/// Detection, rows, compliance, forces and correction, after the free motion.
fn contact(
    world: &World,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    clock: &mut Clock,
) {
    stages::detection(world, &input.tool, state, ws, report);
    rigid::rigid_motion(world, state, ws);
    report.times.detection += clock.lap();
    stages::rows(world, &input.tool, state, ws, report);
    stages::compliance(world, input.factor, ws, report);
    report.times.compliance += clock.lap();
    forces::solve(world, input, state, ws, report);
    report.times.solve += clock.lap();
    correction::correct(world, input.factor, state, ws, report);
    report.times.correction += clock.lap();
}

/// Explicit substeps, each with its own contact, the tool on its way from its last pose to the new one. The report's
/// force and torque are means over the substeps, its residual and gap the worst, its iterations and times sums; it is
/// solved where all of them are.
fn explicit(
    world: &World,
    input: &StepInput<'_>,
    substeps: u32,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
    clock: &mut Clock,
) {
    let from = state.tool.unwrap_or(input.tool);
    let share = 1.0 / f64::from(substeps);
    let (mut force, mut torque, mut residual, mut sweeps) = (Vector3::zeros(), Vector3::zeros(), 0.0_f64, 0);
    let mut ended = SolveStatus::Solved;
    for k in 1..=substeps {
        free_motion::explicit_motion(world, state, ws, report);
        report.times.free_motion += clock.lap();
        let tool = if k == substeps { input.tool } else { from.towards(&input.tool, f64::from(k) * share) };
        (report.active, report.indentation) = (0, 0.0);
        contact(world, &StepInput { tool, ..*input }, state, ws, report, clock);
        state.tool = Some(tool);
        if report.status == StepStatus::RolledBack {
            return;
        }
        (force, torque) = (force + report.force * share, torque + report.torque * share);
        residual = residual.max(report.solve.residual);
        ended = if report.solve.is_solved() { ended } else { report.solve.status };
        sweeps += report.solve.iterations;
    }
    (report.force, report.torque) = (force, torque);
    (report.solve.status, report.solve.residual, report.solve.iterations) = (ended, residual, sweeps);
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
