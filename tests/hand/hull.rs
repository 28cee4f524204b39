//! A hull pressed into tissue: forces and torques of ticks beside those of the same tissue stepped offline at 1 kHz.

#![allow(clippy::print_stdout)] // measured numbers

use std::path::Path;

use nalgebra::Vector3;
use palpate::collision::Turn;
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::coupling::{CouplingConfig, Spring};
use palpate::haptics::script::ScriptKey;
use palpate::prelude::*;
use palpate::run::{Length, RunOptions};
use palpate::scene::SceneDescription;
use palpate::tick::TickFlags;

use crate::block::{SKIN, TOML, record};

/// Half edges (m) of a box, and how far (degrees) it is turned about the y axis: it comes down on one of its edges.
const HALF: [f64; 3] = [0.014, 0.011, 0.006];
const TILT: f64 = 12.0;

/// How deep (m) the edge goes.
const DEPTH: f64 = 7e-3;

/// Ticks over which a lumped node that is hit at 1 kHz spreads its impulse: an artefact of the mesh, which lasts one step.
const WINDOW: usize = 5;

fn world(at: &str, change: impl FnOnce(&mut SceneDescription)) -> World {
    let corner = |k: usize| [0, 1, 2].map(|c| if k >> c & 1 == 0 { -HALF[c] } else { HALF[c] });
    let corners: Vec<_> = (0..8).map(corner).collect();
    let hull = format!("kind = \"convex\", vertices = {corners:?}");
    let text = TOML
        .replace("kind = \"sphere\", radius = 0.012", &hull)
        .replace("at = \"faces\"", &format!("at = \"{at}\""))
        .replace("cells = [6, 6, 4]", "cells = [10, 10, 5]");
    let mut scene = Scene::from_toml(&text, Path::new("")).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let tilt = TILT.to_radians();
    let edge = HALF[0] * tilt.sin() + HALF[2] * tilt.cos();
    let key = |time, z| ScriptKey {
        time,
        position: [0.041, 0.039, z],
        rotation: Some(Turn::about(Vector3::y(), TILT)),
        ..ScriptKey::default()
    };
    scene
        .edit(|scene| {
            scene.device.kind = "scripted".into();
            // The tool follows its path exactly, so that a tick and an offline run see the same one.
            let stiff = Spring { stiffness: 1e5, damping: 0.0 };
            scene.coupling = Some(CouplingConfig { translation: stiff, rotation: None });
            scene.hand.path = vec![key(0.0, SKIN + edge + 2e-3), key(0.4, SKIN + edge - DEPTH)];
            change(scene);
        })
        .unwrap();
    scene.build().unwrap()
}

/// Means over [`WINDOW`] ticks.
fn means(values: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    values.windows(WINDOW).map(|window| window.iter().sum::<Vector3<f64>>() / WINDOW as f64).collect()
}

/// Largest distance of the means, relative to the largest of the second.
fn off(felt: &[Vector3<f64>], exact: &[Vector3<f64>]) -> (f64, f64) {
    let (felt, exact) = (means(felt), means(exact));
    let largest = exact.iter().map(Vector3::norm).fold(0.0, f64::max);
    (felt.iter().zip(&exact).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / largest, largest)
}

/// Within a tenth of the largest, as for a ball: in the first 100 ms of the touch, and all the way down. The edge lies beside the
/// hull's origin, so that there is a torque, and a wrong sign of it would be off by twice its size.
#[test]
fn a_hull_is_felt_as_at_1_khz_with_force_and_torque() {
    for at in ["nodes", "faces"] {
        let offline = world(at, |scene| {
            scene.rates.step = 1000.0;
            scene.bodies[0].compliance = ComplianceMethod::Exact;
        });
        let fast = world(at, |_| {});
        let options =
            RunOptions { length: Length::Seconds(0.4), lockstep: true, threads: Some(1), ..RunOptions::default() };
        let (_, recorder) = record(&fast, &options);
        assert!(recorder.ticks.iter().all(|t| t.record.flags.contains(TickFlags::LOCAL)));
        let first = recorder.ticks.iter().position(|t| t.record.active > 0).expect("it touches");
        let mut simulation = Simulation::new(&offline).unwrap();
        let exact: Vec<_> = (recorder.ticks.iter())
            .map(|tick| {
                let report = simulation.step(&tick.record.tool_pose);
                (report.force, report.torque)
            })
            .collect();
        let felt: Vec<_> =
            (recorder.ticks.iter().map(|tick| &tick.record.contact_wrench)).map(|w| (w.force, w.torque)).collect();
        let part = |from: usize, to: usize| {
            let split =
                |of: &[(Vector3<f64>, Vector3<f64>)]| -> (Vec<_>, Vec<_>) { of[from..to].iter().copied().unzip() };
            let (felt, exact) = (split(&felt), split(&exact));
            (off(&felt.0, &exact.0), off(&felt.1, &exact.1))
        };
        for (name, from, to) in [("first 100 ms", first, first + 100), ("all of it", first, felt.len())] {
            let ((force, newton), (torque, metres)) = part(from, to);
            println!(
                "{at}, {name}: force {:.1} % of {newton:.3} N, torque {:.1} % of {:.2} mN m",
                100.0 * force,
                100.0 * torque,
                1e3 * metres
            );
            assert!(newton > 0.5 && metres > 2e-3, "{at}: {newton} N, {metres} N m");
            assert!(force < 0.1 && torque < 0.1, "{at}, {name}: {force} of the force, {torque} of the torque");
        }
    }
}
