//! The direct approaches of contact against the indirect one: Lagrange multipliers give the same motion, penalty tends to it as
//! its stiffness grows, and fails where a penalty must.

#![allow(clippy::print_stdout)] // tables of what was measured

use crate::block;
use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::constraints::penalty::PenaltyConfig;
use palpate::prelude::*;
use palpate::scene::ContactMethod;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

const G: f64 = 9.81;
const FRICTION: f64 = 0.5;

/// The press-and-slide scene, solved far below what is compared: interior-point programs with cones come to 1e-8.
fn pressed(method: ContactMethod, friction: f64, penalty: Option<PenaltyConfig>) -> World {
    let lagrange = method == ContactMethod::Lagrange;
    block::world(|scene| {
        scene.contact.method = method;
        scene.contact.penalty = penalty;
        // A program of the whole body is slow: 108 free nodes.
        scene.bodies[0].block.as_mut().unwrap().cells = [5, 5, 3];
        scene.contact.friction = friction;
        scene.bodies[0].compliance = ComplianceMethod::Exact;
        scene.bodies[0].tolerance = 1e-11;
        (scene.solver.tolerance, scene.solver.max_sweeps) = (if lagrange { 1e-7 } else { 1e-9 }, 20_000);
    })
}

/// Forces on the nodes and on the tool cancel, to the rounding of their sums.
fn third_law(sim: &Simulation<'_>, report: &StepReport) {
    let mut nodal = vec![0.0; 3 * sim.world().model().free_nodes()];
    sim.workspace().rows().tissue.add_transposed(sim.forces(), &mut nodal);
    let on_body: Vector3<f64> = nodal.chunks_exact(3).map(|f| Vector3::new(f[0], f[1], f[2])).sum();
    let size: f64 = sim.forces().iter().map(|l| l.abs()).sum();
    assert!((on_body + report.force).norm() <= 1e-13 * size, "{on_body:?} {:?}", report.force);
}

/// So many steps of press, slide and release: report and positions of all nodes.
fn slide(world: &World, steps: u64) -> Vec<(StepReport, Vec<Vector3<f64>>)> {
    let mut sim = Simulation::new(world).unwrap();
    let step = |k| {
        let report = sim.step(&block::pose(k));
        assert_eq!(report.status, StepStatus::Advanced);
        third_law(&sim, &report);
        (report, sim.positions().to_vec())
    };
    (0..steps).map(step).collect()
}

/// Both solve the same problem, to 1e-9 and 1e-7 of its gaps (millimetres) and 1e-11 of the motion; sixty steps carry what is
/// left from step to step through a stable body.
#[test]
fn lagrange_multipliers_and_exact_compliance_give_one_motion() {
    // With friction to the middle of the slide: ten programs a step.
    for (friction, steps) in [(0.0, block::STEPS), (0.3, 30)] {
        let expected = slide(&pressed(ContactMethod::Compliance, friction, None), steps);
        let found = slide(&pressed(ContactMethod::Lagrange, friction, None), steps);
        let largest = expected.iter().map(|(report, _)| report.force.norm()).fold(0.0, f64::max);
        let (mut force, mut place, mut residual, mut active) = (0.0f64, 0.0f64, 0.0f64, 0);
        for ((a, x), (b, y)) in expected.iter().zip(&found) {
            assert_eq!(a.detection.contacts, b.detection.contacts);
            assert!(b.detection.contacts == 0 || b.solve.status == SolveStatus::Solved, "{:?}", b.solve);
            force = force.max((a.force - b.force).norm() / largest);
            place = place.max(block::distance(x, y));
            residual = residual.max(b.solve.residual);
            active = active.max(b.active);
        }
        println!(
            "friction {friction}: forces differ by {force:.1e} of {largest:.3} N, places by {place:.1e} m; residual {residual:.1e}, {active} contacts"
        );
        assert!(active >= 2 && largest > 0.3, "{active} contacts, {largest} N");
        assert!(force < 1e-5 && place < 1e-8, "{force} {place}");
        // The balance is restored by a linear solve after the program, without the forces that the program left on open
        // contacts, each of them within the tolerance of 1e-7 and up to five at once; the gaps of that motion are what is judged.
        assert!(residual < 6e-7, "{residual}");
    }
}

