//! Does what stands between the contact force and the hand keep out of a sound palpation, and act where it must?

#![allow(clippy::print_stdout)] // measured numbers

mod block;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use palpate::haptics::coupling::{BoundGrounds, CouplingConfig, Spring};
use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, RunOptions};
use palpate::scene::{Scene, SceneDescription, TickMethod};
use palpate::session::{Phase, PortSample, Session};
use palpate::summary::{ForceCounts, RunEnd};
use palpate::tick::TickFlags;
use palpate::trace::{TickFlags as TraceFlags, Trace};

use block::{RADIUS, SKIN, TOML, record, world};

fn lockstep(seconds: f64) -> RunOptions {
    RunOptions { length: Length::Seconds(seconds), lockstep: true, threads: Some(1), ..RunOptions::default() }
}

#[test]
fn nothing_but_the_first_fade_acts_in_a_palpation() {
    for method in [TickMethod::Local, TickMethod::Frozen] {
        let by = |control: bool| {
            let world = world(|scene| {
                (scene.tick.method, scene.passivity.control) = (method, control);
            });
            record(&world, &lockstep(1.2))
        };
        let (outcome, recorder) = by(true);
        let port = outcome.summary.port;
        println!("{method:?}: {:.3} mJ, lowest of a contact {:.4} mJ", 1e3 * port.energy[0], 1e3 * port.least_account);
        assert_eq!(port.counts, ForceCounts { fading_in: 300, ..ForceCounts::default() }, "{method:?}");
        assert!(port.energy[0] > 1e-4 && port.energy[1] == 0.0, "a hand that slides with friction does work: {port:?}");
        assert!(port.least_account > -5e-4, "{port:?}");
        // What does not act changes no bit.
        let (_, without) = by(false);
        assert_eq!(recorder.forces(), without.forces());
    }
}

#[test]
fn a_coupling_far_too_stiff_is_calmed_counted_and_traced() {
    let folder = tempfile::tempdir().unwrap();
    let run = |control: bool| {
        let mut scene = Scene::from_toml(&TOML.replace("young = 6e3", "young = 6e6"), Path::new("")).unwrap();
        scene
            .edit(|scene| {
                scene.passivity.control = control;
                // Against skin that is all but rigid, twice what even the damping of this hand would bear.
                (scene.device.mechanics.friction, scene.device.mechanics.encoder_step) = (0.0, 0.0);
                let translation = Spring { stiffness: 6000.0, damping: 2.0 };
                scene.coupling = Some(CouplingConfig { translation, rotation: None });
                scene.hand.preset = "fingertip".into();
                let at = |time, z| ScriptKey { time, position: [0.033, 0.037, z], ..ScriptKey::default() };
                scene.hand.path = vec![at(0.0, SKIN + RADIUS + 1e-3), at(0.3, SKIN + RADIUS - 2e-3)];
            })
            .unwrap();
        let path = folder.path().join(format!("{control}.mcap"));
        let options = RunOptions { trace: Some(path.clone()), ..lockstep(1.2) };
        let (outcome, recorder) = record(&scene.build().unwrap(), &options);
        (outcome.summary.port, recorder, Trace::load(&path).unwrap())
    };
    // Speed of the device in the last fifth of a second (m/s).
    let swing = |recorder: &block::Recorder| {
        let last = recorder.ticks.iter().filter(|t| t.record.time > 1.0);
        last.map(|t| t.record.device_velocity.linear.norm()).fold(0.0, f64::max)
    };
    let ((off, wild, _), (on, calm, trace)) = (run(false), run(true));
    println!(
        "lowest energy of a contact: {:.2} mJ without, {:.2} mJ with, in {} ticks; speed {:.3} and {:.3} m/s",
        1e3 * off.least_account,
        1e3 * on.least_account,
        on.counts.passivity,
        swing(&wild),
        swing(&calm),
    );
    assert!(off.counts.passivity == 0 && off.least_account < -5e-3, "{off:?}");
    assert!(on.counts.passivity > 0 && on.least_account > 0.2 * off.least_account, "{on:?}");
    assert!(swing(&calm) < 0.5 * swing(&wild));
    let told = trace.ticks.iter().filter(|t| t.flags.contains(TraceFlags::PASSIVITY)).count() as u64;
    assert_eq!(told, on.counts.passivity);
    for (tick, record) in trace.ticks.iter().zip(&calm.ticks) {
        assert_eq!(tick.energy.to_bits(), record.record.energy.account.to_bits());
    }
}

