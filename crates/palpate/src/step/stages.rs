//! Detection, rows and compliance, each a few lines between the description, the state and the workspace.

use nalgebra::{DMatrixViewMut, Matrix3};
use palpate_collision::detection::detect_tool;
use palpate_collision::tool::ToolPose;
use palpate_constraints::body::{self, RigidBodies, SoftBody};
use palpate_constraints::compliance::{ComplianceMethod, ComplianceReport, WarpedInverse};
use palpate_constraints::precomputed::PrecomputedInverse;
use palpate_constraints::rows::{ContactRows, Counterpart, RowInput, ToolMotion, build_fixed_rows, build_rows};
use palpate_fem::factor::Factor;
use palpate_fem::integrator::backward_euler::factor_end;

use super::bodies;
use super::first_inverse::FirstInverse;
use super::free_motion::refactor;
use super::workspace::NewtonStage;
use super::{FactorFit, StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Integration, Rung, World};

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
    pose_problem(world, ws);
}

/// The contact problem of the rows at hand, without its compliance: the law and the free gap of each.
pub(super) fn pose_problem(world: &World, ws: &mut StepWorkspace) {
    let law = world.description().contact.contact_law();
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
pub(super) fn compliance(world: &World, factor: &FactorSample, ws: &mut StepWorkspace, report: &mut StepReport) {
    if ws.rows.is_empty() {
        return;
    }
    own_factor(world, ws, report);
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
pub(super) fn own_factor(world: &World, ws: &mut StepWorkspace, report: &mut StepReport) {
    let plan = world.plan();
    let exact = plan.compliance == ComplianceMethod::Exact && !plan.constant || report.rung == Some(Rung::Exact);
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
            let (inverse, method) = inverse(world, factor, own, ws.newton.as_ref(), ws.first.as_ref(), &ws.rotations);
            let mut soft = SoftBody { inverse, workspace: &mut ws.compliance, correction };
            (body::assemble(&mut [&mut soft, &mut rigid], rows, ws.dt, w), Some(method))
        }
    }
}

/// The factor of the step's own matrix, where there is one: of Newton's last matrix, the latest of a matrix that never changes,
/// or `own`, which is to be current.
pub(super) fn exact_factor<'a>(
    world: &World,
    latest: &'a FactorSample,
    own: Option<&'a Factor>,
    newton: Option<&'a NewtonStage>,
) -> Option<&'a Factor> {
    match newton {
        Some(newton) => newton.factored.then_some(&newton.ws.factor),
        None if world.plan().constant => Some(&latest.factor),
        None => own,
    }
}

/// What stands for `A⁻¹` in compliance and correction, and which method that is: this step's own factor where there is a
/// valid one, the first inverse where that serves the step, else the latest factor.
pub(super) fn inverse<'a>(
    world: &World,
    latest: &'a FactorSample,
    own: Option<&'a Factor>,
    newton: Option<&'a NewtonStage>,
    first: Option<&'a FirstInverse>,
    rotations: &'a [Matrix3<f64>],
) -> (WarpedInverse<'a, PrecomputedInverse<'a>>, ComplianceMethod) {
    match exact_factor(world, latest, own, newton) {
        Some(own) => (WarpedInverse::new(ComplianceMethod::Exact, own.into(), rotations), ComplianceMethod::Exact),
        None => {
            if let Some(warped) = first.and_then(|first| first.warped(latest, rotations)) {
                return (warped, ComplianceMethod::Warped);
            }
            let warped = world.plan().refactor != Refactor::Thread;
            let method = if warped { ComplianceMethod::Warped } else { ComplianceMethod::Asynchronous };
            (WarpedInverse::new(method, (&latest.factor).into(), rotations), method)
        }
    }
}
