//! How far to go along a direction of Newton's method.

use nalgebra::Vector3;

use super::{ImplicitWorkspace, NewtonReport, NewtonStatus};
use crate::{
    integrator::{
        dot,
        potential::{Line, Potential},
    },
    model::{FemModel, FemState},
};

/// Share of the slope by which the potential must fall (Armijo).
const SUFFICIENT: f64 = 1e-4;

/// Largest slope at the trial point, relative to that at the begin, where the energy is too coarse to compare.
const FLAT: f64 = 0.9;

/// Halvings of one direction: 2^-30 of it is below the rounding of positions.
const MOST_CUTS: u32 = 30;

/// Moves `state` along `ws.direction` to where the potential is lower; a status where it is not.
pub(super) fn search(
    potential: &Potential<'_>,
    state: &mut FemState,
    ws: &mut ImplicitWorkspace,
    report: &mut NewtonReport,
) -> Option<NewtonStatus> {
    ws.base.copy_from_slice(&state.q);
    let before = potential.elastic(state, &ws.fem.folds);
    let line = potential.along(ws);
    let noise = 8.0 * f64::EPSILON * before.abs() + ws.energy_rounding(state, potential.scale());
    let farthest = ws.direction.chunks_exact(3).map(|d| Vector3::new(d[0], d[1], d[2]).norm()).fold(0.0, f64::max);
    let mut t = if farthest > ws.reach { ws.reach / farthest } else { 1.0 };
    for cut in 0..=MOST_CUTS {
        step_to(potential.model, t, state, ws);
        if let Some(fall) = accept(potential, &line, [before, noise], t, state, ws) {
            report.cuts += cut;
            report.decrease += fall;
            return None;
        }
        t *= 0.5;
    }
    report.cuts += MOST_CUTS;
    state.q.copy_from_slice(&ws.base);
    Some(NewtonStatus::Stalled)
}

/// `q = base + t d` at the free nodes.
fn step_to(model: &FemModel, t: f64, state: &mut FemState, ws: &ImplicitWorkspace) {
    for (d, &node) in ws.direction.chunks_exact(3).zip(model.node_of_free()) {
        let node = node as usize;
        state.q[node] = ws.base[node] + Vector3::new(d[0], d[1], d[2]) * t;
    }
}

/// The fall of the potential (J) where the trial point is good enough.
fn accept(
    potential: &Potential<'_>,
    line: &Line,
    [before, noise]: [f64; 2],
    t: f64,
    state: &FemState,
    ws: &mut ImplicitWorkspace,
) -> Option<f64> {
    let after = potential.elastic(state, &ws.fem.folds);
    let change = after - before + t * (line.linear + 0.5 * t * line.quadratic);
    if change <= SUFFICIENT * t * line.slope {
        return Some(-change);
    }
    // Not `>`: NaN is refused too.
    let hidden = change <= noise;
    if !hidden {
        return None;
    }
    // The residual at the trial point overwrites the one at the base, which the next cut does not need.
    potential.residual_at(state, ws);
    let slope = -dot(&ws.residual, &ws.direction);
    (slope.abs() <= FLAT * line.slope.abs()).then_some(-change)
}
