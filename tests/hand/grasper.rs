//! Jaws on what they hold: forces equal and opposite, lifted by friction or slipping as Coulomb says, a torque of the
//! gripper in closed form, and the same answer from patches and frozen rows.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use crate::jaws;

use nalgebra::{Isometry3, Vector3};
use palpate::collision::ToolPose;
use palpate::collision::tool::{Jaw, jaw_of};
use palpate::prelude::*;
use palpate::run::{Length, RunOptions};
use palpate::scene::TickMethod;
use palpate::step::StepStatus;

use crate::jaws::{GRASPER, HALF, RADIUS, REACH, gripper, opening};

const DT: f64 = 0.005;
const G: f64 = 9.81;

/// A cube of 2 cm that nothing holds but the jaws, stiff enough to yield by tenths of a millimetre.
fn cube(gravity: f64, friction: f64) -> World {
    jaws::world(&format!(
        r#"
        name = "cube"
        gravity = [0, 0, {gravity}]
        [rates]
        step = {}
        [[body]]
        name = "cube"
        block = {{ min = [-0.01, -0.01, -0.01], max = [0.01, 0.01, 0.01], cells = [4, 4, 4] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = 1e5, poisson = 0.3 }}
        compliance = "exact"
        tolerance = 1e-13
        {GRASPER}
        [contact]
        at = "nodes"
        margin = 1e-3
        friction = {friction}
        [solver]
        tolerance = 1e-10
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, {REACH}] }}]
        "#,
        1.0 / DT
    ))
}

/// The grasper with its balls' lowest points of the arc at the middle of the cube, `squeeze` (m) into each side.
fn closed(squeeze: f64) -> ToolPose {
    let angle = opening(HALF + RADIUS - squeeze);
    // The balls rise as they open: the hinge stands where their centres are at half height.
    ToolPose { frame: Isometry3::translation(0.0, 0.0, REACH * (0.5 * angle).cos()), opening: angle }
}

/// Force of a jaw on the tissue (N), and the sum of its normal forces.
fn force_of(sim: &Simulation<'_>, jaw: Jaw) -> (Vector3<f64>, f64) {
    let rows = sim.workspace().rows();
    let contacts = &sim.state().contacts.contacts;
    let mut sum = (Vector3::zeros(), 0.0);
    for (block, frame) in rows.blocks.iter().zip(&rows.frames) {
        if jaw_of(contacts[block.contact as usize].feature) == Some(jaw) {
            let force = &sim.forces()[block.range()];
            sum.0 += frame.to_world(force);
            sum.1 += force[0];
        }
    }
    sum
}

#[test]
fn jaws_that_close_on_a_free_cube_squeeze_it_with_equal_and_opposite_forces() {
    let world = cube(0.0, 0.5);
    let mut sim = Simulation::new(&world).unwrap();
    for k in 0..200 {
        let squeeze = -1e-4 + 4e-4 * (f64::from(k) / 60.0).min(1.0);
        assert_eq!(sim.step(&closed(squeeze)).status, StepStatus::Advanced);
    }
    let (first, second) = (force_of(&sim, Jaw::First).0, force_of(&sim, Jaw::Second).0);
    println!("first {first:?}, second {second:?}");
    // The first jaw hangs on the side of +x.
    assert!(first.x < -0.01 && second.x > 0.01, "{first:?} {second:?}");
    assert!((first + second).norm() < 1e-4 * first.norm(), "{:?} is left over", first + second);
    let hinge = world.tool().hinge().unwrap();
    // The torque on the gripper is the forces' power over the opening: ball centres move by REACH/2 per rad.
    let pose = closed(3e-4);
    let torque: f64 = sim.snapshot().gripper_rows().iter().zip(sim.snapshot().lambda()).map(|(g, l)| g * l).sum();
    let contacts = &sim.state().contacts.contacts;
    let rows = sim.workspace().rows();
    let expected: f64 = (rows.blocks.iter().zip(&rows.frames))
        .map(|(block, frame)| {
            let contact = &contacts[block.contact as usize];
            let on_tool = -frame.to_world(&sim.forces()[block.range()]);
            let jaw = jaw_of(contact.feature).unwrap();
            let e = 1e-6;
            let at = |o: f64| {
                let local =
                    world.tool().jaw_pose(Some(jaw), &pose).inverse_transform_point(&contact.tissue_point.into());
                world.tool().jaw_pose(Some(jaw), &ToolPose { opening: o, ..pose }) * local
            };
            let rate = (at(pose.opening + e) - at(pose.opening - e)) / (2.0 * e);
            on_tool.dot(&rate)
        })
        .sum();
    println!("torque {torque} N m, by virtual power {expected} N m; hinge {hinge:?}");
    assert!(torque > 0.0, "what is squeezed opens the jaws");
    // The difference quotient is exact to e².
    assert!((torque - expected).abs() < 1e-8 * torque.abs(), "{torque} {expected}");
}