#[test]
fn a_coupling_beyond_the_bound_is_warned_of_with_the_number_and_its_grounds() {
    let stiff = |stiffness: f64| {
        world(|scene: &mut SceneDescription| {
            scene.coupling = Some(CouplingConfig { translation: Spring { stiffness, damping: 2.0 }, rotation: None });
        })
    };
    // b = 0.2 and B = 2 N s/m, one tick of delay: 2 √(b B) / 1.5 ms.
    let bound = 2.0 * 0.4_f64.sqrt() / 1.5e-3;
    for (stiffness, warned) in [(0.99 * bound, false), (1.01 * bound, true)] {
        let world = stiff(stiffness);
        let choice = world.coupling().unwrap();
        assert!(!choice.rigid_torque, "no motors for torque");
        assert!((choice.bound.stiffness - bound).abs() < 1e-9 && choice.bound.grounds == BoundGrounds::Device);
        assert_eq!((choice.of_scene, choice.exceeds()), (true, warned));
        let text = world.warnings().join("\n");
        assert_eq!(text.contains("translation.stiffness") && text.contains("843 N/m"), warned, "{text}");
        assert!(world.understood().contains("by the scene"), "{}", world.understood());
    }
    let tuned = world(|_| {}).coupling().unwrap();
    assert_eq!((tuned.of_scene, tuned.exceeds(), tuned.config.translation.stiffness), (false, false, 700.0));
    // A sluggish loop gets a softer coupling, and one whose damping nobody knows a bound by a light grip.
    let slow = world(|scene| scene.rates.tick = 200.0).coupling().unwrap();
    assert!((slow.config.translation.stiffness - 700.0 / 5.0).abs() < 1e-9, "{slow}");
    let unknown = world(|scene| scene.device.preset = Some("omega.3".into())).coupling().unwrap();
    assert_eq!((unknown.bound.grounds, unknown.config.translation.stiffness), (BoundGrounds::LightGrip, 1000.0));
}

#[test]
fn numbers_of_passivity_and_limits_out_of_their_range_are_refused_by_name() {
    for (table, word) in [
        ("[passivity]\nallowance = -1e-3", "allowance"),
        ("[passivity]\nmemory = 0", "memory"),
        ("[passivity]\ndamping = -2.0", "damping"),
        ("[passivity]\nleast_speed = 0.0", "least_speed"),
        ("[passivity]\nreset_after = inf", "reset_after"),
        ("[passivity]\nalowance = 1e-3", "alowance"),
        ("[limits]\nmax_power = 0.0", "max_power"),
        ("[limits]\njump_speed = nan", "jump_speed"),
    ] {
        let text = format!("{TOML}\n{table}\n");
        let error = Scene::from_toml(&text, Path::new("")).expect_err(table);
        assert!(error.to_string().contains(word), "{table}: {error}");
    }
}

/// A free ball on the block; the tool comes down on it and pushes it into the tissue, and leaves.
#[test]
fn a_tool_at_a_rigid_body_is_felt_on_patches_that_have_its_contacts() {
    let text = format!(
        "{}\n[[rigid_body]]\nname = \"egg\"\nshape = {{ kind = \"sphere\", radius = 0.01 }}\nmass = 0.05\n\
         position = [0.033, 0.037, {}]\n",
        TOML.replace("at = \"faces\"", "at = \"nodes\""),
        SKIN + 0.0105
    );
    let mut scene = Scene::from_toml(&text, Path::new("")).unwrap();
    let touch = SKIN + 0.0205 + RADIUS;
    let key = |time, z| ScriptKey { time, position: [0.033, 0.037, z], ..ScriptKey::default() };
    scene
        .edit(|scene| {
            scene.bodies[0].rayleigh_stiffness = 0.02;
            let (above, below) = (touch + 0.006, touch - 0.004);
            scene.hand.path = vec![key(0.0, above), key(0.2, above), key(0.5, below), key(0.8, below), key(1.1, above)];
        })
        .unwrap();
    let world = scene.build().unwrap();
    let (outcome, recorder) = record(&world, &lockstep(1.3));
    let s = &outcome.summary;
    println!("{} of {} steps frozen, up to {:.2} N; {:?}", s.frozen_at_rigid, s.steps, s.largest_force, s.port);
    assert_eq!(s.end, RunEnd::Completed);
    assert_eq!(s.frozen_at_rigid, 0);
    let touched = |t: &&palpate::tick::TickReport| t.record.active > 0 && t.record.flags.contains(TickFlags::LOCAL);
    let felt: Vec<_> = recorder.ticks.iter().filter(touched).collect();
    assert!(felt.len() > 200, "{}", felt.len());
    assert!(felt.iter().any(|t| t.record.wrench.force.z > 0.1), "it is felt");
    assert!(recorder.forces().iter().all(|f| f.iter().all(|x| x.is_finite()) && f.norm() <= block::MAX_FORCE));
    let change = recorder.forces().windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max);
    assert!(change <= 2.0 * (1.0 + 1e-9), "{change} N in a millisecond");
    let local = |from: f64, to: f64| {
        let within = recorder.ticks.iter().filter(|t| (from..to).contains(&t.record.time));
        within.filter(|t| t.record.flags.contains(TickFlags::LOCAL)).count()
    };
    assert!(local(0.0, 0.2) > 100, "patches before it is met");
    assert_eq!(recorder.forces().last().map(|f| f.norm()), Some(0.0), "it has left");
    // Held there, ticks and steps agree on the force.
    let tick = recorder.ticks.iter().find(|t| t.record.time >= 0.75).unwrap();
    let step = recorder.steps.iter().find(|r| r.time >= 0.75).unwrap();
    let (by_tick, by_step) = (tick.record.contact_wrench.force.norm(), step.force.norm());
    assert!((by_tick - by_step).abs() < 0.1 * by_step.max(0.1), "{by_tick} N by ticks, {by_step} N by steps");
}

