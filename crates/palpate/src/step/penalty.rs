//! Contact by springs and dampers; see [`palpate_constraints::penalty`]. It allocates nothing.

use palpate_constraints::law::Law;
use palpate_constraints::penalty::PenaltyContact;
use palpate_constraints::penalty::solve::{
    PenaltyLimits, PenaltyProblem, PenaltyStatus, PenaltyWorkspace, penalty_motion,
};
use palpate_constraints::rows::{RowBlock, ToolMotion};
use palpate_fem::pcg::PcgConfig;
use palpate_fem::sparse::SystemMatrix;
use palpate_solver::report::{SolveReport, SolveStatus};

use super::coupled_system::CoupledPreconditioner;
use super::direct::{DirectMethod, DirectStage, system_and_rows};
use super::forces::NOT_SOLVED;
use super::preconditioner::StepPreconditioner;
use super::rigid::RigidStage;
use super::{StepInput, StepState, StepWorkspace};
use crate::world::{Far, World};

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
    let Some(DirectStage { method: DirectMethod::Penalty(stage), coupled, motion, .. }) = &mut ws.direct else {
        return NOT_SOLVED;
    };
    let (system, rows) = system_and_rows(coupled.as_ref(), &ws.fem.system, &ws.rows);
    let tool =
        state.tool.map_or_else(ToolMotion::none, |before| ToolMotion::of_tool(world.tool(), &before, &input.tool));
    let config = description.contact.penalty.unwrap_or_default();
    stage.ws.contacts.clear();
    for (k, (block, posed)) in ws.rows.blocks.iter().zip(ws.problem.blocks()).enumerate() {
        let Some(before) = gap_before(world, input, &tool, state, (k, block), &ws.rigid) else { return NOT_SOLVED };
        let friction = match posed.law {
            Law::Coulomb(law) => law.friction,
            _ => 0.0,
        };
        stage.ws.contacts.push(PenaltyContact::new(
            &config,
            friction,
            system,
            rows,
            block.first_row as usize,
            ws.dt,
            before,
        ));
    }
    let problem = PenaltyProblem { system, rows, blocks: &ws.rows.blocks, delta_free: &ws.rows.delta_free, dt: ws.dt };
    let body = &description.bodies[0];
    let linear = PcgConfig { relative_tolerance: body.tolerance, max_iterations: body.max_iterations };
    let limits = PenaltyLimits { tolerance: ws.limits.0, iterations: ws.limits.1, linear };
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let tissue = StepPreconditioner::new(own, input.factor, &ws.rotations, &mut ws.solve);
    let mut preconditioner = CoupledPreconditioner { tissue, rigid: &ws.rigid.inverse };
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

/// Gap (m) of a block when the step began, both sides where they were then: gaps are measured with the tool at the end of its
/// way, which is taken back along the normal.
fn gap_before(
    world: &World,
    input: &StepInput<'_>,
    tool: &ToolMotion,
    state: &StepState,
    (number, block): (usize, &RowBlock),
    rigid: &RigidStage,
) -> Option<f64> {
    let reference = input.tool.frame.translation.vector;
    if number < rigid.skin_blocks {
        let contact = state.contacts.contacts.get(block.contact as usize)?;
        let way = tool.displacement_at(contact.feature, &(contact.tissue_point - reference));
        return Some(contact.gap + contact.normal.dot(&way));
    }
    let pair = rigid.blocks.iter().position(|blocks| blocks.contains(&number))?;
    let place = state.pairs.get(pair)?.contact(block.contact as usize)?;
    let pair = world.bodies().pairs.get(pair)?;
    let Far::Tool(part) = pair.far else { return Some(place.gap) };
    let part = tool.of(world.tool().parts().get(part).and_then(|part| part.jaw));
    let way = part.displacement_at(place.feature, &(place.point - reference));
    Some(place.gap + place.normal.dot(&way))
}
