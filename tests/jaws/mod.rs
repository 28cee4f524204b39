//! Tools of several parts: scenes that several test binaries share.
#![allow(dead_code, unreachable_pub)] // each test file uses its part

use std::path::Path;

use palpate::scene::Scene;
use palpate::world::World;

/// A world from the text of its scene.
pub fn world(text: &str) -> World {
    let scene = Scene::from_toml(text, Path::new("")).unwrap_or_else(|e| panic!("{e}\n{text}"));
    scene.build().unwrap_or_else(|e| panic!("{e}"))
}

/// Distance of the balls' centres from the hinge (m), their radius, and half the width of what they hold.
pub const REACH: f64 = 0.05;
pub const RADIUS: f64 = 0.01;
pub const HALF: f64 = 0.01;

/// Two balls on arms that hang from a hinge, which meet in a point at the opening 0.
pub const GRASPER: &str = r#"
        [[tool]]
        name = "grasper"
        [tool.shape]
        kind = "compound"
        parts = [
            { shape = { kind = "sphere", radius = 0.01 }, position = [0, 0, -0.05], jaw = 1 },
            { shape = { kind = "sphere", radius = 0.01 }, position = [0, 0, -0.05], jaw = 2 },
        ]
        gripper = { pivot = [0, 0, 0], axis = [0, -1, 0], closed_degrees = 0, open_degrees = 90 }
"#;

/// Opening (rad) at which the balls' centres are `x` (m) from the middle.
pub fn opening(x: f64) -> f64 {
    2.0 * (x / REACH).asin()
}

/// Gripper that asks for this opening (rad).
pub fn gripper(opening: f64) -> f64 {
    opening / std::f64::consts::FRAC_PI_2
}
