//! The stages of the step, each a few lines between the description, the state and the workspace.

use nalgebra::{DMatrixViewMut, Matrix3, Vector3};
use palpate_collision::contact::Contact;
use palpate_collision::detection::detect_tool;
use palpate_collision::tool::ToolPose;
use palpate_constraints::body::{self, RigidBodies, SoftBody};
use palpate_constraints::compliance::{ComplianceMethod, ComplianceReport, WarpedInverse};
use palpate_constraints::rows::{ContactRows, Counterpart, RowInput, ToolMotion, build_fixed_rows, build_rows};
use palpate_fem::factor::{Factor, FactorStatus};
use palpate_fem::integrator::backward_euler::factor_end;
use palpate_fem::integrator::explicit::explicit_velocity;
use palpate_fem::pcg::{PcgConfig, PcgStatus, pcg};
use palpate_fem::rotation::nodal_rotations;
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::solver::SolverWorkspace;

use super::bodies;
use super::direct::direct_contact;
use super::preconditioner::StepPreconditioner;
use super::workspace::NewtonStage;
use super::{FactorFit, StepInput, StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Integration, World};

/// How far (m) a contact may slide from a remembered force and still start from it: a few tool motions of one step.
const WARM_START_RADIUS: f64 = 5e-3;

/// Factors this step's matrix into the step's own memory.
fn refactor(ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(own) = &mut ws.own else { return };
    ws.own_is_current = own.refactor(&ws.fem.system).status == FactorStatus::Ok;
    report.refused = !ws.own_is_current;
}

/// `A dv = b` by conjugate gradients from zero, preconditioned by the factor warped with the rotations since it was
/// taken, or by the step's own where the plan makes one first; then the free velocity `v + dv`.
pub(super) fn free_motion(
    world: &World,
    factor: &FactorSample,
    state: &StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    let body = &world.description().bodies[0];
    let plan = world.plan();
    ws.own_is_current = false;
    if plan.refactor == Refactor::Step {
        refactor(ws, report);
    }
    // Where every matrix is the first, its factor knows nothing of rotations.
    if !ws.own_is_current && !plan.constant {
        nodal_rotations(world.model(), &factor.q, &state.fem.q, &mut ws.rotations);
    }
    let config = PcgConfig { relative_tolerance: body.tolerance, max_iterations: body.max_iterations };
    ws.v_free.fill(0.0);
    let own = ws.own.as_ref().filter(|_| ws.own_is_current).or(plan.constant.then_some(&factor.factor));
    let mut preconditioner = StepPreconditioner::new(own, factor, &ws.rotations, &mut ws.solve);
    report.free_motion = pcg(&ws.fem.system, &ws.fem.rhs, &mut ws.v_free, &mut preconditioner, config, &mut ws.pcg);
    for (dv, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
        let v = &state.fem.v[node as usize];
        (0..3).for_each(|c| dv[c] += v[c]);
    }
    // A preconditioner that knows nothing of what is held lets it move by the tolerance.
    for (v, _) in ws.v_free.chunks_exact_mut(3).zip(world.model().held()).filter(|(_, held)| **held) {
        v.fill(0.0);
    }
}

/// The free velocity of one explicit substep.
pub(super) fn explicit_motion(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(stage) = &mut ws.explicit else { return };
    let explicit = explicit_velocity(world.model(), ws.dt, &[], &state.fem, &mut stage.ws);
    report.assembly = report.assembly.worst(explicit.assembly);
    ws.v_free.copy_from_slice(stage.ws.velocity());
    if explicit.non_finite.is_some() {
        report.free_motion.status = PcgStatus::NonFinite;
    }
}

/// Contacts of the skin with the tool and of all other pairs of bodies, at the begin of the step.
pub(super) fn detection(
    world: &World,
    tool: &ToolPose,
    state: &mut StepState,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    ws.geometry.refit(&state.fem.q);
    report.detection = detect_tool(
        &ws.geometry,
        &state.fem.q,
        world.tool(),
        tool,
        world.detection(),
        &mut ws.detection,
        &mut state.contacts,
    );
    bodies::detection(world, tool, state, ws, report);
}

/// Rows `H` and `delta_free`, and the law of each contact.
pub(super) fn rows(world: &World, tool: &ToolPose, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let law = world.description().contact.contact_law();
    let motion = state.tool.map_or_else(ToolMotion::none, |before| ToolMotion::of_tool(world.tool(), &before, tool));
    let input = RowInput {
        free_of_node: world.model().free_of_node(),
        v_free: &ws.v_free,
        dt: ws.dt,
        counterpart: Counterpart::Tool { reference: tool.frame.translation.vector, motion },
        friction: law.rows() > 1,
    };
    report.rows = build_rows(&state.contacts.contacts, &input, &mut ws.rows);
    build_fixed_rows(&state.contacts.contacts, &input, &mut ws.fixed_rows);
    report.rows = report.rows.and(bodies::rows(world, tool, &motion, state, ws));
    // As many rows as the capacity was made for: the reset cannot fail, and an empty problem is a safe one if it did.
    if ws.problem.reset(ws.rows.len()).is_err() {
        ws.rows.clear();
        ws.rigid.clear_blocks();
        return;
    }
    bodies::push_laws(world, law, ws);
    ws.problem.delta_free_mut().copy_from_slice(&ws.rows.delta_free);
    choose_laws(world, ws);
}

