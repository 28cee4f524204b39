//! A driver that tells time by its device's clock, while the hand lives by this machine's: each rule goes by the one that is on
//! the safe side.

use crate::rig::{Bench, Wall, at, snapshot_of, strong_spec};
use palpate_haptics::device::TickTime;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::tick::TickConfig;
use proptest::prelude::*;

use nalgebra::{Isometry3, Vector3};
use palpate_haptics::snapshot::HapticSnapshot;

/// Largest change of force (N/s) and of the gain (1/s).
const SLEW: f64 = 100.0;
const FADE: f64 = 1.0 / 0.05;

fn bench() -> Bench {
    let mut config = TickConfig::for_device(&strong_spec());
    (config.limits.force_slew, config.limits.fade_in) = (SLEW, 1.0 / FADE);
    Bench::new(&config, &strong_spec())
}

fn floor(step: u64) -> HapticSnapshot {
    snapshot_of(step, &[Wall::floor(1e-3)], &Isometry3::identity())
}

/// A tick with the tool so deep, `dt` seconds after the last by the device's clock and `host` by this machine's.
fn tick(bench: &mut Bench, snapshot: &HapticSnapshot, depth: f64, dt: f64, host: f64) -> TickRecord {
    let time = TickTime { index: bench.index, time: 0.0, dt, host_lead: Some(host - dt) };
    bench.index += 1;
    bench.tick.tick(&mut bench.state, snapshot, &at(-Vector3::z() * depth), time, &mut bench.ws)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn force_and_gain_change_no_faster_than_either_clock_allows(
        ticks in prop::collection::vec((0.0..4e-3, 1e-6..0.06, 0.0..0.06, 0_u8..4), 1..80),
    ) {
        let (mut bench, mut before) = (bench(), None::<TickRecord>);
        for (k, (depth, leap, late, kind)) in ticks.into_iter().enumerate() {
            // In step; a leap of the device's clock; a late host; neither.
            let (dt, host) = [(1e-3, 1e-3), (leap, 1e-3), (1e-3, late), (leap, late)][usize::from(kind)];
            let record = tick(&mut bench, &floor(1 + k as u64 / 9), depth, dt, host);
            let (change, rise) = before.map_or((record.wrench.force.norm(), record.gain), |before| {
                ((record.wrench.force - before.wrench.force).norm(), record.gain - before.gain)
            });
            // The lead is a difference: an ulp of 0.06 s, times the slew.
            let least = dt.min(host);
            prop_assert!(change <= SLEW * least + 1e-12, "{change} N in {least} s");
            prop_assert!(rise <= FADE * least + 1e-12, "{rise} in {least} s");
            prop_assert!(record.granted <= least + 1e-15);
            prop_assert_eq!(record.flags.contains(TickFlags::GAP), dt > 0.05 || host > 0.05);
            before = Some(record);
        }
    }
}

#[test]
fn a_snapshot_ages_by_the_clock_by_which_steps_come() {
    let mut bench = bench();
    let snapshot = floor(1);
    tick(&mut bench, &snapshot, 1e-3, 1e-3, 1e-3);
    let record = (0..100).map(|_| tick(&mut bench, &snapshot, 1e-3, 0.5e-3, 1.5e-3)).last().unwrap();
    assert!((record.snapshot_age - 0.15).abs() < 1e-12, "{}", record.snapshot_age);
    assert!((record.host_lead - 1e-3).abs() < 1e-15 && record.dt == 0.5e-3 && record.granted == 0.5e-3);
}

#[test]
fn calls_within_the_resolution_of_this_machines_clock_hold_the_force_and_many_of_them_end_it() {
    let mut bench = bench();
    let snapshot = floor(1);
    let full = (0..100).map(|_| tick(&mut bench, &snapshot, 1e-3, 1e-3, 1e-3)).last().unwrap().wrench.force;
    assert!(full.norm() > 0.3, "{} N", full.norm());
    for k in 1..=60 {
        let record = tick(&mut bench, &snapshot, 3e-3, 0.0, 0.0);
        let stopped = k >= 50;
        assert_eq!(record.flags.contains(TickFlags::GAP), stopped, "call {k}");
        assert_eq!(record.wrench.force, if stopped { Vector3::zeros() } else { full }, "call {k}");
    }
    let back = tick(&mut bench, &snapshot, 1e-3, 1e-3, 1e-3);
    assert!(back.wrench.force.norm() < 0.03 * full.norm() && back.flags.contains(TickFlags::FADE_IN));
}
