//! A guard of the free motion: tissue in trouble moves no farther than its incremental potential falls.
//!
//! One linearisation is right where the tissue is nearly what it was at the begin of the step. Where elements are crushed
//! or inside out it overshoots, and by more in every step. The free motion `d = h v_free` is the first direction of Newton's
//! method on the potential `Φ` of [`palpate_fem::integrator::potential`]; it is halved until `Φ(q + t d) <= Φ(q)`. The
//! terms besides the elastic energy need no product with the matrix, since `A d = h² r`.
//!
//! A shortened motion is not enough: nodes that stay behind an end that moves are what folds and tears a body. In steps that
//! begin folded, or crushed beyond the laws' measured range, or whose motion had to be shortened, the motion is repeated: a
//! few iterations of Newton's method with line search on `Φ`, without stiffness damping and none farther than [`REACH`].
//! Elements that are held open ([`super::held_open`]) are so meanwhile. Linear tissue is repeated only where its
//! factor is cheap enough for it, averaged tissue only where it is held open: as often as not another motion than the first
//! leads it into a fold.
//!
//! The guard looks only at steps that give it a reason; others cost nothing and keep their bits. It does not see contact,
//! which corrects the motion afterwards.

use nalgebra::Vector3;
use palpate_fem::assembly::{FoldReport, incremental_energy};
use palpate_fem::element::ElementKind;
use palpate_fem::integrator::backward_euler::newton_step;
use palpate_fem::integrator::newton::{ImplicitWorkspace, NewtonConfig, NewtonStatus};
use palpate_fem::material::{Law, neo_hookean::EXTENSION_BELOW};

use super::{StepReport, StepState, StepWorkspace};
use crate::world::{Integration, World};

/// Linearisations of quadratic tissue in trouble, and of any that is held open, at most. Most steps need fewer; a step that
/// needs more goes on in the next.
const MANY: u32 = 10;

/// Those of linear tissue in trouble. On a block of 768 elements, beyond all reason, two leave 7 of 90 cases astray, one 10,
/// three or four 9, and none 16.
const FEW: u32 = 2;

/// Residual at which they end, relative to the forces that it balances.
const TOLERANCE: f64 = 1e-3;

/// The same where linear tissue is held open: the barrier's forces are the larger part, and it shall come to rest.
const TOLERANCE_HELD: f64 = 1e-6;

/// Farthest that one of them moves a node, relative to the size of the body. Without it nodes that are inside out in stiff
/// tissue leave the body at the first direction.
const REACH: f64 = 0.1;

/// Volume ratio of an element below which a step is looked at.
const CRUSHED: f64 = 0.5;

/// Motion in one step, relative to the size of the body, above which it is looked at.
const FAR: f64 = 0.05;

/// Motion, relative to the size of the body, beyond which it is not tissue that is in trouble but what loads it: such a
/// step is left to fail, to be rolled back and told.
const HOPELESS: f64 = 1e3;

/// Most halvings: 2^-20 of a motion that crosses the body is far below what a hand feels.
const MOST_CUTS: u32 = 20;

/// Memory to repeat motions, for bodies that may need it: not for linear laws, whose energy has one minimum, and not for
/// linear or averaged elements whose factor is not made [`FEW`] times within a step.
pub(super) fn rescue(world: &World) -> Option<ImplicitWorkspace> {
    let (body, plan) = (&world.description().bodies[0], world.plan());
    let guarded = body.guard && *world.integration() == Integration::BackwardEuler && !plan.constant;
    let quadratic = world.model().element_kind() == ElementKind::Quadratic;
    let affordable = f64::from(FEW) * plan.factorization <= world.dt();
    let size = world.mesh().bounding_box().diagonal();
    let memory = || ImplicitWorkspace::careful(world.model(), world.symbolic(), REACH * size);
    (guarded && (quadratic || affordable)).then(memory)
}

/// How often the motion of tissue in trouble is repeated, at most, and when that is enough.
fn repeats(world: &World, state: &StepState) -> NewtonConfig {
    let (iterations, tolerance) = match world.model().element_kind() {
        ElementKind::Quadratic => (MANY, TOLERANCE),
        // What is repeated knows nothing of the tool, and would lose it what it carries.
        _ if !state.warm_start.is_empty() => (0, TOLERANCE),
        _ if state.stuck > 0 => (MANY, TOLERANCE_HELD),
        ElementKind::Linear if tears(world) => (FEW, TOLERANCE),
        ElementKind::Linear | ElementKind::Averaged => (0, TOLERANCE),
    };
    NewtonConfig { iterations, tolerance }
}

/// Whether some of the tissue has a law that is continued below a volume ratio, whose linearised steps tear it. Crushed
/// bodies of other laws come back without being repeated.
fn tears(world: &World) -> bool {
    let body = &world.description().bodies[0];
    let tissues = std::iter::once(&body.material).chain(body.regions.values());
    tissues.into_iter().any(|tissue| tissue.law.is_continued())
}

/// Shortens `ws.v_free` where the potential would grow, and repeats it where tissue is in trouble; counts both. Returns
/// whether the tissue may have passed through itself meanwhile.
pub(super) fn guard(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) -> bool {
    let h = ws.dt;
    let farthest = ws.v_free.chunks_exact(3).map(|v| h * Vector3::new(v[0], v[1], v[2]).norm()).fold(0.0, f64::max);
    let reason = report.folds.folded > 0
        || report.assembly.inverted > 0
        || report.assembly.min_jacobian < CRUSHED
        || farthest > FAR * ws.size;
    // Linear elasticity, by which tissue is led, does not overshoot.
    if !world.description().bodies[0].guard || !reason || report.led || report.assembly.non_finite.is_some() {
        return false;
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
        ws.carries = false;
        ws.v_free.iter_mut().for_each(|v| *v *= t);
    }
    // Fixed nodes lie where the state has them.
    ws.trial.q.copy_from_slice(&state.fem.q);
    let crushed = report.assembly.min_jacobian < EXTENSION_BELOW;
    let config = repeats(world, state);
    // Written so that NaN is hopeless.
    let hopeful = t * farthest < HOPELESS * ws.size;
    if hopeful && config.iterations > 0 && (report.cuts > 0 || report.folds.folded > 0 || crushed) {
        repeat(world, &config, state, ws, report);
    }
    crushed || farthest > FAR * ws.size || report.cuts > 0 || report.repeated > 0
}

/// The motion by Newton's method from the begin of the step, into `ws.v_free`.
fn repeat(world: &World, config: &NewtonConfig, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let Some(rescue) = &mut ws.rescue else { return };
    ws.trial.v.copy_from_slice(&state.fem.v);
    ws.trial.memory.copy_from_slice(&state.fem.memory);
    let quadratic = world.model().element_kind() == ElementKind::Quadratic;
    if quadratic && report.folds == FoldReport::NONE {
        report.folds = ws.fem.folds.find(world.model(), &state.fem.q);
    }
    rescue.fem.folds.copy_from(&ws.fem.folds);
    let newton = newton_step(world.model(), ws.dt, &[], config, &mut ws.trial, rescue);
    report.repeated = newton.iterations;
    // Where the balance is within tolerance before the first iteration, the first direction still has something to say.
    if newton.status != NewtonStatus::NonFinite && newton.iterations > 0 {
        ws.carries = false;
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
