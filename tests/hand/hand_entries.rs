//! The passivity controller in the closed loop: a hand that goes into the bundled block by any way and holds.
//!
//! A hand that goes in while the force fades in has put little energy in, and is given more back when the force has come:
//! the account is overdrawn for as long as it holds. A controller that switches the push in place of damping makes a swing of that.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use std::path::Path;

use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, RunOptions};
use palpate::scene::{Scene, SceneDescription};
use palpate::tick::TickFlags;

/// How a hand goes in, and how long it takes (s).
#[derive(Clone, Copy, Debug)]
struct Entry {
    hand: &'static str,
    /// Heights of the ball's centre at the begin and the end (m); the block lies from 0 to 30 mm, its fixed face is at 0.
    way: [f64; 2],
    time: f64,
}

/// What came of it.
#[derive(Debug)]
struct Outcome {
    /// Least energy of a contact (J).
    lowest: f64,
    /// Energy over the whole (J).
    net: f64,
    /// Range of the device over the second half (m).
    swing: f64,
    acted: usize,
    slewed: usize,
}

fn run(entry: Entry, control: bool, change: impl FnOnce(&mut SceneDescription)) -> Outcome {
    let mut scene = Scene::from_toml(include_str!("../../examples/scenes/block.toml"), Path::new("")).unwrap();
    scene
        .edit(|scene| {
            scene.passivity.control = control;
            scene.hand.preset = entry.hand.into();
            let key = |time, z| ScriptKey { time, position: [0.0, 0.0, z], ..ScriptKey::default() };
            scene.hand.path = vec![key(0.0, entry.way[0]), key(entry.time, entry.way[1]), key(1.5, entry.way[1])];
            change(scene);
        })
        .unwrap();
    let length = Length::Seconds(1.5);
    let options = RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() };
    let (outcome, recorder) = block::record(&scene.build().unwrap(), &options);
    let port = outcome.summary.port;
    let late = recorder.ticks.iter().filter(|t| t.record.time > 0.75);
    let places = late.map(|t| t.record.device_pose.translation.z);
    let (least, most) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)));
    let count = |flag| recorder.ticks.iter().filter(|t| t.record.flags.contains(flag)).count();
    Outcome {
        lowest: port.least_account,
        net: port.energy[0],
        swing: most - least,
        acted: count(TickFlags::PASSIVITY),
        slewed: count(TickFlags::SLEW_LIMITED),
    }
}

/// Encoder step of the virtual device (m): what a swing may differ by.
const ENCODER: f64 = 30e-6;

fn compare(entry: Entry, change: impl Fn(&mut SceneDescription) + Copy) -> [Outcome; 2] {
    let [off, on] = [false, true].map(|control| run(entry, control, change));
    println!(
        "{entry:?}: lowest {:.2} mJ without, {:.2} mJ with; net {:.1}, {:.1} mJ; swing {:.3}, {:.3} mm; acted {}, slew {}, {}",
        1e3 * off.lowest,
        1e3 * on.lowest,
        1e3 * off.net,
        1e3 * on.net,
        1e3 * off.swing,
        1e3 * on.swing,
        on.acted,
        off.slewed,
        on.slewed,
    );
    assert_eq!(off.acted, 0);
    assert!(on.lowest >= off.lowest, "{entry:?}: more energy with control: {on:?}, {off:?}");
    assert!(on.swing <= off.swing + 2.0 * ENCODER, "{entry:?}: a larger swing with control: {on:?}, {off:?}");
    [off, on]
}

#[test]
fn a_hand_that_goes_in_while_the_force_fades_in_gets_no_more_energy_and_no_more_swing_with_control() {
    let mut acted = 0;
    for hand in ["loose", "normal", "firm"] {
        for time in [0.05, 0.1, 0.2, 0.3] {
            for way in [[-0.02, 0.03], [0.05, 0.02]] {
                let [_, on] = compare(Entry { hand, way, time }, |_| {});
                acted += usize::from(on.acted > 0);
                // A contact that does nothing but hold: the controller comes to rest too.
                assert!(on.acted < 700, "{on:?}");
            }
        }
    }
    assert!(acted >= 12, "the controller had to act in {acted} of 24 only");
}

#[test]
fn a_swing_of_too_stiff_a_coupling_is_reduced_and_gives_out_less() {
    for (hand, stiffness) in [("loose", 5000.0), ("normal", 8000.0), ("firm", 14_000.0)] {
        let entry = Entry { hand, way: [-0.02, -0.005], time: 0.5 };
        let [off, on] = compare(entry, |scene| {
            // A fast fade, so that what is given out is the swing's own; against the fixed face, which does not give way.
            scene.limits.fade_in = 1e-3;
            let translation = palpate::haptics::coupling::Spring { stiffness, damping: 2.0 };
            scene.coupling = Some(palpate::haptics::coupling::CouplingConfig { translation, rotation: None });
        });
        assert!(off.swing > 1e-4, "{hand}: there is no swing: {off:?}");
        assert!(on.swing < 0.9 * off.swing && on.lowest > 0.9 * off.lowest, "{hand}: {on:?}, {off:?}");
    }
}
