//! Every registered law is reached by name from a scene, with and without viscosity, and carries a press of the tool; a
//! failed step forgets nothing, and `check` says what was understood.

use crate::block;
use std::path::Path;

use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::fem::element::ElementKind;
use palpate::fem::material::{Law, Material, PronyTerm};
use palpate::scene::{IntegratorKind, NodeSelection, Scene};
use palpate::simulation::Simulation;
use palpate::step::StepStatus;
use palpate::world::World;

use crate::block::{STEPS, TOML, pose};

const NEO_HOOKEAN: &str = r#"{ law = "neo_hookean", young = 6e3, poisson = 0.45 }"#;

const LIVER: &str = "viscosity = [{ modulus = 0.235, time = 0.27 }, { modulus = 0.333, time = 0.03 }]";

/// The scene of the tests with another material.
fn scene(material: &str) -> Result<Scene, String> {
    assert!(TOML.contains(NEO_HOOKEAN));
    Scene::from_toml(&TOML.replace(NEO_HOOKEAN, material), Path::new("")).map_err(|e| e.to_string())
}

fn world(material: &str) -> World {
    scene(material).unwrap().build().unwrap()
}

/// Largest force of the tissue on the tool during the press (N), and the state at its end.
fn press(world: &World) -> (f64, palpate::fem::model::FemState) {
    let mut simulation = Simulation::new(world).unwrap();
    let mut largest = 0.0_f64;
    for k in 0..STEPS {
        let report = simulation.step(&pose(k));
        assert_eq!(report.status, StepStatus::Advanced, "{} at step {k}", world.understood());
        largest = largest.max(report.force.norm());
    }
    (largest, simulation.state().fem.clone())
}

