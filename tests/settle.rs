//! A heavy body begins at rest: settled by quasi-static iterations before the first step.

use nalgebra::Isometry3;
use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::prelude::*;
use std::path::Path;

fn block(young: f64, settle: bool) -> Scene {
    let text = format!(
        r#"
        name = "column"
        gravity = [0, 0, -9.81]
        [[body]]
        name = "column"
        block = {{ min = [0, 0, 0], max = [0.04, 0.04, 0.08], cells = [3, 3, 6] }}
        density = 1000
        settle = {settle}
        material = {{ law = "neo_hookean", young = {young}, poisson = 0.4 }}
        fixed = [{{ below = {{ axis = "z", at = 0.0 }} }}]
        [[tool]]
        name = "far away"
        shape = {{ kind = "sphere", radius = 0.005 }}
        [hand]
        path = [{{ time = 0, position = [1, 1, 1] }}]
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
        // The iterations end at a motion of 1e-6 of the diagonal (98 mm): 1e-7 m against a stiffness of E L = 2e3 N/m
        // at most, 2e-4 N, in a body of 1.26 N.
        assert!(unbalanced < 2e-4 * weight, "unbalanced force {unbalanced} N of {weight} N");

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
