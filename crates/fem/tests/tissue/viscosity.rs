//! Prony viscosity against theory: relaxation, creep, storage and loss, rigid motion, dissipation, and what a state holds.
#![allow(non_snake_case)]

use crate::tissue_setup::{Random, all_materials, block, dense, laws_for, mesh_for};
use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use palpate_fem::{
    assembly::{Coefficients, elastic_energy},
    assembly::{FemWorkspace, advance_memory, assemble, assemble_with, incremental_energy, internal_forces},
    element::{ElementKind, quadratic::POINTS},
    material::{Law, Material, MaterialError, PronyTerm},
    mesh::TetMesh,
    model::{FemConfig, FemError, FemModel, FemState},
};

/// The liver's series [Marchesseau 2010].
const LIVER: [PronyTerm; 2] = [PronyTerm { modulus: 0.235, time: 0.27 }, PronyTerm { modulus: 0.333, time: 0.03 }];

const YOUNG: f64 = 5e3;
const POISSON: f64 = 0.4;

fn mesh() -> TetMesh {
    block([1, 1, 1], [0.1; 3], 0.0)
}

fn model_of(material: Material, viscosity: &[PronyTerm], filter: bool) -> FemModel {
    model_by(ElementKind::Linear, material, viscosity, filter)
}

fn model_by(element: ElementKind, material: Material, viscosity: &[PronyTerm], filter: bool) -> FemModel {
    let config = FemConfig {
        element,
        material,
        viscosity: viscosity.to_vec(),
        gravity: Vector3::zeros(),
        filter,
        ..FemConfig::default()
    };
    FemModel::new(&mesh_for(&mesh(), element), &config).unwrap()
}

/// Every kind of element with every law that it takes and that takes viscosity.
fn viscous_kinds() -> impl Iterator<Item = (ElementKind, Material)> {
    let laws = |kind| laws_for(kind, YOUNG, POISSON).into_iter().filter(Law::is_frame_indifferent);
    ElementKind::ALL.into_iter().flat_map(move |kind| laws(kind).map(move |law| (kind, law)))
}

fn viscous_laws() -> impl Iterator<Item = Material> {
    all_materials(YOUNG, POISSON).into_iter().filter(Law::is_frame_indifferent)
}

fn deform(model: &FemModel, F: &Matrix3<f64>, state: &mut FemState) {
    for (q, x) in state.q.iter_mut().zip(model.q_rest()) {
        *q = F * x;
    }
}

/// First Piola stress of a block in homogeneous deformation (Pa), from the virial of its nodal forces, at the end of a step.
fn stress(model: &FemModel, state: &FemState, dt: f64, ws: &mut FemWorkspace) -> Matrix3<f64> {
    ws.dt = dt;
    internal_forces(model, state, ws);
    let virial: Matrix3<f64> = ws.f_int.iter().zip(model.q_rest()).map(|(f, x)| -f * x.transpose()).sum();
    virial / 1e-3
}

/// `F` of simple shear.
fn sheared(g: f64) -> Matrix3<f64> {
    let mut F = Matrix3::identity();
    F[(0, 1)] = g;
    F
}

/// Shear stress after steps `dt` up to `time`, held at a shear from time 0 on.
fn relaxed_stress(model: &FemModel, g: f64, time: f64, steps: usize) -> f64 {
    let mut state = model.rest_state();
    let mut ws = FemWorkspace::new(model);
    deform(model, &sheared(g), &mut state);
    let dt = time / steps as f64;
    let mut answer = 0.0;
    for _ in 0..steps {
        answer = stress(model, &state, dt, &mut ws)[(0, 1)];
        advance_memory(model, &mut state, dt);
    }
    answer
}

