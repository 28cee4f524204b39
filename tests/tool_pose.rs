//! Position and orientation of the device reach the tool, and force and torque the device.

#![allow(clippy::print_stdout)] // measured numbers

mod block;
mod jaws;

use nalgebra::{UnitQuaternion, Vector3};
use palpate::collision::Turn;
use palpate::haptics::script::ScriptKey;
use palpate::replay::replay;
use palpate::run::{Length, RunOptions};
use palpate::scene::{Scene, TickMethod};
use palpate::tick::TickRecord;
use palpate::world::World;

use block::{RADIUS, SKIN};

fn run(world: &World, seconds: f64) -> Vec<TickRecord> {
    let length = Length::Seconds(seconds);
    let options = RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() };
    block::record(world, &options).1.ticks.iter().map(|tick| tick.record).collect()
}

/// The block of the tests under another tool, on a device that follows `path` and renders torque.
fn world(tool: &str, friction: f64, method: TickMethod, path: Vec<ScriptKey>) -> World {
    let text = block::TOML.replace(r#"{ kind = "sphere", radius = 0.012 }"#, tool);
    let mut scene = Scene::from_toml(&text, std::path::Path::new("")).unwrap_or_else(|e| panic!("{e}"));
    scene
        .edit(|scene| {
            let virtual_device = palpate::haptics::device::DeviceSpec::virtual_device(0.0);
            scene.device.kind = "scripted".into();
            scene.device.record = Some(palpate::haptics::device::DeviceSpec { max_torque: 1.0, ..virtual_device });
            (scene.contact.friction, scene.tick.method, scene.hand.path) = (friction, method, path);
        })
        .unwrap_or_else(|e| panic!("{e}"));
    scene.build().unwrap_or_else(|e| panic!("{e}"))
}

const CAPSULE: &str = r#"{ kind = "capsule", half_length = 0.02, radius = 0.008 }"#;

#[test]
fn a_compound_of_one_part_is_that_part_to_the_bit() {
    let turn = Turn::about(Vector3::new(0.3, 1.0, 0.1), 80.0);
    let path = |turn| {
        let high =
            ScriptKey { rotation: Some(Turn::about(Vector3::y(), 90.0)), ..ScriptKey::at(0.0, [0.04, 0.04, 0.06]) };
        vec![high, ScriptKey { rotation: turn, ..ScriptKey::at(0.4, [0.041, 0.038, 0.045]) }]
    };
    let compound = format!("{{ kind = \"compound\", parts = [{{ shape = {CAPSULE} }}] }}");
    for method in [TickMethod::Local, TickMethod::Frozen] {
        let alone = run(&world(CAPSULE, 0.3, method, path(Some(turn))), 0.6);
        let part = run(&world(&compound, 0.3, method, path(Some(turn))), 0.6);
        let most = alone.iter().map(|tick| tick.wrench.force.norm()).fold(0.0, f64::max);
        assert!(most > 0.1, "{most} N");
        for (a, b) in alone.iter().zip(&part) {
            let bits = |w: &TickRecord| {
                [w.wrench.force, w.wrench.torque, w.tool_pose.translation.vector].map(|v| v.map(f64::to_bits))
            };
            assert_eq!(bits(a), bits(b), "{method:?} at {} s", a.time);
        }
    }
}

/// A frictionless ball's force goes through its centre, so about a point at −r from it the torque is r × f.
#[test]
fn the_torque_of_a_force_at_an_offset_is_the_lever_times_the_force_also_where_the_device_is_turned() {
    let tool = r#"{ kind = "compound", parts = [{ shape = { kind = "sphere", radius = 0.012 }, position = [0.03, 0.0, 0.01] }] }"#;
    let offset = Vector3::new(0.03, 0.0, 0.01);
    for method in [TickMethod::Local, TickMethod::Frozen] {
        for degrees in [0.0, 90.0, -50.0] {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::to_radians(degrees));
            let target = Vector3::new(0.037, 0.041, SKIN + RADIUS - 4e-3);
            let lever = turn * offset;
            let at = |time, above: f64| {
                let key = ScriptKey::at(time, (target - lever + Vector3::z() * above).into());
                ScriptKey { rotation: Some(Turn::about(Vector3::z(), degrees)), ..key }
            };
            let ticks = run(&world(tool, 0.0, method, vec![at(0.0, 0.01), at(0.3, 0.0)]), 0.8);
            let sent = ticks.last().unwrap().wrench;
            let expected = lever.cross(&sent.force);
            println!("{method:?}, {degrees}°: force {:?}, torque {:?}", sent.force, sent.torque);
            assert!(sent.force.z > 0.1, "{:?}", sent.force);
            // At rest the tissue points lie on the ball, up to the tick's tolerance of a micrometre's order; frozen rows have
            // the levers of the step's own contact points.
            assert!((sent.torque - expected).norm() < 5e-3 * expected.norm(), "{:?} {expected:?}", sent.torque);
            let rotation = ticks.last().unwrap().device_pose.rotation;
            assert!(rotation.angle_to(&turn) < 1e-12);
        }
    }
}

