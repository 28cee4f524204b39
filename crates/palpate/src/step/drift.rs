//! How the tissue goes on: where it would be a step later if the tool let go of it, for the tick to move it there meanwhile.
//!
//! Let `q`, `v` be the end of the step, `v₋` the velocity at its begin, `f` its forces of contact, `D = αM + βK`. What the
//! elements lack of balance at `q` follows from the step itself, `h (f_ext + f_int) = M (v - v₋) - h f`, so the next free motion
//! needs no assembly, by the matrix at hand:
//! ```text
//! q_free⁺ = q + h v + h A⁻¹ (M (v - v₋) - h f - h² K v)
//! d + e   = q_free⁺ - (q - h² A⁻¹ f) = h A⁻¹ ((M + h D) v + M (v - v₋))                                    m
//!         = r h v + (1 - r) d,     r = β / (β + h),    A = (1 + h α) M + (h β + h²) K
//! d       = h A⁻¹ M ((1 + h α) v + (v - v₋) / (1 - r)),     e = r (h v - d)
//! ```
//! d is even motion, all of it where only mass counts. e is what viscosity lets go on, all of it where mass does not count: with
//! [`creep`](palpate_haptics::tick) from `q` to `(1 + β/h) e` it begins with the velocity `v - d/h`, so that d and e begin with `v`,
//! as the tissue does.
//!
//! Without it a tick that follows a steady hand meets tissue that has to be set in motion anew in every step: it feels
//! `(M/h + D) v` too much at the step's end.
//!
//! Viscosity of a material's own is left out of `D`; rigid bodies that hold the tissue are taken to rest meanwhile.

use nalgebra::Vector3;
use palpate_constraints::rows::ContactRows;
use palpate_fem::factor::SolveStatus;
use palpate_fem::preconditioner::Preconditioner;

use super::preconditioner::StepPreconditioner;
use super::stages::exact_factor;
use super::{StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{Integration, World};

/// The drift d, or d + e of what does not creep, and the way h v of the free nodes (m), three numbers each, by one solve with the factor at hand. `None` where there
/// is no such matrix (explicit substeps) or a number is not finite.
pub(super) fn drift<'w>(
    world: &World,
    latest: &FactorSample,
    state: &StepState,
    creeps: bool,
    ws: &'w mut StepWorkspace,
) -> Option<(&'w [f64], &'w [f64])> {
    let (model, h) = (world.model(), ws.dt);
    if matches!(world.integration(), Integration::Explicit { .. }) {
        return None;
    }
    let own = ws.own.as_ref().filter(|_| ws.own_is_current);
    let exact = exact_factor(world, latest, own, ws.newton.as_ref());
    // The latest factor is not made for Newton's matrices.
    if exact.is_none() && ws.newton.is_some() {
        return None;
    }
    let r = held_back(world, h);
    let even = (1.0 + h * model.rayleigh_mass()) * (1.0 - r);
    let velocities = |node: usize| Some((state.fem.v.get(node)?, state.before.v.get(node)?));
    for (b, &node) in ws.load.chunks_exact_mut(3).zip(model.node_of_free()) {
        let (v, before) = velocities(node as usize)?;
        b.copy_from_slice(((v * even + v - before) * model.mass()[node as usize]).as_slice());
    }
    let mut inverse = StepPreconditioner::new(exact, latest, &ws.rotations, &mut ws.solve);
    if inverse.apply(&ws.load, &mut ws.sample) != SolveStatus::Ok {
        return None;
    }
    let places = ws.sample.chunks_exact_mut(3).zip(ws.load.chunks_exact_mut(3));
    for (((d, way), &node), held) in places.zip(model.node_of_free()).zip(model.held()) {
        let v = state.fem.v.get(node as usize)?;
        way.copy_from_slice((v * h).as_slice());
        let (of_way, of_even) = if creeps { (0.0, 1.0 / (1.0 - r)) } else { (r, 1.0) };
        (0..3).for_each(|c| d[c] = if *held { 0.0 } else { h * (of_way * v[c] + of_even * d[c]) });
        if *held {
            way.fill(0.0);
        }
    }
    ws.sample.iter().chain(&ws.load).all(|d| d.is_finite()).then_some((&ws.sample[..], &ws.load[..]))
}

