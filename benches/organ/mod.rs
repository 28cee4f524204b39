//! What the benches share: the bundled liver in several sizes, and a simulation that presses a ball into it.
#![allow(dead_code)] // every bench is a program of its own and uses a part of this

pub(crate) mod patch;
pub(crate) mod traffic;

use std::time::{Duration, Instant};

use criterion::Criterion;
use nalgebra::{Isometry3, Vector3};
use palpate::collision::detection::ContactKind;
use palpate::collision::shape::ToolShape;
use palpate::fem::material::Material;
use palpate::fem::model::{FemModel, FemState};
use palpate::scene::{Scene, SceneDescription};
use palpate::simulation::Simulation;
use palpate::step::StepReport;
use palpate::world::World;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Lattice constants (m) of livers with about 1,500, 3,000 and 8,000 nodes.
pub(crate) const CELLS: [f64; 3] = [0.0155, 0.012, 0.0084];

/// The lattice constant of the smallest of them.
pub(crate) const SMALL: f64 = CELLS[0];

/// Radius (m) of the ball that presses: a fist, so that many contacts carry force at once.
const BALL: f64 = 0.1;

/// Contacts that the ball may have at once.
const CAPACITY: usize = 160;

/// Steps for which the ball moves, and how far (m) in each: it meets the skin after about 20 mm and dents it by as much.
const PRESS_STEPS: u32 = 27;
const PRESS_STEP: f64 = 1.5e-3;

/// Steps for which the pressed ball is dragged along the skin, and how far (m) in each.
const DRAG_STEPS: u32 = 4;
const DRAG_STEP: f64 = 2e-3;

/// The bundled liver with another lattice constant (m) and what else `change` says.
pub(crate) fn liver(cell: f64, change: impl FnOnce(&mut SceneDescription)) -> World {
    let mut scene = Scene::bundled("liver").expect("the scene is bundled");
    scene.use_cell(cell).expect("the cell is positive");
    scene.edit(change).expect("the change is valid");
    scene.build().expect("the bundled image gives a body")
}

/// The liver all of one law.
pub(crate) fn liver_of(cell: f64, material: Material) -> World {
    liver(cell, |scene| {
        scene.bodies[0].material = material.into();
        scene.bodies[0].regions.clear();
    })
}

/// The liver under a ball that meets the nodes of its skin.
pub(crate) fn liver_under_ball(cell: f64) -> World {
    liver(cell, under_ball)
}

/// Puts a ball that meets the nodes of its skin in the place of the liver's tool.
pub(crate) fn under_ball(scene: &mut SceneDescription) {
    scene.tools[0].shape = ToolShape::sphere(BALL).expect("the radius is positive").into();
    scene.contact.max_contacts = CAPACITY;
    scene.contact.at = ContactKind::Nodes;
    scene.hand.path.iter_mut().for_each(|key| key.position[1] -= BALL);
}

/// Size of the body as text for the name of a case.
pub(crate) fn nodes(world: &World) -> String {
    format!("{} nodes", world.mesh().nodes.len())
}

/// A pool of worker threads.
pub(crate) fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().expect("the system grants threads")
}

/// A simulation after the ball was pressed into the body, and what its last step reported.
pub(crate) fn press(world: &World) -> (Simulation<'_>, StepReport) {
    let mut simulation = Simulation::new(world).expect("the liver has a factor");
    let mut report = simulation.step(&world.first_pose());
    for k in 1..=PRESS_STEPS {
        let depth = PRESS_STEP * f64::from(k);
        report = simulation.step(&(Isometry3::translation(0.0, depth, 0.0) * world.first_pose()));
    }
    (simulation, report)
}

/// Goes on from [`press`]: the ball slides along the skin at the same depth.
pub(crate) fn drag(world: &World, simulation: &mut Simulation<'_>) {
    let depth = PRESS_STEP * f64::from(PRESS_STEPS);
    for k in 1..=DRAG_STEPS {
        let along = DRAG_STEP * f64::from(k);
        simulation.step(&(Isometry3::translation(along, depth, 0.0) * world.first_pose()));
    }
}

/// The body bent, twisted and squeezed: half of its elements are compressed, as under a hand.
pub(crate) fn bent(model: &FemModel) -> FemState {
    let mut state = model.rest_state();
    for q in &mut state.q {
        let x = *q;
        *q += Vector3::new(0.8 * x.z * x.z, -0.1 * x.y, -0.5 * x.x * x.z);
    }
    state
}

/// Median times (s) of two ways to do the same, run in turn, so that both meet the same load.
pub(crate) fn paired_medians(repetitions: usize, mut first: impl FnMut(), mut second: impl FnMut()) -> [f64; 2] {
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..repetitions.max(1) {
        for (times, work) in times.iter_mut().zip([&mut first as &mut dyn FnMut(), &mut second]) {
            let start = Instant::now();
            work();
            times.push(start.elapsed().as_secs_f64());
        }
    }
    times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    })
}

/// True where cargo measures; `cargo test --benches` and `cargo bench -- --test` only see that all runs.
pub(crate) fn measuring() -> bool {
    let has = |flag: &str| std::env::args().any(|argument| argument == flag);
    has("--bench") && !has("--test")
}

/// Runs benches on a worker of a pool, as the step runs: handing work to a pool from outside costs a wake-up each time.
///
/// The cases differ by far more than the spread of ten samples, and all benches together are to take a few minutes.
pub(crate) fn benches(threads: usize, run: impl FnOnce(&mut Criterion) + Send) {
    pool(threads).install(|| {
        let mut criterion = Criterion::default()
            .warm_up_time(Duration::from_millis(300))
            .measurement_time(Duration::from_secs(1))
            .sample_size(10)
            .configure_from_args();
        run(&mut criterion);
        criterion.final_summary();
    });
}