#[test]
fn a_capsule_that_turns_about_its_axis_in_contact_is_braked_by_friction() {
    let (friction, radius) = (0.3, 0.008);
    // Its axis is laid along x: z to x by 90 degrees about y.
    let lying = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    let rolled = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle) * lying;
    let at =
        |time, z, angle| ScriptKey { rotation: Some(rolled(angle).into()), ..ScriptKey::at(time, [0.04, 0.04, z]) };
    let low = SKIN + radius - 1e-3;
    let path = vec![at(0.0, SKIN + 0.012, 0.0), at(0.3, low, 0.0), at(0.6, low, 0.0), at(1.4, low, 1.5)];
    for method in [TickMethod::Local, TickMethod::Frozen] {
        let ticks = run(&world(CAPSULE, friction, method, path.clone()), 1.05);
        let (rest, turning) = (ticks[590].contact_wrench, ticks[1040].contact_wrench);
        println!("{method:?}: at rest {rest:?}, turning {turning:?}");
        // What the way down has left in the friction, on tetrahedra that are no mirror images of one another.
        assert!(rest.torque.x.abs() < 0.3 * friction * radius * rest.force.z, "{rest:?}");
        // The device turns about +x at its fastest there.
        assert!(ticks[1000].device_velocity.angular.x > 3.0 && ticks[1000].device_velocity.angular.yz().norm() < 1e-9);
        // Normal forces lean outward by the capsule's dent, so that their sum is a little above the vertical force.
        let share = -turning.torque.x / (friction * radius * turning.force.z);
        println!("{share} of friction · radius · force");
        assert!((0.9..1.25).contains(&share), "{share}");
    }
}

#[test]
fn a_grasp_replays_to_the_bit_from_lockstep_and_from_real_time() {
    let folder = tempfile::tempdir().unwrap();
    let world = Scene::bundled("grasp").unwrap().build().unwrap();
    for lockstep in [true, false] {
        let path = folder.path().join(format!("{lockstep}.mcap"));
        let options =
            RunOptions { length: Length::Seconds(1.2), lockstep, trace: Some(path.clone()), ..RunOptions::default() };
        let (_, recorder) = block::record(&world, &options);
        let torque = recorder.ticks.iter().map(|tick| tick.record.gripper.torque).fold(0.0, f64::max);
        assert!(torque > 1e-4, "{torque} N m");
        let report = replay(&path).unwrap();
        assert!(report.is_identical(), "{report:?}");
    }
}

/// What it lifts weighs 5.6 cm³ of 1050 kg/m³.
#[test]
fn the_bundled_grasp_lifts_the_block_by_friction_and_lets_it_go() {
    let world = Scene::bundled("grasp").unwrap().build().unwrap();
    let length = Length::Seconds(2.8);
    let options = RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() };
    let (_, recorder) = block::record(&world, &options);
    let at = |time: f64| recorder.ticks[(time * 1e3) as usize].record;
    let (before, lifted, after) = (at(0.45), at(1.89), at(2.79));
    println!("open {:?}\nlifted {:?}\nagain {:?}", before.gripper, lifted.gripper, after.gripper);
    assert_eq!((before.gripper.torque, before.active), (0.0, 0), "the open jaws touch nothing");
    // In the air the tool carries the weight of the block; what is left of its swing is below a percent after 0.3 s.
    let weight = 5.6e-6 * 1050.0 * 9.81;
    let step = recorder.steps.iter().rfind(|step| step.time < 1.89).unwrap();
    println!("of a weight of {weight} N the step carries {:?} N, the tick {:?}", step.force, lifted.wrench.force);
    assert!((step.force.z / -weight - 1.0).abs() < 0.01, "{:?}", step.force);
    // The tick has its own anchors of friction. Those of a body that nothing else holds are worth 5 N/m, so that a
    // millimetre between the slip of the ticks and that of the steps on the way up is some 5 mN.
    assert!((lifted.wrench.force.z / -weight - 1.0).abs() < 0.25, "{:?}", lifted.wrench.force);
    assert!(lifted.gripper.torque > 1e-3 && lifted.gripper.effort > 0.0, "it pushes the jaws open");
    assert_eq!((after.wrench.force.norm(), after.gripper.torque), (0.0, 0.0), "and it is let go");
}
