//! What every kind of element owes: exact uniform strain, derivatives of one energy, rigid motion without force, momentum,
//! the same bits on any number of threads.
#![allow(non_snake_case)]

use crate::tissue_setup::{Random, block, dense, equilibrium_dense, laws_for, mesh_for, nodes_where};
use nalgebra::{Matrix3, Rotation3, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble, assemble_with, elastic_energy, internal_forces},
    element::ElementKind,
    material::{Law, Material},
    mesh::TetMesh,
    model::{FemConfig, FemModel, FemState},
    rotation::nodal_rotations,
};

/// Distorted block of 3 x 3 x 3 cells with curved edges where there are mid-nodes.
fn distorted(kind: ElementKind) -> TetMesh {
    let mut mesh = mesh_for(&block([3, 3, 3], [0.06, 0.07, 0.08], 0.2), kind);
    let corners: Vec<bool> = {
        let mut is_corner = vec![false; mesh.nodes.len()];
        mesh.tetrahedra.iter().flatten().for_each(|&i| is_corner[i as usize] = true);
        is_corner
    };
    let mut random = Random(5);
    for (x, corner) in mesh.nodes.iter_mut().zip(corners) {
        let shift = random.vector() * 0.0012;
        if !corner {
            *x += shift;
        }
    }
    mesh
}

fn config(kind: ElementKind, material: Material) -> FemConfig {
    FemConfig { element: kind, material, gravity: Vector3::zeros(), filter: false, ..FemConfig::default() }
}

/// Largest force or entry, for relative errors.
fn largest(values: &[Vector3<f64>]) -> f64 {
    values.iter().map(|f| f.amax()).fold(0.0, f64::max)
}

fn random_state(model: &FemModel, size: f64) -> FemState {
    let mut random = Random(21);
    let mut state = model.rest_state();
    for i in 0..model.nodes() {
        state.q[i] += random.vector() * size;
        state.v[i] = random.vector();
    }
    state
}

#[test]
fn uniform_strain_is_exact_on_a_distorted_mesh() {
    let F = Rotation3::from_euler_angles(0.5, 0.2, -0.9).into_inner()
        * Matrix3::new(1.15, 0.2, -0.05, 0.1, 0.9, 0.15, 0.0, -0.1, 1.05);
    for kind in ElementKind::ALL {
        let mesh = distorted(kind);
        let surface = mesh.surface().nodes;
        assert!(mesh.nodes.len() > surface.len() + 7);
        for material in laws_for(kind, 5e3, 0.4) {
            let model = FemModel::new(&mesh, &FemConfig { fixed: surface.clone(), ..config(kind, material) }).unwrap();
            let mut state = model.rest_state();
            let mut random = Random(9);
            for (i, x) in mesh.nodes.iter().enumerate() {
                state.q[i] = F * x;
                // Inner nodes start beside the answer.
                if !surface.contains(&(i as u32)) {
                    state.q[i] += random.vector() * 0.0008;
                }
            }
            let mut ws = FemWorkspace::new(&model);
            let residual = equilibrium_dense(&model, &mut state, &mut ws, 1e-15);
            assert!(residual < 1e-12, "{} {}: residual {residual:e} N", kind.name(), material.name());
            for (i, x) in mesh.nodes.iter().enumerate() {
                let error = (state.q[i] - F * x).norm() / 0.08;
                assert!(error < 1e-12, "{} {}: node {i} off by {error:e}", kind.name(), material.name());
            }
            // The energy of uniform strain, to rounding.
            let exact = material.energy_density(&F) * model.volume();
            let found = elastic_energy(&model, &state);
            assert!((found - exact).abs() < 1e-12 * exact, "{} {}: {found} {exact}", kind.name(), material.name());
        }
    }
}

