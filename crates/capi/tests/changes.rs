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
    // The cut skin can be drawn, and the whole one still.
    // SAFETY: plain numbers.
    let mut surface: Surface = unsafe { std::mem::zeroed() };
    surface.struct_size = size_of::<Surface>() as u32;
    // SAFETY: a simulation that lives, a struct whose size is set.
    assert_eq!(unsafe { palpate_surface_counts(rig.simulation, &raw mut surface) }, Status::Ok);
    assert_eq!(surface.events, 2, "the cut and the clamp");
    let skin = |events: u32| {
        let mut triangles = vec![[u32::MAX; 3]; 1000];
        // SAFETY: a simulation that lives, room for as many triangles as is said.
        let status = unsafe { palpate_surface_triangles(rig.simulation, events, triangles.as_mut_ptr().cast(), 1000) };
        assert_eq!(status, Status::Ok, "{}", last_error());
        triangles.retain(|triangle| *triangle != [u32::MAX; 3]);
        triangles
    };
    assert_eq!(skin(0).len(), 108);
    assert!(skin(1) != skin(0) && skin(1) == skin(2), "a cut changes the skin, a clamp does not");
    assert_eq!(surface.triangles, skin(2).len() as u64);
    let mut none = [0; 3];
    // SAFETY: a simulation that lives, room for one triangle.
    let beyond = unsafe { palpate_surface_triangles(rig.simulation, 3, none.as_mut_ptr(), 1) };
    assert!(beyond == Status::ErrorArgument && last_error().contains("3 events, but there are 2"), "{}", last_error());
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

/// Bodies from outside are made from what the last event leaves: one that must wait for it says so and until when.
#[test]
fn a_change_that_waits_for_an_event_says_which_and_one_after_it_does_not() {
    let scene = |time: f64| {
        let event =
            format!("[[event]]\n time = {time}\n release = {{ box = {{ min = [0, 0, 0], max = [0.01, 0.01, 0] }} }}");
        SCENE.replace("name = \"block\"", "name = \"block\"\n changes = 1") + &event
    };
    let phase = |rig: &Rig| {
        // SAFETY: plain numbers.
        let mut surface: Surface = unsafe { std::mem::zeroed() };
        surface.struct_size = size_of::<Surface>() as u32;
        // SAFETY: a simulation that lives, a struct whose size is set.
        assert_eq!(unsafe { palpate_surface_counts(rig.simulation, &raw mut surface) }, Status::Ok);
        surface.events
    };
    let early = Rig::of(&scene(1e4), &options());
    assert_eq!(early.start(), Status::Ok);
    early.tick_until(0.002, "steps before the event", |_| early.statistics().steps > 2);
    assert_eq!(change(early.simulation, CUT), Status::Notice, "it waits for three hours");
    assert!(last_error().contains("10000 s"), "{}", last_error());
    let steps = early.statistics().steps;
    early.tick_until(0.002, "steps after the change", |_| early.statistics().steps > steps + 5);
    assert_eq!(phase(&early), 0, "neither the event nor the change has happened");

    let late = Rig::of(&scene(0.1), &options());
    assert_eq!(late.start(), Status::Ok);
    late.tick_until(0.002, "the event", |_| phase(&late) == 1);
    assert_eq!(change(late.simulation, CUT), Status::Ok, "{}", last_error());
    late.tick_until(0.002, "the change", |_| phase(&late) == 2);
}
