//! Does the coupling follow from what a driver tells of its device, and is a jump what it says?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::mem::offset_of;
use std::time::Duration;

use palpate_capi::*;
use rig::{Rig, TOUCH, create, is_silent, last_error, options};

/// Stiffness of the coupling by what the driver sees of it: force over the way from the device to the tool (N/m).
fn coupling(options: &Options) -> f64 {
    let rig = Rig::started(options);
    let depth = 0.004;
    rig.press(depth);
    // The damper of the coupling is silent when the tissue is.
    let steps = rig.statistics().steps;
    let still = rig.tick_until(depth, "thirty steps", |_| rig.statistics().steps > steps + 30);
    assert!(still.contacts > 0 && still.gain == 1.0, "{still:?}");
    let stretch = still.tool_position[2] - (-TOUCH - depth);
    still.contact_force[2] / stretch
}

/// The stiffest one against any wall, over its margin of 1.2, for damping b of the device and B of the coupling in N s/m
/// and n ticks of delay at 1 kHz: by the header.
fn granted(b: f64, coupling: f64, n: f64) -> f64 {
    2.0 * (b * coupling).sqrt() / ((n + 0.5) * 1e-3) / 1.2
}

#[test]
fn the_coupling_follows_from_mass_damping_friction_resolution_and_delay() {
    let light = Options { rate: 1000.0, device_mass: 1.0, device_damping: 0.05, ..options() };
    let none = PALPATE_OPTION_NO_DELAY;
    let cases = [
        ("damping", light, granted(0.05, 2.0, 1.0)),
        ("less damping", Options { device_damping: 0.01, ..light }, granted(0.01, 2.0, 1.0)),
        ("delay", Options { device_delay_ticks: 3, ..light }, granted(0.05, 2.0, 3.0)),
        ("no delay", Options { device_damping: 0.01, switches: none, ..light }, granted(0.01, 2.0, 0.0)),
        // B = m / (4 (n + 1/2) T) is 0.5 N s/m.
        ("mass", Options { device_mass: 3e-3, ..light }, granted(0.05, 0.5, 1.0)),
        ("encoder", Options { device_friction: 1e-3, device_resolution: 1e-5, ..light }, 200.0 / 1.2),
    ];
    for (what, options, wanted) in cases {
        let found = coupling(&options);
        // The tissue still moves by a share of what it gave way.
        assert!((found / wanted - 1.0).abs() < 0.02, "{what}: {found} N/m, {wanted} N/m by the header");
    }
}

#[test]
fn a_driver_of_an_older_header_tells_nothing_of_its_device() {
    let old = Options { struct_size: offset_of!(Options, device_mass) as u32, device_mass: f64::NAN, ..options() };
    let (status, simulation) = create(rig::SCENE, &old);
    assert_eq!(status, Status::Ok, "{}", last_error());
    // SAFETY: it was created, and nobody else has it.
    assert_eq!(unsafe { palpate_destroy(simulation) }, Status::Ok);
}

#[test]
fn a_jump_is_a_motion_of_the_length_and_speed_that_the_options_tell() {
    let jumps = |options: &Options, by: f64| {
        let rig = Rig::started(options);
        rig.tick_until(-0.02, "a step", |o| o.flags & PALPATE_TICK_NO_STEP == 0);
        std::thread::sleep(Duration::from_millis(1));
        let (_, there) = rig.tick_at(-0.02 - by);
        assert!(is_silent(&there), "all in air: {there:?}");
        there.flags & PALPATE_TICK_JUMPED != 0
    };
    let given = options();
    assert!(jumps(&given, 0.1) && !jumps(&given, 0.01), "by default from 20 mm on");
    assert!(jumps(&Options { jump_distance: 5e-3, jump_speed: 1e-3, ..given }, 0.01));
    assert!(!jumps(&Options { jump_distance: 0.2, ..given }, 0.1));
    assert!(!jumps(&Options { jump_speed: 1e6, ..given }, 0.1));
}
