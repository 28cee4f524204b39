//! Does the force go smoothly over from one step's tissue to the next's, and does it begin as it would at 1 kHz?

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use std::collections::VecDeque;

use nalgebra::Vector3;
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::coupling::{CouplingConfig, Spring};
use palpate::run::{Length, RunOptions, RunOutcome};
use palpate::scene::{Scene, SceneDescription, TickMethod};
use palpate::simulation::Simulation;
use palpate::tick::{TickFlags, TickRecord};

use crate::block::{Recorder, record, scene, world};

fn lockstep(seconds: f64) -> RunOptions {
    RunOptions { length: Length::Seconds(seconds), lockstep: true, threads: Some(1), ..RunOptions::default() }
}

/// The methods of the tick, each with the time of its hand-over (s).
const METHODS: [(TickMethod, f64); 4] =
    [(TickMethod::Frozen, 0.0), (TickMethod::Local, 0.0), (TickMethod::Local, 10e-3), (TickMethod::Local, 33e-3)];

fn by(method: (TickMethod, f64), scene: &mut SceneDescription) {
    scene.tick.method = method.0;
    if method.0 == TickMethod::Local {
        scene.tick.hand_over = method.1;
    }
}

/// A press and a slide of 13 mm, held in a hand or forced.
fn palpation(method: (TickMethod, f64), device: &str) -> (RunOutcome, Recorder) {
    let world = world(|scene| {
        by(method, scene);
        scene.device.kind = device.into();
    });
    record(&world, &lockstep(1.2))
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

#[test]
fn in_press_and_slide_palpation_no_snapshot_makes_the_force_jump() {
    for device in ["virtual", "scripted"] {
        let mut largest = Vec::new();
        for method in METHODS {
            let (outcome, recorder) = palpation(method, device);
            let new = |flags: TickFlags| flags.contains(TickFlags::NEW_SNAPSHOT);
            let swaps: Vec<_> =
                recorder.ticks.iter().map(|t| &t.record).filter(|r| new(r.flags) && r.active > 0).collect();
            let mut jumps: Vec<f64> = swaps.iter().map(|r| r.force_jump).collect();
            jumps.sort_by(f64::total_cmp);
            // What the whole tick changed, the motion of the hand included, while in contact.
            let force = |k: usize| recorder.ticks[k].record.contact_wrench.force;
            let touching = |k: usize| recorder.ticks[k].record.active > 0;
            let changes = (1..recorder.ticks.len()).filter(|&k| touching(k - 1) && touching(k));
            let mut changes: Vec<f64> = changes.map(|k| (force(k) - force(k - 1)).norm()).collect();
            changes.sort_by(f64::total_cmp);
            let s = &outcome.summary;
            println!(
                "{device}, {:?}, {:.0} ms: force up to {:.2} N; jump at {} snapshots p50 {:.2}, p99 {:.2}, max {:.2} mN; \
                 change in a tick p50 {:.2}, p99 {:.1}, max {:.1} mN; impulse of steps {:.4}, of ticks {:.4} N s",
                method.0,
                method.1 * 1e3,
                s.largest_force,
                jumps.len(),
                quantile(&jumps, 0.5) * 1e3,
                quantile(&jumps, 0.99) * 1e3,
                quantile(&jumps, 1.0) * 1e3,
                quantile(&changes, 0.5) * 1e3,
                quantile(&changes, 0.99) * 1e3,
                quantile(&changes, 1.0) * 1e3,
                s.impulse[0],
                s.impulse[1],
            );
            assert!(jumps.len() > 20 && s.largest_force > 0.7 && s.beyond_patch == 0, "{s:?}");
            let local = recorder.ticks.iter().filter(|t| t.record.flags.contains(TickFlags::LOCAL)).count();
            assert_eq!(local, if method.0 == TickMethod::Local { recorder.ticks.len() } else { 0 });
            // The summary tells the same, to the width of its bins.
            assert!((s.force_jump.max - quantile(&jumps, 1.0)).abs() <= 1e-3 * quantile(&jumps, 1.0) + 1e-8);
            if method.1 > 0.0 {
                for r in &swaps {
                    let bound = (0.05 * r.contact_wrench.force.norm()).max(0.020);
                    assert!(r.force_jump < bound, "{:?}: {} N of {}", method, r.force_jump, bound);
                }
                // A tick's change, of a hand that slides, is felt less than a frozen row's jump alone.
                assert!(quantile(&changes, 1.0) < 0.5 * largest[0], "{method:?}");
            }
            // Both are impulses of one tissue on one tool: what the steps put on it and what the hand would feel.
            assert!((s.impulse[1] / s.impulse[0] - 1.0).abs() < 0.1, "{:?}", s.impulse);
            largest.push(quantile(&jumps, 1.0));
        }
        assert!(largest[2] < 0.1 * largest[0] && largest[3] < 0.1 * largest[0], "{largest:?}: frozen rows jump");
    }
}

/// The bundled palpation of the liver at every rate of the tissue that the charts show: at each snapshot the force jumps by less
/// than 5 % of itself or 20 mN, whichever is more.
#[test]
fn in_the_palpation_of_the_liver_no_snapshot_makes_the_force_jump_at_any_rate() {
    for (rate, least) in [(10.0, 50), (30.0, 150), (100.0, 500)] {
        let mut scene = Scene::bundled("liver").unwrap();
        scene.edit(|scene| scene.rates.step = rate).unwrap();
        let (outcome, recorder) = record(&scene.build().unwrap(), &lockstep(10.0));
        let records = recorder.ticks.iter().map(|tick| &tick.record);
        let swaps: Vec<_> = records.filter(|r| r.flags.contains(TickFlags::NEW_SNAPSHOT) && r.active > 0).collect();
        let share = |r: &TickRecord| r.force_jump / (0.05 * r.contact_wrench.force.norm()).max(0.020);
        let worst = swaps.iter().max_by(|a, b| share(a).total_cmp(&share(b))).expect("it touches");
        let (jump, force) = (worst.force_jump, worst.contact_wrench.force.norm());
        println!(
            "{rate} Hz: worst of {} snapshots {:.1} mN of {force:.3} N at {:.3} s",
            swaps.len(),
            1e3 * jump,
            worst.time
        );
        assert!(swaps.len() > least && outcome.summary.largest_force > 0.7, "{:?}", outcome.summary);
        assert!(share(worst) < 1.0, "{rate} Hz: {jump} of {force} N at {} s", worst.time);
    }
}

/// The tool follows its path exactly, so that a tick and an offline run see the same one.
fn forced(scene: &mut SceneDescription) {
    scene.device.kind = "scripted".into();
    let stiff = Spring { stiffness: 1e5, damping: 0.0 };
    scene.coupling = Some(CouplingConfig { translation: stiff, rotation: None });
}

/// Ticks over which a lumped node that is hit at 1 kHz spreads its impulse: an artefact of the mesh, which lasts one step.
const WINDOW: usize = 5;

#[test]
fn the_first_touch_is_that_of_the_tissue_computed_offline_at_1_khz() {
    for (friction, depth) in [(0.0, 0.010), (0.3, 0.010), (0.3, 0.005)] {
        let press = |scene: &mut SceneDescription| {
            forced(scene);
            scene.contact.friction = friction;
            scene.hand.path[1].position[2] = block::SKIN + block::RADIUS - depth;
            scene.hand.path.truncate(2);
        };
        let offline = world(|scene| {
            press(scene);
            scene.rates.step = 1000.0;
            scene.bodies[0].compliance = ComplianceMethod::Exact;
        });
        for method in METHODS {
            let fast = world(|scene| {
                press(scene);
                by(method, scene);
            });
            let (_, recorder) = record(&fast, &lockstep(0.5));
            let mut simulation = Simulation::new(&offline).unwrap();
            let first = recorder.ticks.iter().position(|t| t.record.active > 0).expect("it touches");
            let (mut felt, mut exact) = (VecDeque::new(), VecDeque::new());
            let (mut worst, mut spike, mut largest, mut at_end) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0);
            for tick in &recorder.ticks[..first + 100] {
                let reference = simulation.step(&tick.record.tool_pose).force.norm();
                let force = tick.record.contact_wrench.force.norm();
                for (window, value) in [(&mut felt, force), (&mut exact, reference)] {
                    window.push_back(value);
                    if window.len() > WINDOW {
                        window.pop_front();
                    }
                }
                let mean = |window: &VecDeque<f64>| window.iter().sum::<f64>() / WINDOW as f64;
                worst = worst.max((mean(&felt) - mean(&exact)).abs());
                largest = largest.max(mean(&exact));
                spike = spike.max(force - largest);
                at_end = (force - reference).abs() / reference;
            }
            println!(
                "friction {friction}, {:.0} mm, {:?}, {:.0} ms: {largest:.3} N within 100 ms; off by {:.1} mN at most \
                 ({:.1} % of it), {:.1} % at the end; above what was due by {:.1} mN at most",
                depth * 1e3,
                method.0,
                method.1 * 1e3,
                worst * 1e3,
                100.0 * worst / largest,
                100.0 * at_end,
                spike * 1e3
            );
            assert!(largest > 0.2, "{largest} N");
            if method == METHODS[2] {
                assert!(worst < 0.1 * largest && at_end < 0.1 && spike < 0.1 * largest);
            }
        }
    }
}

