//! The largest wall stiffness that the virtual device renders is that of the sampled-data theory.
//!
//! A bilateral spring at the origin, force = −K x at each tick, no friction, no encoder: a linear loop, whose edge the
//! eigenvalues of the sampled system give. The table holds those for m = 0.1 kg, b = 0.2 N s/m.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

use nalgebra::Vector3;
use palpate_haptics::device::{HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::hand::Hand;
use palpate_haptics::script::HandScript;
use palpate_haptics::wrench::Wrench;

/// Whether the oscillation grows between the second and the last quarter of `ticks`.
fn grows(hand: Hand, delay: usize, period: f64, stiffness: f64, ticks: u64) -> bool {
    let script = HandScript::at(Vector3::zeros());
    let device = VirtualDevice::new(VirtualDeviceConfig::ideal(delay), hand, script).unwrap();
    let mut device = device.with_velocity(Vector3::new(0.1, 0.0, 0.0));
    let (mut early, mut late) = (0.0_f64, 0.0_f64);
    for index in 0..ticks {
        let sample = device.read(TickTime::regular(index, period)).unwrap();
        let x = sample.pose.translation.vector;
        device.write(Wrench::from_force(-x * stiffness)).unwrap();
        let energy = device.velocity().norm_squared() + x.norm_squared() * (stiffness + hand.stiffness) / 0.1;
        if energy > 1e6 {
            return true;
        }
        match 4 * index / ticks {
            1 => early = early.max(energy),
            3 => late = late.max(energy),
            _ => {}
        }
    }
    late > early
}

fn edge(hand: Hand, delay: usize, period: f64) -> f64 {
    let (mut low, mut high) = (0.5_f64, 1e5_f64);
    while high / low > 1.001 {
        let middle = (low * high).sqrt();
        if grows(hand, delay, period, middle, 12_000) { high = middle } else { low = middle }
    }
    (low * high).sqrt()
}

/// N/m; 1 kHz without and with a tick of delay, 30 Hz the same.
const TABLE: [(&str, [f64; 4]); 4] = [
    ("none", [403.0, 133.0, 12.0, 4.0]),
    ("fingertip", [4430.0, 1479.0, 181.0, 100.0]),
    ("stylus", [8445.0, 2846.0, 378.0, 212.0]),
    ("arm", [13389.0, 4471.0, 434.0, 158.0]),
];

#[test]
fn largest_stable_stiffness_is_within_3_percent_of_the_eigenvalues_for_each_hand() {
    for (name, expected) in TABLE {
        let hand = Hand::preset(name).unwrap();
        let loops = [(0, 1e-3), (1, 1e-3), (0, 1.0 / 30.0), (1, 1.0 / 30.0)];
        for ((delay, period), expected) in loops.into_iter().zip(expected) {
            let found = edge(hand, delay, period);
            println!("{name:10} delay {delay} period {period:.4} s: {found:9.1} N/m, table {expected}");
            // The table is rounded to 1 N/m.
            let tolerance = 0.03 * expected + 0.5;
            assert!((found - expected).abs() <= tolerance, "{name}, delay {delay}, {period} s: {found} != {expected}");
        }
    }
}

#[test]
fn first_order_law_holds_for_the_bare_device() {
    // K = b / ((n + 1/2) T) up to terms of order T b / m = 0.2 %; 2 % leaves room for n² times that.
    for delay in 0..3 {
        let theory = 0.2 / ((delay as f64 + 0.5) * 1e-3);
        let found = edge(Hand::preset("none").unwrap(), delay, 1e-3);
        assert!((found / theory - 1.0).abs() < 0.02, "delay {delay}: {found} != {theory}");
    }
}