/// From one state in press, slide and release, one step each: the error of the force falls as 1/k, with friction and without, so
/// that the answer of Signorini's and Coulomb's laws is the limit.
#[test]
fn penalty_tends_to_the_law_of_contact_at_first_order_in_compliance() {
    for (friction, begin) in [(0.0, 15), (0.0, 45), (0.3, 15), (0.3, 30), (0.3, 38)] {
        let law = pressed(ContactMethod::Compliance, friction, None);
        let mut exact = Simulation::new(&law).unwrap();
        (0..begin).for_each(|k| _ = exact.step(&block::pose(k)));
        let (fem, tool, contacts) = (exact.state().fem.clone(), exact.state().tool, exact.state().contacts.clone());
        let expected = exact.step(&block::pose(begin));
        let error = |stiffness| {
            let penalty = PenaltyConfig { stiffness: Some(stiffness), damping: 0.0, ..PenaltyConfig::default() };
            let world = pressed(ContactMethod::Penalty, friction, Some(penalty));
            let mut sim = Simulation::new(&world).unwrap();
            let state = sim.state_mut();
            (state.fem, state.tool, state.contacts) = (fem.clone(), tool, contacts.clone());
            let report = sim.step(&block::pose(begin));
            third_law(&sim, &report);
            assert_eq!(report.solve.status, SolveStatus::Solved, "{:?}", report.solve);
            ((report.force - expected.force).norm() / expected.force.norm(), report.solve.residual)
        };
        let measured = [1e2, 1e4, 1e5, 1e6].map(error);
        let order = (measured[2].0 / measured[3].0).log10();
        println!(
            "friction {friction}, step {begin}, {} contacts: error and residual {measured:.5?}, order {order:.3}",
            expected.active
        );
        assert!(expected.active >= 2);
        // The force depends on the stiffness, ...
        assert!(measured[0].0 > 0.05, "{measured:?}");
        // ... and ten times the stiffness leaves a tenth of the error, up to terms of 1/k².
        assert!((order - 1.0).abs() < 0.02, "order {order}: {measured:?}");
    }
}

/// A free block of 8 x 8 x 3 cm and 1 MPa on a level floor, with gravity leaning by `angle` (rad) and `height` (m) above it.
fn incline(method: &str, angle: f64, height: f64, rate: f64) -> World {
    let text = format!(
        r#"
        name = "incline"
        gravity = [{}, 0, {}]
        [rates]
        step = {rate}
        tick = 2000
        [[body]]
        name = "block"
        block = {{ min = [-0.04, -0.04, {height}], max = [0.04, 0.04, {}], cells = [3, 3, 2] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = 1e6, poisson = 0.3 }}
        compliance = "exact"
        tolerance = 1e-12
        [[tool]]
        name = "floor"
        shape = {{ kind = "convex", vertices = [
            [-9, -9, -1], [9, -9, -1], [-9, 9, -1], [9, 9, -1], [-9, -9, 0], [9, -9, 0], [-9, 9, 0], [9, 9, 0]] }}
        [contact]
        at = "nodes"
        friction = {FRICTION}
        {method}
        [solver]
        tolerance = {}
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0] }}]
        "#,
        G * angle.sin(),
        -G * angle.cos(),
        height + 0.03,
        if method.contains("lagrange") { 1e-7 } else { 1e-9 },
    );
    Scene::from_toml(&text, std::path::Path::new("")).unwrap().build().unwrap()
}

fn mass(world: &World) -> f64 {
    world.model().mass().iter().sum()
}

/// Mean velocity of the body (m/s).
fn velocity(sim: &Simulation<'_>) -> Vector3<f64> {
    let momentum: Vector3<f64> = sim.state().fem.v.iter().zip(sim.world().model().mass()).map(|(v, m)| v * *m).sum();
    momentum / mass(sim.world())
}

/// One step on the floor, in which momentum must balance: gravity and the reported force are all there is.
fn settled_step(sim: &mut Simulation<'_>) -> StepReport {
    let (m, dt) = (mass(sim.world()), sim.world().dt());
    let before = velocity(sim);
    let report = sim.step(&Isometry3::identity());
    assert_eq!(report.status, StepStatus::Advanced);
    third_law(sim, &report);
    let gravity = Vector3::from(sim.world().description().gravity);
    let unaccounted = (velocity(sim) - before) * (m / dt) - gravity * m + report.force;
    // The balance of the contact solve is good to 1e-9 of the contact forces.
    assert!(unaccounted.norm() < 1e-7 * m * G, "{unaccounted:?} N");
    report
}

const DT: f64 = 0.005;

