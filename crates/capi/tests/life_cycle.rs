//! Are simulations created, started, stopped and freed in any order, and is every mistake told with its remedy?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::ffi::{CStr, CString};
use std::ptr;

use palpate_capi::*;
use rig::{Rig, SCENE, create, last_error, open_port, options};

#[test]
fn mistakes_of_a_scene_are_told_with_their_place() {
    let missing = CString::new("no/such/scene.toml").unwrap();
    let mut simulation = ptr::dangling_mut();
    // SAFETY: a text, NULL options, and a pointer of this function.
    let status = unsafe { palpate_create_from_file(missing.as_ptr(), ptr::null(), &raw mut simulation) };
    assert_eq!((status, simulation.is_null()), (Status::ErrorScene, true));
    assert!(last_error().contains("no/such/scene.toml"), "{}", last_error());

    let (status, simulation) = create("name = 3", &options());
    assert_eq!((status, simulation.is_null()), (Status::ErrorScene, true));
    assert!(last_error().contains("string"), "{}", last_error());
    let (status, _) = create(&SCENE.replace("young = 5e3", "young = -5e3"), &options());
    assert_eq!(status, Status::ErrorScene);
    assert!(last_error().contains("young"), "{}", last_error());
}

#[test]
fn options_out_of_their_range_are_refused_by_name() {
    let refused = [
        (Options { rate: 50.0, ..options() }, Status::ErrorScene, "100"),
        (Options { rate: f64::NAN, ..options() }, Status::ErrorScene, "8000"),
        (Options { max_force: -1.0, ..options() }, Status::ErrorScene, "maximum force"),
        (Options { force_slew: f64::INFINITY, ..options() }, Status::ErrorScene, "force_slew"),
        (Options { stale_after: 2.0, ..options() }, Status::ErrorScene, "stale_zero"),
        (Options { axes: [1, 2, 4], ..options() }, Status::ErrorArgument, "4 is no axis"),
        (Options { axes: [2, 1, 3], ..options() }, Status::ErrorScene, "cross product"),
        (Options { struct_size: 3, ..options() }, Status::ErrorStructSize, "struct_size"),
    ];
    for (options, expected, word) in refused {
        let (status, simulation) = create(SCENE, &options);
        assert_eq!((status, simulation.is_null()), (expected, true), "{word}: {}", last_error());
        assert!(last_error().contains(word), "{word}: {}", last_error());
    }
}

#[test]
fn null_is_refused_everywhere_and_freed_without_complaint() {
    let text = CString::new(SCENE).unwrap();
    // SAFETY: NULL is allowed, and the text lives.
    unsafe {
        assert_eq!(palpate_create_from_file(ptr::null(), ptr::null(), ptr::null_mut()), Status::ErrorNull);
        let mut simulation = ptr::null_mut();
        assert_eq!(palpate_create_from_file(ptr::null(), ptr::null(), &raw mut simulation), Status::ErrorNull);
        assert_eq!(
            palpate_create_from_string(text.as_ptr(), ptr::null(), ptr::null(), ptr::null_mut()),
            Status::ErrorNull
        );
        assert_eq!(palpate_open_port(ptr::null(), ptr::null_mut()), Status::ErrorNull);
        for call in [palpate_start, palpate_pause, palpate_resume, palpate_stop] {
            assert_eq!(call(ptr::null()), Status::ErrorNull);
        }
        assert_eq!(palpate_statistics(ptr::null(), ptr::null_mut()), Status::ErrorNull);
        assert_eq!(palpate_destroy(ptr::null_mut()), Status::Ok);
        assert_eq!(palpate_close_port(ptr::null_mut()), Status::Ok);
    }
}

#[test]
fn a_text_that_is_not_utf_8_is_refused() {
    let latin = CString::new(vec![b'n', 0xE4, b'h']).unwrap();
    let mut simulation = ptr::null_mut();
    // SAFETY: a text and a pointer of this function.
    let status = unsafe { palpate_create_from_file(latin.as_ptr(), ptr::null(), &raw mut simulation) };
    assert_eq!(status, Status::ErrorArgument);
    assert!(last_error().contains("UTF-8"));
}