/// Momentum of the body (kg m/s) and its mass.
fn momentum(sim: &Simulation<'_>) -> (f64, f64) {
    let mass = sim.world().model().mass();
    (sim.state().fem.v.iter().zip(mass).map(|(v, m)| v.z * m).sum(), mass.iter().sum())
}

/// Height of the body's centre of mass (m).
fn height(sim: &Simulation<'_>) -> f64 {
    let mass = sim.world().model().mass();
    let moment: f64 = sim.state().fem.q.iter().zip(mass).map(|(q, m)| q.z * m).sum();
    moment / mass.iter().sum::<f64>()
}

#[test]
fn a_cube_is_held_by_friction_above_its_weight_and_falls_below_as_coulomb_says() {
    let squeeze = 3e-4;
    // The normal force of the same squeeze, without weight.
    let weightless = cube(0.0, 0.5);
    let mut sim = Simulation::new(&weightless).unwrap();
    (0..100).for_each(|_| _ = sim.step(&closed(squeeze)));
    let normal = 0.5 * (force_of(&sim, Jaw::First).1 + force_of(&sim, Jaw::Second).1);
    let mass = momentum(&sim).1;
    let threshold = mass * G / (2.0 * normal);
    println!("normal force {normal} N, weight {} N: friction must be {threshold}", mass * G);

    // Above the threshold it hangs still, and friction carries the weight.
    let world = cube(-G, 1.3 * threshold);
    let mut sim = Simulation::new(&world).unwrap();
    (0..200).for_each(|_| _ = sim.step(&closed(squeeze)));
    let before = height(&sim);
    let mut last = sim.step(&closed(squeeze));
    (0..100).for_each(|_| last = sim.step(&closed(squeeze)));
    // One node a side holds it: it may turn about the line between them, but not sink.
    let crept = (height(&sim) - before).abs();
    println!("held: crept by {crept:.1e} m in 100 steps, force on the tool {:?}", last.force);
    // It would have fallen by 1.2 m; what it turns by about that line moves its centre in second order.
    assert!(crept < 1e-6, "{crept} m");
    assert!((last.force.z + mass * G).abs() < 1e-5 * mass * G, "{}", last.force.z);

    // Below it slides from where it hung, and falls with what friction leaves of gravity.
    let held = sim;
    let friction = 0.6 * threshold;
    let world = cube(-G, friction);
    let mut sim = Simulation::new(&world).unwrap();
    let state = sim.state_mut();
    (state.fem, state.tool) = (held.state().fem.clone(), held.state().tool);
    state.contacts = held.state().contacts.clone();
    for k in 0..4 {
        let before = momentum(&sim).0;
        sim.step(&closed(squeeze));
        let vertical = force_of(&sim, Jaw::First).0.z + force_of(&sim, Jaw::Second).0.z;
        let up = (momentum(&sim).0 - before) / DT;
        println!("falls: {} m/s², {} of gravity", up / mass, up / (mass * G));
        // Momentum: weight and what the jaws give, to the residual of the linear solves.
        assert!((up - (vertical - mass * G)).abs() < 1e-8 * mass * G);
        // At first with two forces of the settled squeeze on the cone, 0.6 of the weight; the cube has yielded in the
        // meantime by what a Poisson ratio of 0.3 and its weight make of it, some percent of the squeeze.
        assert!(k > 0 || (up / (mass * G) + 0.4).abs() < 0.05, "it falls: {up} N");
        assert!(up < 0.0, "it falls: {up} N");
        let rows = sim.workspace().rows();
        let loaded =
            rows.blocks.iter().zip(&rows.frames).filter(|(block, _)| sim.forces()[block.first_row as usize] > 0.0);
        for (block, frame) in loaded {
            let force = &sim.forces()[block.range()];
            let along = frame.to_world(force) - frame.normal * force[0];
            // What slides is on the cone, and drawn up; to the solver's tolerance.
            assert!((along.norm() / (friction * force[0]) - 1.0).abs() < 1e-6, "{along:?} at {force:?}");
            assert!(along.z > 0.99 * along.norm(), "{along:?}");
        }
    }
}

