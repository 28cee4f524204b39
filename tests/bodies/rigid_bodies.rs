//! Rigid bodies with tissue, with fixed bodies, with the tool, with one another, and alone.

#![allow(clippy::print_stdout)] // tables of what was measured

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::replay::replay;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};
use palpate::trace::{Trace, TraceConfig, TraceWriter};
use rayon::ThreadPoolBuilder;

const G: f64 = 9.81;
const FRICTION: f64 = 0.5;

/// A soft block of 8 x 8 x 3 cm, held at z = 0 where `held`, at the height `z`, and bodies in TOML beside it.
fn world(gravity: Vector3<f64>, step: f64, z: f64, held: bool, bodies: &str) -> World {
    let fixed =
        if held { format!("fixed = [{{ below = {{ axis = \"z\", at = {} }} }}]", z + 1e-9) } else { String::new() };
    let text = format!(
        r#"
        name = "bodies"
        gravity = [{}, {}, {}]
        [rates]
        step = {step}
        tick = {}
        [[body]]
        name = "block"
        block = {{ min = [-0.04, -0.04, {z}], max = [0.04, 0.04, {}], cells = [6, 6, 3] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = 2e4, poisson = 0.4 }}
        compliance = "exact"
        tolerance = 1e-13
        {fixed}
        [[tool]]
        name = "probe"
        shape = {{ kind = "sphere", radius = 0.01 }}
        [contact]
        friction = {FRICTION}
        [solver]
        tolerance = 1e-10
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.8] }}]
        {bodies}
        "#,
        gravity.x,
        gravity.y,
        gravity.z,
        step.max(1000.0),
        z + 0.03,
    );
    Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap()
}

fn away() -> Isometry3<f64> {
    Isometry3::translation(0.0, 0.0, 0.8)
}

fn step(sim: &mut Simulation<'_>) -> StepReport {
    let report = sim.step(&away());
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.rows.rows == 0 || report.solve.status == SolveStatus::Solved, "{report:?}");
    report
}

fn down() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -G)
}

const BALL: &str = r#"
[[rigid_body]]
name = "ball"
shape = { kind = "sphere", radius = 0.03 }
mass = 0.3
position = [0.002, 0.001, 0.0605]
"#;

/// Index of the pair of tissue and the first rigid body.
fn soft_and_rigid(world: &World) -> usize {
    use palpate::world::{Far, Near};
    let wanted = |pair: &palpate::world::Pair| (pair.near, pair.far) == (Near::Soft, Far::Rigid(0));
    world.bodies().pairs.iter().position(wanted).unwrap()
}

#[test]
fn a_ball_at_rest_on_tissue_presses_with_its_weight() {
    let world = world(down(), 50.0, 0.0, true, BALL);
    let mut sim = Simulation::new(&world).unwrap();
    let last = (0..150).map(|_| step(&mut sim)).last().unwrap();
    let pair = sim.workspace().pair_force(soft_and_rigid(&world)).unwrap();
    let (weight, ball) = (0.3 * G, sim.state().rigid[0]);
    println!(
        "{} of {} contacts carry {:?} N of {weight:.6} N, sunk by {:.3} mm, {:.1e} m/s",
        pair.active,
        pair.contacts,
        pair.force.as_slice(),
        1e3 * (0.06 - ball.pose.translation.z),
        ball.velocity.norm()
    );
    // The normals point to the tissue: the ball presses down.
    assert!((pair.force.z + weight).abs() < 1e-5 * weight, "{}", pair.force.z);
    assert!(ball.velocity.norm() < 1e-6 && pair.active >= 5, "at rest, in a dent");
    // A gap that is found is closed within the step that finds it, but for the turn of the normals.
    assert!(last.bodies.deepest_gap > -1e-6, "{}", last.bodies.deepest_gap);
}

/// Momentum of the tissue and of all rigid bodies (kg m/s).
fn momentum(sim: &Simulation<'_>) -> Vector3<f64> {
    let soft: Vector3<f64> = sim.state().fem.v.iter().zip(sim.world().model().mass()).map(|(v, m)| v * *m).sum();
    let bodies = &sim.world().bodies().rigid;
    soft + bodies
        .iter()
        .zip(&sim.state().rigid)
        .map(|(body, state)| state.velocity * body.model.mass())
        .sum::<Vector3<f64>>()
}

