//! Forces and energy without the tangent: as the assembly has them, on any number of threads.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};
use palpate_fem::{
    assembly::{FemWorkspace, assemble, incremental_energy, internal_forces},
    block::{block, evenly},
    element::ElementKind,
    material::{Law, Material, PronyTerm},
    mesh::TetMesh,
    model::{FemConfig, FemModel, FemState},
};
use rayon::ThreadPoolBuilder;

const STEP: f64 = 0.02;

/// 1296 elements: more than one task has, for every kind.
fn mesh(kind: ElementKind) -> TetMesh {
    let mesh = block(&evenly(0.0, 0.06, 6), &evenly(0.0, 0.06, 6), &evenly(0.0, 0.06, 6));
    if kind == ElementKind::Quadratic { mesh.promoted() } else { mesh }
}

/// A body of one law, elastic or viscous, or none where the kind of element has no such body.
fn model(kind: ElementKind, law: &str, viscous: bool) -> Option<FemModel> {
    let mesh = mesh(kind);
    let material = Material::from_young_poisson(law, 5e3, 0.45)?;
    let unfit = kind == ElementKind::Averaged && material.without_bulk().is_none();
    if unfit || viscous && !material.is_frame_indifferent() {
        return None;
    }
    let viscosity = if viscous { vec![PronyTerm { modulus: 0.3, time: 0.1 }] } else { Vec::new() };
    let fixed = mesh.node_sets["z_min"].clone();
    let config = FemConfig { element: kind, material, viscosity, fixed, filter: false, ..FemConfig::default() };
    Some(FemModel::new(&mesh, &config).unwrap())
}

/// Sheared, bent and squeezed, with a memory of its own.
fn deformed(model: &FemModel) -> FemState {
    let mut state = model.rest_state();
    for q in &mut state.q {
        let x = *q;
        *q += Vector3::new(0.3 * x.y + 2.0 * x.z * x.z, -0.1 * x.y, -1.5 * x.x * x.z - 0.1 * x.z);
    }
    for (k, memory) in state.memory.iter_mut().enumerate() {
        memory.iter_mut().enumerate().for_each(|(c, m)| *m = ((7 * k + c) % 11) as f64 - 5.0);
    }
    state
}

fn each(mut check: impl FnMut(&str, ElementKind, &FemModel)) {
    for kind in [ElementKind::Linear, ElementKind::Averaged, ElementKind::Quadratic] {
        for law in Material::NAMES {
            for viscous in [false, true] {
                if let Some(model) = model(kind, law, viscous) {
                    check(&format!("{law}, {kind:?}, viscous: {viscous}"), kind, &model);
                }
            }
        }
    }
}

#[test]
fn forces_alone_are_those_of_the_assembly_and_so_is_what_they_report() {
    each(|case, _, model| {
        let state = deformed(model);
        let mut ws = FemWorkspace::new(model);
        let whole = assemble(model, &state, STEP, &[], &mut ws);
        let expected = ws.f_int.clone();
        ws.dt = STEP;
        let alone = internal_forces(model, &state, &mut ws);
        let largest = expected.iter().map(Vector3::norm).fold(0.0, f64::max);
        let off = expected.iter().zip(&ws.f_int).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        // Rounding of the stresses of some twenty elements around a node, which cancel in part.
        assert!(off <= 1e-12 * largest, "{case}: {off} of {largest} N");
        assert_eq!((alone.inverted, alone.filtered, alone.non_finite), (whole.inverted, 0, None), "{case}");
        assert!((alone.min_jacobian / whole.min_jacobian - 1.0).abs() < 1e-13, "{case}");
        assert_eq!(alone.min_jacobian_tetrahedron, whole.min_jacobian_tetrahedron, "{case}");
    });
}

#[test]
fn the_energy_is_the_sum_over_the_elements() {
    // Uniform strain, so that the energy is the density at one F times the volume, whatever the kind.
    let F = Matrix3::new(1.1, 0.2, 0.0, 0.1, 0.9, 0.1, 0.0, -0.1, 1.05);
    each(|case, _, model| {
        let law = Material::NAMES.iter().find(|name| case.starts_with(*name) && case[name.len()..].starts_with(','));
        let material = Material::from_young_poisson(law.unwrap(), 5e3, 0.45).unwrap();
        let mut state = model.rest_state();
        state.q.iter_mut().for_each(|q| *q = F * *q);
        let expected = material.energy_density(&F) * model.volume();
        let energy = palpate_fem::assembly::elastic_energy(model, &state);
        assert!((energy / expected - 1.0).abs() < 1e-11, "{case}: {energy} instead of {expected} J");
    });
}

#[test]
fn forces_and_energy_have_the_same_bits_for_any_number_of_threads() {
    each(|case, _, model| {
        let state = deformed(model);
        let run = |threads: usize| {
            ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut ws = FemWorkspace::new(model);
                ws.dt = STEP;
                let report = internal_forces(model, &state, &mut ws);
                (ws.f_int, report, incremental_energy(model, &state, STEP).to_bits())
            })
        };
        let one = run(1);
        assert!(one.0.iter().any(|f| f.norm() > 0.0));
        for threads in [2, 4] {
            assert!(run(threads) == one, "{case}: {threads} threads");
        }
    });
}

#[test]
fn forces_alone_name_the_element_that_is_not_finite_and_count_the_inverted() {
    each(|case, kind, model| {
        let mut ws = FemWorkspace::new(model);
        let mut state = model.rest_state();
        state.q.iter_mut().for_each(|q| q.z = -q.z);
        let report = internal_forces(model, &state, &mut ws);
        assert_eq!((report.inverted, report.non_finite), (1296, None), "{case}");
        let mut state = model.rest_state();
        let node = model.node_of_free()[100];
        state.q[node as usize].y = f64::NAN;
        let report = internal_forces(model, &state, &mut ws);
        let named = report.non_finite.expect("named") as usize;
        let mesh = mesh(kind);
        let holds =
            mesh.tetrahedra[named].contains(&node) || mesh.mid_nodes.get(named).is_some_and(|m| m.contains(&node));
        // The groups of averaged elements carry it to their neighbours.
        assert!(holds || kind == ElementKind::Averaged, "{case}: tetrahedron {named}, node {node}");
    });
}

#[test]
fn elements_of_groups_that_the_filter_drops_count_as_filtered() {
    let mesh = mesh(ElementKind::Averaged);
    let material = Material::from_young_poisson("mooney_rivlin", 5e3, 0.45).unwrap();
    let fixed = mesh.node_sets["z_min"].clone();
    let config = FemConfig { element: ElementKind::Averaged, material, fixed, ..FemConfig::default() };
    let model = FemModel::new(&mesh, &config).unwrap();
    let mut state = model.rest_state();
    let mut ws = FemWorkspace::new(&model);
    // Beyond J = e the logarithmic bulk term k/2 ln²J is concave: a uniform stretch by 1.5 has J = 3.4.
    state.q.iter_mut().for_each(|q| *q *= 1.5);
    assert_eq!(assemble(&model, &state, STEP, &[], &mut ws).filtered, 1296);
    ws.filter = false;
    assert_eq!(assemble(&model, &state, STEP, &[], &mut ws).filtered, 0);
}