#[test]
fn a_held_block_relaxes_along_the_prony_series_at_first_order() {
    for material in viscous_laws() {
        let model = model_of(material, &LIVER, true);
        let (g, time) = (0.3, 0.1);
        // Isochoric: the whole shear stress of these laws but for what the bulk modulus multiplies.
        let elastic = material.first_piola(&sheared(g));
        let bulk = (elastic - material.relaxed(0.5).first_piola(&sheared(g)) * 2.0) * -1.0;
        let series: f64 = LIVER.iter().map(|t| t.modulus * (1.0 - (-time / t.time).exp())).sum();
        let expected = bulk[(0, 1)] + (elastic - bulk)[(0, 1)] * (1.0 - series);
        let errors = [20, 40, 80].map(|steps| (relaxed_stress(&model, g, time, steps) - expected).abs());
        for pair in errors.windows(2) {
            // First order halves the error; the next order at h = τ/6 leaves 15 %.
            let ratio = pair[0] / pair[1];
            assert!((1.8..2.3).contains(&ratio), "{}: {errors:?}", material.name());
        }
        assert!(errors[2] < 0.01 * elastic[(0, 1)].abs(), "{}: {errors:?}", material.name());
        // A step without end is the relaxed equilibrium, and so is a very long time.
        let mut state = model.rest_state();
        deform(&model, &sheared(g), &mut state);
        let mut ws = FemWorkspace::new(&model);
        let end = stress(&model, &state, f64::INFINITY, &mut ws)[(0, 1)];
        let left = bulk[(0, 1)] + (elastic - bulk)[(0, 1)] * (1.0 - 0.235 - 0.333);
        assert!((end - left).abs() < 1e-9 * elastic.amax(), "{} {end} {left}", material.name());
        assert!((relaxed_stress(&model, g, 30.0, 300) - left).abs() < 1e-6 * elastic.amax(), "{}", material.name());
        advance_memory(&model, &mut state, f64::INFINITY);
        let held = stress(&model, &state, 0.01, &mut ws)[(0, 1)];
        assert!((held - left).abs() < 1e-9 * elastic.amax(), "{} {held} {left}", material.name());
    }
}

#[test]
fn the_bulk_stays_elastic() {
    for material in viscous_laws() {
        let model = model_of(material, &LIVER, true);
        let mut state = model.rest_state();
        let mut ws = FemWorkspace::new(&model);
        // Isochoric laws answer any change of volume elastically, the others a small one.
        let isochoric = ["mooney_rivlin", "arruda_boyce", "veronda_westmann", "ogden"].contains(&material.name());
        let F = Matrix3::identity() * if isochoric { 0.9 } else { 1.0 + 1e-6 };
        deform(&model, &F, &mut state);
        for _ in 0..20 {
            let P = stress(&model, &state, 0.05, &mut ws);
            advance_memory(&model, &mut state, 0.05);
            let elastic = material.first_piola(&F);
            assert!((P - elastic).amax() < 1e-5 * elastic.amax(), "{} {P} {elastic}", material.name());
        }
    }
}

#[test]
fn a_block_under_a_constant_shear_stress_creeps_as_theory_says() {
    // One branch: J(t) = (1 + α/(1-α) (1 - e^(-t (1-α)/τ))) / G0, small strain.
    let (alpha, tau) = (0.4, 0.2);
    let law = Material::from_young_poisson("neo_hookean", YOUNG, POISSON).unwrap();
    let model = model_of(law, &[PronyTerm { modulus: alpha, time: tau }], true);
    let G = law.small_strain().mu;
    let creep = |time: f64, steps: usize| {
        let mut state = model.rest_state();
        let mut ws = FemWorkspace::new(&model);
        let dt = time / steps as f64;
        let (load, mut g) = (1e-5 * G, 0.0);
        for _ in 0..steps {
            // The stress is linear in such a small shear: two evaluations give the shear of the load.
            let mut at = |g: f64| {
                deform(&model, &sheared(g), &mut state);
                stress(&model, &state, dt, &mut ws)[(0, 1)]
            };
            let (low, high) = (at(0.0), at(1e-5));
            g = 1e-5 * (load - low) / (high - low);
            deform(&model, &sheared(g), &mut state);
            advance_memory(&model, &mut state, dt);
        }
        g / load * G
    };
    let time: f64 = 0.3;
    let expected = 1.0 + alpha / (1.0 - alpha) * (1.0 - (-time * (1.0 - alpha) / tau).exp());
    let errors = [30, 60].map(|steps| (creep(time, steps) - expected).abs());
    assert!((1.85..2.15).contains(&(errors[0] / errors[1])) && errors[1] < 0.005 * expected, "{errors:?}");
}