#[test]
fn a_ball_that_hits_a_free_block_gives_it_what_it_loses() {
    let flying = format!("{BALL}velocity = [0.4, -0.1, -1.5]\nangular_velocity = [3, 20, -5]\n");
    for integrator in ["backward_euler", "newton", "explicit"] {
        let mut scene = world(Vector3::zeros(), 100.0, 0.0, false, &flying).scene().clone();
        let text =
            scene.text().replace("tolerance = 1e-13", &format!("integrator = \"{integrator}\"\n tolerance = 1e-13"));
        scene = Scene::from_toml(&text, Path::new("")).unwrap();
        scene
            .edit(|scene| {
                let body = &mut scene.bodies[0];
                match integrator {
                    "newton" => {
                        body.newton = Some(palpate::scene::NewtonDescription { iterations: 40, tolerance: 1e-12 })
                    }
                    "explicit" => (body.rayleigh_stiffness, scene.solver.tolerance) = (1e-5, 1e-8),
                    _ => {}
                }
            })
            .unwrap();
        let world = scene.build().unwrap();
        let mut sim = Simulation::new(&world).unwrap();
        let before = momentum(&sim);
        let (mut touched, mut strongest) = (0, 0.0_f64);
        for _ in 0..30 {
            let report = sim.step(&away());
            assert_eq!(report.status, StepStatus::Advanced);
            touched += u32::from(report.bodies.active > 0);
            strongest = strongest.max(sim.workspace().pair_force(soft_and_rigid(&world)).unwrap().normal);
        }
        let lost = (momentum(&sim) - before).norm() / before.norm();
        let ball = &sim.state().rigid[0];
        println!("{integrator}: {touched} steps in contact, up to {strongest:.1} N, momentum changes by {lost:.1e}");
        assert!(touched > 0 && (ball.velocity.z + 1.5).abs() > 0.1, "they met: {ball:?}");
        // Newton's method and conjugate gradients leave what their tolerance says of forces far above the momentum's.
        assert!(lost < 1e-10, "{integrator}: {lost}");
    }
}

const INCLINE: &str = r#"
[[fixed_body]]
name = "floor"
shape = { kind = "plane", normal = [0, 0, 1] }
[[rigid_body]]
name = "brick"
shape = { kind = "box", size = [0.06, 0.04, 0.02] }
mass = 0.2
position = [0, 0, 0.01]
"#;

/// Runs the brick for `time` (s) under gravity that leans by `angle` (rad); the tissue is out of the way.
fn slide(angle: f64, rate: f64, time: f64, bodies: &str) -> (Vector3<f64>, Vector3<f64>) {
    let gravity = Vector3::new(angle.sin(), 0.0, -angle.cos()) * G;
    let world = world(gravity, rate, 0.5, true, bodies);
    let mut sim = Simulation::new(&world).unwrap();
    let from = sim.state().rigid[0].pose.translation.vector;
    (0..(time * rate).round() as usize).for_each(|_| _ = step(&mut sim));
    let state = sim.state().rigid[0];
    (state.pose.translation.vector - from, state.velocity)
}

/// Semi-implicit Euler gives the velocity under a constant force exactly and the place to first order: it is `a t h / 2`
/// ahead of `a t² / 2`.
#[test]
fn a_brick_slides_down_a_slope_with_coulombs_acceleration_to_first_order() {
    let (angle, time) = (0.7f64, 0.4);
    let a = G * (angle.sin() - FRICTION * angle.cos());
    let mut errors = Vec::new();
    for rate in [50.0, 100.0, 200.0] {
        let (path, v) = slide(angle, rate, time, INCLINE);
        let ahead = path.x - 0.5 * a * time * time;
        println!("{rate} Hz: {:.9} m/s of {:.9}, {ahead:.3e} m ahead", v.x, a * time);
        assert!((v.x - a * time).abs() < 1e-7 * a, "{}", v.x - a * time);
        assert!((ahead - 0.5 * a * time / rate).abs() < 1e-7, "{ahead}");
        assert!(path.z.abs() < 1e-9 && path.y.abs() < 1e-9, "{path:?}");
        errors.push(ahead);
    }
    let order = (errors[0] / errors[2]).log2() / 2.0;
    assert!((order - 1.0).abs() < 1e-3, "order {order}");
    let (path, v) = slide(0.46, 100.0, 0.5, INCLINE);
    assert!(path.norm() < 1e-9 && v.norm() < 1e-9, "it sticks below the angle of friction: {path:?} {v:?}");
}