/// The tissue goes on with the hand between two steps. Were it at rest there, a tick would press against the inertia and the
/// damping of the step's own length: 8.6 % of the force at 100 Hz.
#[test]
fn a_press_at_constant_speed_is_as_stiff_as_at_1_khz_whatever_the_rate_of_the_tissue() {
    let speed = 0.05;
    let press = |scene: &mut SceneDescription| {
        forced(scene);
        // Cubic, so that its middle third is even to a tenth; the tool touches after a sixth of it.
        let top = block::SKIN + block::RADIUS + 0.003;
        let keys = scene.hand.path.iter_mut().zip([(0.0, top), (0.3, top - 0.2 * speed)]);
        keys.for_each(|(key, (time, z))| (key.time, key.position[2]) = (time, z));
        scene.hand.path.truncate(2);
    };
    let offline = world(|scene| {
        press(scene);
        scene.rates.step = 1000.0;
        scene.bodies[0].compliance = ComplianceMethod::Exact;
    });
    for rate in [30.0, 100.0, 900.0, 1000.0] {
        let fast = world(|scene| {
            press(scene);
            scene.rates.step = rate;
        });
        let (_, recorder) = record(&fast, &lockstep(0.3));
        let mut simulation = Simulation::new(&offline).unwrap();
        let first = recorder.ticks.iter().position(|t| t.record.active > 0).expect("it touches");
        let forces = recorder.ticks.iter().map(|tick| {
            let reference = simulation.step(&tick.record.tool_pose).force;
            (tick.record.contact_wrench.force, reference)
        });
        let forces: Vec<_> = forces.take(first + 100).collect();
        let largest = forces.iter().map(|(_, reference)| reference.norm()).fold(0.0, f64::max);
        // From the first step that knows of the touch on.
        let known = first + (1000.0 / rate) as usize;
        let mean = |window: &[(Vector3<f64>, Vector3<f64>)]| {
            window.iter().map(|(felt, reference)| felt - reference).sum::<Vector3<f64>>().norm() / WINDOW as f64
        };
        let worst = forces[known..].windows(WINDOW).map(mean).fold(0.0, f64::max) / largest;
        println!("{rate} Hz: {largest:.3} N, off by {:.2} % at most", 100.0 * worst);
        assert!(largest > 0.2 && worst < 0.05, "{rate} Hz: {worst} of {largest} N");
    }
}

