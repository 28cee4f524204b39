//! A still round tool pressed into faces: the force comes to rest, and the loaded points with it.

#![allow(clippy::print_stdout)] // a table of what was measured

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use palpate::prelude::*;
use palpate::scene::SceneError;
use palpate::step::StepStatus;

const SPHERE: &str = "{ kind = \"sphere\", radius = 0.02 }";
const CAPSULE: &str = "{ kind = \"capsule\", radius = 0.02, half_length = 0.015 }";
const CAPACITY: usize = 200;

/// Steps at 30 Hz: half a second down, a second and a half to come to rest, a second that counts.
const DOWN: u32 = 15;
const STEPS: u32 = 90;
const LAST: usize = 30;

/// Range of the force over the last second, over its mean: a tenth of what a hand can tell apart.
const RESTS: f64 = 1e-3;

/// Normal force (N) of each step, under a tool that goes down to `depth` (m) and stays there.
fn press(shape: &str, element: &str, compliance: &str, friction: f64, depth: f64) -> Vec<f64> {
    let text = format!(
        r#"
        name = "rest"
        gravity = [0, 0, 0]
        [rates]
        step = 30
        [[body]]
        name = "block"
        block = {{ min = [0, 0, 0], max = [0.08, 0.08, 0.04], cells = [8, 8, 4] }}
        element = "{element}"
        density = 1000
        rayleigh_stiffness = 0.005
        material = {{ law = "neo_hookean", young = 10e3, poisson = 0.40 }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "{compliance}"
        [[tool]]
        name = "tool"
        shape = {shape}
        [contact]
        at = "faces"
        hold = true
        friction = {friction}
        max_contacts = {CAPACITY}
        [solver]
        tolerance = 1e-8
        max_sweeps = 5000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0.2] }}]
        "#
    );
    let scene = Scene::from_toml(&text, std::path::Path::new("")).unwrap();
    let world = scene.build().unwrap();
    let mut sim = Simulation::new(&world).unwrap();
    // A capsule lies aslant over the cells, and neither tool stands over a node.
    let turn = UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.3);
    let step = |k: u32| {
        let z = 0.06 - depth * (f64::from(k) / f64::from(DOWN)).min(1.0);
        let report = sim.step(&Isometry3::from_parts(Vector3::new(0.0413, 0.0421, z).into(), turn));
        assert_eq!(report.status, StepStatus::Advanced, "step {k}");
        assert_eq!(report.detection.dropped, 0, "step {k}: contacts beyond the capacity");
        let held = &sim.state().contacts.held;
        assert_eq!(held.len(), report.active, "step {k}: the loaded points are held, and no others");
        report.force.z
    };
    (0..STEPS).map(step).collect()
}

/// Mean (N) of the last second, and range over mean.
fn rest(forces: &[f64]) -> (f64, f64) {
    let last = &forces[forces.len() - LAST..];
    let (low, high) = last.iter().fold((f64::MAX, f64::MIN), |(low, high), f| (low.min(*f), high.max(*f)));
    let mean = last.iter().sum::<f64>() / LAST as f64;
    (mean, (high - low) / mean)
}

fn comes_to_rest(shape: &str, element: &str, compliance: &str, friction: f64, depth: f64) {
    let (mean, range) = rest(&press(shape, element, compliance, friction, depth));
    println!("{shape} {element} {compliance} friction {friction}: {mean:.4} N, range {:.5} %", 100.0 * range);
    assert!(mean > 0.5 && range < RESTS, "{shape} {element} {compliance} {friction}: {mean} N, range {range}");
}

#[test]
fn a_still_tool_comes_to_rest_on_faces() {
    for shape in [SPHERE, CAPSULE] {
        for friction in [0.0, 0.3] {
            for depth in [0.004, 0.006] {
                comes_to_rest(shape, "linear", "exact", friction, depth);
            }
            comes_to_rest(shape, "averaged", "exact", friction, 0.004);
        }
    }
}

#[test]
fn a_still_tool_comes_to_rest_by_an_asynchronous_factor() {
    for shape in [SPHERE, CAPSULE] {
        comes_to_rest(shape, "linear", "asynchronous", 0.3, 0.004);
    }
}

#[test]
fn the_way_to_rest_is_the_same_to_the_bit() {
    let bits = || press(CAPSULE, "linear", "exact", 0.3, 0.006).iter().map(|f| f.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(), bits());
}

/// Only round tools at faces have points to hold: elsewhere the key would do nothing, and is refused where it stands.
#[test]
fn holding_points_that_are_not_held_is_refused() {
    let scene = |at: &str, shape: &str| {
        let text = format!(
            r#"
            name = "rest"
            [[body]]
            name = "block"
            block = {{ min = [0, 0, 0], max = [0.08, 0.08, 0.04], cells = [2, 2, 2] }}
            material = {{ law = "neo_hookean", young = 10e3, poisson = 0.40 }}
            [[tool]]
            name = "tool"
            shape = {shape}
            [contact]
            at = "{at}"
            hold = true
            [hand]
            path = [{{ time = 0, position = [0, 0, 0.2] }}]
            "#
        );
        Scene::from_toml(&text, std::path::Path::new(""))
    };
    assert!(scene("faces", SPHERE).is_ok() && scene("faces", CAPSULE).is_ok());
    let hull = "{ kind = \"convex\", vertices = [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]] }";
    for (at, shape, remedy) in [("nodes", SPHERE, "at = \"faces\""), ("faces", hull, "a sphere or a capsule")] {
        let Err(SceneError::Invalid(error)) = scene(at, shape) else { panic!("accepted: {at}, {shape}") };
        println!("{error}");
        assert_eq!(&error.text[error.span.clone()], "true", "{error}");
        assert!(error.to_string().contains("hold = true has no effect"), "{error}");
        assert!(error.remedy.is_some_and(|said| said.contains(remedy)));
    }
}
