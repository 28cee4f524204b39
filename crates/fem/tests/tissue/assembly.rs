//! The assembled system: what `A` and `b` are, the same bits for any number of threads, and free bodies in motion.
#![allow(non_snake_case)]

use crate::tissue_setup;
use crate::tissue_setup::{Random, all_materials, block, dense, nodes_where};
use nalgebra::{DMatrix, DVector, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble, assemble_with, elastic_energy, internal_forces},
    material::{Corotational, Law, NeoHookean},
    mesh::TetMesh,
    model::{FemConfig, FemModel, FemState},
    sparse::FIXED,
};

/// A block whose tetrahedra alternate between a soft and a stiff region of different laws.
fn layered() -> (TetMesh, FemConfig) {
    let mut mesh = block([3, 3, 4], [0.06, 0.06, 0.08], 0.15);
    mesh.region_names = vec!["soft".into(), "stiff".into()];
    mesh.regions = (0..mesh.tetrahedra.len()).map(|t| (t % 3 == 0) as u16).collect();
    let config = FemConfig {
        material: NeoHookean { young: 5e3, poisson: 0.45 }.into(),
        region_materials: [("stiff".to_string(), Corotational { young: 5e5, poisson: 0.3 }.into())].into(),
        region_densities: [("stiff".to_string(), 1500.0)].into(),
        density: 1000.0,
        rayleigh_mass: 0.3,
        rayleigh_stiffness: 0.02,
        fixed: nodes_where(&mesh, |x| x.z < 1e-9),
        filter: false,
        ..FemConfig::default()
    };
    (mesh, config)
}

fn random_state(model: &FemModel, size: f64) -> FemState {
    let mut random = Random(21);
    let mut state = model.rest_state();
    for i in 0..model.nodes() {
        let fixed = model.free_of_node()[i] == FIXED;
        state.q[i] += if fixed { Vector3::zeros() } else { random.vector() * size };
        state.v[i] = random.vector();
    }
    state
}

/// Values over the free nodes.
fn free(model: &FemModel, values: &[Vector3<f64>]) -> DVector<f64> {
    DVector::from_iterator(
        3 * model.free_nodes(),
        model.node_of_free().iter().flat_map(|&i| values[i as usize].iter().copied().collect::<Vec<_>>()),
    )
}

#[test]
fn the_system_is_backward_euler_with_rayleigh_damping() {
    let (mesh, config) = layered();
    let model = FemModel::new(&mesh, &config).unwrap();
    let state = random_state(&model, 0.001);
    let mut ws = FemWorkspace::new(&model);
    let mut random = Random(4);
    let f_ext: Vec<_> = (0..model.nodes()).map(|_| random.vector() * 0.1).collect();

    assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
    let K = dense(&ws);
    let f_int = free(&model, &ws.f_int);
    let M =
        DMatrix::from_diagonal(&free(&model, &model.mass().iter().map(|&m| Vector3::repeat(m)).collect::<Vec<_>>()));
    let g = free(&model, &vec![config.gravity; model.nodes()]);
    let f_static = &f_int + &M * &g;
    assert!((DVector::from_column_slice(&ws.rhs) - f_static).amax() < 1e-15);
    let C = &M * config.rayleigh_mass + &K * config.rayleigh_stiffness;
    let (h, v) = (1.0 / 30.0, free(&model, &state.v));
    let A = &M + &C * h + &K * (h * h);
    let b = (free(&model, &f_ext) + &M * &g + &f_int - &C * &v) * h - &K * &v * (h * h);

    assemble(&model, &state, h, &f_ext, &mut ws);
    assert!((dense(&ws) - &A).amax() <= 1e-14 * A.amax());
    assert!((DVector::from_column_slice(&ws.rhs) - &b).amax() <= 1e-14 * b.amax());
    assert_eq!(dense(&ws), dense(&ws).transpose(), "A is symmetric to the bit");
}