/// A ball that rolls without slipping falls with 5/7 of the slope's acceleration; without friction with all of it.
#[test]
fn a_ball_rolls_with_five_sevenths() {
    let ball = INCLINE.replace(r#"kind = "box", size = [0.06, 0.04, 0.02]"#, r#"kind = "sphere", radius = 0.01"#);
    let (angle, time) = (0.3f64, 0.5);
    let (_, v) = slide(angle, 200.0, time, &ball);
    let rolling = 5.0 / 7.0 * G * angle.sin() * time;
    println!("{} of {rolling} m/s", v.x);
    // The lever of the contact is that of the step's begin: one part in (v h / r)² of it turns away.
    assert!((v.x - rolling).abs() < 1e-6 * rolling, "{}", v.x - rolling);
    let (_, v) = slide(angle, 200.0, time, &format!("{ball}friction = 0\n"));
    assert!((v.x - G * angle.sin() * time).abs() < 1e-9, "a pair of which one has no friction has none: {}", v.x);
}

#[test]
fn a_stack_of_bricks_on_a_floor_stands_and_passes_the_weight_on() {
    let brick = |k: usize| {
        format!(
            "[[rigid_body]]\nname = \"brick{k}\"\nmass = 0.2\nposition = [{}, 0, {}]\nrotation = [0, 0, {}]\nshape = {{ kind = \"box\", size = [0.06, 0.04, 0.02] }}\n",
            0.003 * k as f64,
            0.01 + 0.02 * k as f64,
            0.4 * k as f64,
        )
    };
    let floor =
        "[[fixed_body]]\nname = \"floor\"\nshape = { kind = \"box\", size = [1, 1, 0.1] }\nposition = [0, 0, -0.05]\n";
    let bodies = format!("{floor}{}{}{}", brick(0), brick(1), brick(2));
    let world = world(down(), 100.0, 0.5, true, &bodies);
    let mut sim = Simulation::new(&world).unwrap();
    (0..100).for_each(|_| _ = step(&mut sim));
    let heights: Vec<f64> = sim.state().rigid.iter().map(|b| b.pose.translation.z).collect();
    let names = |k: usize| world.bodies().pairs[k];
    let mut seen = 0;
    for k in 0..world.bodies().pairs.len() {
        use palpate::world::{Far, Near};
        let above = match (names(k).near, names(k).far) {
            (Near::Rigid(0), Far::Fixed(0)) => 3.0,
            (Near::Rigid(0), Far::Rigid(1)) => -2.0,
            (Near::Rigid(1), Far::Rigid(2)) => -1.0,
            _ => 0.0,
        };
        let force = sim.workspace().pair_force(k).unwrap().force;
        seen += u32::from(above != 0.0);
        assert!((force - Vector3::z() * (above * 0.2 * G)).norm() < 1e-6, "{:?}: {force:?}", names(k));
    }
    println!("heights {heights:?}");
    assert_eq!(seen, 3);
    assert!(heights.iter().enumerate().all(|(k, z)| (z - 0.01 - 0.02 * k as f64).abs() < 1e-9), "{heights:?}");
}

/// The tool pushes a ball that floats: what the ball gains in momentum the hand gives.
#[test]
fn the_tool_pushes_a_ball_and_feels_it() {
    let world = world(Vector3::zeros(), 100.0, 0.0, true, &BALL.replace("0.0605", "0.3"));
    let mut sim = Simulation::new(&world).unwrap();
    let mut felt = Vector3::zeros();
    for k in 0..20 {
        let before = momentum(&sim);
        let report = sim.step(&Isometry3::translation(0.004, 0.0, 0.345 - 0.001 * f64::from(k)));
        assert_eq!(report.status, StepStatus::Advanced);
        let gained = (momentum(&sim) - before) * 100.0;
        assert!((gained + report.force).norm() < 1e-9, "{gained:?} {:?}", report.force);
        felt += report.force * 0.01;
        // The tick gets the row: the ball gives way by h² / m along the normal that is found first.
        let snapshot = sim.snapshot();
        assert!(snapshot.valid && snapshot.contacts() == report.bodies.contacts as usize);
        if snapshot.contacts() > 0 {
            let rows = snapshot.tool_rows().iter().zip(snapshot.lambda());
            let handed: Vector3<f64> = rows.map(|(row, l)| Vector3::new(row[0], row[1], row[2]) * *l).sum();
            assert!((handed - report.force).norm() < 1e-12, "{handed:?} {:?}", report.force);
            assert!((snapshot.compliance()[0] - 1e-4 / 0.3).abs() < 1e-12, "{}", snapshot.compliance()[0]);
        }
    }
    let ball = sim.state().rigid[0];
    println!("the ball flies with {:?} m/s", ball.velocity.as_slice());
    assert!(felt.z > 0.01 && ball.velocity.z < -0.05, "{felt:?}");
}

#[test]
fn a_step_that_fails_puts_every_body_back_at_rest() {
    let world = world(down(), 50.0, 0.0, true, BALL);
    let mut sim = Simulation::new(&world).unwrap();
    (0..10).for_each(|_| _ = step(&mut sim));
    let spoils: [fn(&mut Simulation<'_>); 3] = [
        |sim| sim.state_mut().fem.v[150].x = f64::NAN,
        |sim| sim.state_mut().rigid[0].velocity.x = f64::NAN,
        |sim| sim.state_mut().rigid[0].angular_momentum.y = f64::INFINITY,
    ];
    for spoil in spoils {
        let before = sim.state().rigid[0].pose;
        spoil(&mut sim);
        let report = sim.step(&away());
        assert_eq!(report.status, StepStatus::RolledBack);
        assert!(!sim.snapshot().valid, "the tick sends no force");
        let ball = sim.state().rigid[0];
        assert_eq!((ball.pose, ball.velocity, ball.angular_momentum), (before, Vector3::zeros(), Vector3::zeros()));
        (0..3).for_each(|_| _ = step(&mut sim));
    }
}

/// A trace holds where every rigid body was after every step, and the frame that its shape is drawn in; a replay computes
/// the same bits, and notices one that was changed.
#[test]
fn a_trace_holds_the_bodies_and_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (folder.path().join("run.mcap"), folder.path().join("copy.mcap"));
    let world = world(down(), 50.0, 0.0, true, &format!("{INCLINE}{BALL}").replace("[0, 0, 0.01]", "[0.1, 0, 0.05]"));
    let options =
        RunOptions { length: Length::Seconds(0.4), lockstep: true, trace: Some(path.clone()), ..RunOptions::default() };
    let outcome = run(&world, &options, &AtomicBool::new(false), &mut Unobserved).unwrap();
    let trace = Trace::load(&path).unwrap();
    assert_eq!(trace.rigid.len() as u64, 2 * outcome.summary.steps);
    let last = trace.rigid.last().unwrap();
    let end = &outcome.summary.rigid_bodies[1];
    assert_eq!((last.body, end.name.as_str(), last.position), (1, "ball", end.position));
    assert!(trace.rigid.iter().any(|r| r.body == 0 && r.velocity[2] < -0.1), "the brick falls");
    assert_eq!(trace.others.get("/body/shapes"), Some(&1));
    // Two frames for each step, and those of tool and device every ten ticks.
    assert!(trace.others["/tf"] as usize > trace.rigid.len());
    assert!(replay(&path).unwrap().is_identical());

    let mut changed = trace.clone();
    let x = &mut changed.rigid[11].position[0];
    *x = f64::from_bits(x.to_bits() ^ 1);
    let config = TraceConfig {
        engine: trace.metadata["engine"]
            .iter()
            .filter(|(k, _)| *k != "start_unix_ns")
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect(),
        attachments: trace.attachments.clone(),
        ..TraceConfig::default()
    };
    let mut writer = TraceWriter::create(&copy, &config).unwrap();
    changed.ticks.iter().for_each(|tick| writer.write_tick(tick).unwrap());
    changed.rigid.iter().for_each(|body| writer.write_rigid(body).unwrap());
    writer.write_metadata("end", trace.metadata["end"].clone()).unwrap();
    assert!(writer.finish().2.is_none());
    let report = replay(&copy).unwrap();
    assert_eq!((report.first_difference, report.first_body_difference, report.is_identical()), (None, Some(5), false));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let bodies = format!("{INCLINE}{BALL}angular_velocity = [1, 2, 3]\n");
    let bodies = bodies.replace("[0, 0, 0.01]", "[0.1, 0, 0.01]");
    let run = |threads: usize| {
        ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let world = world(down(), 50.0, 0.0, false, &bodies);
            let mut sim = Simulation::new(&world).unwrap();
            let digests: Vec<u64> = (0..40).map(|_| step(&mut sim).bodies.digest).collect();
            let bits: Vec<u64> =
                sim.positions().iter().flat_map(|x| x.iter().map(|c| c.to_bits()).collect::<Vec<_>>()).collect();
            (digests, bits)
        })
    };
    let one = run(1);
    assert!(one.0.windows(2).all(|w| w[0] != w[1]), "the bodies move");
    assert!(run(2) == one && run(4) == one);
}
