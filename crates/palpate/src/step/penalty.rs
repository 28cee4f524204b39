//! Contact by springs and dampers; see [`palpate_constraints::penalty`]. It allocates nothing.

use palpate_constraints::penalty::PenaltyContact;
use palpate_constraints::penalty::solve::{
    PenaltyLimits, PenaltyProblem, PenaltyStatus, PenaltyWorkspace, penalty_motion,
};
use palpate_constraints::rows::ToolMotion;
use palpate_fem::pcg::PcgConfig;
use palpate_fem::sparse::SystemMatrix;
use palpate_solver::report::{SolveReport, SolveStatus};

use super::direct::{DirectMethod, DirectStage};
use super::forces::NOT_SOLVED;
use super::preconditioner::StepPreconditioner;
use super::{StepInput, StepState, StepWorkspace};
use crate::world::World;

/// Scratch of penalty contact.
pub(super) struct PenaltyStage {
    ws: PenaltyWorkspace,
}

impl PenaltyStage {
    pub(super) fn new(system: &SystemMatrix, contacts: usize) -> Self {
        Self { ws: PenaltyWorkspace::new(system, contacts) }
    }
}

/// Forces into `ws.lambda`, motion into the stage. `Solved` says that the springs balance the body; how far they are from the
/// law of contact is the residual.
pub(super) fn penalty(world: &World, input: &StepInput<'_>, state: &StepState, ws: &mut StepWorkspace) -> SolveReport {
    let (m, description) = (ws.rows.len(), world.description());
    let Some(DirectStage { method: DirectMethod::Penalty(stage), motion, .. }) = &mut ws.direct else {
        return NOT_SOLVED;
    };
    // Gaps of the step's begin are measured with the tool at its end: its way along the normal is taken back.
    let tool =
        state.tool.map_or_else(ToolMotion::none, |before| ToolMotion::of_tool(world.tool(), &before, &input.tool));
    let config = description.contact.penalty.unwrap_or_default();
    stage.ws.contacts.clear();
    for block in &ws.rows.blocks {
        let Some(contact) = state.contacts.contacts.get(block.contact as usize) else { return NOT_SOLVED };
        let lever = contact.tissue_point - input.tool.frame.translation.vector;
        let before = contact.gap + contact.normal.dot(&tool.displacement_at(contact.feature, &lever));
        stage.ws.contacts.push(PenaltyContact::new(
            &config,
            description.contact.friction,
            &ws.fem.system,
            &ws.rows.tissue,
            block.first_row as usize,
            ws.dt,
            before,
        ));
    }
    let problem = PenaltyProblem {
        system: &ws.fem.system,
        rows: &ws.rows.tissue,
        blocks: &ws.rows.blocks,
        delta_free: &ws.rows.delta_free,
        dt: ws.dt,
    };
    let body = &description.bodies[0];
    let linear = PcgConfig { relative_tolerance: body.tolerance, max_iterations: body.max_iterations };
    let limits = PenaltyLimits { tolerance: ws.limits.0, iterations: ws.limits.1, linear };
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let mut preconditioner = StepPreconditioner::new(own, input.factor, &ws.rotations, &mut ws.solve);
    let report = penalty_motion(&problem, &limits, &mut preconditioner, motion, &mut ws.lambda[..m], &mut stage.ws);
    let status = match report.status {
        PenaltyStatus::Converged => SolveStatus::Solved,
        PenaltyStatus::OutOfIterations => SolveStatus::MaxIterations,
        PenaltyStatus::Stalled => SolveStatus::Stalled,
        PenaltyStatus::NonFinite => SolveStatus::NotFinite,
        PenaltyStatus::Invalid => SolveStatus::Invalid,
    };
    SolveReport { status, iterations: report.iterations, ..NOT_SOLVED }
}
