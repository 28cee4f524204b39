//! The patch test: a distorted mesh whose surface moves affinely answers with that uniform strain, exactly.
#![allow(non_snake_case)]

use crate::tissue_setup;
use crate::tissue_setup::{all_materials, block, equilibrium_dense, nodes_where};
use nalgebra::{Matrix3, Rotation3};
use palpate_fem::{
    assembly::FemWorkspace,
    material::Law,
    model::{FemConfig, FemModel},
};

#[test]
fn uniform_strain_is_exact_on_a_distorted_mesh() {
    let size = [0.08, 0.1, 0.12];
    let mesh = block([4, 4, 4], size, 0.2);
    let surface = nodes_where(&mesh, |x| (0..3).any(|c| x[c] < 1e-9 || x[c] > size[c] - 1e-9));
    assert_eq!(mesh.nodes.len() - surface.len(), 27);
    let mut F = Matrix3::new(1.15, 0.2, -0.05, 0.1, 0.9, 0.15, 0.0, -0.1, 1.05);
    F = Rotation3::from_euler_angles(0.5, 0.2, -0.9).into_inner() * F;
    for material in all_materials(5e3, 0.4) {
        let config = FemConfig {
            material,
            gravity: nalgebra::Vector3::zeros(),
            fixed: surface.clone(),
            filter: false,
            ..FemConfig::default()
        };
        let model = FemModel::new(&mesh, &config).unwrap();
        let mut state = model.rest_state();
        // Inner nodes start beside the answer, by a third of a cell.
        let mut random = tissue_setup::Random(9);
        for (i, x) in mesh.nodes.iter().enumerate() {
            state.q[i] = F * x;
            if !surface.contains(&(i as u32)) {
                state.q[i] += random.vector() * 0.002;
            }
        }
        let mut ws = FemWorkspace::new(&model);
        // Stress times the area around a node is about 1 N: rounding leaves 1e-15 of it.
        let residual = equilibrium_dense(&model, &mut state, &mut ws, 1e-15);
        assert!(residual < 1e-12, "{}: residual {residual:e} N", material.name());
        for (i, x) in mesh.nodes.iter().enumerate() {
            let error = (state.q[i] - F * x).norm() / size[0];
            assert!(error < 1e-12, "{}: node {i} off by {error:e} of the size", material.name());
        }
        // Uniform strain, uniform stress in every element.
        let P = material.first_piola(&F);
        for element in model.elements() {
            let found = material.first_piola(&element.deformation_gradient(&state.q));
            assert!((found - P).amax() < 1e-11 * P.amax(), "{}", material.name());
        }
    }
}
