//! The stiffest wall that the rig renders, by its motion and by its eigenvalues, beside theory.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

use palpate_haptics::device::VirtualDeviceConfig;
use palpate_haptics::hand::{HAND_PRESETS, Hand};
use palpate_haptics::rig::{Rig, Search, Wall, largest_stable, passive_stiffness, stable_stiffness};

const PERIOD: f64 = 1e-3;

fn rig(damping: f64, delay_ticks: usize, hand: Hand) -> Rig {
    // Nothing but the script needs sub-steps, and it stands still.
    let mechanics = VirtualDeviceConfig { damping, substeps: 1, ..VirtualDeviceConfig::ideal(delay_ticks) };
    Rig { mechanics, hand, period: PERIOD }
}

const SEARCH: Search = Search { low: 5.0, high: 1e6, stride: 2.0, ratio: 1.002 };

fn by_motion(rig: &Rig, damping: f64) -> f64 {
    let stable = |stiffness| rig.comes_to_rest(&Wall { stiffness, damping }, 8000).unwrap();
    largest_stable(&SEARCH, stable).expect("a soft wall holds")
}

fn by_eigenvalues(rig: &Rig, damping: f64) -> f64 {
    largest_stable(&SEARCH, |stiffness| rig.spectral_radius(&Wall { stiffness, damping }) < 1.0)
        .expect("a soft wall holds")
}

fn none() -> Hand {
    Hand::preset("none").unwrap()
}

#[test]
fn an_ideal_device_renders_the_walls_that_colgate_and_schenkel_allow_and_no_stiffer_ones() {
    for damping in [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0] {
        let rig = rig(damping, 0, none());
        let line = passive_stiffness(damping, 0.0, PERIOD);
        let (moved, eigen) = (by_motion(&rig, 0.0), by_eigenvalues(&rig, 0.0));
        println!("b {damping:4} N s/m: line {line:7.1}, motion {moved:7.1}, eigenvalues {eigen:7.1} N/m");
        assert!((moved / line - 1.0).abs() < 0.05 && (eigen / line - 1.0).abs() < 0.05, "b = {damping}");
        // The criterion calls a motion endless that falls by less than 1 % in 2 s: K off by 0.01 m/b, relatively.
        assert!((moved / eigen - 1.0).abs() < 3e-3 + 0.01 * 0.1 / damping, "b = {damping}: {moved} {eigen}");
    }
}

#[test]
fn motion_and_eigenvalues_agree_for_every_hand_damper_and_delay() {
    for preset in HAND_PRESETS {
        for (delay, damping) in [(0, 0.0), (1, 0.0), (3, 0.0), (0, 0.5), (1, 0.5)] {
            let rig = rig(0.2, delay, preset.hand);
            let (moved, eigen) = (by_motion(&rig, damping), by_eigenvalues(&rig, damping));
            let line = stable_stiffness(0.2, damping, PERIOD, delay);
            println!("{:10} delay {delay} B {damping}: motion {moved:8.1}, eigenvalues {eigen:8.1} N/m", preset.name);
            assert!((moved / eigen - 1.0).abs() < 0.02, "{}: {moved} {eigen}", preset.name);
            if preset.name == "none" && damping == 0.0 {
                assert!((eigen / line - 1.0).abs() < 0.02, "delay {delay}: {eigen} {line}");
            }
        }
    }
}

#[test]
fn no_passive_hand_makes_a_wall_unstable_that_is_passive_and_some_does_beyond_it() {
    let b = 1.0;
    for damping in [-0.5, 0.2, 0.5, 0.8] {
        let line = passive_stiffness(b, damping, PERIOD);
        let alone = by_eigenvalues(&rig(b, 0, none()), damping);
        // Springs without damping, up to those that swing with the ticks; masses; grasps. Half of it is the Nyquist rate.
        let nyquist = 0.1 * (std::f64::consts::PI / PERIOD).powi(2);
        let springs = (0..60).map(|k| Hand::rigid(0.0, 0.0, nyquist * 0.025 * f64::from(k)));
        let masses = [0.01, 0.1, 1.0].map(|mass| Hand::rigid(mass, 0.0, 0.0));
        let grasps = (0..20).map(|k| Hand::rigid(0.1, 0.1, 0.0).grasping(nyquist * 0.05 * f64::from(k + 1), 0.0));
        let hands = springs.chain(masses).chain(grasps).chain(HAND_PRESETS.iter().map(|preset| preset.hand));
        let worst = hands.map(|hand| by_eigenvalues(&rig(b, 0, hand), damping)).fold(f64::INFINITY, f64::min);
        println!("B {damping}: passive up to {line:.0}, worst hand {worst:.0}, alone {alone:.0} N/m");
        // The search ends within 0.2 % of the edge.
        assert!(worst > 0.998 * line, "B = {damping}: {worst} {line}");
        if damping > 0.0 {
            assert!(worst < 0.95 * alone, "B = {damping}: the hand matters: {worst} {alone}");
        }
    }
}
