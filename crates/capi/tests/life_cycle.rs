//! Are simulations created, started, stopped and freed in any order, and is every mistake told with its remedy?

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::ffi::{CStr, CString};
use std::ptr;
use std::time::Duration;

use palpate_capi::*;
use rig::{Rig, SCENE, create, input, last_error, norm, open_port, options};

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
    let axes = [1, 2, 3];
    let refused = [
        (Options { rate: 50.0, ..options() }, "rate: ", "100"),
        (Options { rate: f64::NAN, ..options() }, "rate: ", "8000"),
        (Options { max_force: -1.0, ..options() }, "max_force: ", "maximum force"),
        (Options { force_slew: f64::INFINITY, ..options() }, "force_slew: ", "inf"),
        (Options { stale_after: 2.0, ..options() }, "stale_after: ", "stale_zero"),
        (Options { gap: 1e-9, ..options() }, "gap: ", "limits.gap above 0.001"),
        (Options { axes: [1, 2, 4], ..options() }, "axes: ", "4 is no axis"),
        (Options { axes: [2, 1, 3], ..options() }, "axes: ", "cross product"),
        (Options { origin: [0.0, f64::NAN, 0.0], axes, ..options() }, "origin: ", "NaN"),
        (Options { origin: [0.0, 1e300, 0.0], axes, ..options() }, "origin: ", "1000"),
        (Options { origin: [0.0, f64::NAN, 0.0], ..options() }, "origin: ", "axes"),
        (Options { origin: [0.1, 0.0, 0.0], ..options() }, "origin: ", "axes"),
        (Options { threads: 1025, ..options() }, "threads: ", "1024"),
        (Options { threads: u32::MAX, ..options() }, "threads: ", "1024"),
        (Options { switches: 0xff, ..options() }, "switches: ", "0xfc"),
        (Options { reserved: 1, ..options() }, "reserved: ", "zero"),
        (Options { reserved_switches: 1, ..options() }, "reserved: ", "zero"),
        (Options { reserved_delay: 1, ..options() }, "reserved: ", "zero"),
        (Options { device_mass: -0.1, ..options() }, "device_mass: ", "mass [kg]"),
        (Options { device_damping: f64::NAN, ..options() }, "device_damping: ", "NaN"),
        (Options { device_friction: -1.0, ..options() }, "device_friction: ", "friction [N]"),
        (Options { device_resolution: f64::INFINITY, ..options() }, "device_resolution: ", "resolution [m]"),
        (Options { device_delay_ticks: 16, ..options() }, "device_delay_ticks: ", "0 to 15"),
        (
            Options { device_delay_ticks: 1, switches: PALPATE_OPTION_NO_DELAY, ..options() },
            "device_delay_ticks: ",
            "one of them",
        ),
        (Options { jump_speed: -1.0, ..options() }, "jump_speed: ", "[m/s]"),
        (Options { jump_distance: f64::NAN, ..options() }, "jump_distance: ", "NaN"),
        (Options { trace: c"".as_ptr(), ..options() }, "trace: ", "NULL"),
    ];
    for (options, name, word) in refused {
        let (status, simulation) = create(SCENE, &options);
        assert_eq!((status, simulation.is_null()), (Status::ErrorArgument, true), "{name}{word}: {}", last_error());
        let said = last_error();
        assert!(said.starts_with(name) && said.contains(word), "{name}{word}: {said}");
        assert!(!said.contains("as changed") && !said.contains("999999"), "{said}");
    }
    let (status, _) = create(SCENE, &Options { struct_size: 3, ..options() });
    assert_eq!(status, Status::ErrorStructSize);
    assert!(last_error().contains("struct_size"));
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
    let (_, begin) = rig.tick_at(-0.008);
    assert_eq!((begin.tick, begin.contacts), (0, 0), "after {} ticks with the port before", first.tick);
    assert!(begin.flags & PALPATE_TICK_NO_STEP != 0, "the tissue waits for the first tick: {begin:?}");
    rig.press(0.004);
    assert_eq!(rig.statistics().phase, PALPATE_PHASE_RUNNING);
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
    // The device's x points up.
    let given = Options { max_force: 0.2, rate: 500.0, axes: [3, 1, 2], ..options() };
    let mut simulation = ptr::null_mut();
    // SAFETY: a text, a struct and a pointer of this function.
    let status = unsafe { palpate_create_from_file(name.as_ptr(), &raw const given, &raw mut simulation) };
    assert_eq!(status, Status::Ok, "{}", last_error());
    let (status, port) = open_port(simulation);
    assert_eq!(status, Status::Ok, "{}", last_error());
    let rig = Rig { simulation, port, begin: std::time::Instant::now() };
    assert_eq!(rig.start(), Status::Ok);
    // The ball of 12 mm touches the block at a height of 42 mm.
    let tick = || rig.tick(&input(rig.now(), [0.035, 0.0, 0.0])).1;
    assert_eq!(tick().dt, 1.0 / 500.0, "the first tick has no other period than that of the options");
    let begin = std::time::Instant::now();
    let limited = loop {
        std::thread::sleep(Duration::from_millis(1));
        let output = tick();
        assert!(norm(output.force) <= 0.2 * (1.0 + 1e-12), "{output:?}");
        if output.gain == 1.0 && output.flags & PALPATE_TICK_FORCE_LIMITED != 0 {
            break output;
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "the force never reached its limit: {output:?}");
    };
    let [up, y, z] = limited.force;
    assert!(up > 0.19 && y.hypot(z) < 0.05, "{limited:?}");
    assert!(norm(limited.contact_force) > 0.2);
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
    assert_eq!(rig.stop(), Status::Notice);
    assert!(last_error().contains("rolled back"), "{}", last_error());
}

#[test]
fn a_trace_that_cannot_be_made_is_refused_before_anything_runs() {
    let path = CString::new("/no/such/folder/driver.mcap").unwrap();
    let (status, simulation) = create(SCENE, &Options { trace: path.as_ptr(), ..options() });
    assert_eq!(status, Status::Ok, "{}", last_error());
    let (status, port) = open_port(simulation);
    assert_eq!((status, port.is_null()), (Status::ErrorSetUp, true));
    assert!(last_error().contains("/no/such/folder/driver.mcap"), "{}", last_error());
    // SAFETY: nobody uses it any more.
    unsafe { palpate_destroy(simulation) };
}

#[cfg(target_os = "linux")]
#[test]
fn a_trace_that_finds_no_room_is_told_when_it_ends() {
    let rig = Rig::started(&Options { trace: c"/dev/full".as_ptr(), ..options() });
    rig.press(0.004);
    assert_eq!(rig.stop(), Status::Notice);
    assert!(last_error().contains("/dev/full"), "{}", last_error());
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