/// Above the angle of friction a block slides with `g (sin θ - μ cos θ)` whatever the method: the penalty's friction is then
/// on the cone as well.
#[test]
fn a_block_slides_with_the_acceleration_of_coulomb_by_both() {
    let angle = 0.6f64;
    let expected = G * (angle.sin() - FRICTION * angle.cos());
    for method in ["method = \"lagrange\"", "method = \"penalty\"\npenalty = { stiffness = 1e4 }"] {
        let world = incline(method, angle, 0.0, 1.0 / DT);
        let mut sim = Simulation::new(&world).unwrap();
        (0..30).for_each(|_| _ = settled_step(&mut sim));
        let from = velocity(&sim);
        (0..10).for_each(|_| _ = settled_step(&mut sim));
        let a = (velocity(&sim) - from) / (10.0 * DT);
        println!("{method}: a = {:.6} of {expected:.6} m/s²", a.x);
        assert!((a - Vector3::x() * expected).norm() < 1e-4 * expected, "{method}: {a:?}");
    }
}

/// Below it, Lagrange multipliers hold the block to the tolerances of the solver and of the free motion.
#[test]
fn a_block_sticks_by_lagrange_multipliers() {
    let world = incline("method = \"lagrange\"", 0.4, 0.0, 1.0 / DT);
    let mut sim = Simulation::new(&world).unwrap();
    (0..80).for_each(|_| _ = settled_step(&mut sim));
    let before = sim.positions().to_vec();
    (0..10).for_each(|_| _ = settled_step(&mut sim));
    let moved = block::distance(sim.positions(), &before);
    println!("moved by {moved:.1e} m in 10 steps");
    assert!(moved < 1e-9, "{moved}");
}

/// Penalty does what its doc says it must: the weight sinks in by `m g cos θ / (n k)`, and the block creeps by
/// `m g sin θ / (n k)` in every step.
#[test]
fn a_block_on_penalty_sinks_by_its_weight_over_stiffness_and_creeps() {
    let angle = 0.1f64;
    for stiffness in [2e3, 2e4] {
        let method = format!("method = \"penalty\"\npenalty = {{ stiffness = {stiffness}, damping = 0.01 }}");
        let world = incline(&method, angle, 0.0, 1.0 / DT);
        let mut sim = Simulation::new(&world).unwrap();
        (0..200).for_each(|_| _ = settled_step(&mut sim));
        let report = settled_step(&mut sim);
        let (m, n) = (mass(&world), report.active as f64);
        let bottom: Vec<f64> = sim.positions().iter().map(|x| x.z).filter(|z| *z < 0.01).collect();
        let depth = -bottom.iter().sum::<f64>() / bottom.len() as f64;
        let (sunk, crept) = (m * G * angle.cos() / (n * stiffness), m * G * angle.sin() / (n * stiffness));
        let creep = velocity(&sim).x * DT;
        println!(
            "{stiffness} N/m: depth {depth:.4e} of {sunk:.4e} m, creep {creep:.4e} of {crept:.4e} m a step, residual {:.1e}",
            report.solve.residual
        );
        assert_eq!(bottom.len(), report.active);
        assert!((depth / sunk - 1.0).abs() < 1e-3, "{depth} {sunk}");
        assert!((creep / crept - 1.0).abs() < 1e-3, "{creep} {crept}");
    }
}

/// Dropped by 1 mm, the block rebounds from springs without dampers and chatters; where it lands by the law of contact it
/// stays, as backward Euler's impact is plastic, and a damper ends the chatter.
#[test]
fn undamped_penalty_chatters_where_the_law_of_contact_does_not() {
    let partings = |method: &str| {
        let world = incline(method, 0.0, 1e-3, 2000.0);
        let mut sim = Simulation::new(&world).unwrap();
        let (mut landed, mut partings, mut touching) = (false, 0, false);
        for _ in 0..400 {
            let report = settled_step(&mut sim);
            partings += usize::from(touching && report.active == 0);
            touching = report.active > 0;
            landed |= touching;
        }
        assert!(landed, "{method}");
        partings
    };
    let undamped = partings("method = \"penalty\"\npenalty = { stiffness = 2e3, damping = 0 }");
    let damped = partings("method = \"penalty\"\npenalty = { stiffness = 2e3, damping = 0.02 }");
    let law = partings("");
    println!("partings in 0.2 s: undamped {undamped}, damped {damped}, by the law {law}");
    assert!(undamped >= 2 && damped < undamped && law <= damped, "{undamped} {damped} {law}");
}