#[test]
fn a_deep_press_that_is_held_neither_chatters_nor_creeps() {
    // More than the ball's radius, where q_free of a step lies beyond its centre.
    for friction in [0.0, 0.3] {
        let world = world(|scene| {
            forced(scene);
            scene.contact.friction = friction;
            scene.hand.path[1].position[2] = block::SKIN + block::RADIUS - 0.015;
            scene.hand.path.truncate(2);
        });
        let (outcome, recorder) = record(&world, &lockstep(1.5));
        let held: Vec<_> = recorder.ticks[1000..].iter().map(|t| t.record.contact_wrench.force).collect();
        let last = held[held.len() - 1];
        let off = held.iter().map(|f| (f - last).norm()).fold(0.0, f64::max);
        let step = recorder.steps.last().unwrap();
        println!(
            "friction {friction}: {:.3} N, by the step {:.3} N; over the last half second off by {:.2} mN at most; jump \
             at most {:.2} mN",
            last.norm(),
            step.force.norm(),
            off * 1e3,
            outcome.summary.largest_jump * 1e3
        );
        assert!(last.norm() > 2.0);
        // The tick's tolerance is a thousandth.
        assert!(off < 5e-3 * last.norm(), "{off} N");
        // The same contacts on the same tissue, but for the tick's linearised tissue and its own friction.
        assert!((step.force - last).norm() < 0.01 * last.norm(), "{} by the step, {last} by the tick", step.force);
    }
}