#[test]
fn storage_and_loss_modulus_follow_theory_at_small_amplitude() {
    let law = Material::from_young_poisson("arruda_boyce", YOUNG, POISSON).unwrap();
    let model = model_of(law, &LIVER, true);
    let G = law.small_strain().mu;
    for frequency in [0.3, 1.0, 5.0] {
        let omega = std::f64::consts::TAU * frequency;
        // Backward Euler errs by about ω h / 2 in the phase of the branches.
        let steps = 2000;
        let dt = 1.0 / (frequency * steps as f64);
        let mut state = model.rest_state();
        let mut ws = FemWorkspace::new(&model);
        let cycles = (2.0 + 6.0 * 0.27 * frequency).ceil() as usize;
        let (mut storage, mut loss, mut work) = (0.0, 0.0, 0.0);
        let amplitude = 1e-5;
        let mut before = 0.0;
        for k in 1..=cycles * steps {
            let phase = omega * dt * k as f64;
            let g = amplitude * phase.sin();
            deform(&model, &sheared(g), &mut state);
            let tau = stress(&model, &state, dt, &mut ws)[(0, 1)];
            advance_memory(&model, &mut state, dt);
            if k > (cycles - 1) * steps {
                storage += 2.0 * tau * phase.sin() / (amplitude * steps as f64);
                loss += 2.0 * tau * phase.cos() / (amplitude * steps as f64);
                work += tau * (g - before);
            }
            before = g;
        }
        let part = |t: &PronyTerm| {
            let x = omega * t.time;
            (t.modulus / (1.0 + x * x), t.modulus * x / (1.0 + x * x))
        };
        let relaxed: f64 = LIVER.iter().map(|t| part(t).0).sum();
        let lost: f64 = LIVER.iter().map(|t| part(t).1).sum();
        assert!((storage / G - (1.0 - relaxed)).abs() < 2e-3, "{frequency}: {} {}", storage / G, 1.0 - relaxed);
        assert!((loss / G - lost).abs() < 2e-3, "{frequency}: {} {lost}", loss / G);
        // A cycle dissipates π G'' per squared amplitude and volume.
        let expected = std::f64::consts::PI * lost * G * amplitude * amplitude;
        assert!((work / expected - 1.0).abs() < 0.02, "{frequency}: {work:e} {expected:e}");
    }
}

#[test]
fn rigid_motion_adds_no_stress_and_turns_what_there_is() {
    let mut random = Random(41);
    for material in viscous_laws() {
        let model = model_of(material, &LIVER, true);
        let mut ws = FemWorkspace::new(&model);
        let mut state = model.rest_state();
        for k in 1..=10 {
            deform(&model, &Rotation3::new(random.vector() * f64::from(k)).into_inner(), &mut state);
            let P = stress(&model, &state, 0.03, &mut ws);
            advance_memory(&model, &mut state, 0.03);
            assert!(P.amax() < 1e-10 * YOUNG, "{} {P}", material.name());
        }
        // The same history of strain with and without turns: the stress of the turned one is turned.
        let (mut still, mut turning) = (model.rest_state(), model.rest_state());
        for k in 0..10 {
            let F = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.2 * random.symmetric());
            let Q = Rotation3::new(random.vector() * f64::from(k)).into_inner();
            deform(&model, &F, &mut still);
            deform(&model, &(Q * F), &mut turning);
            let (one, other) = (stress(&model, &still, 0.03, &mut ws), stress(&model, &turning, 0.03, &mut ws));
            assert!((Q * one - other).amax() < 1e-9 * YOUNG.max(one.amax()), "{}", material.name());
            advance_memory(&model, &mut still, 0.03);
            advance_memory(&model, &mut turning, 0.03);
        }
    }
}

#[test]
fn force_and_tangent_of_a_step_are_derivatives_of_its_energy() {
    let mut random = Random(43);
    for (kind, material) in viscous_kinds() {
        let model = model_by(kind, material, &LIVER, false);
        let mut ws = FemWorkspace::new(&model);
        let mut state = model.rest_state();
        deform(&model, &(Matrix3::identity() + Matrix3::from_fn(|_, _| 0.3 * random.symmetric())), &mut state);
        advance_memory(&model, &mut state, 0.05);
        let dt = 0.02;
        ws.dt = dt;
        // A tenth of the distance between nodes.
        let size = if kind == ElementKind::Quadratic { 0.005 } else { 0.01 };
        for q in &mut state.q {
            *q += random.vector() * size;
        }
        let direction: Vec<Vector3<f64>> = state.q.iter().map(|_| random.vector()).collect();
        assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
        let (K, f) = (dense(&ws), ws.f_int.clone());
        let assembled = f.clone();
        internal_forces(&model, &state, &mut ws);
        assert!(ws.f_int.iter().zip(&assembled).all(|(a, b)| (a - b).norm() < 1e-12 * YOUNG * 0.01));
        assert!((&K - K.transpose()).amax() <= 1e-12 * K.amax(), "{}", material.name());
        let h = 1e-6;
        let mut at = |sign: f64| {
            let mut moved = state.clone();
            moved.q.iter_mut().zip(&direction).for_each(|(q, d)| *q += d * (sign * h));
            internal_forces(&model, &moved, &mut ws);
            (incremental_energy(&model, &moved, dt), ws.f_int.clone())
        };
        let ((ahead, f_ahead), (behind, f_behind)) = (at(1.0), at(-1.0));
        let work: f64 = f.iter().zip(&direction).map(|(f, d)| f.dot(d)).sum();
        let size: f64 = f.iter().map(Vector3::norm).sum();
        // Central differences of step 1e-6 m on elements of 0.1 m: 1e-10 by truncation, as much by rounding.
        assert!(((behind - ahead) / (2.0 * h) - work).abs() < 1e-7 * size, "{kind:?} {} {work}", material.name());
        for i in 0..model.nodes() {
            let difference = (f_behind[i] - f_ahead[i]) / (2.0 * h);
            let exact: Vector3<f64> =
                (0..model.nodes()).map(|j| K.fixed_view::<3, 3>(3 * i, 3 * j) * direction[j]).sum();
            assert!((difference - exact).norm() < 1e-7 * K.amax(), "{kind:?} {} node {i}", material.name());
        }
    }
}

