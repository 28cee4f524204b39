//! Does the program run a scene on hardware, and say what it finds?
//!
//! The hardware is a library compiled from C that speaks the vendor's interface, or a service on this machine that speaks its
//! protocol. Says so and returns where there is no compiler.

#![cfg(unix)] // shared libraries by their Unix names
#![allow(clippy::print_stdout)] // why a test was skipped

#[path = "../program_runs/mod.rs"]
mod program_runs;
#[path = "../../../devices/tests/service/mod.rs"]
mod service;

mod force_dimension;
mod haply;
mod openhaptics;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use palpate::trace::{TickFlags, TickRecord, Trace};
use program_runs::{Place, SCENE};
use serde_json::Value;

/// The scene without a path for the hand, on this device.
fn scene(device: &str) -> String {
    let (scene, _) = SCENE.split_once("[hand]").unwrap();
    format!("{scene}[device]\norigin = [0.0, 0.0, 0.044]\n{device}\n")
}

/// A folder with the scene on this device and, as `lib{name}.so`, the stand-in `name`.c compiled with these definitions;
/// `None`, with a printed reason, where there is no compiler.
fn place(name: &str, device: &str, definitions: &[&str]) -> Option<Place> {
    let place = Place::with(&scene(device));
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../devices/tests/stand_in/{name}.c"));
    let mut command = Command::new("cc");
    command.args(["-shared", "-fPIC", "-pthread"]).args(definitions).arg(source);
    command.arg("-o").arg(place.path(&format!("lib{name}.so"))).arg("-lm");
    match command.output() {
        Ok(output) => assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => {
            println!("skipped: there is no C compiler here: {error}");
            return None;
        }
    }
    Some(place)
}

/// The program in the folder, with the hand 10 mm below the device's origin.
fn run(folder: &Path, words: &str, environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(words.split_whitespace()).current_dir(folder).env("STAND_IN_HAND", "0 0 -0.01");
    command.envs(environment.iter().copied()).output().unwrap()
}

fn folder(place: &Place) -> PathBuf {
    place.path("scene.toml").parent().unwrap().to_path_buf()
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A run to the end of the scene: the notes of its summary, and its trace, which replays to the bit.
fn completed(place: &Place, environment: &[(&str, &str)]) -> (String, Trace) {
    let output = run(&folder(place), "run scene.toml --json --threads 1", environment);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&summary["end"], &summary["mode"]), (&"completed".into(), &"real time".into()));
    let trace = Trace::load(place.path("small.mcap")).unwrap();
    let output = run(&folder(place), "replay small.mcap", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    (summary["notes"].to_string(), trace)
}

fn is_missing(tick: &TickRecord) -> bool {
    tick.flags.contains(TickFlags::DEVICE_MISSING)
}

/// The hand has felt the body, and then the device was gone for good: from there on there is no force.
fn assert_lost_in_contact(trace: &Trace) {
    let gone = trace.ticks.iter().rposition(|tick| !is_missing(tick)).expect("it answered once") + 1;
    let (before, after) = trace.ticks.split_at(gone);
    assert!(before.iter().any(|tick| tick.force[2] > 0.0), "no force before the fault");
    assert!(!after.is_empty(), "it answers to the end");
    let missing = trace.ticks.iter().filter(|tick| is_missing(tick));
    missing.for_each(|tick| assert_eq!((tick.force, tick.torque), ([0.0; 3], [0.0; 3]), "tick {}", tick.tick));
}

/// The ball has touched the body, which has held the hand.
fn assert_felt(trace: &Trace, max_force: f64) {
    // In the world the device's origin lies at 44 mm, and the ball touches at 40.
    let height = trace.ticks.last().unwrap().device_position[2];
    let largest = trace.ticks.iter().map(|tick| norm(tick.force)).fold(0.0, f64::max);
    assert!(height < 0.040 && height > 0.033, "{height} m");
    assert!(largest > 0.05 && largest <= max_force, "{largest} N");
    assert!(trace.ticks.iter().all(|tick| norm(tick.force) == 0.0 || tick.force[2] > 0.0), "the body pulls");
}

/// What the program says of a scene that it refuses.
fn refused(place: &Place, environment: &[(&str, &str)]) -> String {
    let output = run(&folder(place), "run scene.toml --no-trace", environment);
    assert!(!output.status.success() && output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    // The message is wrapped to the width of a terminal.
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    message.split(|c: char| c.is_whitespace() || c == '│').filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}