#[test]
fn scenes_say_what_the_tick_works_on_and_refuse_what_it_cannot() {
    let text = block::TOML;
    let parse = |tick: &str| palpate::scene::Scene::from_toml(&format!("{text}\n{tick}"), std::path::Path::new(""));
    let default = parse("").unwrap();
    assert_eq!(default.description().tick.method, TickMethod::Local);
    assert!(default.build().unwrap().understood().contains("tick: local (48 nodes at most, hand-over 10 ms)"));
    // A third of a step at most; one that a scene states and that is cut is warned of, one by default is not.
    let rated = |rate: f64, tick: &str| {
        let world = parse(&format!("[rates]\nstep = {rate}\n[tick]\n{tick}")).unwrap().build().unwrap();
        let late = world.warnings().iter().find(|warning| warning.contains("hand_over")).cloned();
        (world.hand_over(), late)
    };
    assert_eq!(rated(30.0, ""), (10e-3, None));
    assert_eq!(rated(100.0, "hand_over = 0.002"), (2e-3, None));
    let third = |time: f64| (time - 0.01 / 3.0).abs() < 1e-12;
    assert!(matches!(rated(100.0, ""), (time, None) if third(time)));
    for stated in ["0.02", "0.005", "0.0034"] {
        let (cut, late) = rated(100.0, &format!("hand_over = {stated}"));
        assert!(third(cut) && late.as_ref().is_some_and(|late| late.contains("cut to 3.3 ms")), "{late:?}");
    }
    assert!(matches!(rated(100.0, "hand_over = 0.00333"), (_, None)));
    // A hand-over that is over within a tick is none.
    let fast = parse("[rates]\nstep = 500.0").unwrap().build().unwrap();
    assert!(fast.understood().contains("each step's shape at once"), "{}", fast.understood());
    let frozen = parse("[tick]\nmethod = \"frozen\"").unwrap().build().unwrap();
    assert!(frozen.understood().contains("tick: frozen rows") && frozen.patch_nodes() == 0);
    assert_eq!(frozen.empty_snapshot().patch.max_nodes(), 0);
    for (tick, expected) in [
        ("patch_nodes = 2", "patch_nodes = 2"),
        ("patch_nodes = 100000", "from 3 to 512"),
        ("hand_over = -1.0", "negative"),
        ("method = \"thawed\"", "unknown variant"),
        ("method = \"frozen\"\nhand_over = 0.02", "no effect"),
        ("method = \"frozen\"\npatch_nodes = 20", "no effect"),
    ] {
        let error = parse(&format!("[tick]\n{tick}")).unwrap_err().to_string();
        assert!(error.contains(expected), "{tick}: {error}");
    }
    assert_eq!(scene(|_| {}).description().tick.patch_nodes, 48);
}
