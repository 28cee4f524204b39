//! A guard of the free motion: tissue in trouble moves no farther than its incremental potential falls.
//!
//! One linearisation is right where the tissue is nearly what it was at the begin of the step. Where elements are crushed
//! or inside out it overshoots, and by more in every step. The free motion `d = h v_free` is the first direction of Newton's
//! method on the potential `Φ` of [`palpate_fem::integrator::potential`]; it is halved until `Φ(q + t d) <= Φ(q)`. The
//! terms besides the elastic energy need no product with the matrix, since `A d = h² r`.
//!
//! On quadratic elements a shortened motion is not enough: nodes that stay behind an end that moves are what folds them. In
//! steps that begin folded, or crushed beyond the laws' measured range, or whose motion had to be shortened, the motion is
//! repeated: a few iterations of Newton's method with line search on `Φ`, without stiffness damping and none farther than
//! [`REACH`]. Elements that fold between the points at which their law is evaluated are held open meanwhile
//! ([`Folds`](palpate_fem::assembly::Folds)). Linear and averaged elements keep the first direction.
//!
//! The guard looks only at steps that give it a reason; others cost nothing and keep their bits. It does not see contact,
//! which corrects the motion afterwards.

use nalgebra::Vector3;
use palpate_fem::assembly::{FoldReport, assemble, incremental_energy};
use palpate_fem::element::ElementKind;
use palpate_fem::integrator::backward_euler::newton_step;
use palpate_fem::integrator::newton::{ImplicitWorkspace, NewtonConfig, NewtonStatus};
use palpate_fem::material::neo_hookean::EXTENSION_BELOW;

use super::{StepReport, StepState, StepWorkspace};
use crate::world::{Integration, World};

/// Volume ratio of a quadratic element at its points above which it is not looked at for folds: where it is uneven enough
/// to be folded at a node, it is below this at the point next to it.
const EVEN: f64 = 0.7;

/// Repeated linearisations, at most. Most steps in trouble need fewer; a step that needs more goes on in the next.
const REPEATS: NewtonConfig = NewtonConfig { iterations: 10, tolerance: 1e-3 };

/// Farthest that one of them moves a node, relative to the size of the body. Without it nodes that are inside out in stiff
/// tissue leave the body at the first direction.
const REACH: f64 = 0.1;

/// Volume ratio of an element below which a step is looked at.
const CRUSHED: f64 = 0.5;

/// Motion in one step, relative to the size of the body, above which it is looked at.
const FAR: f64 = 0.05;

/// Most halvings: 2^-20 of a motion that crosses the body is far below what a hand feels.
const MOST_CUTS: u32 = 20;

/// Memory to repeat motions, for bodies that may need it: not for linear laws, whose energy has one minimum.
pub(super) fn rescue(world: &World) -> Option<ImplicitWorkspace> {
    let quadratic = world.model().element_kind() == ElementKind::Quadratic && !world.plan().constant;
    let guarded = world.description().bodies[0].guard && *world.integration() == Integration::BackwardEuler;
    let size = world.mesh().bounding_box().diagonal();
    (quadratic && guarded).then(|| ImplicitWorkspace::careful(world.model(), world.symbolic(), REACH * size))
}

/// Holds quadratic elements open that are folded at the begin of the step, and assembles anew where there are any.
pub(super) fn open_folds(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    // Written so that NaN is even: such a step fails for its own reason.
    let uneven = report.assembly.min_jacobian < EVEN;
    if ws.rescue.is_none() || !uneven {
        return;
    }
    report.folds = ws.fem.folds.find(world.model(), &state.fem.q);
    if report.folds.folded > 0 {
        report.assembly = assemble(world.model(), &state.fem, ws.dt, &[], &mut ws.fem);
    }
}

