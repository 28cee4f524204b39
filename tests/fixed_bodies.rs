//! Soft tissue on fixed bodies: weight, friction, rest, and shapes of every kind.

#![allow(clippy::print_stdout)] // tables of what was measured

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

const G: f64 = 9.81;
const FRICTION: f64 = 0.5;

/// A soft block of 8 x 8 x 3 cm whose bottom face lies in z = 0, and bodies in TOML beside it. The tool is far away.
fn scene(gravity: Vector3<f64>, young: f64, step: f64, bodies: &str) -> Scene {
    let text = format!(
        r#"
        name = "block"
        gravity = [{}, {}, {}]
        [rates]
        step = {step}
        [[body]]
        name = "block"
        block = {{ min = [-0.04, -0.04, 0], max = [0.04, 0.04, 0.03], cells = [4, 4, 2] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = {young}, poisson = 0.3 }}
        compliance = "exact"
        tolerance = 1e-13
        [[tool]]
        name = "probe"
        shape = {{ kind = "sphere", radius = 0.005 }}
        [contact]
        friction = {FRICTION}
        [solver]
        tolerance = 1e-10
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.5] }}]
        {bodies}
        "#,
        gravity.x, gravity.y, gravity.z,
    );
    Scene::from_toml(&text, Path::new("")).unwrap()
}

const FLOOR: &str = r#"
[[fixed_body]]
name = "floor"
shape = { kind = "plane", normal = [0, 0, 2] }
"#;

fn away() -> Isometry3<f64> {
    Isometry3::translation(0.0, 0.0, 0.5)
}

fn step(sim: &mut Simulation<'_>) -> StepReport {
    let report = sim.step(&away());
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.bodies.contacts == 0 || report.solve.status == SolveStatus::Solved, "{report:?}");
    report
}

fn mass(world: &World) -> f64 {
    world.model().mass().iter().sum()
}

fn momentum(sim: &Simulation<'_>) -> Vector3<f64> {
    sim.state().fem.v.iter().zip(sim.world().model().mass()).map(|(v, m)| v * *m).sum()
}

fn leaning(angle: f64) -> Vector3<f64> {
    Vector3::new(angle.sin(), 0.0, -angle.cos()) * G
}

#[test]
fn a_floor_carries_the_weight_and_nothing_sinks_into_it() {
    let world = scene(leaning(0.0), 2e4, 100.0, FLOOR).build().unwrap();
    let mut sim = Simulation::new(&world).unwrap();
    let last = (0..300).map(|_| step(&mut sim)).last().unwrap();
    let pair = sim.workspace().pair_force(0).unwrap();
    let weight = mass(&world) * G;
    let deepest = sim.positions().iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
    println!(
        "{} of {} contacts carry {:.9} N of {weight:.9} N; lowest node {deepest:.1e} m",
        pair.active, pair.contacts, pair.normal
    );
    assert_eq!(last.bodies.contacts, 25);
    // What is left of elastic motion after three seconds.
    assert!((pair.normal - weight).abs() < 1e-7 * weight, "{}", pair.normal - weight);
    assert!((pair.force - Vector3::z() * weight).norm() < 1e-6 * weight, "{:?}", pair.force);
    // The solver's tolerance is relative to the free gaps, g h² here.
    assert!(deepest > -1e-9 * G / 1e4, "{deepest}");
    assert_eq!(last.force, Vector3::zeros(), "the tool is far away");
}
