//! The barrier that holds elements open: its force and tangent are derivatives of its energy, for every kind of element;
//! elements that are open keep their bits.

#![allow(non_snake_case)]

use crate::tissue_setup::block;
use nalgebra::Vector3;
use palpate_fem::assembly::{Coefficients, FemWorkspace, OPEN_BELOW, assemble_with, internal_forces};
use palpate_fem::element::ElementKind;
use palpate_fem::material::Material;
use palpate_fem::model::{FemConfig, FemModel, FemState};

/// A body with its layers exchanged, so that many of its elements are inside out.
fn folded(kind: ElementKind) -> (FemModel, FemState) {
    let mesh = block([2, 2, 2], [0.04, 0.04, 0.04], 0.2);
    let mesh = if kind == ElementKind::Quadratic { mesh.promoted() } else { mesh };
    let config = FemConfig {
        material: Material::from_young_poisson("stable_neo_hookean", 5e3, 0.4).unwrap(),
        element: kind,
        density: 1000.0,
        fixed: (0..mesh.nodes.len() as u32).filter(|&i| mesh.nodes[i as usize].z == 0.0).collect(),
        filter: false,
        ..FemConfig::default()
    };
    let model = FemModel::new(&mesh, &config).unwrap();
    let mut state = model.rest_state();
    for (i, q) in state.q.iter_mut().enumerate() {
        // Uneven, so that no two elements are alike: up to a quarter of a cell.
        let shake = |k: usize| 0.005 * (1.7 * (i * 3 + k) as f64).sin();
        *q = Vector3::new(q.x + shake(0), q.y + shake(1), 0.02 + 0.3 * (q.z - 0.02) + shake(2));
    }
    (model, state)
}

/// Energy of the barrier alone (J), as its own forces see it.
fn energy(model: &FemModel, ws: &FemWorkspace, q: &[Vector3<f64>]) -> f64 {
    ws.folds.energy(model, q)
}

/// Force of the barrier (N): with it less without it.
fn force(model: &FemModel, state: &FemState, ws: &mut FemWorkspace, without: &mut FemWorkspace) -> Vec<Vector3<f64>> {
    internal_forces(model, state, ws);
    internal_forces(model, state, without);
    ws.f_int.iter().zip(&without.f_int).map(|(a, b)| a - b).collect()
}

#[test]
fn force_and_tangent_are_derivatives_of_the_energy_on_every_element() {
    for kind in ElementKind::ALL {
        let (model, mut state) = folded(kind);
        let (mut ws, mut without) = (FemWorkspace::new(&model), FemWorkspace::new(&model));
        let report = ws.folds.find(&model, &state.q);
        assert!(report.folded > 3 && report.min_jacobian < 0.0, "{kind:?}: {report:?}");
        ws.folds.stiffen(50.0);
        let f = force(&model, &state, &mut ws, &mut without);
        let total: Vector3<f64> = f.iter().sum();
        let largest = f.iter().map(Vector3::norm).fold(0.0, f64::max);
        assert!(largest > 0.0 && total.norm() < 1e-12 * largest * f.len() as f64, "{kind:?}: {total:?} of {largest}");
        let coefficients = Coefficients { mass: 0.0, stiffness: 1.0 };
        assemble_with(&model, &state, coefficients, &[], &mut ws);
        assemble_with(&model, &state, coefficients, &[], &mut without);
        // Central differences: error of step squared, 1e-6 relative, above the rounding of the sums.
        let step = 1e-7;
        let stiffest = ws.system.blocks.iter().map(|b| b.amax()).fold(0.0, f64::max);
        for (k, &node) in model.node_of_free().iter().enumerate().step_by(5) {
            let node = node as usize;
            for c in 0..3 {
                let at = state.q[node][c];
                state.q[node][c] = at + step;
                let (above, force_above) =
                    (energy(&model, &ws, &state.q), force(&model, &state, &mut ws, &mut without));
                state.q[node][c] = at - step;
                let (below, force_below) =
                    (energy(&model, &ws, &state.q), force(&model, &state, &mut ws, &mut without));
                state.q[node][c] = at;
                let slope = (below - above) / (2.0 * step);
                assert!((slope - f[node][c]).abs() < 1e-5 * largest, "{kind:?}, node {node}: {slope} {}", f[node][c]);
                for (j, &other) in model.node_of_free().iter().enumerate() {
                    let other = other as usize;
                    let Some(p) = model.pattern().find(j as u32, k as u32) else { continue };
                    let K = ws.system.blocks[p] - without.system.blocks[p];
                    let column = (force_below[other] - force_above[other]) / (2.0 * step);
                    assert!((column - K.column(c)).norm() < 1e-5 * stiffest, "{kind:?}: {column:?} {:?}", K.column(c));
                }
            }
        }
    }
}

#[test]
fn elements_that_are_open_keep_their_bits() {
    for kind in ElementKind::ALL {
        let (model, mut state) = folded(kind);
        // Nowhere as flat as the barrier, in places flat enough to be watched.
        for (q, rest) in state.q.iter_mut().zip(model.q_rest()) {
            *q = Vector3::new(rest.x, rest.y + 0.1 * rest.x, 0.4 * rest.z);
        }
        let (mut ws, mut without) = (FemWorkspace::new(&model), FemWorkspace::new(&model));
        let report = ws.folds.find(&model, &state.q);
        assert!(report.folded == 0 && report.min_jacobian < 0.5 && report.min_jacobian > OPEN_BELOW, "{report:?}");
        ws.folds.stiffen(1e4);
        assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
        assemble_with(&model, &state, Coefficients::STATIC, &[], &mut without);
        assert!(ws.f_int == without.f_int && ws.system.blocks == without.system.blocks, "{kind:?}");
        assert!(energy(&model, &ws, &state.q) == 0.0);
    }
}