/// Gives each contact of tool and skin the law that belongs to its free gap.
pub(super) fn choose_laws(world: &World, ws: &mut StepWorkspace) {
    let law = world.description().contact.contact_law();
    for (k, block) in ws.rows.blocks.iter().enumerate().take(ws.rigid.skin_blocks) {
        if let Some(&gap) = ws.rows.delta_free.get(block.first_row as usize) {
            ws.problem.set_law(k, law.at_free_gap(gap));
        }
    }
}

/// `W = h² H A⁻¹ Hᵀ` from the latest factor, warped by the rotations since it was taken, from this step's own, or from the
/// lumped mass of an explicit substep.
///
/// Where this step's matrix cannot be factored, the latest factor serves, and the report says so. Where that cannot give
/// `W` either, the step goes on without contact.
pub(super) fn compliance(
    world: &World,
    factor: &FactorSample,
    exact_steps: u32,
    ws: &mut StepWorkspace,
    report: &mut StepReport,
) {
    if ws.rows.is_empty() {
        return;
    }
    own_factor(world, exact_steps, ws, report);
    if is_of_another_body(ws, report) {
        report.compliance.usable = false;
        return;
    }
    let rows = std::mem::take(&mut ws.rows);
    let mut problem = std::mem::take(&mut ws.problem);
    let method;
    (report.compliance, method) = compliance_of(world, factor, &rows, problem.compliance_mut(), ws);
    report.method = method.unwrap_or(report.method);
    (ws.rows, ws.problem) = (rows, problem);
}

/// Whether the factor at hand is that of the body before an event, and there is no other: it is no inverse then.
pub(super) fn is_of_another_body(ws: &StepWorkspace, report: &StepReport) -> bool {
    report.change.factor == FactorFit::Outdated && !ws.own_is_current
}

/// Factors this step's own matrix where the method wants one that is not there yet.
pub(super) fn own_factor(world: &World, exact_steps: u32, ws: &mut StepWorkspace, report: &mut StepReport) {
    let plan = world.plan();
    let outdated = report.change.factor == FactorFit::Outdated;
    let exact = plan.compliance == ComplianceMethod::Exact && !plan.constant || exact_steps > 0 || outdated;
    // What was refused before the free motion would be refused again.
    if exact && !ws.own_is_current && !report.refused && *world.integration() == Integration::BackwardEuler {
        refactor(ws, report);
    }
    if let Some(newton) = ws.newton.as_mut().filter(|newton| !newton.factored) {
        newton.factored = factor_end(world.model(), ws.dt, &newton.free, &mut newton.ws);
        report.refused = !newton.factored;
    }
}

/// `W = h² H A⁻¹ Hᵀ` of any rows, over all bodies, into `w`, and the method that gave the soft one's; none for the lumped
/// mass.
pub(super) fn compliance_of<'w>(
    world: &World,
    factor: &FactorSample,
    rows: &ContactRows,
    w: impl Into<DMatrixViewMut<'w, f64>>,
    ws: &mut StepWorkspace,
) -> (ComplianceReport, Option<ComplianceMethod>) {
    let correction = &mut ws.correction;
    let mut rigid = RigidBodies { inverse: &ws.rigid.inverse, correction: &mut ws.rigid.correction };
    match &mut ws.explicit {
        Some(explicit) => {
            let inverse = WarpedInverse { inverse: &explicit.inverse, rotations: None };
            let mut soft = SoftBody { inverse, workspace: &mut explicit.compliance, correction };
            (body::assemble(&mut [&mut soft, &mut rigid], rows, ws.dt, w), None)
        }
        None => {
            let own = ws.own.as_ref().filter(|_| ws.own_is_current);
            let (inverse, method) = inverse(world, factor, own, ws.newton.as_ref(), &ws.rotations);
            let mut soft = SoftBody { inverse, workspace: &mut ws.compliance, correction };
            (body::assemble(&mut [&mut soft, &mut rigid], rows, ws.dt, w), Some(method))
        }
    }
}

/// What stands for `A⁻¹` in compliance and correction, and which method that is: this step's own factor where there is a
/// valid one.
pub(super) fn inverse<'a>(
    world: &World,
    latest: &'a FactorSample,
    own: Option<&'a Factor>,
    newton: Option<&'a NewtonStage>,
    rotations: &'a [Matrix3<f64>],
) -> (WarpedInverse<'a, Factor>, ComplianceMethod) {
    let own = match newton {
        Some(newton) => newton.factored.then_some(&newton.ws.factor),
        None if world.plan().constant => Some(&latest.factor),
        None => own,
    };
    match own {
        Some(own) => (WarpedInverse::new(ComplianceMethod::Exact, own, rotations), ComplianceMethod::Exact),
        None => {
            let warped = world.plan().refactor != Refactor::Thread;
            let method = if warped { ComplianceMethod::Warped } else { ComplianceMethod::Asynchronous };
            (WarpedInverse::new(method, &latest.factor, rotations), method)
        }
    }
}

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

/// A solve that did not happen.
pub(super) const NOT_SOLVED: SolveReport = SolveReport {
    status: SolveStatus::NotFinite,
    iterations: 0,
    residual: f64::INFINITY,
    worst_block: 0,
    worst_gap: f64::INFINITY,
};
