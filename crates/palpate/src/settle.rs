//! The state in which a run begins: at rest under gravity.

use palpate_fem::assembly::{FemWorkspace, advance_memory, assemble};
use palpate_fem::factor::{Factor, FactorStatus, SolveWorkspace};
use palpate_fem::model::{FemModel, FemState};

use crate::world::World;

/// Step (s) of the quasi-static iterations: inertia and damping are then below a thousandth of the stiffness of soft
/// tissue, so that each iteration is nearly one of Newton's.
const SETTLE_STEP: f64 = 3.0;

/// Iterations after which the body is taken as it is.
const MOST_ITERATIONS: usize = 100;

/// Largest motion in one iteration, relative to the size of the body: a linearisation says little beyond it.
const LARGEST_MOTION: f64 = 0.05;

/// Iterations end where the largest motion is below this part of the size of the body: well below what a hand feels.
const SETTLED: f64 = 1e-6;

/// The body at rest under its own weight, and whether the iterations converged.
///
/// Without gravity, without fixed nodes (a free body only falls), or where the scene says so, it is the mesh itself.
pub(crate) fn settle(world: &World) -> (FemState, bool) {
    let model = world.model();
    let mut state = model.rest_state();
    let body = &world.description().bodies[0];
    let heavy = world.description().gravity != [0.0; 3];
    if !body.settle || !heavy || model.free_nodes() == world.mesh().nodes.len() {
        return (state, true);
    }
    let size = world.mesh().bounding_box().diagonal();
    let converged = iterate(model, world, &mut state, size);
    (state, converged)
}

fn iterate(model: &FemModel, world: &World, state: &mut FemState, size: f64) -> bool {
    let mut ws = FemWorkspace::new(model);
    let mut factor = Factor::new(std::sync::Arc::clone(world.symbolic()));
    let mut solve = SolveWorkspace::new(world.symbolic());
    let mut dv = vec![0.0; 3 * model.free_nodes()];
    for _ in 0..MOST_ITERATIONS {
        assemble(model, state, SETTLE_STEP, &[], &mut ws);
        dv.copy_from_slice(&ws.rhs);
        if factor.refactor(&ws.system).status != FactorStatus::Ok || !factor.solve(&mut dv, &mut solve).is_ok() {
            return false;
        }
        let largest = SETTLE_STEP * dv.chunks_exact(3).map(|d| d[0].hypot(d[1]).hypot(d[2])).fold(0.0, f64::max);
        if !largest.is_finite() {
            return false;
        }
        let scale = SETTLE_STEP * (LARGEST_MOTION * size / largest.max(f64::MIN_POSITIVE)).min(1.0);
        for (k, &node) in model.node_of_free().iter().enumerate() {
            for c in 0..3 {
                state.q[node as usize][c] += scale * dv[3 * k + c];
            }
        }
        // Viscous tissue ends relaxed.
        advance_memory(model, state, SETTLE_STEP);
        if largest < SETTLED * size {
            advance_memory(model, state, f64::INFINITY);
            return true;
        }
    }
    false
}
