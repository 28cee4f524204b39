//! The direct approaches of contact with fixed and rigid bodies, and on a body that changes: Lagrange multipliers give the motion
//! of exact compliance, springs carry weights with the penetration that they must, and what one body loses the others gain.

#![allow(clippy::print_stdout)] // tables of what was measured

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

const G: f64 = 9.81;

const FLOOR: &str = r#"
[[fixed_body]]
name = "floor"
shape = { kind = "plane", normal = [0, 0, 1] }
"#;

/// A ball of 0.3 kg above the block.
const BALL: &str = r#"
[[rigid_body]]
name = "ball"
shape = { kind = "sphere", radius = 0.03 }
mass = 0.3
position = [0.002, 0.001, 0.0605]
"#;

/// Another that falls onto the first beside its top.
const SECOND: &str = r#"
[[rigid_body]]
name = "second"
shape = { kind = "sphere", radius = 0.02 }
mass = 0.1
position = [0.012, 0.001, 0.11]
"#;

/// A soft block of 8 x 8 x 3 cm on z = 0, by a method of contact and with more in TOML. The tool is far away.
fn world(method: &str, gravity: [f64; 3], held: bool, more: &str) -> World {
    let fixed = if held { "fixed = [{ below = { axis = \"z\", at = 1e-9 } }]" } else { "" };
    let tolerance = if method.contains("lagrange") { 1e-7 } else { 1e-10 };
    let text = format!(
        r#"
        name = "bodies"
        gravity = {gravity:?}
        [rates]
        step = 100
        tick = 1000
        [[body]]
        name = "block"
        block = {{ min = [-0.04, -0.04, 0], max = [0.04, 0.04, 0.03], cells = [4, 4, 2] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = 2e4, poisson = 0.4 }}
        compliance = "exact"
        tolerance = 1e-12
        {fixed}
        [[tool]]
        name = "probe"
        shape = {{ kind = "sphere", radius = 0.01 }}
        [contact]
        friction = 0.5
        {method}
        [solver]
        tolerance = {tolerance}
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.8] }}]
        {more}
        "#
    );
    Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap()
}

const LAGRANGE: &str = "method = \"lagrange\"";

fn penalty(stiffness: f64) -> String {
    format!("method = \"penalty\"\npenalty = {{ stiffness = {stiffness}, damping = 0.01 }}")
}

fn step(sim: &mut Simulation<'_>) -> StepReport {
    let report = sim.step(&Isometry3::translation(0.0, 0.0, 0.8));
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.rows.rows == 0 || report.solve.status == SolveStatus::Solved, "{:?}", report.solve);
    report
}

/// Where everything is: nodes, then the centres of the rigid bodies.
fn places(sim: &Simulation<'_>) -> Vec<Vector3<f64>> {
    let rigid = sim.state().rigid.iter().map(|body| body.pose.translation.vector);
    sim.positions().iter().copied().chain(rigid).collect()
}

/// Momentum of all bodies (kg m/s).
fn momentum(sim: &Simulation<'_>) -> Vector3<f64> {
    let soft: Vector3<f64> = sim.state().fem.v.iter().zip(sim.world().model().mass()).map(|(v, m)| v * *m).sum();
    let rigid = sim.world().bodies().rigid.iter().zip(&sim.state().rigid);
    soft + rigid.map(|(body, state)| state.velocity * body.model.mass()).sum::<Vector3<f64>>()
}

