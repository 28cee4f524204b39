//! Tissue beyond reason at 30 Hz: crushed, pulled, twisted, begun inside out or flat, for every law and for stiffness
//! ratios of 1 and 1e4. Either the body comes back to its shape, or each failed step names an element, puts the body
//! back, and the simulation goes on.
//!
//! `cargo test --release -p palpate --test tissue robustness -- --nocapture` prints the table of `docs/robustness.md`.

#![allow(clippy::print_stdout)] // the table

use crate::ordeals;
use nalgebra::{Isometry3, Vector3};
use palpate::fem::assembly::OPEN_BELOW;
use palpate::fem::element::ElementKind;
use palpate::fem::format::write_msh;
use palpate::fem::material::Material;
use palpate::fem::mesh::TetMesh;
use palpate::prelude::*;

use crate::ordeals::{ORDEALS, Ordeal, endure, mesh, world};

/// Cells over the width of the block.
const CELLS: usize = 2;

#[test]
fn every_law_comes_back_or_says_where_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path(), CELLS);
    println!("| law | element | ratio | {} |", ORDEALS.map(|o| format!("{o:?}")).join(" | "));
    println!("| --- | --- | --- |{}", " --- |".repeat(ORDEALS.len()));
    let quadratic = ["neo_hookean", "mooney_rivlin", "stable_neo_hookean"].map(|law| (law, ElementKind::Quadratic));
    let averaged = ["neo_hookean", "mooney_rivlin"].map(|law| (law, ElementKind::Averaged));
    let others = quadratic.into_iter().chain(averaged);
    for (law, element) in Material::NAMES.iter().map(|law| (*law, ElementKind::Linear)).chain(others) {
        for ratio in [1.0, 1e4] {
            let world = world(folder.path(), law, element, ratio, true).unwrap();
            let outcomes = ORDEALS.map(|ordeal| endure(&world, ordeal));
            println!("| `{law}` | {} | {ratio:e} | {} |", element.name(), outcomes.map(|o| o.text()).join(" | "));
            for (ordeal, outcome) in ORDEALS.into_iter().zip(outcomes) {
                // What is not itself again is named in each step of the last second, as tissue that lies upon itself or is
                // inside out, and no step was given up.
                let named = outcome.named >= 30 && outcome.astray < 1.0 && outcome.rolled_back == 0;
                let case = format!("{law}, {element:?}, {ratio:e}, {ordeal:?}: {outcome:?}");
                assert!(outcome.recovers() || named, "{case}");
            }
        }
    }
}

#[test]
fn without_the_guard_a_crushed_body_is_torn_named_rolled_back_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path(), CELLS);
    let world = world(folder.path(), "neo_hookean", ElementKind::Linear, 1.0, false).unwrap();
    // What `step` asserts of every step that fails: finite, at rest, an element and its region named.
    let outcome = endure(&world, Ordeal::Crushed);
    assert!(outcome.rolled_back > 0 && !outcome.recovers(), "{outcome:?}");
    let outcome = endure(&world, Ordeal::Pulled);
    assert!(outcome.rolled_back == 0 && outcome.recovers(), "{outcome:?}");
}

/// Of a quadratic body whose nodes are mirrored, elements are folded: the report counts and names them, their motion is
/// repeated, and once they are open again nothing of that acts any more.
#[test]
fn folds_of_quadratic_elements_are_counted_named_and_opened() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path(), CELLS);
    let world = world(folder.path(), "neo_hookean", ElementKind::Quadratic, 1.0, true).unwrap();
    let mut simulation = Simulation::new(&world).unwrap();
    let rest = world.mesh().nodes.clone();
    for &node in world.model().node_of_free() {
        simulation.state_mut().fem.q[node as usize] = Ordeal::InsideOut.begun(rest[node as usize]);
    }
    let pose = Isometry3::translation(1.0, 1.0, 1.0);
    let first = simulation.step(&pose);
    assert!(first.folds.folded > 0 && first.folds.min_jacobian < OPEN_BELOW, "{:?}", first.folds);
    assert!((first.folds.tetrahedron as usize) < world.mesh().tetrahedra.len());
    assert!(first.repeated > 1, "{}", first.repeated);
    let reports: Vec<_> = (0..60).map(|_| simulation.step(&pose)).collect();
    let opened = reports.iter().position(|r| r.folds.folded == 0).expect("no element stays folded");
    assert!(reports[opened..].iter().all(|r| r.folds.folded == 0), "an element that was opened folds again");
    let last = reports.last().unwrap();
    assert_eq!((last.repeated, last.cuts), (0, 0));
}

