//! A heavy body begins at rest: settled by Newton's method before the first step, and whole where others are.

#![allow(clippy::print_stdout)] // measured numbers

use nalgebra::Isometry3;
use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::prelude::*;
use palpate::scene::BlockDescription;
use std::path::Path;

fn block(young: f64, settle: bool) -> Scene {
    column(young, settle, "-9.81", "fixed = [{ below = { axis = \"z\", at = 0.0 } }]", "[1, 1, 1]", "")
}

fn column(young: f64, settle: bool, gravity: &str, fixed: &str, tool: &str, bodies: &str) -> Scene {
    let text = format!(
        r#"
        name = "column"
        gravity = [0, 0, {gravity}]
        [[body]]
        name = "column"
        block = {{ min = [0, 0, 0], max = [0.04, 0.04, 0.08], cells = [3, 3, 6] }}
        density = 1000
        settle = {settle}
        material = {{ law = "neo_hookean", young = {young}, poisson = 0.4 }}
        {fixed}
        [[tool]]
        name = "far away"
        shape = {{ kind = "sphere", radius = 0.005 }}
        [hand]
        path = [{{ time = 0, position = {tool} }}]
        {bodies}
        "#
    );
    Scene::from_toml(&text, Path::new(".")).expect("a sound scene")
}

#[test]
fn a_settled_body_is_in_equilibrium_and_stays_there() {
    for young in [5e3, 2e4] {
        let world = block(young, true).build().expect("a sound world");
        let mut simulation = Simulation::new(&world).expect("positive definite");
        let model = world.model();
        let begin = simulation.positions().to_vec();

        let mut ws = FemWorkspace::new(model);
        internal_forces(model, &simulation.state().fem, &mut ws);
        let unbalanced: f64 = model
            .node_of_free()
            .iter()
            .map(|&n| (ws.f_int[n as usize] + model.mass()[n as usize] * model.gravity()).norm_squared())
            .sum::<f64>()
            .sqrt();
        let weight = 9.81 * model.mass().iter().sum::<f64>();
        // Newton's method ends at 1e-9 of the forces that balance: weight and internal forces, with those at the base that
        // hold it, each with a norm over the nodes below the whole weight.
        let forces = ws.f_int.iter().map(|f| f.norm_squared()).sum::<f64>().sqrt();
        assert!(unbalanced < 1e-9 * (forces + weight), "unbalanced force {unbalanced} N of {weight} N");
        println!("unbalanced {unbalanced:.1e} N of {weight:.3} N");

        let sag = begin.iter().zip(&world.mesh().nodes).map(|(q, x)| x.z - q.z).fold(0.0, f64::max);
        // A bar that hangs or stands on its end shortens by rho g L² / 2 E; clamping the base makes it a little less.
        let bar = 1000.0 * 9.81 * 0.08_f64.powi(2) / (2.0 * young);
        assert!((0.7..1.15).contains(&(sag / bar)), "sag {sag} m against {bar} m of a slender bar");

        for _ in 0..60 {
            simulation.step(&Isometry3::translation(1.0, 1.0, 1.0));
        }
        let drift = simulation.positions().iter().zip(&begin).map(|(q, b)| (q - b).norm()).fold(0.0, f64::max);
        assert!(drift < 1e-6, "the body moved by {drift} m after it had settled");
    }
}

#[test]
fn a_body_that_is_told_not_to_settle_begins_as_its_mesh() {
    let world = block(5e3, false).build().expect("a sound world");
    let mut simulation = Simulation::new(&world).expect("positive definite");
    assert_eq!(simulation.positions(), world.mesh().nodes.as_slice());
    simulation.step(&Isometry3::translation(1.0, 1.0, 1.0));
    assert_ne!(simulation.positions(), world.mesh().nodes.as_slice(), "gravity acts");
}

/// On its side the column sags by 15 mm at its end: into a floor that is 5 mm below its mesh, onto a tool below it,
/// and out of one that its mesh holds.
#[test]
fn overlap_is_judged_where_the_body_has_settled() {
    let held = "fixed = [{ node_set = \"x_min\" }]";
    let build = |settle: bool, tool: &str, bodies: &str| {
        let mut scene = column(1e5, settle, "-9.81", held, tool, bodies);
        scene
            .edit(|scene| {
                let lying = BlockDescription { min: [0.0; 3], max: [0.12, 0.03, 0.03], cells: [8, 2, 2] };
                scene.bodies[0].block = Some(lying);
                scene.tools[0].name = "ball".into();
            })
            .unwrap();
        scene.build().map_err(|e| e.to_string())
    };
    let world = build(true, "[1, 1, 1]", "").unwrap();
    let sunk = Simulation::new(&world).unwrap().positions().iter().map(|q| q.z).fold(f64::INFINITY, f64::min);
    println!("lowest node at {:.1} mm", 1e3 * sunk);
    assert!((-0.03..-0.01).contains(&sunk), "{sunk}");

    let floor =
        "[[fixed_body]]\nname = \"floor\"\nposition = [0, 0, -0.005]\nshape = { kind = \"plane\", normal = [0, 0, 1] }";
    let said = build(true, "[1, 1, 1]", floor).err().expect("refused");
    let depth = format!("overlap by {:.4} m", -0.005 - sunk);
    assert!(said.contains(&depth) && said.contains("settle = false"), "{depth}: {said}");
    assert!(build(false, "[1, 1, 1]", floor).is_ok(), "its mesh is above the floor");

    // Below the mesh at its free end, where the settled body is; and in the mesh, where it is no more.
    let below = format!("[0.11, 0.015, {:?}]", sunk + 0.008);
    let said = build(true, &below, "").err().expect("refused");
    assert!(said.contains("inside the body") && said.contains("settle = false"), "{said}");
    assert!(build(false, &below, "").is_ok());
    assert!(build(true, "[0.108, 0.015, 0.018]", "").is_ok());
    assert!(build(false, "[0.108, 0.015, 0.018]", "").err().expect("refused").contains("inside the body"));
}

/// What is told of the begin is what happens.
#[test]
fn a_scene_is_told_to_settle_only_where_it_does() {
    let held = "fixed = [{ below = { axis = \"z\", at = 0.0 } }]";
    for (settle, gravity, fixed, words) in [
        (true, "-9.81", held, "settled before the run"),
        (false, "-9.81", held, "begins as its mesh"),
        (true, "0", held, "begins as its mesh, which has no weight"),
        (true, "-9.81", "", "begins as its mesh, which nothing holds"),
    ] {
        let world = column(5e3, settle, gravity, fixed, "[1, 1, 1]", "").build().unwrap();
        let (said, settled) = (world.understood(), Simulation::new(&world).unwrap().settled().is_some());
        assert!(said.lines().any(|line| line.ends_with(&format!("m/s², {words}"))), "{words}: {said}");
        assert_eq!(settled, words.starts_with("settled"), "{said}");
    }
}