/// Both solve one problem, to 1e-10 and 1e-7 of gaps that are millimetres at most: 1e-10 m a step, and twenty steps carry it on
/// for some steps each.
#[test]
fn lagrange_multipliers_give_the_motion_of_exact_compliance_with_bodies_of_every_kind() {
    let leaning = |slope: f64| [G * slope, 0.0, -G];
    let cut = "[[event]]\ntime = 0.05\nremove = { above = { axis = \"x\", at = 0.02 } }\n";
    let released = "[[event]]\ntime = 0.05\nrelease = { node_set = \"z_min\" }\n";
    for (name, gravity, held, more) in [
        ("tissue on a floor", leaning(0.7), false, FLOOR.to_string()),
        ("a ball on tissue", leaning(0.2), true, BALL.into()),
        ("two balls, tissue and a floor", [0.0, 0.0, -G], false, format!("{FLOOR}{BALL}{SECOND}")),
        ("tissue that is cut", leaning(0.2), false, format!("{FLOOR}{BALL}{cut}")),
        ("tissue that is let go", [0.0, 0.0, -G], true, format!("{FLOOR}{BALL}{released}")),
    ] {
        let worlds = ["", LAGRANGE].map(|method| world(method, gravity, held, &more));
        let [mut exact, mut direct] = worlds.each_ref().map(|world| Simulation::new(world).unwrap());
        let (mut far, mut active, mut moved) = (0.0f64, 0, 0.0f64);
        let start = places(&exact);
        for _ in 0..20 {
            let (a, b) = (step(&mut exact), step(&mut direct));
            assert_eq!(a.bodies.contacts, b.bodies.contacts, "{name}");
            active = active.max(b.bodies.active);
            let (x, y) = (places(&exact), places(&direct));
            far = x.iter().zip(&y).map(|(x, y)| (x - y).norm()).fold(far, f64::max);
            moved = x.iter().zip(&start).map(|(x, y)| (x - y).norm()).fold(moved, f64::max);
        }
        println!("{name}: up to {active} contacts, moved by {moved:.1e} m, apart by {far:.1e} m");
        assert!(active >= 2 && moved > 1e-3, "{name}: {active} contacts, {moved} m");
        assert!(far < 1e-8, "{name}: {far} m");
    }
}

/// Nothing but contact acts: what the ball loses the block gains, to the balance that the solve is asked for. Spin and slip bring
/// friction in.
#[test]
fn what_a_ball_loses_the_block_gains() {
    let flying = format!("{BALL}velocity = [0.4, -0.1, -1.5]\nangular_velocity = [3, 20, -5]\n");
    for method in [LAGRANGE.to_string(), penalty(2e3)] {
        let world = world(&method, [0.0; 3], false, &flying);
        let mut sim = Simulation::new(&world).unwrap();
        let (before, ball) = (momentum(&sim), sim.state().rigid[0].velocity);
        let mut active = 0;
        (0..20).for_each(|_| active = active.max(step(&mut sim).bodies.active));
        let (lost, gained) = (momentum(&sim) - before, (sim.state().rigid[0].velocity - ball).norm());
        println!("{method}: {active} contacts, the ball's velocity changes by {gained:.3} m/s, momentum by {lost:?}");
        assert!(active >= 2 && gained > 0.5);
        // Of about 0.45 kg m/s; twenty steps that balance to 1e-10.
        assert!(lost.norm() < 1e-9, "{method}: {lost:?}");
    }
}

/// Springs under weight: the block's lower nodes lie below the floor by `m g / (n k)`, and the ball that rolls nowhere lies in
/// the floor by its own weight over one spring.
#[test]
fn springs_carry_weights_with_the_penetration_that_they_must() {
    let apart = BALL.replace("[0.002, 0.001, 0.0605]", "[0.2, 0.0, 0.03]");
    for stiffness in [2e3, 2e4] {
        let world = world(&penalty(stiffness), [0.0, 0.0, -G], false, &format!("{FLOOR}{apart}"));
        let mut sim = Simulation::new(&world).unwrap();
        let report = (0..300).map(|_| step(&mut sim)).last().unwrap();
        let mass: f64 = world.model().mass().iter().sum();
        let bottom: Vec<f64> = sim.positions().iter().map(|x| x.z).filter(|z| *z < 0.01).collect();
        let n = bottom.len();
        let (depth, sunk) = (-bottom.iter().sum::<f64>() / n as f64, mass * G / (n as f64 * stiffness));
        let (ball, rests) = (0.03 - sim.state().rigid[0].pose.translation.z, 0.3 * G / stiffness);
        println!("{stiffness} N/m: block {depth:.5e} of {sunk:.5e} m, ball {ball:.5e} of {rests:.5e} m");
        assert_eq!(report.bodies.active as usize, n + 1, "each lower node and the ball");
        assert!((depth / sunk - 1.0).abs() < 1e-4 && (ball / rests - 1.0).abs() < 1e-4);
    }
}