#[test]
fn every_point_of_quadrature_remembers_its_own_stress() {
    let mut random = Random(59);
    let dt = 0.02;
    for (kind, material) in viscous_kinds().filter(|(kind, _)| *kind != ElementKind::Averaged) {
        let model = model_by(kind, material, &LIVER, false);
        let mut state = model.rest_state();
        for _ in 0..2 {
            state.q.iter_mut().for_each(|q| *q += random.vector() * 0.003);
            advance_memory(&model, &mut state, 0.05);
        }
        state.q.iter_mut().for_each(|q| *q += random.vector() * 0.003);
        let mut ws = FemWorkspace::new(&model);
        ws.dt = dt;
        internal_forces(&model, &state, &mut ws);

        // From the equations alone: P = relaxed law - F Γ, f_i = -Σ w P ∇N_i.
        let share: f64 = LIVER.iter().map(|t| t.modulus * dt / (dt + t.time)).sum();
        let law = material.relaxed(share);
        let mut expected = vec![Vector3::zeros(); model.nodes()];
        let mut histories = state.memory.chunks_exact(LIVER.len());
        let mut add = |nodes: &[u32], gradients: &[Vector3<f64>], weight: f64| {
            let history = histories.next().expect("one for each point").iter().zip(LIVER);
            let s: Vector6<f64> = history.map(|(s, t)| s * (t.time / (dt + t.time))).sum();
            let memory = Matrix3::new(s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2]);
            let F: Matrix3<f64> = nodes.iter().zip(gradients).map(|(&i, g)| state.q[i as usize] * g.transpose()).sum();
            let P = law.first_piola(&F) - F * memory;
            nodes.iter().zip(gradients).for_each(|(&i, g)| expected[i as usize] -= P * g * weight);
        };
        if kind == ElementKind::Quadratic {
            for element in model.quadratic_elements() {
                (0..POINTS).for_each(|k| add(&element.nodes, &element.gradients(k), element.weights[k]));
            }
        } else {
            for element in model.elements() {
                add(&element.nodes, &element.shape_vectors(), element.volume);
            }
        }
        let largest = expected.iter().map(Vector3::norm).fold(0.0, f64::max);
        for (ours, expected) in ws.f_int.iter().zip(&expected) {
            assert!((ours - expected).norm() < 1e-11 * largest, "{kind:?} {}: {ours} {expected}", material.name());
        }
    }
}

#[test]
fn the_filter_makes_the_tangent_of_viscous_elements_semidefinite() {
    let mut random = Random(47);
    let mut filtered = 0;
    for (kind, material) in viscous_kinds() {
        let model = model_by(kind, material, &LIVER, true);
        let mut ws = FemWorkspace::new(&model);
        for _ in 0..10 {
            let mut state = model.rest_state();
            for step in 0..3 {
                // Pulled first, then pressed: the memory of tension makes the pressed tissue unstable.
                let pull = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, if step < 2 { 1.8 } else { 0.6 }));
                deform(&model, &(pull + Matrix3::from_fn(|_, _| 0.1 * random.symmetric())), &mut state);
                ws.dt = 0.1;
                let report = assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
                assert!(report.filtered as usize <= model.elements().len());
                filtered += report.filtered;
                let K = dense(&ws);
                let least = ((&K + K.transpose()) * 0.5).symmetric_eigenvalues().min();
                assert!(least > -1e-8 * K.amax(), "{kind:?} {} {least:e}", material.name());
                advance_memory(&model, &mut state, 0.1);
            }
        }
    }
    assert!(filtered > 100, "{filtered}");
}

