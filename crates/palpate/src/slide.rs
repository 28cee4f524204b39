//! The scene of unit tests of threads and replays: a ball on a virtual device that is pressed into a block and slides
//! over it.

use std::path::Path;

use crate::scene::Scene;
use crate::world::World;

/// Pressed at 0.4 s, and at the end of its way at `end` (s, later).
pub(crate) fn slide(end: f64) -> World {
    let text = format!(
        r#"
        name = "slide"
        [[body]]
        name = "block"
        block = {{ min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [3, 3, 3] }}
        compliance = "async"
        rayleigh_stiffness = 0.005
        material = {{ law = "neo_hookean", young = 5e3, poisson = 0.4 }}
        fixed = [{{ below = {{ axis = "z", at = 0.0 }} }}]
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = 0.008 }}
        [contact]
        at = "faces"
        friction = 0.3
        [hand]
        preset = "firm"
        path = [
            {{ time = 0.0, position = [0.015, 0.02, 0.05] }},
            {{ time = 0.4, position = [0.015, 0.02, 0.044] }},
            {{ time = {end}, position = [0.025, 0.02, 0.044] }},
        ]
        "#
    );
    Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap()
}
