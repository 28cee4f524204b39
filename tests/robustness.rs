//! Tissue beyond reason at 30 Hz: crushed, pulled, twisted, begun inside out or flat, for every law and for stiffness
//! ratios of 1 and 1e4. Either the body comes back to its shape, or each failed step names an element, puts the body
//! back, and the simulation goes on.
//!
//! `cargo test --release -p palpate --test robustness -- --nocapture` prints the table of `docs/robustness.md`.

#![allow(clippy::print_stdout)] // the table

mod ordeals;

use nalgebra::Isometry3;
use palpate::fem::assembly::OPEN_BELOW;
use palpate::fem::element::ElementKind;
use palpate::fem::material::Material;
use palpate::prelude::*;

use ordeals::{ORDEALS, Ordeal, endure, mesh, world};

/// Cells over the width of the block.
const CELLS: usize = 2;

/// Laws that soften in shear beyond a full turn: see the test.
const WIND_UP: [&str; 4] = ["mooney_rivlin", "arruda_boyce", "veronda_westmann", "ogden"];

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
                // Wound up by a full turn, tissue goes through itself. The laws of this list have more than one equilibrium
                // between the same two ends then, and rounding decides in which they come to rest: uninverted, not torn.
                let wound = ordeal == Ordeal::Twisted && WIND_UP.contains(&law);
                let may_stay = wound && element != ElementKind::Quadratic;
                // It slipped through itself by inverted elements, and each such step named the worst of them.
                let slipped = outcome.smallest <= 0.0;
                let whole = outcome.rests() && outcome.astray < 1.0 && outcome.rolled_back == 0;
                let case = format!("{law}, {element:?}, {ratio:e}, {ordeal:?}: {outcome:?}");
                assert!(outcome.recovers() || may_stay && whole && slipped, "{case}");
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
