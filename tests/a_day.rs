//! A day of virtual time in lockstep, with tissue: no counter and no clock drifts, and the last minute is as the second one.

#![allow(clippy::print_stdout)] // measured numbers

use std::path::Path;
use std::sync::atomic::AtomicBool;

use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, Observer, RunOptions, run};
use palpate::scene::Scene;
use palpate::step::StepReport;
use palpate::summary::RunEnd;
use palpate::tick::{TickFlags, TickReport};

/// Seconds of a day, and of one round of the tool's path.
const DAY: u64 = 86_400;
const ROUND: u64 = 60;

/// Ticks in a second, a step each: powers of two, so that every time of the day is a number without rounding.
const TICKS: u64 = 8;

/// 18 nodes.
const TOML: &str = r#"
name = "day"
seconds = 86400
gravity = [0, 0, 0]

[[body]]
name = "block"
block = { min = [-0.02, -0.02, 0.0], max = [0.02, 0.02, 0.02], cells = [2, 2, 1] }
density = 1000
rayleigh_stiffness = 0.01
material = { law = "neo_hookean", young = 6e3, poisson = 0.4 }
fixed = [{ node_set = "z_min" }]

[[tool]]
name = "ball"
shape = { kind = "sphere", radius = 0.012 }

[contact]
friction = 0.3
at = "nodes"

[rates]
step = 1
factor = 1
tick = 8

[device]
kind = "scripted"

[limits]
gap = 0.5
stale_after = 3.0
stale_zero = 5.0

[hand]
preset = "none"
path = [{ time = 0.0, position = [0.0, 0.0, 0.05] }, { time = 1.0, position = [0.0, 0.0, 0.05] }]
"#;

/// What a minute's ticks told in numbers and flags, and the forces of its steps (N).
#[derive(Clone, Debug, Default)]
struct Minute {
    ticks: Vec<([f64; 7], TickFlags)>,
    steps: Vec<[f64; 3]>,
}

/// Counts all, checks every clock, and keeps two minutes.
#[derive(Default)]
struct Watch {
    ticks: u64,
    steps: u64,
    touched: u64,
    /// The second minute and the last: the first begins with the fade.
    minutes: [Minute; 2],
}

/// Which of the two this second is in, if any.
fn kept(second: f64) -> Option<usize> {
    [ROUND, DAY - ROUND].iter().position(|begin| (*begin as f64..(begin + ROUND) as f64).contains(&second))
}

impl Observer for Watch {
    fn step(&mut self, report: &StepReport) {
        assert_eq!((report.step, report.time), (self.steps, self.steps as f64), "a step is missing or twice");
        self.steps += 1;
        if let Some(which) = kept(report.time) {
            self.minutes[which].steps.push(report.force.into());
        }
    }

    fn tick(&mut self, report: &TickReport) {
        let r = &report.record;
        assert_eq!(r.index, self.ticks, "a tick is missing or twice");
        assert_eq!((r.time, r.dt), (self.ticks as f64 / TICKS as f64, 1.0 / TICKS as f64), "the tick's clock");
        assert!(r.snapshot_age <= 1.0 || r.snapshot_step == 0, "{} s", r.snapshot_age);
        self.ticks += 1;
        self.touched += u64::from(r.active > 0);
        if let Some(which) = kept(r.time) {
            let (f, p) = (r.wrench.force, r.tool_pose.translation.vector);
            let numbers = [f.x, f.y, f.z, p.x, p.y, p.z, r.gain];
            self.minutes[which].ticks.push((numbers, r.flags));
        }
    }
}

#[test]
fn a_day_in_lockstep_has_every_step_and_tick_and_ends_as_it_began() {
    let mut scene = Scene::from_toml(TOML, Path::new("")).unwrap();
    scene
        .edit(|scene| {
            let key = |second: u64, [x, z]: [f64; 2]| ScriptKey {
                time: second as f64,
                position: [x, 0.0, z],
                ..ScriptKey::default()
            };
            // Down, aside, up, and back in the air, once a minute.
            let [air, pressed] = [0.05, 0.028];
            let round = [(0, [0.0, air]), (8, [0.0, pressed]), (16, [0.008, pressed]), (24, [0.008, air])];
            let rounds = (0..DAY / ROUND).flat_map(|k| round.map(|(second, place)| key(k * ROUND + second, place)));
            scene.hand.path = rounds.chain([key(DAY, [0.0, air])]).collect();
        })
        .unwrap();
    let world = scene.build().unwrap();
    let options =
        RunOptions { length: Length::Seconds(DAY as f64), lockstep: true, threads: Some(1), ..RunOptions::default() };
    let mut watch = Watch::default();
    let outcome = run(&world, &options, &AtomicBool::new(false), &mut watch).unwrap();
    let s = &outcome.summary;
    println!("{} steps, {} ticks, {} in contact", s.steps, s.ticks, watch.touched);
    assert_eq!(s.end, RunEnd::Completed);
    assert_eq!((s.steps, s.ticks, s.simulated), (DAY, DAY * TICKS, DAY as f64));
    assert_eq!((watch.steps, watch.ticks), (DAY, DAY * TICKS));
    let [second, last] = &watch.minutes;
    assert_eq!((second.steps.len(), second.ticks.len()), (ROUND as usize, (ROUND * TICKS) as usize));
    assert!(second.ticks.iter().any(|(numbers, _)| numbers[2] > 0.0), "nothing is felt");
    assert!(watch.touched > DAY / 10, "{}", watch.touched);
    // Times are the same to the bit, and so is the path. Tissue that has come to rest keeps a shape of 1e-18 m of rounding, from
    // which steps go other ways of rounding: in N and m, far below what a tick's sweeps leave.
    let near = |most: f64, a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most);
    for (k, (a, b)) in second.steps.iter().zip(&last.steps).enumerate() {
        assert!(near(1e-9, a, b), "step {k} of the minute: {a:?} N, {b:?} N");
    }
    for (k, ((a, flags), (b, then))) in second.ticks.iter().zip(&last.ticks).enumerate() {
        assert!(near(1e-8, a, b) && flags == then, "tick {k} of the minute: {a:?}, {b:?}");
    }
}
