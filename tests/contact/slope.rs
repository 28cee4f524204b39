//! A block on a floor, with gravity that leans.

use nalgebra::Vector3;
use palpate::prelude::*;

/// Gravity (m/s²) and the step (s).
pub(crate) const G: f64 = 9.81;
pub(crate) const DT: f64 = 0.005;

/// Gravity on a slope of `angle` (rad) that falls towards `heading` (rad).
pub(crate) fn leaning(angle: f64, heading: f64) -> Vector3<f64> {
    Vector3::new(angle.sin() * heading.cos(), angle.sin() * heading.sin(), -angle.cos()) * G
}

/// A free block of 8 x 8 x 3 cm on a level floor, stiff enough (1 MPa) to bend by micrometres under its weight; `contact` are
/// further keys of `[contact]`.
pub(crate) fn world(gravity: Vector3<f64>, contact: &str) -> World {
    let text = format!(
        r#"
        name = "incline"
        gravity = [{}, {}, {}]
        [rates]
        step = {}
        [[body]]
        name = "block"
        block = {{ min = [-0.04, -0.04, 0], max = [0.04, 0.04, 0.03], cells = [3, 3, 2] }}
        density = 1000
        rayleigh_stiffness = 0.02
        material = {{ law = "neo_hookean", young = 1e6, poisson = 0.3 }}
        compliance = "exact"
        tolerance = 1e-13
        [[tool]]
        name = "floor"
        shape = {{ kind = "convex", vertices = [
            [-9, -9, -1], [9, -9, -1], [-9, 9, -1], [9, 9, -1], [-9, -9, 0], [9, -9, 0], [-9, 9, 0], [9, 9, 0]] }}
        [contact]
        at = "nodes"
        {contact}
        [solver]
        tolerance = 1e-10
        max_sweeps = 100000
        [hand]
        path = [{{ time = 0, position = [0, 0, 0] }}]
        "#,
        gravity.x,
        gravity.y,
        gravity.z,
        1.0 / DT,
    );
    Scene::from_toml(&text, std::path::Path::new("")).unwrap().build().unwrap()
}