/// Shortens `ws.v_free` where the potential would grow, and repeats it where quadratic tissue is in trouble; counts both.
pub(super) fn guard(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let h = ws.dt;
    let farthest = ws.v_free.chunks_exact(3).map(|v| h * Vector3::new(v[0], v[1], v[2]).norm()).fold(0.0, f64::max);
    let reason = report.folds.folded > 0
        || report.assembly.inverted > 0
        || report.assembly.min_jacobian < CRUSHED
        || farthest > FAR * ws.size;
    if !world.description().bodies[0].guard || !reason || report.assembly.non_finite.is_some() {
        return;
    }
    let [linear, quadratic] = rest_of_the_potential(world, state, ws);
    let (model, folds) = (world.model(), &ws.fem.folds);
    let before = incremental_energy(model, &state.fem, h) + folds.energy(model, &state.fem.q);
    let mut t = 1.0;
    while report.cuts < MOST_CUTS {
        for (v, &node) in ws.v_free.chunks_exact(3).zip(world.model().node_of_free()) {
            ws.trial.q[node as usize] = state.fem.q[node as usize] + Vector3::new(v[0], v[1], v[2]) * (t * h);
        }
        let after = incremental_energy(model, &ws.trial, h) + folds.energy(model, &ws.trial.q);
        let change = after - before + t * (linear + 0.5 * t * quadratic);
        // A change that is not a number is refused.
        if change <= 0.0 {
            break;
        }
        t *= 0.5;
        report.cuts += 1;
    }
    if t < 1.0 {
        ws.v_free.iter_mut().for_each(|v| *v *= t);
    }
    // Fixed nodes lie where the state has them.
    ws.trial.q.copy_from_slice(&state.fem.q);
    let crushed = report.assembly.min_jacobian < EXTENSION_BELOW;
    if report.cuts > 0 || report.folds.folded > 0 || crushed {
        repeat(world, state, ws, report);
    }
}

/// The motion by Newton's method from the begin of the step, into `ws.v_free`.
fn repeat(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(rescue) = &mut ws.rescue else { return };
    ws.trial.v.copy_from_slice(&state.fem.v);
    ws.trial.memory.copy_from_slice(&state.fem.memory);
    if report.folds == FoldReport::NONE {
        report.folds = ws.fem.folds.find(world.model(), &state.fem.q);
    }
    rescue.fem.folds.copy_from(&ws.fem.folds);
    let newton = newton_step(world.model(), ws.dt, &[], &REPEATS, &mut ws.trial, rescue);
    report.repeated = newton.iterations;
    if newton.status != NewtonStatus::NonFinite {
        for (v, &node) in ws.v_free.chunks_exact_mut(3).zip(world.model().node_of_free()) {
            v.copy_from_slice(ws.trial.v[node as usize].as_slice());
        }
    }
    ws.trial.q.copy_from_slice(&state.fem.q);
}

/// Slope and curvature (J) along `d = h v_free` of everything in the potential but the elastic energy.
fn rest_of_the_potential(world: &World, state: &StepState, ws: &mut StepWorkspace) -> [f64; 2] {
    let (h, model) = (ws.dt, world.model());
    let (alpha, beta) = (model.rayleigh_mass(), model.rayleigh_stiffness());
    let (mut elastic, mut outer, mut inertia) = (0.0, 0.0, 0.0);
    for (v, &node) in ws.v_free.chunks_exact(3).zip(model.node_of_free()) {
        let (d, i) = (Vector3::new(v[0], v[1], v[2]) * h, node as usize);
        elastic += ws.fem.f_int[i].dot(&d);
        outer += (model.gravity() + state.fem.v[i] / h).dot(&d) * model.mass()[i];
        inertia += model.mass()[i] * d.norm_squared();
    }
    ws.trial.q.copy_from_slice(&state.fem.q);
    ws.trial.memory.copy_from_slice(&state.fem.memory);
    // dᵀ A d = h² r·d and A = M (1 + αh) + (h² + βh) K; a K that conjugate gradients see as negative is their tolerance.
    let stiffness = (h * h * (elastic + outer) - (1.0 + alpha * h) * inertia).max(0.0) / (h * (h + beta));
    [-outer, inertia * (1.0 / h + alpha) / h + beta / h * stiffness]
}