#[test]
fn forces_and_stiffness_of_a_body_are_derivatives_of_its_energy() {
    let (mesh, config) = layered();
    let model = FemModel::new(&mesh, &config).unwrap();
    let state = random_state(&model, 0.001);
    let mut ws = FemWorkspace::new(&model);
    assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
    let (K, f_int) = (dense(&ws), ws.f_int.clone());
    let (k_scale, f_scale) = (K.amax(), f_int.iter().map(|f| f.amax()).fold(0.0, f64::max));
    // eps^(1/3) of a cell: see tissue_derivatives.rs.
    let step = 6e-6 * 0.02;
    for free_node in [0, 7, model.free_nodes() - 1] {
        let node = model.node_of_free()[free_node] as usize;
        for c in 0..3 {
            let mut at = |sign: f64| {
                let mut moved = state.clone();
                moved.q[node][c] += sign * step;
                internal_forces(&model, &moved, &mut ws);
                (elastic_energy(&model, &moved), free(&model, &ws.f_int))
            };
            let (ahead, behind) = (at(1.0), at(-1.0));
            let force = -(ahead.0 - behind.0) / (2.0 * step);
            assert!((force - f_int[node][c]).abs() < 1e-7 * f_scale, "{force} {}", f_int[node][c]);
            let column = (behind.1 - ahead.1) / (2.0 * step);
            assert!((column - K.column(3 * free_node + c)).amax() < 1e-7 * k_scale);
        }
    }
}

#[test]
fn assembly_has_the_same_bits_on_one_two_and_four_threads() {
    let (mesh, mut config) = layered();
    for filter in [false, true] {
        config.filter = filter;
        let model = FemModel::new(&mesh, &config).unwrap();
        let state = random_state(&model, 0.01);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut ws = FemWorkspace::new(&model);
                let report = assemble(&model, &state, 0.02, &[], &mut ws);
                let bits = |x: &f64| x.to_bits();
                let blocks: Vec<u64> = ws.system.blocks.iter().flat_map(|b| b.iter().map(bits)).collect();
                let forces: Vec<u64> = ws.f_int.iter().flat_map(|f| f.iter().map(bits)).collect();
                (blocks, ws.rhs.iter().map(bits).collect::<Vec<_>>(), forces, report)
            })
        };
        let one = run(1);
        assert!(!filter || one.3.filtered > 0);
        assert!(one.3.inverted > 0, "the state should hold inverted elements: {:?}", one.3);
        assert_eq!(one, run(2));
        assert_eq!(one, run(4));
        // A workspace made for several threads gives the same on one.
        let pools = [4, 1].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap());
        let mut ws = pools[0].install(|| FemWorkspace::new(&model));
        pools[1].install(|| assemble(&model, &state, 0.02, &[], &mut ws));
        assert_eq!(one.1, ws.rhs.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    }
}

#[test]
fn internal_forces_alone_agree_with_those_of_the_assembly() {
    let (mesh, config) = layered();
    let model = FemModel::new(&mesh, &config).unwrap();
    let state = random_state(&model, 0.004);
    let mut ws = FemWorkspace::new(&model);
    assemble(&model, &state, 0.02, &[], &mut ws);
    let assembled = ws.f_int.clone();
    internal_forces(&model, &state, &mut ws);
    let scale = assembled.iter().map(|f| f.amax()).fold(0.0, f64::max);
    for (a, b) in assembled.iter().zip(&ws.f_int) {
        assert!((a - b).amax() <= 1e-12 * scale);
    }
}

#[test]
fn a_free_body_keeps_its_momentum() {
    // The linear law answers a rotation with a torque.
    for material in all_materials(5e3, 0.45).into_iter().filter(Law::is_frame_indifferent) {
        for filter in [false, true] {
            let mesh = block([2, 2, 2], [0.04; 3], 0.1);
            let config = FemConfig { material, gravity: Vector3::zeros(), filter, ..FemConfig::default() };
            let model = FemModel::new(&mesh, &config).unwrap();
            let mut state = model.rest_state();
            let mut random = Random(2);
            for v in &mut state.v {
                *v = random.vector() * 0.2;
            }
            let mut ws = FemWorkspace::new(&model);
            let momentum =
                |state: &FemState| -> Vector3<f64> { state.v.iter().zip(model.mass()).map(|(v, m)| v * *m).sum() };
            let before = momentum(&state);
            let h = 0.01;
            for _ in 0..20 {
                assemble(&model, &state, h, &[], &mut ws);
                let net: Vector3<f64> = ws.f_int.iter().sum();
                let torque: Vector3<f64> = state.q.iter().zip(&ws.f_int).map(|(q, f)| q.cross(f)).sum();
                // At rest forces are rounding of Young's modulus times the area of a face.
                let scale: f64 = ws.f_int.iter().map(|f| f.norm()).sum::<f64>() + 5e3 * 4e-4;
                // A law that takes a rotation for strain leaves a torque.
                let torque = if material.is_frame_indifferent() { torque.norm() } else { 0.0 };
                assert!(net.norm() <= 1e-14 * scale && torque <= 1e-13 * scale, "{}: {net} {torque}", material.name());
                let step = dense(&ws).lu().solve(&DVector::from_column_slice(&ws.rhs)).unwrap();
                for (k, &i) in model.node_of_free().iter().enumerate() {
                    state.v[i as usize] += Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]);
                    state.q[i as usize] += state.v[i as usize] * h;
                }
            }
            // Columns of K sum to zero, so the step keeps momentum up to the dense solver's rounding.
            let size: f64 = state.v.iter().zip(model.mass()).map(|(v, m)| v.norm() * m).sum();
            assert!((momentum(&state) - before).norm() < 1e-12 * size, "{}", material.name());
        }
    }
}