#[test]
fn elements_that_were_flat_or_inverted_remember_something_finite() {
    for material in viscous_laws() {
        let model = model_of(material, &LIVER, true);
        let mut ws = FemWorkspace::new(&model);
        let mut state = model.rest_state();
        for height in [0.5, 0.0, -0.4, -1e-9, 0.0, 1e-9, 0.6, 1.0] {
            deform(&model, &Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, height)), &mut state);
            let report = assemble(&model, &state, 0.03, &[], &mut ws);
            advance_memory(&model, &mut state, 0.03);
            assert!(report.non_finite.is_none() && state.memory.iter().flatten().all(|s| s.is_finite()));
        }
        // And forget it.
        let mut left = 0.0;
        for _ in 0..200 {
            advance_memory(&model, &mut state, 0.03);
            left = stress(&model, &state, 0.03, &mut ws).amax();
        }
        assert!(left < 1e-3 * YOUNG, "{}: {left}", material.name());
    }
}

#[test]
fn the_memory_is_state_and_the_same_for_any_number_of_threads() {
    ElementKind::ALL.into_iter().for_each(memory_is_state);
}

fn memory_is_state(kind: ElementKind) {
    let mut mesh = mesh_for(&block([3, 3, 3], [0.1; 3], 0.2), kind);
    let points = if kind == ElementKind::Quadratic { POINTS } else { 1 };
    mesh.region_names = vec!["soft".into(), "stiff".into(), "elastic".into()];
    mesh.regions = (0..mesh.tetrahedra.len()).map(|t| (t % 3) as u16).collect();
    let material = |young| Material::from_young_poisson("mooney_rivlin", young, 0.45).unwrap();
    let config = FemConfig {
        element: kind,
        material: material(5e3),
        viscosity: LIVER.to_vec(),
        region_materials: [("stiff".to_string(), material(2e4))].into(),
        region_viscosities: [("stiff".to_string(), LIVER[..1].to_vec()), ("elastic".to_string(), Vec::new())].into(),
        ..FemConfig::default()
    };
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let model = FemModel::new(&mesh, &config).unwrap();
            let mut state = model.rest_state();
            // Two terms in the first third, one in the second, none in the last.
            assert_eq!(state.memory.len(), points * mesh.tetrahedra.len());
            let mut ws = FemWorkspace::new(&model);
            let mut random = Random(53);
            for _ in 0..5 {
                state.q.iter_mut().for_each(|q| *q += random.vector() * 1e-3);
                assemble(&model, &state, 0.03, &[], &mut ws);
                advance_memory(&model, &mut state, 0.03);
            }
            (state, ws.rhs.clone(), ws.f_int.clone())
        })
    };
    let one = run(1);
    assert!(one == run(3), "bits differ between 1 and 3 threads");
    assert!(one.0.memory.iter().all(|s| s.amax() > 0.0));
}

#[test]
fn elastic_bodies_remember_nothing_and_mistakes_are_refused() {
    let law = |name: &str| Material::from_young_poisson(name, YOUNG, POISSON).unwrap();
    let model = model_of(law("ogden"), &[], true);
    let state = model.rest_state();
    assert!(state.memory.is_empty());
    assert_eq!(incremental_energy(&model, &state, 0.1), elastic_energy(&model, &state));
    let refused = |name: &str, terms: &[PronyTerm]| {
        let config = FemConfig { material: law(name), viscosity: terms.to_vec(), ..FemConfig::default() };
        match FemModel::new(&mesh(), &config).unwrap_err() {
            FemError::Material { place, error } => (place, error),
            other => panic!("{other}"),
        }
    };
    let term = |modulus, time| PronyTerm { modulus, time };
    let place = || "the body".to_string();
    let one = refused("ogden", &[LIVER[0], term(0.0, 1.0)]);
    assert_eq!(one, (place(), MaterialError::PronyModulus { term: 1, modulus: 0.0 }));
    let one = refused("ogden", &[term(0.2, 0.0)]);
    assert_eq!(one, (place(), MaterialError::PronyTime { term: 0, time: 0.0 }));
    assert!(matches!(refused("ogden", &[term(0.2, -1.0)]).1, MaterialError::PronyTime { .. }));
    assert!(matches!(refused("ogden", &[term(f64::NAN, 1.0)]).1, MaterialError::PronyModulus { .. }));
    assert!(matches!(refused("ogden", &[term(0.5, 1.0), term(0.5, 2.0)]).1, MaterialError::PronySum(1.0)));
    assert_eq!(refused("linear", &LIVER).1, MaterialError::NoViscosity("linear"));
}
