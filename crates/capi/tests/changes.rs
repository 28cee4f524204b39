//! A body that is cut and clamped through the C interface while it runs.

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::ffi::CString;

use palpate_capi::*;
use rig::{Rig, SCENE, create, last_error, open_port, options};

fn change(simulation: *const Simulation, text: &str) -> Status {
    let text = CString::new(text).unwrap();
    // SAFETY: a simulation of the caller that lives, a text of this function.
    unsafe { palpate_change(simulation, text.as_ptr()) }
}

const CUT: &str = "remove = { box = { min = [0, 0, 0.02], max = [0.015, 0.04, 0.05] } }";

#[test]
fn a_body_is_changed_while_it_runs_and_refuses_what_cannot_be() {
    let scene = SCENE.replace("name = \"block\"", "name = \"block\"\n changes = 2");
    let (status, simulation) = create(&scene, &options());
    assert_eq!(status, Status::Ok, "{}", last_error());
    assert_eq!(change(simulation, CUT), Status::ErrorPhase);
    assert!(last_error().contains("palpate_open_port"), "{}", last_error());
    let (status, port) = open_port(simulation);
    assert_eq!(status, Status::Ok, "{}", last_error());
    let rig = Rig { simulation, port, begin: std::time::Instant::now() };
    assert_eq!(change(rig.simulation, CUT), Status::ErrorPhase);
    assert!(last_error().contains("does not run"), "{}", last_error());
    assert_eq!(rig.start(), Status::Ok);
    rig.tick_until(0.002, "a force", |output| output.force[2] > 0.0);

    assert_eq!(change(rig.simulation, CUT), Status::Ok, "{}", last_error());
    for (wrong, word) in [
        ("remve = 3", "remve"),
        ("remove = { box = { min = [1, 1, 1], max = [2, 2, 2] } }", "holds no element"),
        (CUT, "gone by then"),
        ("", "changes nothing"),
    ] {
        assert_eq!(change(rig.simulation, wrong), Status::ErrorArgument, "{wrong}");
        assert!(last_error().contains(word), "{wrong}: {}", last_error());
    }
    assert_eq!(
        change(rig.simulation, "hold = { box = { min = [0.03, 0.03, 0.03], max = [0.05, 0.05, 0.05] } }"),
        Status::Ok
    );
    assert_eq!(change(rig.simulation, CUT), Status::ErrorArgument);
    assert!(last_error().contains("room for"), "{}", last_error());
    let steps = rig.statistics().steps;
    rig.tick_until(0.002, "steps with the changed body", |_| rig.statistics().steps > steps + 5);
    assert_eq!(rig.stop(), Status::Ok, "{}", last_error());
    // SAFETY: NULL is allowed.
    assert_eq!(unsafe { palpate_change(std::ptr::null(), std::ptr::null()) }, Status::ErrorNull);
}

#[test]
fn a_scene_without_room_says_so() {
    let rig = Rig::started(&options());
    assert_eq!(change(rig.simulation, CUT), Status::ErrorArgument);
    assert!(last_error().contains("changes = 8"), "{}", last_error());
}
