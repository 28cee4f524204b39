//! Does the force go smoothly over from one step's tissue to the next's, and does it begin as it would at 1 kHz?

#![allow(clippy::print_stdout)] // measured numbers

mod block;

use nalgebra::{Isometry3, Vector3};
use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, RunOptions};
use palpate::scene::{SceneDescription, TickMethod};
use palpate::simulation::Simulation;
use palpate::tick::TickFlags;

use block::{SKIN, record, scene, world};

fn lockstep(seconds: f64) -> RunOptions {
    RunOptions { length: Length::Seconds(seconds), lockstep: true, threads: Some(1), ..RunOptions::default() }
}

#[test]
fn explore_jumps() {
    for device in ["virtual", "scripted"] {
    for (method, hand_over) in [(TickMethod::Frozen, 0.01), (TickMethod::Local, 0.0), (TickMethod::Local, 0.01), (TickMethod::Local, 0.033)] {
        let world = world(|scene| {
            scene.device.kind = device.into();
            scene.tick.method = method;
            if method == TickMethod::Local { scene.tick.hand_over = hand_over; }
        });
        let (outcome, recorder) = record(&world, &lockstep(1.2));
        let mut jumps: Vec<(f64, f64)> = recorder.ticks.iter().filter(|t| t.record.flags.contains(TickFlags::NEW_SNAPSHOT) && t.record.active > 0)
            .map(|t| (t.record.force_jump, t.record.contact_wrench.force.norm())).collect();
        let peak = outcome.summary.largest_force;
        jumps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n = jumps.len();
        // largest change of the force within one tick while in contact
        let mut change: Vec<f64> = recorder.ticks.windows(2).filter(|w| w[0].record.active > 0 && w[1].record.active > 0)
            .map(|w| (w[1].record.contact_wrench.force - w[0].record.contact_wrench.force).norm()).collect();
        change.sort_by(f64::total_cmp);
        let c = change.len();
        let flags: u32 = recorder.ticks.iter().map(|t| u32::from(t.record.flags.contains(TickFlags::LOCAL))).sum();
        let beyond: u32 = recorder.ticks.iter().map(|t| u32::from(t.record.flags.contains(TickFlags::BEYOND_PATCH))).sum();
        let unconv: u32 = recorder.ticks.iter().map(|t| u32::from(t.record.flags.contains(TickFlags::NOT_CONVERGED))).sum();
        println!("{device} {method:?} {hand_over}: peak {peak:.3} N, {n} jumps p50 {:.1} p99 {:.1} max {:.1} mN; change per tick p50 {:.2} p99 {:.1} max {:.1} mN; local {flags}, beyond {beyond}, unconverged {unconv}, nodes {:?}",
            jumps[n/2].0*1e3, jumps[n*99/100].0*1e3, jumps[n-1].0*1e3, change[c/2]*1e3, change[c*99/100]*1e3, change[c-1]*1e3, recorder.steps.iter().map(|s| s.patch.nodes).max());
    }
    }
}

#[test]
fn explore_touch() {
    for (device, friction, z) in [("scripted", 0.0, 0.042), ("scripted", 0.3, 0.042), ("virtual", 0.3, 0.042), ("scripted", 0.3, 0.035)] {
    for (method, hand_over) in [(TickMethod::Frozen, 0.01), (TickMethod::Local, 0.0), (TickMethod::Local, 0.01), (TickMethod::Local, 0.033)] {
        let change = |scene: &mut SceneDescription| {
            scene.device.kind = device.into();
            scene.contact.friction = friction;
            for k in [1, 2] { scene.hand.path[k].position[2] = z; }
        };
        let fast = world(|scene| {
            change(scene);
            scene.tick.method = method;
            if method == TickMethod::Local { scene.tick.hand_over = hand_over; }
        });
        let (_, recorder) = record(&fast, &lockstep(0.6));
        let offline = world(|scene| {
            change(scene);
            scene.rates.step = 1000.0;
            scene.bodies[0].compliance = palpate::constraints::compliance::ComplianceMethod::Exact;
        });
        let mut simulation = Simulation::new(&offline).unwrap();
        let first = recorder.ticks.iter().position(|t| t.record.active > 0).unwrap();
        let mut worst = [0.0_f64; 3];
        let mut line = String::new();
        for (k, tick) in recorder.ticks.iter().enumerate() {
            let report = simulation.step(&tick.record.tool_pose);
            let (a, b) = (tick.record.contact_wrench.force, report.force);
            if k < first { assert!(b.norm() < 1e-2, "{b}"); continue; }
            let i = if k < first + 100 { 0 } else { 1 };
            worst[i] = worst[i].max((a - b).norm());
            if k < first + 100 && b.norm() > 0.02 { worst[2] = worst[2].max((a - b).norm() / b.norm()); }
            if (k - first) % 25 == 0 { line += &format!(" {:.0}/{:.0}", a.norm() * 1e3, b.norm() * 1e3); }
        }
        println!("{device} mu {friction} z {z} {method:?} {hand_over}: worst first 100 ms {:.1} mN ({:.1} %), later {:.1} mN:{line}", worst[0]*1e3, worst[2]*1e2, worst[1]*1e3);
    }
    }
}
