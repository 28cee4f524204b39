//! Deep and fast presses by an old factor: the exact correction keeps the body whole where the matching one tears it.

#![allow(clippy::print_stdout)] // what was measured

mod block;

use nalgebra::Isometry3;
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::haptics::script::ScriptKey;
use palpate::prelude::*;
use palpate::scene::Refactor;
use palpate::step::StepStatus;
use palpate::summary::RunEnd;

use block::record;

/// A large ball over a block of soft tissue of `cells`, as in a test of indentation.
fn fine(element: &str, cells: [usize; 3], change: impl FnOnce(&mut SceneDescription)) -> World {
    let text = format!(
        r#"
        name = "fine"
        [[body]]
        name = "block"
        block = {{ min = [0, 0, 0], max = [0.1, 0.1, 0.05], cells = {cells:?} }}
        element = "{element}"
        density = 1000
        rayleigh_stiffness = 0.005
        material = {{ law = "neo_hookean", young = 10e3, poisson = 0.40 }}
        fixed = [{{ node_set = "z_min" }}]
        compliance = "async"
        [[tool]]
        name = "ball"
        shape = {{ kind = "sphere", radius = 0.04 }}
        [contact]
        at = "nodes"
        max_contacts = 200
        [hand]
        path = [{{ time = 0, position = [0.05, 0.05, 0.1] }}]
        "#
    );
    let mut scene = Scene::from_toml(&text, std::path::Path::new("")).unwrap();
    scene.edit(change).unwrap();
    scene.build().unwrap()
}

/// What a press of the fine block came to.
struct Press {
    /// Step at which the body was given up.
    failed: Option<u64>,
    /// Force at the end (N).
    force: f64,
    /// Largest force of a step (N).
    largest: f64,
}

/// 8 mm in half a second, then held for as long; the factor refreshed every 3 steps.
fn press(world: &World) -> Press {
    let mut simulation = Simulation::new(world).unwrap().refresh_every(3);
    let mut largest = 0.0_f64;
    let mut force = 0.0;
    for k in 0..30_u64 {
        let depth = 0.008 * (k as f64 / 15.0).min(1.0);
        let report = simulation.step(&Isometry3::translation(0.05, 0.05, 0.09 - depth));
        if report.status == StepStatus::RolledBack {
            return Press { failed: Some(k), force: 0.0, largest };
        }
        force = report.force.z;
        largest = largest.max(report.force.norm());
        if std::env::var("PRINT").is_ok() {
            println!(
                "{k:3} {:7.3} N, {} PCG, {} corr, along {:.3}, sampled {:.3}, overlap {:.2e}, {:.1} ms [asm {:.1} free {:.1} det {:.1} W {:.1} solve {:.1} corr {:.1} sample {:.1}]",
                force, report.free_motion.iterations, report.error.correction_iterations, report.error.along_forces,
                report.error.sampled, report.error.overlap, 1e3*report.times.total, 1e3*report.times.assembly, 1e3*report.times.free_motion, 1e3*report.times.detection, 1e3*report.times.compliance, 1e3*report.times.solve, 1e3*report.times.correction, 1e3*report.times.sampling
            );
        }
    }
    Press { failed: None, force, largest }
}

#[test]
fn a_fine_block_is_pressed_fast_without_being_torn() {
    for (element, cells) in [("averaged", [20, 20, 10]), ("quadratic", [10, 10, 5])] {
        for correction in [MotionCorrection::Matching, MotionCorrection::Exact] {
            let world = fine(element, cells, |scene| scene.bodies[0].correction = correction);
            println!("{}", world.understood());
            let run = press(&world);
            println!("{element}, {correction:?}: failed {:?}, {:.3} N at the end, largest {:.3} N", run.failed, run.force, run.largest);
        }
        let world = fine(element, cells, |scene| scene.bodies[0].compliance = ComplianceMethod::Exact);
        let run = press(&world);
        println!("{element}, exact W: {:.3} N at the end, largest {:.3} N", run.force, run.largest);
    }
}

#[test]
fn a_block_is_pressed_to_half_its_height_in_two_thirds_of_a_second() {
    for (compliance, correction) in [
        (ComplianceMethod::Asynchronous, MotionCorrection::Matching),
        (ComplianceMethod::Asynchronous, MotionCorrection::Exact),
        (ComplianceMethod::Warped, MotionCorrection::Exact),
        (ComplianceMethod::Exact, MotionCorrection::Exact),
    ] {
        let world = block::world(|scene| {
            scene.device.kind = "scripted".into();
            (scene.bodies[0].compliance, scene.bodies[0].correction) = (compliance, correction);
            let key = |time, z| ScriptKey { time, position: [0.033, 0.037, z], release: false };
            scene.hand.path = vec![key(0.0, 0.053), key(0.67, 0.030), key(1.2, 0.030)];
        });
        let options = RunOptions { length: Length::Seconds(1.2), lockstep: true, ..RunOptions::default() };
        let (outcome, recorder) = record(&world, &options);
        let last = recorder.steps.last().unwrap();
        println!(
            "{compliance:?} {correction:?}: {:?}, {:.3} N at the end, error {:?}, {} early of {}, {:?}",
            outcome.summary.end, last.force.z, outcome.summary.compliance_error.p50, outcome.summary.factors_early, outcome.summary.factors, outcome.summary.iterations
        );
    }
    let _ = (Refactor::Step, RunEnd::Completed);
}
