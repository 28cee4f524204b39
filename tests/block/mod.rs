//! The scene of these tests: a ball presses a small block of soft tissue, slides over it, and lets go.

#![allow(dead_code, unreachable_pub)]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Vector3};
use palpate::run::{Observer, RunOptions, RunOutcome, run};
use palpate::scene::{Scene, SceneDescription};
use palpate::step::StepReport;
use palpate::tick::TickReport;
use palpate::world::World;

/// Largest force of the virtual and of the scripted device (N).
pub const MAX_FORCE: f64 = 12.0;

/// Height of the block's skin (m).
pub const SKIN: f64 = 0.04;

/// Radius of the ball (m).
pub const RADIUS: f64 = 0.012;

/// 245 nodes, 196 of them free. The hand begins 3 mm above the skin.
pub const TOML: &str = r#"
name = "block"
seconds = 1.2

[[body]]
name = "tissue"
block = { min = [0.0, 0.0, 0.0], max = [0.08, 0.08, 0.04], cells = [6, 6, 4] }
density = 1000
rayleigh_mass = 2.0
rayleigh_stiffness = 0.005
material = { law = "neo_hookean", young = 6e3, poisson = 0.45 }
fixed = [{ node_set = "z_min" }]

[[tool]]
name = "ball"
shape = { kind = "sphere", radius = 0.012 }

[contact]
friction = 0.3
at = "faces"

[device]
kind = "virtual"

[hand]
preset = "arm"
path = [
    { time = 0.0, position = [0.033, 0.037, 0.055] },
    { time = 0.5, position = [0.033, 0.037, 0.042] },
    { time = 0.9, position = [0.046, 0.042, 0.042] },
    { time = 1.2, position = [0.046, 0.042, 0.060] },
]
"#;

/// The scene with a change.
pub fn scene(change: impl FnOnce(&mut SceneDescription)) -> Scene {
    let mut scene = Scene::from_toml(TOML, Path::new("")).expect("the scene of the tests is valid");
    scene.edit(change).expect("the change is valid");
    scene
}

/// The scene with a change, ready to run.
pub fn world(change: impl FnOnce(&mut SceneDescription)) -> World {
    scene(change).build().expect("the scene of the tests can be built")
}

/// Pose of the ball at step `k` of 60: down to 10 mm below the skin, 12 mm aside, up again.
pub fn pose(k: u64) -> Isometry3<f64> {
    let part = |from: u64, to: u64| (k.saturating_sub(from) as f64 / (to - from) as f64).min(1.0);
    let (down, aside, up) = (part(0, 20), part(20, 40), part(45, 60));
    let z = SKIN + RADIUS + 0.003 - 0.013 * down + 0.016 * up;
    Isometry3::translation(0.033 + 0.012 * aside, 0.037 + 0.004 * aside, z)
}

/// Steps of [`pose`].
pub const STEPS: u64 = 60;

/// Largest distance between the nodes of two configurations (m).
pub fn distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Keeps every report, and holds every force to its limit.
#[derive(Default)]
pub struct Recorder {
    pub steps: Vec<StepReport>,
    pub ticks: Vec<TickReport>,
}

impl Observer for Recorder {
    fn step(&mut self, report: &StepReport) {
        self.steps.push(*report);
    }

    fn tick(&mut self, report: &TickReport) {
        let force = report.record.wrench.force;
        // Not `>`: NaN must fail too. An ulp more than the limit is rounding of the norm.
        assert!(force.norm() <= MAX_FORCE * (1.0 + 1e-15), "force {force:?} at tick {}", report.record.index);
        self.ticks.push(*report);
    }
}

impl Recorder {
    /// Every force on the hand, as it was sent (N).
    pub fn forces(&self) -> Vec<Vector3<f64>> {
        self.ticks.iter().map(|t| t.record.wrench.force).collect()
    }
}

/// Runs a world to its end and keeps every report.
pub fn record(world: &World, options: &RunOptions) -> (RunOutcome, Recorder) {
    let mut recorder = Recorder::default();
    let outcome = run(world, options, &AtomicBool::new(false), &mut recorder).expect("the run begins");
    (outcome, recorder)
}
