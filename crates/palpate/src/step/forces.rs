//! Contact forces: their solve, and what is remembered and reported of them.

use nalgebra::Vector3;
use palpate_collision::contact::Contact;
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::solver::SolverWorkspace;

use super::bodies;
use super::direct::direct_contact;
use super::{StepInput, StepReport, StepState, StepWorkspace};
use crate::world::World;

/// How far (m) a contact may slide from a remembered force and still start from it: a few tool motions of one step.
const WARM_START_RADIUS: f64 = 5e-3;

/// A solve that did not happen.
pub(super) const NOT_SOLVED: SolveReport = SolveReport {
    status: SolveStatus::NotFinite,
    iterations: 0,
    residual: f64::INFINITY,
    worst_block: 0,
    worst_gap: f64::INFINITY,
};

/// Contact forces by the scene's method: its solver from those of the last step, or a direct approach.
pub(super) fn solve(
    world: &World,
    input: &StepInput<'_>,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let m = ws.rows.len();
    let solved = m > 0 && report.compliance.usable;
    ws.lambda[..m].fill(0.0);
    report.solve = SolveReport { status: SolveStatus::Solved, residual: 0.0, worst_gap: 0.0, ..NOT_SOLVED };
    if solved && ws.direct.is_none() {
        let (contacts, on_skin) = (&state.contacts.contacts, 0..ws.rigid.skin_blocks);
        state.warm_start.fetch(contacts, &ws.rows, on_skin, WARM_START_RADIUS, &mut ws.lambda[..m]);
        bodies::fetch(state, ws, WARM_START_RADIUS);
    }
    if let Some(files) = &mut ws.problem_files {
        files.begin(&ws.lambda[..m]);
    }
    if m > 0 && !solved {
        report.solve = NOT_SOLVED;
    } else if solved && ws.direct.is_some() {
        direct_contact(world, input, state, ws, report);
    } else if solved {
        report.solve = ws.solver.solve(&ws.problem.view(), &mut ws.lambda[..m], &mut ws.solver_workspace);
    }
    if solved {
        let (attempts, solver) = tried(world, ws);
        if attempts >= report.attempts {
            (report.attempts, report.solver) = (attempts, solver);
        }
    }
    report.worst_row = ws.rows.blocks.get(report.solve.worst_block as usize).map(|block| block.first_row);
    if let Some(files) = ws.problem_files.as_mut().filter(|_| solved) {
        files.save(report.step, &ws.problem, &ws.lambda[..m]);
    }
    take_forces(world, state, ws, report);
}

/// Remembers the forces for the next step, and reports their sum.
pub(super) fn take_forces(world: &World, state: &mut StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    bodies::store(state, ws, report);
    let lambda = &ws.lambda[..ws.rows.len()];
    state.warm_start.store(&state.contacts.contacts, &ws.rows, 0..ws.rigid.skin_blocks, lambda);

    if world.description().contact.hold {
        let pushes = |first_row: u32| lambda.get(first_row as usize).is_some_and(|&force| force > 0.0);
        let loaded = ws.rows.blocks.iter().take(ws.rigid.skin_blocks).filter(|block| pushes(block.first_row));
        state.contacts.hold(loaded.map(|block| block.contact as usize));
    }

    (report.active, report.indentation) = (0, 0.0);
    let wrench = ws.rows.wrench(lambda);
    (report.force, report.torque) = (wrench.force, wrench.torque);
    let mut friction = Vector3::zeros();
    for (block, frame) in ws.rows.blocks.iter().zip(&ws.rows.frames).take(ws.rigid.skin_blocks) {
        let Some(force) = lambda.get(block.range()) else { continue };
        if force[0] <= 0.0 {
            continue;
        }
        report.active += 1;
        let Some(contact) = state.contacts.contacts.get(block.contact as usize) else { continue };
        friction += frame.to_world(force) - contact.normal * force[0];
        let push = contact.tissue_point - weighted(contact, &state.rest);
        report.indentation = report.indentation.max(push.dot(&contact.normal));
    }
    report.tangential_force = friction.norm();
}

/// How many solvers the last solve tried, and whose forces were taken.
fn tried(world: &World, ws: &StepWorkspace) -> (u32, &'static str) {
    if ws.direct.is_some() {
        return (1, world.description().contact.method.name());
    }
    let SolverWorkspace::Automatic(automatic) = &ws.solver_workspace else { return (1, ws.solver.name()) };
    let attempts = automatic.attempts();
    // The first of equals, as the automatic choice itself takes it.
    let best = attempts.iter().reduce(|best, a| if a.report.residual < best.report.residual { a } else { best });
    (attempts.len() as u32, best.map_or(ws.solver.name(), |best| best.solver))
}

/// The contact's tissue point in another configuration of the body.
fn weighted(contact: &Contact, q: &[Vector3<f64>]) -> Vector3<f64> {
    contact.nodes.iter().zip(&contact.weights).filter_map(|(&n, w)| Some(q.get(n as usize)? * *w)).sum()
}