/// r: the part of a velocity that viscosity alone lets go on until the end of a step of `h` (s).
pub(super) fn held_back(world: &World, h: f64) -> f64 {
    let viscosity = world.model().rayleigh_stiffness();
    viscosity / (viscosity + h)
}

/// The drift of nodes along rows (m), one number a row.
pub(super) fn along(rows: &ContactRows, drift: &[f64], to: &mut Vec<f64>) {
    to.clear();
    let of_node = |node: u32| drift.get(3 * node as usize..3 * node as usize + 3).map(Vector3::from_column_slice);
    let of_row = |r| rows.tissue.row(r).map(|(node, h)| of_node(node).map_or(0.0, |d| h.dot(&d))).sum();
    to.extend((0..rows.len()).map(|r| -> f64 { of_row(r) }));
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Isometry3;

    use super::*;
    use crate::scene::Scene;
    use crate::step::{StepInput, step};

    /// Linear tissue with both kinds of damping: what holds for its matrix holds for the next step's.
    const PRESS: &str = r#"
        name = "press"
        gravity = [0, 0, -9.81]
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [4, 4, 4] }
        material = { law = "linear", young = 5e3, poisson = 0.4 }
        rayleigh_mass = 2.0
        rayleigh_stiffness = 0.005
        tolerance = 1e-12
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.06] }]
    "#;

    #[test]
    fn the_patch_drifts_to_where_the_next_step_finds_its_free_motion() {
        for rate in [10.0, 30.0, 100.0] {
            let text = format!("{PRESS}[rates]\nstep = {rate}\n");
            let world = Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap();
            let mut ws = StepWorkspace::new(&world);
            let factor = FactorSample::first(&world, &world.model().rest_state(), &mut ws).unwrap();
            let mut state = StepState::new(&world, world.model().rest_state());
            let mut snapshot = world.empty_snapshot();
            let (mut forces, mut all) = (0.0, 0.0);
            for k in 0..12 {
                // Nodes that the patch left at the end of the step before, where they go, and how far that is.
                let expected: Vec<(usize, Vector3<f64>, f64)> = {
                    let patch = &snapshot.patch;
                    let nodes = patch.skin().nodes().iter().take(patch.skin().movable()).enumerate();
                    let goes = |(p, &node): (usize, &u32)| {
                        let way = patch.drift()[p] + patch.flow()[p];
                        (node as usize, patch.q_free()[p] + way, way.norm())
                    };
                    nodes.map(goes).collect()
                };
                let begin = state.fem.q.clone();
                let tool = Isometry3::translation(0.02, 0.02, 0.0520 - 3e-4 * f64::from(k)).into();
                let input = StepInput { time: f64::from(k) / rate, tool, factor: &factor };
                let report = step(&world, &input, &mut state, &mut ws, &mut snapshot);
                forces += report.force.norm();
                let farthest = expected.iter().fold(0.0_f64, |most, (.., drift)| most.max(*drift));
                assert!(k == 0 || !expected.is_empty(), "{rate} Hz, step {k}");
                all += farthest;
                for (node, goes, _) in expected {
                    let at = 3 * world.model().free_of_node()[node] as usize;
                    let free = begin[node] + Vector3::from_column_slice(&ws.v_free[at..at + 3]) * ws.dt;
                    // The conjugate gradients stop at 1e-12 of their right side.
                    assert!(
                        (goes - free).norm() < 1e-8 * farthest,
                        "{rate} Hz, step {k}, node {node}: {}",
                        goes - free
                    );
                }
            }
            assert!(forces > 0.1 && all > 1e-4, "{forces} N, {all} m");
        }
    }
}