#[test]
fn fixed_nodes_have_no_row_and_show_their_reaction() {
    let (mesh, mut config) = layered();
    config.fixed.push(config.fixed[0]);
    let model = FemModel::new(&mesh, &config).unwrap();
    assert_eq!(model.free_nodes() + nodes_where(&mesh, |x| x.z < 1e-9).len(), mesh.nodes.len());
    for (k, &i) in model.node_of_free().iter().enumerate() {
        assert_eq!(model.free_of_node()[i as usize], k as u32);
    }
    let mut state = model.rest_state();
    let mut ws = FemWorkspace::new(&model);
    assert!(tissue_setup::equilibrium_dense(&model, &mut state, &mut ws, 1e-12) <= 1e-11);
    let reaction: Vector3<f64> = config.fixed[1..].iter().map(|&i| -ws.f_int[i as usize]).sum();
    let weight: f64 =
        (0..mesh.nodes.len()).filter(|&i| model.free_of_node()[i] != FIXED).map(|i| model.mass()[i]).sum();
    // The fixed nodes carry the weight of the free ones.
    assert!((reaction + config.gravity * weight).norm() < 1e-9 * reaction.norm(), "{reaction}");
}

#[test]
fn mass_is_lumped_by_volume_and_density_or_shared_equally() {
    let (mesh, mut config) = layered();
    let model = FemModel::new(&mesh, &config).unwrap();
    let stiff: f64 = (model.elements().iter().zip(model.mesh_tetrahedron()))
        .filter(|(_, t)| mesh.regions[**t as usize] == 1)
        .map(|(e, _)| e.volume)
        .sum();
    let volume = 0.06 * 0.06 * 0.08;
    let expected = 1000.0 * volume + 500.0 * stiff;
    assert!((model.mass().iter().sum::<f64>() - expected).abs() < 1e-12);
    config.total_mass = Some(0.5);
    let model = FemModel::new(&mesh, &config).unwrap();
    assert!(model.mass().iter().all(|&m| (m - 0.5 / mesh.nodes.len() as f64).abs() < 1e-16));
}

#[test]
fn the_report_names_the_worst_and_the_broken_tetrahedron() {
    let (mesh, config) = layered();
    let model = FemModel::new(&mesh, &config).unwrap();
    let mut ws = FemWorkspace::new(&model);
    let rest = assemble(&model, &model.rest_state(), 0.02, &[], &mut ws);
    assert!((rest.min_jacobian - 1.0).abs() < 1e-12 && rest.inverted == 0 && rest.non_finite.is_none());

    // Push one node through the opposite face of one tetrahedron.
    let mut state = model.rest_state();
    let nodes = mesh.tetrahedra[100];
    let centre: Vector3<f64> = nodes[1..].iter().map(|&i| state.q[i as usize] / 3.0).sum();
    let top = nodes[0] as usize;
    state.q[top] = centre + (centre - state.q[top]) * 3.0;
    let report = assemble(&model, &state, 0.02, &[], &mut ws);
    assert!(report.inverted >= 1 && report.min_jacobian < 0.0);
    let worst = mesh.tetrahedra[report.min_jacobian_tetrahedron as usize];
    assert!(worst.contains(&nodes[0]));

    state.q[top].x = f64::NAN;
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let report = pool.install(|| assemble(&model, &state, 0.02, &[], &mut FemWorkspace::new(&model)));
        assert!(mesh.tetrahedra[report.non_finite.unwrap() as usize].contains(&nodes[0]));
    }
}