#[test]
fn a_session_that_stops_during_ticks_on_a_patch_brings_the_force_down_by_the_slew_and_keeps_it_there() {
    let world = Arc::new(world(|scene| {
        scene.device.kind = "port".into();
        scene.limits.force_slew = 200.0;
    }));
    let (mut session, mut port) = Session::open(Arc::clone(&world), &lockstep(1.0)).unwrap();
    assert!(session.start());
    let (pressed, end) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let driver = scope.spawn(|| {
            let (mut before, mut depth, mut local) = (0.0_f64, -2e-3_f64, 0_u32);
            let mut last = None;
            while !end.load(Ordering::Relaxed) {
                depth = (depth + 2e-5).min(4e-3);
                let position = [0.033, 0.037, SKIN + RADIUS - depth];
                let orientation = [1.0, 0.0, 0.0, 0.0];
                let report = port.tick(&PortSample {
                    time_ns: None,
                    position,
                    orientation,
                    velocity: None,
                    buttons: 0,
                    gripper: 1.0,
                });
                let force = report.wrench.force.norm();
                // A gap counts as one period.
                assert!(
                    (force - before).abs() <= 200.0 * report.dt.max(1e-3) * (1.0 + 1e-9),
                    "{force} after {before} N"
                );
                before = force;
                let flags = report.record.flags;
                local += u32::from(flags.contains(TickFlags::LOCAL) && report.record.active > 0);
                if force > 0.1 && local > 20 {
                    pressed.store(true, Ordering::Relaxed);
                }
                last = Some(report);
                std::thread::sleep(std::time::Duration::from_micros(500));
            }
            last.expect("it has ticked")
        });
        let begin = std::time::Instant::now();
        while !pressed.load(Ordering::Relaxed) && !driver.is_finished() {
            assert!(begin.elapsed().as_secs() < 30, "the press was never felt");
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert!(session.stop().expect("the first time").is_ok());
        std::thread::sleep(std::time::Duration::from_millis(150));
        end.store(true, Ordering::Relaxed);
        let last = driver.join().unwrap();
        assert_eq!((last.phase, last.wrench.force.norm()), (Phase::Stopped, 0.0));
        assert!(last.record.flags.contains(TickFlags::INVALID_SNAPSHOT), "the stage says that it rests");
    });
}

#[test]
fn a_device_with_motors_for_torque_and_a_rigid_orientation_is_warned_of() {
    let spring = Spring { stiffness: 1.0, damping: 0.01 };
    let on = |preset: &str, rotation: Option<Spring>, max_torque: Option<f64>| {
        let world = world(|scene| {
            scene.device.preset = Some(preset.into());
            scene.limits.max_torque = max_torque;
            scene.coupling = rotation.map(|spring| CouplingConfig {
                translation: Spring { stiffness: 500.0, damping: 2.0 },
                rotation: Some(spring),
            });
        });
        let warned = world.warnings().iter().any(|w| w.contains("motors for torque") && w.contains("`rotation`"));
        (warned, world.coupling().unwrap().to_string())
    };
    let (warned, told) = on("sigma.7", None, None);
    assert!(warned && told.ends_with("rotation rigid, with motors for torque"), "{told}");
    let (warned, told) = on("sigma.7", Some(spring), None);
    assert!(!warned && told.ends_with("rotation 1 N m/rad and 0.01 N m s/rad"), "{told}");
    assert!(!on("sigma.7", None, Some(0.0)).0, "no torque is sent");
    assert!(!on("omega.7", None, None).0, "no motors for torque");
}