/// St Venant-Kirchhoff does not tell a body from its mirror image: begun so it rests inside out, free of stress. Held open it
/// comes back; without the guard it stays where it is.
#[test]
fn a_body_that_rests_inside_out_is_held_open_until_it_is_itself_again() {
    for (element, guard) in [("linear", true), ("averaged", true), ("linear", false)] {
        let law = if element == "linear" { "st_venant_kirchhoff" } else { "arruda_boyce" };
        let text = format!(
            r#"
            name = "mirrored"
            gravity = [0, 0, 0]
            [[body]]
            name = "block"
            block = {{ min = [0, 0, 0], max = [0.02, 0.02, 0.02], cells = [2, 2, 2] }}
            element = "{element}"
            guard = {guard}
            density = 1000
            rayleigh_mass = 2.0
            rayleigh_stiffness = 0.01
            material = {{ law = "{law}", young = 5e3, poisson = 0.3 }}
            fixed = [{{ node_set = "z_min" }}]
            [[tool]]
            name = "far away"
            shape = {{ kind = "sphere", radius = 0.005 }}
            [hand]
            path = [{{ time = 0, position = [1, 1, 1] }}]
            "#
        );
        let world = Scene::from_toml(&text, std::path::Path::new("")).unwrap().build().unwrap();
        let mut simulation = Simulation::new(&world).unwrap();
        let rest = world.mesh().nodes.clone();
        for &node in world.model().node_of_free() {
            simulation.state_mut().fem.q[node as usize].z *= -1.0;
        }
        let reports: Vec<_> = (0..150).map(|_| simulation.step(&Isometry3::translation(1.0, 1.0, 1.0))).collect();
        let astray = simulation.positions().iter().zip(&rest).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max);
        let held = reports.iter().filter(|r| r.folds.folded > 0).count();
        println!("{law}, {element}, guard {guard}: {held} steps held open, {:.1e} m astray", astray);
        let last = reports.last().unwrap();
        if guard {
            assert!(astray < 1e-3 * 0.02 && last.assembly.inverted == 0, "{law}: {astray} m");
            assert_eq!((last.repeated, last.folds.folded), (0, 0), "nothing acts on a body that is itself again");
        } else {
            assert!(held == 0 && last.assembly.inverted > 0 && astray > 0.01, "{astray} m");
        }
    }
}

/// Twisted by a full turn, averaged `mooney_rivlin` slips through itself and comes to rest with every element open: each step
/// says so until it is led home, and then nothing acts on it any more.
#[test]
fn tissue_that_lies_upon_itself_is_named_in_every_step_until_it_is_led_home() {
    let folder = tempfile::tempdir().unwrap();
    mesh(folder.path(), CELLS);
    for guard in [true, false] {
        let world = world(folder.path(), "mooney_rivlin", ElementKind::Averaged, 1.0, guard).unwrap();
        let mut simulation = Simulation::new(&world).unwrap();
        let reports = twisted(&mut simulation);
        let begins = reports.iter().position(|r| r.led);
        let Some(begins) = begins.filter(|_| guard) else {
            assert!(
                !guard && reports.iter().all(|r| r.tangle.is_none() && !r.led),
                "a guard that is off looks for nothing"
            );
            continue;
        };
        // What is led is a body at rest in a tangle without an element inside out.
        let before = &reports[begins - 8..begins];
        assert!(before.iter().all(|r| r.tangle.is_some_and(|t| t.winding == 2) && r.assembly.inverted == 0));
        let led = reports.iter().filter(|r| r.led).count();
        println!("{} edges wound twice, {led} steps led from step {begins}", before[0].tangle.unwrap().edges);
        assert!(reports[begins..begins + led].iter().all(|r| r.led) && led <= 30, "one attempt of {led} steps");
        let last = &reports[reports.len() - 10..];
        assert!(last.iter().all(|r| r.tangle.is_none() && !r.led && (r.cuts, r.repeated) == (0, 0)));
    }
}

