//! A guard of the free motion: tissue in trouble moves no farther than its incremental potential falls.
//!
//! One linearisation is right where the tissue is nearly what it was at the begin of the step. Where elements are crushed
//! or inside out it overshoots, and by more in every step. The free motion `d = h v_free` is the first direction of Newton's
//! method on the potential `Φ` of [`palpate_fem::integrator::potential`]; it is halved until `Φ(q + t d) <= Φ(q)`. The
//! terms besides the elastic energy need no product with the matrix, since `A d = h² r`.
//!
//! The guard looks only at steps that give it a reason; others cost nothing and keep their bits. It does not see contact,
//! which corrects the motion afterwards.

use nalgebra::Vector3;
use palpate_fem::assembly::incremental_energy;

use super::{StepReport, StepState, StepWorkspace};
use crate::world::World;

/// Volume ratio of an element below which a step is looked at.
const CRUSHED: f64 = 0.5;

/// Motion in one step, relative to the size of the body, above which it is looked at.
const FAR: f64 = 0.05;

/// Most halvings: 2^-20 of a motion that crosses the body is far below what a hand feels.
const MOST_CUTS: u32 = 20;

/// Shortens `ws.v_free` where the potential would grow; counts the halvings in the report.
pub(super) fn guard(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &mut StepReport) {
    let h = ws.dt;
    let farthest = ws.v_free.chunks_exact(3).map(|v| h * Vector3::new(v[0], v[1], v[2]).norm()).fold(0.0, f64::max);
    let reason = report.assembly.inverted > 0 || report.assembly.min_jacobian < CRUSHED || farthest > FAR * ws.size;
    if !world.description().bodies[0].guard || !reason || report.assembly.non_finite.is_some() {
        return;
    }
    let [linear, quadratic] = rest_of_the_potential(world, state, ws);
    let before = incremental_energy(world.model(), &state.fem, h);
    let mut t = 1.0;
    while report.cuts < MOST_CUTS {
        for (v, &node) in ws.v_free.chunks_exact(3).zip(world.model().node_of_free()) {
            ws.trial.q[node as usize] = state.fem.q[node as usize] + Vector3::new(v[0], v[1], v[2]) * (t * h);
        }
        let change = incremental_energy(world.model(), &ws.trial, h) - before + t * (linear + 0.5 * t * quadratic);
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