#[test]
fn forces_and_tangents_are_derivatives_of_the_energy() {
    for kind in ElementKind::ALL {
        let mesh = distorted(kind);
        for material in laws_for(kind, 5e3, 0.45) {
            let model = FemModel::new(&mesh, &config(kind, material)).unwrap();
            let mut state = random_state(&model, 0.0012);
            let mut ws = FemWorkspace::new(&model);
            assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
            let (K, f_int) = (dense(&ws), ws.f_int.clone());
            let (k_scale, f_scale) = (K.amax(), largest(&f_int));
            assert!((&K - K.transpose()).amax() < 1e-14 * k_scale, "{}: symmetric", kind.name());
            internal_forces(&model, &state, &mut ws);
            let difference: Vec<_> = ws.f_int.iter().zip(&f_int).map(|(a, b)| a - b).collect();
            // Other order of the same sums; cancellation of stiff bulk stresses costs two digits.
            assert!(largest(&difference) < 1e-13 * f_scale, "{}", kind.name());
            // eps^(1/3) of a cell: see tissue_derivatives.rs.
            let step = 6e-6 * 0.02;
            for node in [0, 21, model.nodes() - 1, model.nodes() / 2] {
                for c in 0..3 {
                    let place = state.q[node][c];
                    let mut at = |x: f64| {
                        state.q[node][c] = x;
                        internal_forces(&model, &state, &mut ws);
                        (elastic_energy(&model, &state), ws.f_int.clone())
                    };
                    let (ahead, behind) = (at(place + step), at(place - step));
                    at(place);
                    let force = -(ahead.0 - behind.0) / (2.0 * step);
                    assert!((force - f_int[node][c]).abs() < 1e-7 * f_scale, "{}", kind.name());
                    for j in 0..model.nodes() {
                        let column = (behind.1[j] - ahead.1[j]) / (2.0 * step);
                        for d in 0..3 {
                            let error = (column[d] - K[(3 * j + d, 3 * node + c)]).abs();
                            assert!(error < 1e-7 * k_scale, "{} node {node} {j}: {error:e}", kind.name());
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn rigid_motion_is_free_of_force_and_forces_carry_no_momentum() {
    for kind in ElementKind::ALL {
        let mesh = distorted(kind);
        for material in laws_for(kind, 5e3, 0.45).into_iter().filter(Law::is_frame_indifferent) {
            let model = FemModel::new(&mesh, &config(kind, material)).unwrap();
            let mut ws = FemWorkspace::new(&model);
            let R = Rotation3::from_euler_angles(2.1, -0.7, 1.3).into_inner();
            let mut state = random_state(&model, 0.002);
            internal_forces(&model, &state, &mut ws);
            let scale = largest(&ws.f_int);
            let force: Vector3<f64> = ws.f_int.iter().sum();
            let torque: Vector3<f64> = ws.f_int.iter().zip(&state.q).map(|(f, q)| q.cross(f)).sum();
            // Sums of a few hundred terms, each rounded at its size.
            assert!(force.amax() < 1e-13 * scale, "{}: {force}", kind.name());
            assert!(torque.amax() < 1e-13 * scale * 0.1, "{}: {torque}", kind.name());

            for (q, x) in state.q.iter_mut().zip(&mesh.nodes) {
                *q = R * x + Vector3::new(3.0, -2.0, 1.0);
            }
            internal_forces(&model, &state, &mut ws);
            // Positions of 3 m keep 4e-16 m, strains 2e-14 of a cell.
            assert!(largest(&ws.f_int) < 1e-11 * scale, "{}: {:e}", kind.name(), largest(&ws.f_int) / scale);
            let mut rotations = vec![Matrix3::identity(); model.free_nodes()];
            nodal_rotations(&model, model.q_rest(), &state.q, &mut rotations);
            assert!(rotations.iter().all(|found| (found - R).amax() < 1e-11), "{}", kind.name());
        }
    }
}

#[test]
fn masses_are_positive_and_carry_the_weight_and_its_moment() {
    for kind in ElementKind::ALL {
        let mesh = mesh_for(&block([3, 2, 4], [0.06, 0.05, 0.08], 0.2), kind);
        let model =
            FemModel::new(&mesh, &FemConfig { element: kind, density: 1200.0, ..FemConfig::default() }).unwrap();
        let total: f64 = model.mass().iter().sum();
        let moment: Vector3<f64> = model.mass().iter().zip(&mesh.nodes).map(|(m, x)| x * *m).sum();
        assert!(model.mass().iter().all(|&m| m > 0.0), "{}", kind.name());
        assert!((total - 1200.0 * 2.4e-4).abs() < 1e-14 * 100.0 * total, "{}: {total}", kind.name());
        let centre = Vector3::new(0.03, 0.025, 0.04);
        assert!((moment / total - centre).amax() < 1e-15, "{}: {}", kind.name(), moment / total);
    }
}

#[test]
fn a_free_fall_is_free_of_strain() {
    for kind in ElementKind::ALL {
        let mesh = distorted(kind);
        let model = FemModel::new(&mesh, &FemConfig { element: kind, ..FemConfig::default() }).unwrap();
        let mut ws = FemWorkspace::new(&model);
        assemble(&model, &model.rest_state(), 0.02, &[], &mut ws);
        // A Δv = b has the solution h g at every node.
        let fall: Vec<f64> = (0..3 * model.free_nodes()).map(|k| [0.0, 0.0, -9.81 * 0.02][k % 3]).collect();
        let mut product = vec![0.0; fall.len()];
        ws.system.multiply(&fall, &mut product);
        let scale = ws.system.blocks.iter().map(|b| b.amax()).fold(0.0, f64::max) * 0.2;
        for (a, b) in product.iter().zip(&ws.rhs) {
            assert!((a - b).abs() < 1e-13 * scale, "{}: {a} {b}", kind.name());
        }
    }
}

#[test]
fn assembly_has_the_same_bits_on_one_two_and_four_threads() {
    for kind in ElementKind::ALL {
        let mut mesh = distorted(kind);
        mesh.region_names = vec!["soft".into(), "stiff".into()];
        mesh.regions = (0..mesh.tetrahedra.len()).map(|t| (t % 3 == 0) as u16).collect();
        for filter in [false, true] {
            let [soft, stiff] =
                [5e3, 5e4].map(|young| Material::from_young_poisson("neo_hookean", young, 0.45).unwrap());
            let config = FemConfig {
                region_materials: [("stiff".to_string(), stiff)].into(),
                fixed: nodes_where(&mesh, |x| x.z < 1e-9),
                rayleigh_stiffness: 0.01,
                filter,
                ..config(kind, soft)
            };
            let model = FemModel::new(&mesh, &config).unwrap();
            let state = random_state(&model, 0.006);
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut ws = FemWorkspace::new(&model);
                    let report = assemble(&model, &state, 0.03, &[], &mut ws);
                    (report, ws.system.blocks, ws.rhs, ws.f_int)
                })
            };
            let one = run(1);
            assert!(filter == (one.0.filtered > 0), "{}: the state must need the filter", kind.name());
            for threads in [2, 4] {
                let other = run(threads);
                assert_eq!(one.0, other.0, "{}", kind.name());
                assert!(one.1 == other.1 && one.2 == other.2 && one.3 == other.3, "{} {threads}", kind.name());
            }
        }
    }
}

#[test]
fn the_filter_leaves_a_positive_semidefinite_matrix() {
    for kind in ElementKind::ALL {
        let mesh = mesh_for(&block([1, 1, 2], [0.02, 0.02, 0.04], 0.0), kind);
        for material in laws_for(kind, 5e3, 0.49) {
            let model = FemModel::new(&mesh, &FemConfig { filter: true, ..config(kind, material) }).unwrap();
            let mut ws = FemWorkspace::new(&model);
            for size in [0.001, 0.008] {
                let state = random_state(&model, size);
                assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
                let eigenvalues = dense(&ws).symmetric_eigenvalues();
                let scale = eigenvalues.amax();
                assert!(eigenvalues.min() > -1e-12 * scale, "{} {}", kind.name(), eigenvalues.min() / scale);
            }
        }
    }
}
