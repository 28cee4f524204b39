//! Soft tissue on fixed bodies: weight, friction, rest, and shapes of every kind.

#![allow(clippy::print_stdout)] // tables of what was measured

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::scene::IntegratorKind;
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
    let last = (0..200).map(|_| step(&mut sim)).last().unwrap();
    let pair = sim.workspace().pair_force(0).unwrap();
    let weight = mass(&world) * G;
    let deepest = sim.positions().iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
    println!(
        "{} of {} contacts carry {:.9} N of {weight:.9} N; lowest node {deepest:.1e} m",
        pair.active, pair.contacts, pair.normal
    );
    assert_eq!(last.bodies.contacts, 25);
    // What is left of elastic motion after two seconds.
    assert!((pair.normal - weight).abs() < 1e-7 * weight, "{}", pair.normal - weight);
    assert!((pair.force - Vector3::z() * weight).norm() < 1e-6 * weight, "{:?}", pair.force);
    // The solver's tolerance of 1e-10 is relative to the free gaps, g h² = 1 mm here.
    assert!(deepest > -1e-12, "{deepest}");
    assert_eq!(last.force, Vector3::zeros(), "the tool is far away");
}

/// Below the angle of friction nothing creeps; above, the block slides with `g (sin θ - friction cos θ)`.
#[test]
fn a_tilted_floor_holds_the_block_below_the_angle_of_friction_and_lets_it_slide_above() {
    for angle in [0.3f64, 0.46, 0.6] {
        let world = scene(leaning(angle), 1e6, 200.0, FLOOR).build().unwrap();
        let mut sim = Simulation::new(&world).unwrap();
        (0..60).for_each(|_| _ = step(&mut sim));
        let (at, from) = (sim.positions().to_vec(), momentum(&sim));
        (0..20).for_each(|_| _ = step(&mut sim));
        let moved = sim.positions().iter().zip(&at).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max);
        let a = (momentum(&sim) - from) / (mass(&world) * 20.0 / 200.0);
        let pair = sim.workspace().pair_force(0).unwrap();
        println!("{angle} rad: moved {moved:.1e} m, a = {:.6} m/s²", a.x);
        if angle.tan() < FRICTION {
            assert!(moved < 1e-10, "{moved}");
            assert!((pair.force.xy().norm() / pair.force.z - angle.tan()).abs() < 1e-5);
        } else {
            let expected = G * (angle.sin() - FRICTION * angle.cos());
            // What is left of elastic motion after 0.3 s, as in the test of the tool as a floor.
            assert!((a.x - expected).abs() < 1e-5 * expected, "{}", a.x - expected);
            assert!((pair.force.xy().norm() / pair.normal - FRICTION).abs() < 1e-6);
        }
    }
}

/// Two triangles a side of a box, as an OBJ file.
fn box_obj(low: [f64; 3], high: [f64; 3]) -> String {
    let mut text = String::new();
    for k in 0..8 {
        let x: Vec<f64> = (0..3).map(|c| if k >> c & 1 == 0 { low[c] } else { high[c] }).collect();
        text += &format!("v {} {} {}\n", x[0], x[1], x[2]);
    }
    for f in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text += &format!("f {} {} {}\nf {} {} {}\n", f[0], f[1], f[2], f[0], f[2], f[3]);
    }
    text
}

/// The same block rests on a floor of every shape, each placed with a rotation where it can bear one, and each carries
/// its weight.
#[test]
fn a_body_of_every_shape_carries_the_block() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.obj"), box_obj([-90.0, -90.0, -20.0], [90.0, 90.0, 0.0])).unwrap();
    let shapes = [
        r#"shape = { kind = "plane", normal = [0, 1, 0] }, rotation = [1.5707963267948966, 0, 0]"#,
        r#"shape = { kind = "box", size = [0.2, 0.02, 0.2] }, rotation = [1.5707963267948966, 0, 0], position = [0, 0, -0.01]"#,
        r#"shape = { kind = "sphere", radius = 3.0 }, position = [0, 0, -3.0]"#,
        r#"shape = { kind = "capsule", half_length = 0.4, radius = 2.0 }, rotation = [0, 1.5707963267948966, 0], position = [0, 0, -2.0]"#,
        r#"shape = { kind = "convex", vertices = [[-0.2, -0.2, 0], [0.2, -0.2, 0], [0, 0.3, 0], [0, 0, -0.1]] }"#,
        r#"shape = { kind = "mesh", file = "slab.obj", scale = 1e-3 }"#,
    ];
    for shape in shapes {
        let body = format!(
            "[[fixed_body]]\nname = \"floor\"\n{}",
            shape.replace(", rotation", "\nrotation").replace(", position", "\nposition")
        );
        let text = scene(leaning(0.0), 2e4, 100.0, &body).text().to_owned();
        let world = Scene::from_toml(&text, folder.path()).unwrap().build().unwrap();
        let mut sim = Simulation::new(&world).unwrap();
        let last = (0..80).map(|_| step(&mut sim)).last().unwrap();
        let (weight, pair) = (mass(&world) * G, sim.workspace().pair_force(0).unwrap());
        println!(
            "{}: {} contacts carry {:.6} of {weight:.6} N",
            world.understood().lines().find(|l| l.starts_with("fixed")).unwrap(),
            pair.active,
            pair.force.z
        );
        // Round floors let the block rock, and rocking dies out slowly.
        assert!((pair.force.z - weight).abs() < 1e-3 * weight, "{shape}: {}", pair.force.z);
        assert!(last.bodies.deepest_gap > -1e-6, "{shape}: {}", last.bodies.deepest_gap);
    }
}

