//! Any bits at all in every number of a snapshot: the force stays finite and within limits, ends where a number is none, and
//! comes back on the next sound snapshot as if nothing had been.

use crate::sheet::{Bench, at};
use crate::snapshot_fields::{Field, OF_ALL, OF_PATCH, OF_ROWS, ball, over, sound};
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::TickConfig;
use palpate_haptics::wrench::Wrench;
use proptest::prelude::*;

const MAX_FORCE: f64 = 30.0;
const MAX_TORQUE: f64 = 0.1;

const NONE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

fn bench() -> Bench {
    Bench::new(&ball(), 10e-3, |config: &mut TickConfig| {
        (config.limits.max_force, config.limits.max_torque) = (Some(MAX_FORCE), Some(MAX_TORQUE));
        config.limits.fade_in = 5e-3;
    })
}

/// The snapshot with its patch, or with its rows alone.
fn shown(mut snapshot: HapticSnapshot, on_patches: bool) -> HapticSnapshot {
    snapshot.patch.valid = on_patches;
    snapshot
}

fn assert_bounded(record: &TickRecord, what: &str) {
    let Wrench { force, torque } = record.wrench;
    assert!(record.wrench.is_finite() && record.contact_wrench.is_finite(), "{what}: {record:?}");
    assert!(force.norm() <= MAX_FORCE * (1.0 + 1e-15), "{what}: {force}");
    assert!(torque.norm() <= MAX_TORQUE * (1.0 + 1e-15), "{what}: {torque}");
    assert!(record.force_jump.is_finite() && record.energy.account.is_finite(), "{what}: {record:?}");
    let tool = &record.tool_pose;
    assert!(tool.translation.vector.iter().all(|x| x.is_finite()), "{what}: the step would be told {tool}");
}

/// Force at the end of so many ticks (N), all of them within limits.
fn pressed(bench: &mut Bench, snapshot: &HapticSnapshot, what: &str) -> f64 {
    let mut force = 0.0;
    for _ in 0..300 {
        let record = bench.tick(snapshot, &at(over(1.2e-3)));
        assert_bounded(&record, what);
        assert!(!record.flags.contains(TickFlags::NON_FINITE), "{what}: on a sound snapshot");
        force = record.wrench.force.z;
    }
    force
}

#[test]
fn a_number_of_the_snapshot_that_is_none_ends_the_force_until_the_next_sound_one() {
    for (on_patches, fields) in [(true, OF_PATCH), (true, OF_ALL), (false, OF_ROWS), (false, &OF_ALL[..3])] {
        let [first, last] = [1, 3].map(|step| shown(sound(step), on_patches));
        let full = pressed(&mut bench(), &last, "nothing is remembered");
        assert!(full > 0.3, "{full} N");
        for ((name, poison), x) in fields.iter().flat_map(|field| NONE.map(|x| (field, x))) {
            let what = format!("{name} {x}, on patches: {on_patches}");
            let mut bad = sound(2);
            poison(&mut bad, x);
            let (bad, mut bench, place) = (shown(bad, on_patches), bench(), at(over(1.2e-3)));
            pressed(&mut bench, &first, &what);
            bench.tick.weigh_outgoing(&mut bench.state, &first, &place, &mut bench.ws);
            for _ in 0..20 {
                let record = bench.tick(&bad, &place);
                assert_bounded(&record, &what);
                assert_eq!(record.wrench, Wrench::zero(), "{what}");
                assert!(record.flags.contains(TickFlags::NON_FINITE), "{what}");
            }
            bench.tick.weigh_outgoing(&mut bench.state, &bad, &place, &mut bench.ws);
            let well = pressed(&mut bench, &last, &what);
            // Both begin from the step's forces; ticks stop at a relative residual of 1e-9.
            assert!((well / full - 1.0).abs() < 1e-6, "{what}: {well} N after it, not {full}");
        }
    }
}

/// A step's snapshot: one of its numbers, where it is overwritten, with what, and the ticks on it with the depth of the ball.
#[derive(Clone, Debug)]
struct Shown {
    field: usize,
    number: Option<f64>,
    depths: Vec<f64>,
}

fn shown_snapshot() -> impl Strategy<Value = Shown> {
    let wild = prop_oneof![
        prop::num::f64::ANY,
        Just(f64::NAN),
        prop::sample::select(vec![1e300, -1e300, f64::MAX, f64::MIN_POSITIVE, -1.0, 0.0]),
        -0.01..0.01_f64,
    ];
    let number = prop::option::weighted(0.6, wild);
    (0..1000_usize, number, prop::collection::vec(-1e-3..2e-3_f64, 1..8)).prop_map(|(field, number, depths)| Shown {
        field,
        number,
        depths,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn force_is_finite_and_within_limits_whatever_the_snapshots_hold(
        on_patches in any::<bool>(),
        steps in prop::collection::vec(shown_snapshot(), 1..16),
    ) {
        let of_kind = if on_patches { OF_PATCH } else { OF_ROWS };
        let of_all = if on_patches { OF_ALL } else { &OF_ALL[..3] };
        let fields: Vec<Field> = of_kind.iter().chain(of_all).copied().collect();
        let (good, mut bench) = (shown(sound(1), on_patches), bench());
        let mut before = good.clone();
        for (step, Shown { field, number, depths }) in steps.into_iter().enumerate() {
            let (name, poison) = fields[field % fields.len()];
            let mut snapshot = good.clone();
            snapshot.step = step as u64 + 1;
            if let Some(x) = number {
                poison(&mut snapshot, x);
                snapshot.patch.valid = on_patches;
            }
            bench.tick.weigh_outgoing(&mut bench.state, &before, &at(over(depths[0])), &mut bench.ws);
            for depth in depths {
                let record = bench.tick(&snapshot, &at(over(depth)));
                let what = format!("step {step}, {name} {number:?}, depth {depth}");
                assert_bounded(&record, &what);
                // Compliance without a force on it has no part in the answer.
                if number.is_some_and(|x| !x.is_finite()) && !name.contains("compliance") {
                    prop_assert_eq!(record.wrench, Wrench::zero(), "{}", what);
                    prop_assert!(record.flags.contains(TickFlags::NON_FINITE), "{}", what);
                }
            }
            before = snapshot;
        }
    }
}
