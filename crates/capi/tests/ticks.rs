//! What does a driver's tick answer: in contact, and when everything goes wrong?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use palpate_capi::*;
use rig::{Rig, input, is_silent, norm, options, stale_output};

#[global_allocator]
static GUARD: AllocDisabler = AllocDisabler;

#[test]
fn force_is_zero_in_air_opposes_penetration_and_grows_with_it() {
    let rig = Rig::started(&options());
    let air = rig.tick_until(-0.008, "a step", |o| o.flags & PALPATE_TICK_NO_STEP == 0);
    assert!(is_silent(&air) && air.contacts == 0, "{air:?}");
    let forces = [0.002, 0.004, 0.006].map(|depth| {
        rig.press(depth);
        // A few steps more, so that the tissue is at rest.
        let begin = rig.statistics().steps;
        rig.tick_until(depth, "ten steps", |_| rig.statistics().steps > begin + 10)
    });
    for force in &forces {
        let [x, y, z] = force.force;
        assert!(z > 0.0 && x.hypot(y) < 0.2 * z, "{force:?}");
        assert!(force.contacts > 0 && force.phase == PALPATE_PHASE_RUNNING);
        assert!(force.tool_position[2] > -rig::TOUCH - 0.006, "the tool stays on the skin");
    }
    assert!(forces[1].force[2] > 1.2 * forces[0].force[2] && forces[2].force[2] > 1.2 * forces[1].force[2]);
    let air = rig.tick_until(-0.008, "air", |o| o.contacts == 0 && is_silent(o));
    assert!(air.gain > 0.0);
}

