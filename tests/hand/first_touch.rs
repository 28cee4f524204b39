//! Does the first touch of the bundled liver, on its own cells, feel as it would at 1 kHz?
//!
//! The same measure as `palpate chart haptics`: means over 5 ms of the contact force, before the limits, along the begin of
//! the scene's path at twice its speed, against the same tissue stepped offline at 1 kHz with exact compliance.

#![allow(clippy::print_stdout)] // measured numbers

use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::coupling::{CouplingConfig, Spring};
use palpate::haptics::script::HandScript;
use palpate::run::{Length, RunOptions};
use palpate::scene::{Scene, SceneDescription};
use palpate::simulation::Simulation;
use palpate::world::World;

use crate::block::record;

/// Time (s) after which the path has been 100 ms in contact.
const SECONDS: f64 = 0.49;

/// Ticks of a mean: a lumped node that is hit at 1 kHz spreads its impulse over a millisecond, an artefact of the mesh.
const WINDOW: usize = 5;

/// Ticks of the first touch.
const TOUCH: usize = 100;

/// Milliseconds of the reference before the touch. The tissue is at rest until then.
const BEFORE: usize = 15;

fn liver(change: impl FnOnce(&mut SceneDescription)) -> World {
    let mut scene = Scene::bundled("liver").unwrap();
    scene
        .edit(|scene| {
            scene.device.kind = "scripted".into();
            // The tool follows the path to a few micrometres.
            let stiff = Spring { stiffness: 1e6, damping: 0.0 };
            scene.coupling = Some(CouplingConfig { translation: stiff, rotation: None });
            // Without the time that it waits at its begin.
            let path = &mut scene.hand.path;
            path.remove(0);
            let begin = path[0].time;
            path.iter_mut().for_each(|key| key.time = 0.5 * (key.time - begin));
            change(scene);
        })
        .unwrap();
    scene.build().unwrap()
}

/// Means over the last [`WINDOW`] ticks.
fn means(forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    forces.windows(WINDOW).map(|window| window.iter().sum::<Vector3<f64>>() / WINDOW as f64).collect()
}

#[test]
fn the_liver_is_touched_as_at_1_khz_by_tissue_of_30_and_100_hz() {
    let offline = liver(|scene| {
        scene.rates.step = 1000.0;
        scene.bodies[0].compliance = ComplianceMethod::Exact;
    });
    let script = HandScript::new(offline.description().hand.path.clone()).unwrap();
    let felt = [30.0, 100.0].map(|rate| {
        let world = liver(|scene| scene.rates.step = rate);
        let options =
            RunOptions { length: Length::Seconds(SECONDS), lockstep: true, threads: Some(1), ..RunOptions::default() };
        let (_, recorder) = record(&world, &options);
        (rate, recorder.ticks.iter().map(|tick| tick.record.contact_wrench.force).collect::<Vec<_>>())
    });
    let touches = |forces: &[Vector3<f64>]| forces.iter().position(|force| force.norm() > 0.0).expect("it touches");
    let first = felt.iter().map(|(_, forces)| touches(forces)).min().unwrap();
    let begin = first - BEFORE;

    let mut simulation = Simulation::new(&offline).unwrap();
    let reference: Vec<_> = (begin..begin + BEFORE + TOUCH)
        .map(|k| {
            let place = script.intent(k as f64 * 1e-3).position;
            simulation.step(&Isometry3::translation(place.x, place.y, place.z)).force
        })
        .collect();
    let hit = touches(&reference);
    assert!(hit > 0, "the reference touches within the {BEFORE} ms before the tick, or later");
    let exact = means(&reference);
    let largest = exact.iter().map(Vector3::norm).fold(0.0, f64::max);
    assert!(largest > 0.3, "{largest} N");
    for (rate, forces) in felt {
        let forces = means(&forces[begin..begin + reference.len()]);
        let off = forces.iter().zip(&exact).map(|(felt, exact)| (felt - exact).norm()).fold(0.0, f64::max);
        println!("{rate} Hz: off by {:.2} % of {largest:.3} N within 100 ms", 100.0 * off / largest);
        assert!(off < 0.1 * largest, "{rate} Hz: {off} of {largest} N");
    }
}