#[test]
fn a_floor_carries_the_block_by_every_integrator() {
    for integrator in [IntegratorKind::Newton, IntegratorKind::Explicit] {
        let mut scene = scene(leaning(0.0), 2e4, 100.0, FLOOR);
        scene
            .edit(|scene| {
                let body = &mut scene.bodies[0];
                (body.integrator, body.compliance, body.tolerance) = (integrator, Default::default(), 1e-6);
                (body.rayleigh_mass, body.rayleigh_stiffness) = (20.0, 1e-5);
                scene.solver.tolerance = 1e-8;
            })
            .unwrap();
        let world = scene.build().unwrap();
        let mut sim = Simulation::new(&world).unwrap();
        (0..60).for_each(|_| assert_eq!(sim.step(&away()).status, StepStatus::Advanced));
        // Explicit contact of a resting block chatters from substep to substep: the mean of its momentum does not.
        let moving = momentum(&sim).norm() / mass(&world);
        let lowest = sim.positions().iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
        println!("{integrator:?}: {moving:.1e} m/s, lowest node {lowest:.1e} m");
        assert!(moving < 1e-3 && lowest > -1e-6, "{integrator:?}: {moving} m/s, {lowest} m");
    }
}

#[test]
fn mistakes_are_told_with_their_place() {
    let gravity = leaning(0.0);
    let good = scene(gravity, 2e4, 100.0, FLOOR).text().to_owned();
    let build = |text: &str| Scene::from_toml(text, Path::new("")).and_then(|s| s.build()).err().map(|e| e.to_string());
    assert_eq!(build(&good), None);
    let ball = "[[rigid_body]]\nname = \"ball\"\nposition = [0, 0, 0.2]\nmass = 0.5\nshape = { kind = \"sphere\", radius = 0.02 }\n";
    assert_eq!(build(&format!("{good}{ball}")), None);
    for (bodies, said) in [
        (FLOOR.replace("[0, 0, 2]", "[0, 0, 0]"), "has no direction"),
        (
            FLOOR.replace(r#"kind = "plane", normal = [0, 0, 2]"#, r#"kind = "box", size = [1, 0, 1]"#),
            "must be positive along each axis",
        ),
        (
            FLOOR.replace(r#"kind = "plane", normal = [0, 0, 2]"#, r#"kind = "mesh", file = "nowhere.obj""#),
            "nowhere.obj",
        ),
        (FLOOR.replace("\"floor\"", "\"block\""), "there is a body named `block` already"),
        (format!("{FLOOR}friction = -0.1\n"), "friction = -0.1"),
        (format!("{FLOOR}max_contacts = 0\n"), "max_contacts = 0"),
        (format!("{FLOOR}position = [0, 0, 0.02]\n"), "overlap by 0.0200 m before the first step"),
        (ball.replace("mass = 0.5", "mass = 0"), "mass = 0 kg is not a positive number"),
        (ball.replace("mass = 0.5", "mass = -2"), "mass = -2 kg is not a positive number"),
        (format!("{ball}inertia = [1e-4, 1e-4, 0]\n"), "are no body's"),
        (format!("{ball}inertia = [1e-4, 1e-4, 3e-4]\n"), "are no body's"),
        (
            ball.replace(r#"kind = "sphere", radius = 0.02"#, r#"kind = "plane", normal = [0, 0, 1]"#),
            "a half-space has no mass",
        ),
        (ball.replace("radius = 0.02", "radius = -0.02"), "radius = -0.02 m must be positive"),
        (ball.replace("0.2]", "nan]"), "not a finite number"),
        (format!("{ball}{}", ball.replace("[0, 0, 0.2]", "[0, 0, 0.3]")), "there is a body named `ball` already"),
        (format!("{ball}{}", ball.replace("\"ball\"", "\"other\"")), "overlap by 0.0400 m"),
        (format!("{FLOOR}colour = 1\n"), "unknown field `colour`"),
    ] {
        let text = good.replace(FLOOR.trim(), "") + &bodies;
        let message = build(&text).unwrap_or_else(|| panic!("accepted: {bodies}"));
        assert!(message.contains(said), "{said:?} is not in: {message}");
        assert!(message.contains(':'), "no place: {message}");
    }
}