/// Reports of a block whose upper end is twisted by a full turn and back.
fn twisted(simulation: &mut Simulation<'_>) -> Vec<palpate::step::StepReport> {
    let rest = simulation.world().mesh().nodes.clone();
    let step = |k: u32| {
        for (q, x) in simulation.state_mut().fem.q.iter_mut().zip(&rest).filter(|(_, x)| x.z > ordeals::HEIGHT - 1e-9) {
            *q = Ordeal::Twisted.driven(*x, ordeals::share(k));
        }
        simulation.step(&Isometry3::translation(1.0, 1.0, 1.0))
    };
    (1..=ordeals::STEPS.iter().sum()).map(step).collect()
}

/// A ring of tetrahedra whose fixed nodes are wound twice round its axis is a tangle whatever its law: it is named in every
/// step for as long as that lasts, led ever more rarely, and free of all that once its fixed nodes are back.
#[test]
fn a_tangle_that_its_ends_hold_is_named_for_as_long_as_it_lasts_and_led_ever_more_rarely() {
    let folder = tempfile::tempdir().unwrap();
    let mut nodes = vec![Vector3::zeros(), Vector3::new(0.0, 0.0, 0.01)];
    let around = |k: u32, turns: f64| {
        let (sine, cosine) = (f64::from(k) * turns * std::f64::consts::TAU / 12.0).sin_cos();
        Vector3::new(0.01 * cosine, 0.01 * sine, 0.005)
    };
    nodes.extend((0..12).map(|k| around(k, 1.0)));
    let tetrahedra = (0..12).map(|k| [0, 1, 2 + k, 2 + (k + 1) % 12]).collect();
    let ring =
        TetMesh { nodes, tetrahedra, regions: vec![0; 12], region_names: vec!["ring".into()], ..TetMesh::default() };
    write_msh(folder.path().join("ring.msh"), &ring).unwrap();
    let text = r#"
        name = "ring"
        gravity = [0, 0, 0]
        [[body]]
        name = "ring"
        mesh = "ring.msh"
        density = 1000
        rayleigh_mass = 2.0
        rayleigh_stiffness = 0.01
        material = { law = "neo_hookean", young = 5e3, poisson = 0.3 }
        fixed = [{ box = { min = [-1, -1, 0.004], max = [1, 1, 0.006] } }]
        [[tool]]
        name = "far away"
        shape = { kind = "sphere", radius = 0.005 }
        [hand]
        path = [{ time = 0, position = [1, 1, 1] }]
        "#;
    let world = Scene::from_toml(text, folder.path()).unwrap().build().unwrap();
    let mut simulation = Simulation::new(&world).unwrap();
    let mut steps = |turns: f64, count: usize| -> Vec<_> {
        (0..12).for_each(|k| simulation.state_mut().fem.q[2 + k as usize] = around(k, turns));
        (0..count).map(|_| simulation.step(&Isometry3::translation(1.0, 1.0, 1.0))).collect()
    };
    let held = steps(2.0, 300);
    for (k, report) in held.iter().enumerate() {
        let tangle = report.tangle.expect("named in every step");
        assert_eq!((tangle.edges, tangle.place.region), (1, 0));
        // Until something is tried it lies upon itself with no element inside out.
        assert!(
            tangle.winding != 1 && (k >= 10 || (tangle.winding, report.assembly.inverted) == (2, 0)),
            "{k}: {tangle:?}"
        );
    }
    let begins: Vec<usize> = (1..held.len()).filter(|&k| held[k].led && !held[k - 1].led).collect();
    let led = held.iter().filter(|r| r.led).count();
    println!("led from steps {begins:?}, {led} steps");
    let waits: Vec<usize> = begins.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(begins.len() >= 2 && waits.windows(2).all(|pair| pair[1] > 2 * pair[0]), "{begins:?}");
    let free = steps(1.0, 10);
    assert!(free.iter().skip(1).all(|r| r.tangle.is_none()));
    assert!(free.last().is_some_and(|r| !r.led), "no tangle, nothing to lead it out of");
}
