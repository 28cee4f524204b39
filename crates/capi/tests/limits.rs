//! Are power, energy and jumps of the pose seen by a driver, and counted?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::time::Duration;

use palpate_capi::*;
use rig::{Rig, input, norm, options};

/// Lifts the tool by 0.1 m/s from 4 mm deep; what the ticks told.
fn lift(rig: &Rig) -> Vec<Output> {
    (0..40)
        .map(|k| {
            std::thread::sleep(Duration::from_millis(1));
            rig.tick_at(0.004 - 1e-4 * f64::from(k)).1
        })
        .collect()
}

/// Statistics that are not older than now.
fn statistics_now(rig: &Rig) -> Statistics {
    std::thread::sleep(Duration::from_millis(200));
    rig.statistics()
}

#[test]
fn power_is_limited_by_the_options_and_counted() {
    let rig = Rig::started(&Options { max_power: 1e-3, ..options() });
    let pressed = rig.press(0.004);
    assert!(pressed.flags & PALPATE_TICK_POWER_LIMITED == 0, "a tool at rest gives no power: {pressed:?}");
    let seen = lift(&rig).iter().filter(|o| o.flags & PALPATE_TICK_POWER_LIMITED != 0).count() as u64;
    let counted = statistics_now(&rig);
    assert!(seen > 0 && counted.power_limited >= seen, "{seen} seen, {counted:?}");
    assert!(counted.limited >= counted.power_limited && counted.force_limited == 0);

    let rig = Rig::started(&options());
    rig.press(0.004);
    assert!(lift(&rig).iter().all(|o| o.flags & PALPATE_TICK_POWER_LIMITED == 0), "nobody stated a limit this low");
}

#[test]
fn the_energy_of_a_contact_is_told_and_none_is_made() {
    let rig = Rig::started(&options());
    // The hand comes down slowly and does work on the tissue.
    for k in 0..200 {
        rig.tick_at(-0.002 + 3e-5 * f64::from(k));
        std::thread::sleep(Duration::from_millis(2));
    }
    let (_, pressed) = rig.tick_at(0.004);
    assert!(pressed.energy > 1e-5 && pressed.contacts > 0, "{pressed:?}");
    let counted = statistics_now(&rig);
    assert!(counted.energy > 0.0 && counted.energy_by_torque == 0.0, "{counted:?}");
    // The allowance is 0.5 mJ.
    assert!(counted.lowest_energy > -6e-4, "{counted:?}");
}

#[test]
fn a_tool_that_jumps_by_a_tenth_of_a_metre_gives_no_force_until_it_is_back() {
    let rig = Rig::started(&options());
    rig.press(0.004);
    std::thread::sleep(Duration::from_millis(1));
    let (status, jumped) = rig.tick_at(0.104);
    assert_eq!(status, Status::Notice);
    assert!(jumped.flags & PALPATE_TICK_JUMPED != 0, "{jumped:?}");
    let silent = rig.tick_until(0.104, "silence", |o| norm(o.force) == 0.0);
    assert!(silent.flags & PALPATE_TICK_JUMPED != 0, "the tool is below the skin: {silent:?}");
    std::thread::sleep(Duration::from_millis(1));
    let (_, back) = rig.tick_at(0.004);
    assert!(back.flags & PALPATE_TICK_JUMPED == 0 && back.gain < 0.5, "{back:?}");
    rig.press(0.004);
    assert!(statistics_now(&rig).jumped > 0);
}

#[test]
fn a_timestamp_that_leaps_gives_the_force_no_more_time_than_has_passed() {
    let rig = Rig::started(&Options { force_slew: 20.0, ..options() });
    rig.press(0.004);
    for _ in 0..5 {
        let begin = rig.now();
        let before = rig.tick_at(0.004).1;
        let ahead = input(rig.now() + 49_000_000, [0.0, 0.0, -rig::TOUCH - 0.009]);
        let (_, leapt) = rig.tick(&ahead);
        // Both ticks began within it.
        let passed = 1e-9 * (rig.now() - begin) as f64;
        let change: [f64; 3] = std::array::from_fn(|i| leapt.force[i] - before.force[i]);
        assert!(leapt.dt <= passed && norm(change) <= 20.0 * passed + 1e-12, "{} N in {passed} s", norm(change));
        assert!(leapt.flags & PALPATE_TICK_CLOCK != 0 || passed > 0.02, "{leapt:?}");
        // The device's clock goes on from before, and is not believed for a second: so it is in the next round.
        rig.tick_until(0.004, "a clock that is believed", |o| o.flags & PALPATE_TICK_CLOCK == 0 && o.gain == 1.0);
    }
}
