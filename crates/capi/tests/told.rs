//! Does a tick tell what the header says: nothing where all is well, and nothing that is not named?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::path::Path;
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use palpate_capi::*;
use rig::{Rig, input, is_silent, norm, options, stale_output};

/// Every bit that the header names.
fn named_flags() -> u32 {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/palpate.h");
    let header = std::fs::read_to_string(path).unwrap();
    let bits = header.lines().filter_map(|line| {
        let value = line.strip_prefix("#define PALPATE_TICK_")?.split("(1u << ").nth(1)?;
        value.trim_end_matches(')').parse::<u32>().ok()
    });
    bits.map(|bit| 1 << bit).sum()
}

#[test]
fn a_still_press_is_answered_by_ok_and_every_flag_has_a_name() {
    // At this rate no tick of the loop is late, whatever else the machine does.
    let rig = Rig::started(&Options { rate: 100.0, ..options() });
    rig.press(0.004);
    let (named, mut ok) = (named_flags(), 0);
    for _ in 0..300 {
        std::thread::sleep(Duration::from_millis(1));
        let (status, output) = rig.tick_at(0.004);
        assert_eq!(output.flags & !named, 0, "{:#x} is not in the header", output.flags & !named);
        let quiet = output.flags & !PALPATE_TICK_NEW_STEP == 0;
        assert_eq!(status, if quiet { Status::Ok } else { Status::Notice }, "{output:?}");
        assert!(output.contacts > 0 && norm(output.force) > 0.0);
        ok += u32::from(status == Status::Ok);
    }
    assert!(ok > 150, "{ok} of 300 ticks are well");
}

#[test]
fn a_second_thread_is_refused_with_a_status_and_no_force() {
    let rig = Rig::started(&options());
    rig.press(0.004);
    let (port, end) = (rig.port as usize, AtomicBool::new(false));
    let hammer = || {
        let (mut refused, mut done) = (0_u64, 0_u64);
        while !end.load(Ordering::Relaxed) {
            let mut output = stale_output();
            let given = input(0, [0.0, 0.0, -0.016]);
            // SAFETY: the port lives until the threads have ended.
            let status = unsafe { palpate_tick(port as *const Port, &raw const given, &raw mut output) };
            if status == Status::ErrorBusy {
                refused += 1;
                assert!(is_silent(&output) && output.flags == PALPATE_TICK_REFUSED);
                assert_eq!(output.phase, PALPATE_PHASE_RUNNING, "the simulation has not failed");
            } else {
                done += 1;
                assert!((status as i32) >= 0 && norm(output.force) < 12.0, "{status:?} {output:?}");
            }
            if refused > 20 && done > 20 {
                end.store(true, Ordering::Relaxed);
            }
        }
        (refused, done)
    };
    let (a, b) = std::thread::scope(|scope| {
        let (a, b) = (scope.spawn(hammer), scope.spawn(hammer));
        std::thread::sleep(Duration::from_millis(50));
        let begin = std::time::Instant::now();
        while !end.load(Ordering::Relaxed) {
            assert!(begin.elapsed() < Duration::from_secs(20), "the threads never met");
            std::thread::sleep(Duration::from_millis(5));
        }
        (a.join().unwrap(), b.join().unwrap())
    });
    assert!(a.0 + b.0 > 20 && a.1 + b.1 > 20, "{a:?} {b:?}");
    let (status, _) = rig.tick_at(0.004);
    assert!((status as i32) >= 0, "one thread alone is let in again");
}

#[test]
fn an_input_with_a_bit_or_field_that_is_not_known_is_refused_without_force() {
    let rig = Rig::started(&options());
    let unknown = [Input { fields: 1 << 2, ..input(0, [0.0; 3]) }, Input { reserved: 1, ..input(0, [0.0; 3]) }];
    for given in unknown {
        rig.press(0.004);
        let (status, output) = rig.tick(&Input { time_ns: rig.now(), position: [0.0, 0.0, -0.016], ..given });
        assert_eq!(status, Status::ErrorArgument, "{given:?}");
        assert!(is_silent(&output) && output.flags & PALPATE_TICK_REFUSED != 0, "{output:?}");
        assert_eq!(output.phase, PALPATE_PHASE_RUNNING);
        let (_, after) = rig.tick_at(0.004);
        assert!(after.gain < 0.5, "the force comes back as a ramp: {after:?}");
    }
}

/// All numbers are finite, but for the two that the header excepts.
fn check_finite(output: &Output) {
    let o = output;
    let vectors = [o.force, o.torque, o.contact_force, o.contact_torque, o.tool_position];
    let numbers = [o.gain, o.dt, o.work, o.energy, o.gripper_effort, o.gripper_torque, o.tool_opening];
    let mut all = vectors.as_flattened().iter().chain(&o.tool_orientation).chain(&numbers);
    assert!(all.all(|x| x.is_finite()), "{o:?}");
    assert!([o.gap, o.step_age].iter().all(|x| x.is_finite() || *x == f64::INFINITY), "{o:?}");
}

#[test]
fn every_number_is_finite_but_gap_and_age_of_the_step() {
    let rig = Rig::new(&options());
    let (_, ready) = rig.tick_at(-0.008);
    check_finite(&ready);
    assert_eq!((ready.gap, ready.step_age), (f64::INFINITY, f64::INFINITY), "no step yet");
    assert_eq!(rig.start(), Status::Ok);
    let pressed = rig.press(0.004);
    check_finite(&pressed);
    assert!(pressed.gap.is_finite() && pressed.step_age.is_finite(), "{pressed:?}");
    let wild = [f64::NAN, f64::INFINITY, -1e300, 1e300];
    for value in wild {
        let given = Input { time_ns: rig.now(), ..input(0, [0.0, value, -0.016]) };
        check_finite(&rig.tick(&given).1);
        check_finite(&rig.tick(&Input { orientation: [value, 0.0, 0.0, 1.0], position: [0.0; 3], ..given }).1);
    }
    let mut output = stale_output();
    // SAFETY: NULL is allowed, and the struct is whole.
    let status = unsafe { palpate_tick(ptr::null(), ptr::null(), &raw mut output) };
    check_finite(&output);
    assert_eq!((status, output.phase), (Status::ErrorNull, PALPATE_PHASE_FAILED));
}
