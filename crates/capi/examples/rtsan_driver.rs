//! A driver on the C library, for a run under RealtimeSanitizer: `palpate_tick` in a thread of its own beside the threads of
//! step, factors and trace, with a tool that presses, slides and leaves, once on patches of tissue and once on frozen rows.
//!
//! Meanwhile the body is cut, the tissue pauses and goes on, a second thread wants the port, and the simulation is stopped
//! and destroyed between ticks. Faults come by a schedule: poses and velocities that are no numbers, jumps, gaps, a clock
//! that runs backwards, inputs that are too small or not there.
//!
//! `palpate_tick` and what it calls are marked `nonblocking` under `cfg(rtsan)`; the sanitizer then stops the program at the
//! first allocation, lock or system call inside them and prints the stack. `cargo xtask test --only realtime` builds and runs
//! it so.
#![allow(unsafe_code, clippy::print_stdout, unreachable_pub)] // calls through the C interface; the rig is shared

use std::ffi::CString;
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use palpate_capi::*;
use rig::{Rig, SCENE, input, last_error, options, stale_output};

#[path = "../tests/rig/mod.rs"]
mod rig;

/// Ticks of one run.
const TICKS: u64 = 16_000;

/// Between two ticks; with the tick's work a driver of some 3 kHz.
const PAUSE: Duration = Duration::from_micros(250);

/// What every run must have met.
const WANTED: [(&str, u32); 11] = [
    ("a new step", PALPATE_TICK_NEW_STEP),
    ("no step yet", PALPATE_TICK_NO_STEP),
    ("tissue at rest", PALPATE_TICK_AT_REST),
    ("an old step", PALPATE_TICK_STALE),
    ("a ramp", PALPATE_TICK_FADE_IN),
    ("a slew limit", PALPATE_TICK_SLEW_LIMITED),
    ("a gap", PALPATE_TICK_GAP),
    ("a bad pose", PALPATE_TICK_BAD_POSE),
    ("a jump", PALPATE_TICK_JUMPED),
    ("a bad clock", PALPATE_TICK_CLOCK),
    ("a refused call", PALPATE_TICK_REFUSED),
];

/// What the ticks of a run answered.
#[derive(Default)]
struct Seen {
    flags: u32,
    /// Ticks that carried a force of contact.
    pressed: u64,
    /// Ticks for which another thread had the port.
    busy: u64,
}

impl Seen {
    fn add(&mut self, (status, output): &(Status, Output)) {
        self.flags |= output.flags;
        self.pressed += u64::from(output.contacts > 0 && rig::norm(output.force) > 0.0);
        self.busy += u64::from(*status == Status::ErrorBusy);
    }

    /// The names of what never came.
    fn missing(&self) -> Vec<&'static str> {
        let flags = WANTED.iter().filter(|(_, flag)| self.flags & flag == 0).map(|(name, _)| *name);
        let counts = [("contact", self.pressed), ("a port in use", self.busy)];
        flags.chain(counts.into_iter().filter(|(_, count)| *count == 0).map(|(name, _)| name)).collect()
    }
}

fn main() {
    for (what, method) in [("patches", ""), ("frozen rows", "\n[tick]\nmethod = \"frozen\"")] {
        let body = "name = \"block\"\n changes = 1\n compliance = \"async\"\n refactor = \"thread\"";
        let scene = SCENE.replace("name = \"block\"", body) + method;
        let seen = run(&scene);
        println!("{TICKS} ticks on {what}, {} with force, {} while the port was in use", seen.pressed, seen.busy);
        let missing = seen.missing();
        assert!(missing.is_empty(), "never happened: {missing:?}");
    }
}

/// A driver's thread from before the start until after the end of a simulation.
fn run(scene: &str) -> Seen {
    let folder = tempfile::tempdir().expect("a folder for the trace");
    let trace = CString::new(folder.path().join("driver.mcap").to_string_lossy().as_bytes()).expect("a path");
    // Every step is old before the next one comes, so that its force fades.
    let ages = Options { stale_after: 0.02, stale_zero: 0.2, ..options() };
    let mut rig = Rig::of(scene, &Options { rate: 3000.0, trace: trace.as_ptr(), ..ages });
    let (ticks, over) = (AtomicU64::new(0), AtomicBool::new(false));
    // A port is used from any thread, by one at a time; pointers alone do not say so.
    let (port, begin) = (rig.port as usize, rig.begin);
    scope(|scope| {
        let driver = scope.spawn(|| {
            let mut seen = Seen::default();
            for index in 0..TICKS {
                seen.add(&tick(port, begin, index));
                ticks.store(index, Ordering::Relaxed);
                sleep(if index % 4000 == 2500 { Duration::from_millis(120) } else { PAUSE });
            }
            over.store(true, Ordering::Relaxed);
            seen
        });
        let until = |index: u64| {
            while ticks.load(Ordering::Relaxed) < index && !over.load(Ordering::Relaxed) {
                sleep(Duration::from_millis(1));
            }
        };
        until(200);
        told(rig.start());
        until(4000);
        let cut = c"remove = { box = { min = [0, 0, 0.02], max = [0.015, 0.04, 0.05] } }";
        // SAFETY: a simulation that lives, a text that is closed by a zero.
        told(unsafe { palpate_change(rig.simulation, cut.as_ptr()) });
        until(7000);
        told(rig.pause());
        until(8000);
        told(rig.resume());
        until(9000);
        let mut second = Seen::default();
        while ticks.load(Ordering::Relaxed) < 9500 {
            second.add(&tick(port, begin, 1));
        }
        until(13_000);
        let statistics = rig.statistics();
        println!("{} steps, {} factors, {} ticks", statistics.steps, statistics.factors, statistics.ticks);
        assert!(statistics.steps > 30 && statistics.factors > 5, "the threads of the simulation work beside the ticks");
        told(rig.stop());
        until(14_500);
        // SAFETY: nobody uses it any more; the rig is told.
        told(unsafe { palpate_destroy(rig.simulation) });
        rig.simulation = ptr::null_mut();
        let seen = driver.join().expect("a driver that ends");
        Seen { busy: seen.busy + second.busy, ..seen }
    })
}

/// Tick `index` of the schedule, on a device whose clock starts at `begin`.
fn tick(port: usize, begin: Instant, index: u64) -> (Status, Output) {
    let turn = index as f64 * 5e-3;
    let now = begin.elapsed().as_nanos() as u64 + 1;
    let mut given = input(now, [6e-3 * (0.37 * turn).sin(), 0.0, -rig::TOUCH - 1e-3 - 4e-3 * turn.sin()]);
    match index % 997 {
        100 => given.position[1] = f64::NAN,
        200 => given.time_ns = 3,
        300 => given.struct_size = 8,
        400 => (given.fields, given.velocity[0]) = (PALPATE_INPUT_VELOCITY, f64::NAN),
        500..510 => given.position[0] += 0.1,
        _ => {}
    }
    let input = if index % 997 == 600 { ptr::null() } else { &raw const given };
    let mut output = stale_output();
    // SAFETY: a port that outlives the threads of a run, structs of this function, or NULL.
    let status = unsafe { palpate_tick(port as *const Port, input, &raw mut output) };
    (status, output)
}

fn told(status: Status) {
    assert!(status == Status::Ok || status == Status::Notice, "{status:?}: {}", last_error());
}