#[test]
fn every_law_carries_a_press_and_viscosity_softens_it() {
    let reference = press(&world(NEO_HOOKEAN)).0;
    for name in Material::NAMES {
        let elastic = world(&format!(r#"{{ law = "{name}", young = 6e3, poisson = 0.45 }}"#));
        assert!(elastic.understood().contains(&format!("law = \"{name}\"")), "{}", elastic.understood());
        let (force, state) = press(&elastic);
        // The press strains the skin by a quarter: laws differ, St Venant-Kirchhoff most, which softens under pressure.
        assert!(force > 0.3 * reference && force < 2.5 * reference, "{name}: {force} {reference}");
        assert!(state.memory.is_empty());
        let text = format!(r#"{{ law = "{name}", young = 6e3, poisson = 0.45, {LIVER} }}"#);
        if !elastic.description().bodies[0].material.law.is_frame_indifferent() {
            let refused = scene(&text).unwrap().build().map(|_| ()).unwrap_err().to_string();
            assert!(refused.contains("takes no viscosity"), "{refused}");
            continue;
        }
        let viscous = world(&text);
        assert!(viscous.understood().contains("relax 23.5 % in 0.27 s, 33.3 % in 0.03 s"), "{}", viscous.understood());
        let (softer, state) = press(&viscous);
        assert!(softer < 0.95 * force && softer > 0.3 * force, "{name}: {softer} {force}");
        assert!(state.memory.len() == 2 * viscous.mesh().tetrahedra.len());
        assert!(state == press(&viscous).1, "{name}: a second run has other bits");
    }
}

#[test]
fn a_failed_step_keeps_the_memory_of_the_tissue() {
    let world = world(&format!(r#"{{ law = "arruda_boyce", young = 6e3, poisson = 0.45, {LIVER} }}"#));
    let mut simulation = Simulation::new(&world).unwrap();
    for k in 0..20 {
        simulation.step(&pose(k));
    }
    let memory = simulation.state().fem.memory.clone();
    assert!(memory.iter().any(|s| s.amax() > 1.0), "the tissue is under stress");
    simulation.state_mut().fem.v[200].x = f64::NAN;
    assert_eq!(simulation.step(&pose(20)).status, StepStatus::RolledBack);
    assert!(simulation.state().fem.memory == memory);
    assert_eq!(simulation.step(&pose(21)).status, StepStatus::Advanced);
    assert!(simulation.state().fem.memory != memory);
}

#[test]
fn a_settled_viscous_body_stays_where_it_is() {
    let heavy = |material: &str| {
        let mut scene = scene(material).unwrap();
        scene.edit(|d| d.gravity = [0.0, 0.0, -9.81]).unwrap();
        scene.build().unwrap()
    };
    let world = heavy(&format!(r#"{{ law = "neo_hookean", young = 6e3, poisson = 0.45, {LIVER} }}"#));
    let mut simulation = Simulation::new(&world).unwrap();
    let begin = simulation.positions().to_vec();
    let away = pose(0);
    for _ in 0..30 {
        simulation.step(&away);
    }
    let sag = block::distance(&begin, &world.mesh().nodes);
    let drift = block::distance(simulation.positions(), &begin);
    // Settled to a millionth of the size; the step's conjugate gradients stop there as well.
    assert!(sag > 1e-4 && drift < 0.01 * sag, "{sag:e} {drift:e}");
    // The relaxed body sags more than the elastic one of the same modulus.
    let elastic = heavy(NEO_HOOKEAN);
    let stiff = block::distance(Simulation::new(&elastic).unwrap().positions(), &elastic.mesh().nodes);
    assert!(sag > 1.5 * stiff, "{sag:e} {stiff:e}");
}

#[test]
fn regions_have_their_own_viscosity_and_scenes_survive_an_edit() {
    let text = format!(r#"{{ law = "ogden", mu = 2e3, alpha = -4, bulk = 2e4, {LIVER} }}"#);
    let mut scene = scene(&text).unwrap();
    let terms = |scene: &Scene| scene.description().bodies[0].material.viscosity.clone();
    let before = terms(&scene);
    assert_eq!(before[1], PronyTerm { modulus: 0.333, time: 0.03 });
    scene.edit(|d| d.seconds = 2.0).unwrap();
    assert_eq!(terms(&scene), before);
    // A region with a tissue of its own has the viscosity that stands there: here none.
    let own = |d: &mut palpate::scene::SceneDescription| {
        let law = Material::from_young_poisson("mooney_rivlin", 6e3, 0.45).unwrap();
        d.bodies[0].regions.insert("block".into(), law.into());
    };
    scene.edit(own).unwrap();
    assert!(scene.build().unwrap().model().rest_state().memory.is_empty());
}

#[test]
fn mistakes_of_materials_are_told_with_the_remedy() {
    for (material, part) in [
        (r#"{ law = "ogdn", young = 6e3, poisson = 0.45 }"#, "did you mean `ogden`"),
        (r#"{ law = "ogden", young = 6e3, poisson = 0.45, alhpa = 3 }"#, "did you mean `alpha`"),
        (r#"{ law = "ogden", mu = 6e3, poisson = 0.45 }"#, "not a mixture"),
        (r#"{ law = "mooney_rivlin", young = 6e3, poisson = 0.5 }"#, "poisson = 0.5"),
        (r#"{ law = "ogden", young = 6e3, poisson = 0.45, viscosity = [{ modulus = 0.2 }] }"#, "missing field `time`"),
    ] {
        let message = scene(material).map(|_| ()).unwrap_err();
        assert!(message.contains(part), "{material}: {message}");
    }
    for (viscosity, part) in [
        ("{ modulus = 0.6, time = 1 }, { modulus = 0.4, time = 2 }", "add up to 1"),
        ("{ modulus = 0.6, time = 0 }", "time = 0 s"),
        ("{ modulus = -0.6, time = 1 }", "modulus = -0.6"),
    ] {
        let text = format!(r#"{{ law = "ogden", young = 6e3, poisson = 0.45, viscosity = [{viscosity}] }}"#);
        let message = scene(&text).and_then(|s| s.build().map(|_| ()).map_err(|e| e.to_string())).unwrap_err();
        assert!(message.contains(part), "{viscosity}: {message}");
    }
}

/// Force (N) that a block sheared at once by a tenth bears on its lower side after 0.3 s, over what it bore at first. Its
/// skin is fixed, so that the strain is uniform and stays.
fn relaxed(element: ElementKind, integrator: IntegratorKind, rate: f64) -> f64 {
    let mut scene = scene(&format!(r#"{{ law = "neo_hookean", young = 6e3, poisson = 0.45, {LIVER} }}"#)).unwrap();
    scene
        .edit(|d| {
            (d.gravity, d.rates.step) = ([0.0; 3], rate);
            let body = &mut d.bodies[0];
            (body.element, body.integrator, body.rayleigh_stiffness) = (element, integrator, 0.0);
            body.block.as_mut().unwrap().cells = [3, 3, 2];
            let sides = ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"];
            body.fixed = sides.map(|side| NodeSelection::NodeSet(side.into())).into();
        })
        .unwrap();
    let world = scene.build().unwrap();
    let mut simulation = Simulation::new(&world).unwrap();
    simulation.state_mut().fem.q.iter_mut().for_each(|q| q.x += 0.1 * q.z);
    let mut ws = FemWorkspace::new(world.model());
    // The stress of this moment: nothing relaxes in no time.
    ws.dt = 0.0;
    let mut bears = |simulation: &Simulation<'_>| {
        internal_forces(world.model(), &simulation.state().fem, &mut ws);
        world.mesh().node_sets["z_min"].iter().map(|&n| ws.f_int[n as usize].x).sum::<f64>()
    };
    let first = bears(&simulation);
    for _ in 0..(0.3 * rate).round() as u32 {
        assert_eq!(simulation.step(&pose(0)).status, StepStatus::Advanced);
    }
    bears(&simulation) / first
}

#[test]
fn a_sheared_block_that_is_held_relaxes_as_its_series_says_with_every_element_and_integrator() {
    let share = |modulus: f64, time: f64| modulus * (1.0 - f64::exp(-0.3 / time));
    let exact = 1.0 - share(0.235, 0.27) - share(0.333, 0.03);
    for element in [ElementKind::Linear, ElementKind::Quadratic, ElementKind::Averaged] {
        for integrator in [IntegratorKind::BackwardEuler, IntegratorKind::Newton] {
            // Memory is backward Euler: of first order, (t h / 2τ²) e^(-t/τ) of each share.
            let errors = [240.0, 480.0].map(|rate| relaxed(element, integrator, rate) - exact);
            let order = (errors[0] / errors[1]).log2();
            assert!(errors[0] > 0.0 && errors[0] < 1e-3, "{element:?}, {integrator:?}: {errors:?}");
            assert!((order - 1.0).abs() < 0.05, "{element:?}, {integrator:?}: order {order}, {errors:?}");
        }
        // Substeps are at least as short as the steps above.
        let error = relaxed(element, IntegratorKind::Explicit, 240.0) - exact;
        assert!((0.0..1e-3).contains(&error), "{element:?}, explicit: {error}");
    }
}