#[test]
fn every_phase_refuses_what_does_not_belong_to_it() {
    let (status, simulation) = create(SCENE, &options());
    assert_eq!(status, Status::Ok, "{}", last_error());
    // SAFETY: a simulation that lives.
    assert_eq!(unsafe { palpate_start(simulation) }, Status::ErrorPhase);
    assert!(last_error().contains("palpate_open_port"));
    // SAFETY: nobody uses it any more.
    unsafe { palpate_destroy(simulation) };

    let rig = Rig::new(&options());
    assert_eq!(rig.statistics().phase, PALPATE_PHASE_READY);
    assert_eq!((rig.pause(), rig.resume()), (Status::ErrorPhase, Status::ErrorPhase));
    let (_, output) = rig.tick_at(0.004);
    assert_eq!((output.force, output.phase), ([0.0; 3], PALPATE_PHASE_READY));
    assert!(output.flags & PALPATE_TICK_NO_STEP != 0);
    let (status, port) = open_port(rig.simulation);
    assert_eq!((status, port.is_null()), (Status::ErrorPhase, true));
    assert_eq!((rig.start(), rig.start()), (Status::Ok, Status::ErrorPhase));
    assert_eq!((rig.stop(), rig.stop()), (Status::Ok, Status::Ok), "stopping twice is no mistake");
    assert_eq!(rig.start(), Status::ErrorPhase);
    assert_eq!(rig.statistics().phase, PALPATE_PHASE_STOPPED);
}

#[test]
fn a_stopped_simulation_begins_anew_from_rest_with_another_port() {
    let mut rig = Rig::started(&options());
    let first = rig.press(0.004);
    assert_eq!(rig.stop(), Status::Ok);
    let (status, port) = open_port(rig.simulation);
    assert_eq!(status, Status::Ok, "{}", last_error());
    let old = std::mem::replace(&mut rig.port, port);
    assert_eq!(rig.start(), Status::Ok);
    let second = rig.press(0.004);
    assert!(second.tick < first.tick + 10_000 && rig.statistics().phase == PALPATE_PHASE_RUNNING);
    // SAFETY: the old port has not been closed, and nobody ticks with it.
    assert_eq!(unsafe { palpate_close_port(old) }, Status::Ok);
}

#[test]
fn a_simulation_that_was_never_started_is_freed() {
    drop(Rig::new(&options()));
    let rig = Rig::new(&options());
    assert_eq!(rig.stop(), Status::Ok);
    assert_eq!(rig.statistics().phase, PALPATE_PHASE_STOPPED);
}

#[test]
fn a_bundled_scene_is_found_by_name_and_limits_are_those_of_the_options() {
    let name = CString::new("block").unwrap();
    let given = Options { max_force: 1.5, rate: 500.0, axes: [2, -1, 3], ..options() };
    let mut simulation = ptr::null_mut();
    // SAFETY: a text, a struct and a pointer of this function.
    let status = unsafe { palpate_create_from_file(name.as_ptr(), &raw const given, &raw mut simulation) };
    assert_eq!(status, Status::Ok, "{}", last_error());
    // SAFETY: nobody uses it any more.
    unsafe { palpate_destroy(simulation) };
}

#[test]
fn a_body_that_fails_ends_the_force_and_says_why() {
    // The square of such a weight is infinite.
    let scene = SCENE.replace("[[body]]", "gravity = [0, 0, -1e200]\n[[body]]\nsettle = false");
    let (status, simulation) = create(&scene, &options());
    assert_eq!(status, Status::Ok, "{}", last_error());
    let (status, port) = open_port(simulation);
    assert_eq!(status, Status::Ok, "{}", last_error());
    let rig = Rig { simulation, port, begin: std::time::Instant::now() };
    assert_eq!(rig.start(), Status::Ok);
    let last = rig.tick_until(0.004, "the failure", |o| o.phase == PALPATE_PHASE_FAILED);
    assert_eq!(last.force, [0.0; 3]);
    assert_eq!(rig.statistics().phase, PALPATE_PHASE_FAILED);
    assert_eq!(rig.stop(), Status::Ok);
    assert!(last_error().contains("rolled back"), "{}", last_error());
}

#[test]
fn a_trace_is_written_and_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("driver.mcap");
    let text = CString::new(path.to_str().unwrap()).unwrap();
    {
        let rig = Rig::started(&Options { trace: text.as_ptr(), rate: 800.0, max_force: 3.0, ..options() });
        rig.press(0.004);
        rig.tick_until(-0.005, "air", |o| o.contacts == 0);
        assert_eq!(rig.stop(), Status::Ok, "{}", last_error());
    }
    let report = palpate::replay::replay(&path).unwrap();
    assert!(report.ticks > 100 && report.is_identical(), "{report:?}");
}

#[test]
fn the_version_is_that_of_the_package() {
    // SAFETY: a text that lives as long as the program.
    let version = unsafe { CStr::from_ptr(palpate_version()) };
    assert_eq!(version.to_str(), Ok(env!("CARGO_PKG_VERSION")));
}