/// A soft block whose side walls are fixed or free, between jaws.
fn run(walls: &str, method: TickMethod, closed: f64) -> Vec<palpate::tick::TickRecord> {
    let world = jaws::world(&format!(
        r#"
        name = "between"
        [[body]]
        name = "block"
        block = {{ min = [-0.01, -0.015, -0.02], max = [0.01, 0.015, 0.012], cells = [4, 6, 6] }}
        rayleigh_stiffness = 0.01
        material = {{ law = "neo_hookean", young = 2e4, poisson = 0.3 }}
        fixed = [{{ node_set = "z_min" }}{walls}]
        {GRASPER}
        [tool.grip]
        stiffness = 2.0
        max_torque = 1.0
        [contact]
        at = "nodes"
        friction = 0.3
        [device]
        kind = "scripted"
        [hand]
        path = [
            {{ time = 0, position = [0, 0, 0.047], gripper = {open} }},
            {{ time = 0.3, position = [0, 0, 0.047], gripper = {closed} }},
        ]
        [tick]
        method = "{method}"
        "#,
        open = gripper(opening(HALF + RADIUS + 4e-3)),
        closed = gripper(closed),
        method = if method == TickMethod::Local { "local" } else { "frozen" },
    ));
    let options =
        RunOptions { length: Length::Seconds(1.0), lockstep: true, threads: Some(1), ..RunOptions::default() };
    block::record(&world, &options).1.ticks.iter().map(|tick| tick.record).collect()
}

#[test]
fn walls_that_do_not_give_way_are_held_with_the_torque_of_the_grippers_spring() {
    let touch = opening(HALF + RADIUS);
    let wanted = touch - 0.05;
    let walls = r#", { node_set = "x_min" }, { node_set = "x_max" }"#;
    for method in [TickMethod::Local, TickMethod::Frozen] {
        let ticks = run(walls, method, wanted);
        let last = ticks.last().unwrap();
        println!(
            "{method:?}: opening {} of {touch} rad, torque {} N m",
            last.gripper.opening, last.gripper.contact_torque
        );
        // Contact is at nodes: the balls reach between them by the sag of an edge, and friction stretches the arc.
        assert!((last.gripper.opening - touch).abs() < 0.02, "{}", last.gripper.opening);
        let spring = 2.0 * (last.gripper.opening - wanted);
        assert!(
            (last.gripper.contact_torque / spring - 1.0).abs() < 1e-3,
            "{} of {spring}",
            last.gripper.contact_torque
        );
        assert_eq!(last.gripper.torque, last.gripper.contact_torque, "within the limits");
        let effort = last.gripper.torque * std::f64::consts::FRAC_PI_2;
        assert!((last.gripper.effort - effort).abs() < 1e-12, "the work of a whole opening");
        let free = ticks[50];
        assert_eq!((free.contacts > 0, free.gripper.torque), (false, 0.0), "nothing is felt in the open");
    }
}

#[test]
fn patches_and_frozen_rows_agree_on_what_is_held_at_rest() {
    let wanted = opening(HALF + RADIUS - 1.5e-3);
    let last = |method| *run("", method, wanted).last().unwrap();
    let (local, frozen) = (last(TickMethod::Local), last(TickMethod::Frozen));
    let (a, b) = (local.gripper.contact_torque, frozen.gripper.contact_torque);
    println!(
        "torque: local {a} N m, frozen {b} N m; opening {} and {} rad",
        local.gripper.opening, frozen.gripper.opening
    );
    assert!(
        local.flags.contains(palpate::tick::TickFlags::LOCAL)
            && !frozen.flags.contains(palpate::tick::TickFlags::LOCAL)
    );
    // The tick's tolerance and what a hundred steps leave of the motion.
    assert!(a > 1e-3 && (a / b - 1.0).abs() < 0.02, "{a} {b}");
    // Nothing but the jaws touches, from both sides.
    assert!(local.wrench.force.x.abs() < 0.05 * a / REACH, "{:?}", local.wrench.force);
}
