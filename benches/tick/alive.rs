//! The tick of a driver at 1 kHz with its whole scene alive beside it: the step at its rate on all cores, the factor in its
//! own thread.
//!
//! A fist is pressed into the liver and circles there, in and out of the skin, so that as many contacts are in the tick's
//! problem as the scene has room for. Work is what the port tells: all between the call and its answer.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use nalgebra::Translation3;
use palpate::run::RunOptions;
use palpate::session::{Port, PortSample, Session, Statistics, raise_priority};
use palpate::summary::Tail;
use palpate::world::World;

use crate::alone::{CIRCLE, LOCAL, PRESS, TURNS};
use crate::organ::{CELLS, liver, under_ball};
use crate::table::{Histogram, MICROSECONDS, head, line};

/// Time between two ticks.
const PERIOD: Duration = Duration::from_millis(1);

/// Speed at which the fist comes down, and how far from its place above the skin (m/s, m).
const SPEED: f64 = 0.1;
const DEPTH: f64 = 0.04;

/// Time before ticks count (s): the fist is down, and the force has faded in.
const WARM_UP: f64 = 1.0;

/// What a driver's ticks showed.
struct Driven {
    work: Tail,
    cpu: Tail,
    histogram: Histogram,
    contacts: Tail,
    active: Tail,
    allocations: u32,
    granted: bool,
}

/// What the driver's device measures after `time` seconds.
fn sample(world: &World, port: &Port, time: f64) -> PortSample {
    let phase = TAU * TURNS * time;
    let down = (SPEED * time).min(DEPTH) + PRESS * (1.7 * phase).sin();
    let motion = Translation3::new(CIRCLE * phase.cos(), down, CIRCLE * phase.sin());
    let pose = port.place().pose_in_device(&(motion * world.first_pose()));
    let [x, y, z, w]: [f64; 4] = pose.rotation.coords.into();
    PortSample {
        time_ns: None,
        position: pose.translation.vector.into(),
        orientation: [w, x, y, z],
        velocity: None,
        buttons: 0,
        gripper: 1.0,
    }
}

/// Ticks for `seconds` beyond the warm-up, on the beat.
fn drive(world: &World, port: &mut Port, seconds: f64) -> Driven {
    let mut seen = Driven {
        work: Tail::new(1e-9),
        cpu: Tail::new(1e-9),
        histogram: Histogram::default(),
        contacts: Tail::new(1.0),
        active: Tail::new(1.0),
        allocations: 0,
        granted: raise_priority(),
    };
    let begin = Instant::now();
    let mut next = begin;
    let mut counts = false;
    while begin.elapsed().as_secs_f64() < WARM_UP + seconds {
        // A beat that is missed is left out.
        next = (next + PERIOD).max(Instant::now());
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        let time = begin.elapsed().as_secs_f64();
        let given = sample(world, port, time);
        if !counts && time >= WARM_UP {
            counts = true;
            assert_no_alloc::reset_violation_count();
        }
        let cpu = ThreadTime::now();
        let report = assert_no_alloc::assert_no_alloc(|| port.tick(&given));
        let cpu = cpu.elapsed().as_secs_f64();
        if counts {
            seen.work.record(report.work);
            seen.cpu.record(cpu);
            seen.histogram.record(report.work);
            seen.contacts.record(f64::from(report.record.contacts));
            seen.active.record(f64::from(report.record.active));
        }
    }
    seen.allocations = assert_no_alloc::violation_count();
    seen
}

/// A session of this world, its driver's ticks, and what else went on.
fn run(world: World, seconds: f64) -> (Driven, Statistics) {
    let world = Arc::new(world);
    let (mut session, mut port) =
        Session::open(Arc::clone(&world), &RunOptions::default()).expect("the bundled scene can be set up");
    assert!(session.start(), "a session that was opened can be started");
    let driven = std::thread::scope(|scope| {
        let driver = scope.spawn(|| drive(&world, &mut port, seconds));
        driver.join().expect("the driver ends in order")
    });
    let statistics = session.statistics();
    let _ = session.stop();
    (driven, statistics)
}

/// Ticks of a driver for `seconds` in each of the local problems; prints their tails.
pub(crate) fn measure(seconds: f64) {
    head(&format!("{seconds} s, all threads alive"));
    let mut notes = Vec::new();
    for (contacts, nodes, target) in LOCAL {
        let world = liver(CELLS[1], |scene| {
            under_ball(scene);
            (scene.contact.max_contacts, scene.tick.patch_nodes) = (contacts, nodes);
        });
        let (seen, others) = run(world, seconds);
        let what = format!("{contacts} contacts, {nodes} nodes");
        line(&format!("{what}, wall"), &seen.work.percentiles(), MICROSECONDS, target);
        line(&format!("{what}, cpu"), &seen.cpu.percentiles(), MICROSECONDS, "");
        notes.push(format!("{what}, wall: {}", seen.histogram));
        notes.push(format!(
            "{what}: {:.0} in the problem and {:.0} with force at the median; beside it {:.1} steps/s of {:.2} ms at the \
             median, {:.1} factors/s; SCHED_FIFO {}; allocations: {}",
            seen.contacts.percentiles().p50,
            seen.active.percentiles().p50,
            others.rates[0],
            1e3 * others.step_work.p50,
            others.rates[1],
            if seen.granted { "granted" } else { "refused" },
            seen.allocations
        ));
    }
    notes.iter().for_each(|note| println!("{note}"));
}