#[test]
fn a_pose_that_is_no_pose_ends_the_force_at_once_and_its_return_is_a_ramp() {
    let rig = Rig::started(&options());
    let bad = [
        input(0, [f64::NAN, 0.0, 0.0]),
        input(0, [0.0, f64::INFINITY, 0.0]),
        input(0, [0.0, 0.0, 1e4]),
        Input { orientation: [2.0, 0.0, 0.0, 0.0], ..input(0, [0.0; 3]) },
        Input { orientation: [f64::NAN, 0.0, 0.0, 0.0], ..input(0, [0.0; 3]) },
    ];
    for given in bad {
        rig.press(0.004);
        let (status, output) = rig.tick(&Input { time_ns: rig.now(), ..given });
        assert_eq!(status, Status::ErrorInput, "{given:?}");
        assert!(is_silent(&output) && output.flags & PALPATE_TICK_BAD_POSE != 0, "{output:?}");
        let (_, after) = rig.tick_at(0.004);
        assert!(after.gain < 0.5 && after.flags & PALPATE_TICK_FADE_IN != 0, "{after:?}");
    }
    let begin = std::time::Instant::now();
    // Some 50 ms old.
    while rig.statistics().refused < bad.len() as u64 && begin.elapsed() < Duration::from_secs(10) {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(rig.statistics().refused, bad.len() as u64);
}

#[test]
fn a_velocity_or_a_gripper_that_is_no_number_ends_the_force_at_once_where_it_is_said_to_be_measured() {
    let rig = Rig::started(&options());
    let nan = f64::NAN;
    let bad = [
        (PALPATE_INPUT_VELOCITY, Input { velocity: [nan, 0.0, 0.0], ..input(0, [0.0; 3]) }),
        (PALPATE_INPUT_VELOCITY, Input { angular_velocity: [0.0, f64::INFINITY, 0.0], ..input(0, [0.0; 3]) }),
        (PALPATE_INPUT_VELOCITY, Input { velocity: [0.0, 0.0, 1e300], ..input(0, [0.0; 3]) }),
        (PALPATE_INPUT_GRIPPER, Input { gripper: nan, ..input(0, [0.0; 3]) }),
    ];
    for (fields, given) in bad {
        let pressed = rig.press(0.004);
        let here = input(0, [0.0, 0.0, -rig::TOUCH - 0.004]);
        let given = Input { position: here.position, orientation: here.orientation, ..given };
        assert!(norm(pressed.force) > 0.0);
        let (status, output) = rig.tick(&Input { time_ns: rig.now(), fields, ..given });
        assert_eq!(status, Status::ErrorInput, "{given:?}");
        assert!(is_silent(&output) && output.flags & PALPATE_TICK_BAD_POSE != 0, "{output:?}");
        // Of numbers that are not said to be measured nothing is taken.
        let (status, _) = rig.tick(&Input { time_ns: rig.now(), fields: 0, ..given });
        assert_ne!(status, Status::ErrorInput, "{given:?}");
    }
}

#[test]
fn no_input_no_port_no_output_and_small_structs_are_refused_without_force() {
    let rig = Rig::started(&options());
    rig.press(0.004);
    let mut output = stale_output();
    let good = input(rig.now(), [0.0, 0.0, -0.016]);
    // SAFETY: NULL is allowed, and all other structs are whole.
    unsafe {
        assert_eq!(palpate_tick(rig.port, ptr::null(), &raw mut output), Status::ErrorNull);
        assert!(is_silent(&output) && output.flags & PALPATE_TICK_REFUSED != 0, "{output:?}");
        output = stale_output();
        assert_eq!(palpate_tick(ptr::null(), &raw const good, &raw mut output), Status::ErrorNull);
        assert!(is_silent(&output) && output.tick == 0);
        assert_eq!(palpate_tick(rig.port, &raw const good, ptr::null_mut()), Status::ErrorNull);
    }
    let (_, after) = rig.tick_at(0.004);
    assert!(after.gain < 0.5, "a force that nobody got does not count as sent: {after:?}");

    rig.press(0.004);
    let (status, output) = rig.tick(&Input { struct_size: 40, ..input(rig.now(), [0.0, 0.0, -0.016]) });
    assert_eq!(status, Status::ErrorStructSize);
    assert!(is_silent(&output));

    // An output of a first version that knows no more than the torque, and one that is too small for that.
    let mut output = Output { struct_size: 64, ..stale_output() };
    // SAFETY: whole structs.
    let status = unsafe { palpate_tick(rig.port, &raw const good, &raw mut output) };
    assert!(status == Status::Ok || status == Status::Notice, "{status:?}");
    assert!(norm(output.force) < 10.0 && output.contact_force == [99.0; 3] && output.phase == 99, "{output:?}");
    let mut output = Output { struct_size: 40, ..stale_output() };
    // SAFETY: whole structs.
    let status = unsafe { palpate_tick(rig.port, &raw const good, &raw mut output) };
    assert_eq!(status, Status::ErrorStructSize);
    assert_eq!((output.force, output.torque), ([0.0; 3], [99.0; 3]), "written as far as it reaches");
}

#[test]
fn an_input_of_an_older_version_is_understood() {
    let rig = Rig::started(&options());
    let wanted = rig.press(0.004).force[2];
    let begin = rig.now();
    let mut force = 0.0;
    while rig.now() < begin + 50_000_000 {
        // Reaches to the orientation; what lies behind it is not to be read.
        let old = Input {
            struct_size: 72,
            fields: PALPATE_INPUT_VELOCITY,
            velocity: [f64::NAN; 3],
            angular_velocity: [f64::NAN; 3],
            buttons: u32::MAX,
            ..input(rig.now(), [0.0, 0.0, -rig::TOUCH - 0.004])
        };
        let (status, output) = rig.tick(&old);
        assert!(status == Status::Ok || status == Status::Notice, "{status:?}");
        force = output.force[2];
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(force > 0.3 * wanted, "{force} N of {wanted} N");
}

#[test]
fn a_clock_that_runs_backwards_is_told_and_the_force_stays_bounded() {
    let rig = Rig::started(&options());
    let before = rig.press(0.004);
    let (_, output) = rig.tick(&input(5, [0.0, 0.0, -rig::TOUCH - 0.004]));
    assert!(output.flags & PALPATE_TICK_CLOCK != 0 && output.dt > 0.0, "{output:?}");
    // 2000 N/s, and never more than the limit.
    assert!((output.force[2] - before.force[2]).abs() <= 2000.0 * output.dt + 1e-9);
    let mut time = 10;
    for _ in 0..50 {
        time += 1_000_000;
        let (_, output) = rig.tick(&input(time, [0.0, 0.0, -rig::TOUCH - 0.004]));
        assert!(norm(output.force) <= 12.0 && output.dt >= 0.0, "{output:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_jump_of_the_pose_stays_within_force_and_slew() {
    let limits = Options { max_force: 2.0, force_slew: 500.0, ..options() };
    let rig = Rig::started(&limits);
    let mut before = rig.press(0.003);
    for k in 0..400 {
        let depth = if k % 20 < 10 { 0.1 } else { -0.05 };
        let (_, output) = rig.tick_at(depth);
        assert!(norm(output.force) <= 2.0, "{output:?}");
        let change: [f64; 3] = std::array::from_fn(|i| output.force[i] - before.force[i]);
        // At a gap the limits count one period.
        assert!(norm(change) <= 500.0 * output.dt.max(1e-3) + 1e-9, "{} N in {} s", norm(change), output.dt);
        before = output;
    }
}

#[test]
fn a_pause_brings_the_force_down_and_its_end_brings_it_back_as_a_ramp() {
    let rig = Rig::started(&Options { force_slew: 20.0, ..options() });
    let pressed = rig.press(0.004);
    assert_eq!(rig.pause(), Status::Ok);
    let mut before = pressed;
    let silent = rig.tick_until(0.004, "silence", |o| {
        assert!((o.force[2] - before.force[2]).abs() <= 20.0 * o.dt.max(1e-3) + 1e-9, "no faster than the limit");
        before = *o;
        is_silent(o)
    });
    assert_eq!(silent.phase, PALPATE_PHASE_PAUSED);
    assert!(silent.flags & PALPATE_TICK_AT_REST != 0, "{silent:?}");
    let steps = rig.statistics().steps;
    for _ in 0..100 {
        assert!(is_silent(&rig.tick_at(0.004).1));
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(rig.statistics().steps <= steps + 1, "the tissue stands still");
    assert_eq!(rig.resume(), Status::Ok);
    let first = rig.tick_until(0.004, "a force", |o| o.force[2] > 0.0);
    assert!(first.gain < 0.5, "{first:?}");
    rig.press(0.004);
}

#[test]
fn stopping_during_ticks_brings_the_force_down_and_destroying_leaves_the_port() {
    let mut rig = Rig::started(&options());
    rig.press(0.004);
    let (port, end) = (rig.port as usize, AtomicBool::new(false));
    std::thread::scope(|scope| {
        let driver = scope.spawn(|| {
            let mut last = stale_output();
            while !end.load(Ordering::Relaxed) {
                let given = input(0, [0.0, 0.0, -0.016]);
                // SAFETY: the port lives until the thread has ended.
                let status = unsafe { palpate_tick(port as *const Port, &raw const given, &raw mut last) };
                assert!((status as i32) >= 0 && norm(last.force) <= 12.0, "{last:?}");
            }
            last
        });
        assert_eq!(rig.stop(), Status::Ok);
        // SAFETY: nobody uses it any more; the rig is told.
        unsafe { palpate_destroy(rig.simulation) };
        rig.simulation = ptr::null_mut();
        std::thread::sleep(Duration::from_millis(100));
        end.store(true, Ordering::Relaxed);
        let last = driver.join().unwrap();
        assert!(is_silent(&last) && last.phase == PALPATE_PHASE_STOPPED, "{last:?}");
    });
}

#[test]
fn a_driver_that_stalls_gets_its_force_back_as_a_ramp() {
    let rig = Rig::started(&options());
    rig.press(0.004);
    std::thread::sleep(Duration::from_millis(120));
    let (_, output) = rig.tick_at(0.004);
    assert!(output.flags & PALPATE_TICK_GAP != 0 && output.gain < 0.1, "{output:?}");
}

#[test]
fn time_is_measured_at_every_rate_so_that_the_ramp_takes_as_long() {
    for rate in [100.0, 500.0, 8000.0] {
        let rig = Rig::started(&Options { rate, gap: 0.2, ..options() });
        let mut gain: Option<f64> = None;
        rig.tick_until(0.004, "the whole force", |o| {
            // 0.3 s from nothing to all, however many ticks that is.
            if let Some(before) =
                gain.filter(|_| o.flags & PALPATE_TICK_FADE_IN != 0 && o.flags & PALPATE_TICK_GAP == 0)
            {
                assert!((o.gain - before - o.dt / 0.3).abs() < 1e-12, "{rate} Hz: {o:?}");
            }
            gain = (o.flags & (PALPATE_TICK_NO_STEP | PALPATE_TICK_GAP) == 0).then_some(o.gain);
            std::thread::sleep(Duration::from_secs_f64((1.0 / rate - 1e-3).max(0.0)));
            o.gain == 1.0 && o.force[2] > 0.02
        });
    }
}

#[test]
fn ticks_allocate_nothing_in_contact_and_in_every_fault() {
    let rig = Rig::started(&options());
    rig.press(0.004);
    let (port, simulation) = (rig.port, rig.simulation);
    let before = violation_count();
    let mut contacts = 0_u64;
    for k in 0..20_000_u32 {
        let depth = if k % 500 < 300 { 0.004 } else { -0.01 };
        let mut given = input(rig.now(), [0.0, 0.0, -rig::TOUCH - depth]);
        match k % 997 {
            1 => given.position[0] = f64::NAN,
            2 => given.time_ns = 3,
            3 => given.struct_size = 8,
            _ => {}
        }
        let mut output = stale_output();
        let input: *const Input = if k % 997 == 4 { ptr::null() } else { &raw const given };
        assert_no_alloc(|| {
            // SAFETY: a port that lives as long as the rig, structs of this function, or NULL.
            unsafe { palpate_tick(port, input, &raw mut output) };
        });
        contacts += u64::from(output.contacts);
        match k {
            8_000 => assert_eq!(rig.pause(), Status::Ok),
            9_000 => assert_eq!(rig.resume(), Status::Ok),
            // SAFETY: as in the rig.
            18_000 => assert_eq!(unsafe { palpate_stop(simulation) }, Status::Ok),
            _ => {}
        }
    }
    assert_eq!(violation_count(), before);
    assert!(contacts > 1000, "{contacts}");
}
