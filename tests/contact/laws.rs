//! The laws of contact in a scene, by the step and by the tick: each has a force in closed form.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use crate::slope;

use std::f64::consts::{FRAC_PI_4, PI, TAU};
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::haptics::script::ScriptKey;
use palpate::prelude::*;
use palpate::scene::{ContactLawKind, NodeSelection, SceneDescription};
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

use crate::block::{RADIUS, SKIN};
use crate::slope::{DT, G, leaning};

/// The block on a slope of `angle` that falls towards `heading` (rad).
fn incline(contact: &str, angle: f64, heading: f64) -> World {
    slope::world(leaning(angle, heading), contact)
}

fn mass(world: &World) -> f64 {
    world.model().mass().iter().sum()
}

fn velocity(sim: &Simulation<'_>) -> Vector3<f64> {
    let model = sim.world().model();
    sim.state().fem.v.iter().zip(model.mass()).map(|(v, m)| v * *m).sum::<Vector3<f64>>() / mass(sim.world())
}

fn step(sim: &mut Simulation<'_>, tool: &Isometry3<f64>) -> StepReport {
    let report = sim.step(tool);
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.detection.contacts == 0 || report.solve.status == SolveStatus::Solved, "{:?}", report.solve);
    report
}

/// Acceleration (m/s²) over twenty steps once the block's elastic motion has died out, and the last report.
fn slide(world: &World) -> (Vector3<f64>, StepReport) {
    let mut sim = Simulation::new(world).unwrap();
    (0..40).for_each(|_| _ = step(&mut sim, &Isometry3::identity()));
    let from = velocity(&sim);
    let last = (0..20).map(|_| step(&mut sim, &Isometry3::identity())).last().unwrap();
    ((velocity(&sim) - from) / (20.0 * DT), last)
}

/// All sixteen nodes slide with the same force each, on a gentle slope, where they carry most, and on a steep one.
#[test]
fn trescas_friction_is_its_limit_whatever_the_normal_force() {
    let limit = 0.03;
    let mut normal_forces = Vec::new();
    for angle in [0.4f64, 0.8, 1.2] {
        let world = incline(&format!("law = \"tresca\"\nlimit = {limit}"), angle, 0.3);
        let (a, last) = slide(&world);
        let expected = G * angle.sin() - last.active as f64 * limit / mass(&world);
        let down = Vector3::new(0.3f64.cos(), 0.3f64.sin(), 0.0);
        println!(
            "{angle} rad: a = {:.6} of {expected:.6} m/s², {} contacts, {:?}",
            a.dot(&down),
            last.active,
            last.force
        );
        assert_eq!(last.active, 16);
        // As for Coulomb's law: what is left of elastic motion.
        assert!((a - down * expected).norm() < 1e-5 * expected, "{a:?}");
        assert!((last.tangential_force - 16.0 * limit).abs() < 1e-7, "{}", last.tangential_force);
        normal_forces.push(last.force.z.abs());
    }
    assert!(normal_forces[0] > 2.0 * normal_forces[2], "{normal_forces:?}");
}

/// On four facets a corner opposes all of `friction`, the middle of a side `cos(π/4)` of it; on 64 all directions are alike,
/// and like the exact cone to `1 - cos(π/64)`.
#[test]
fn facets_oppose_sliding_by_friction_at_corners_and_by_its_cosine_between() {
    let (angle, friction) = (0.6f64, 0.5);
    let opposed = |contact: &str, heading: f64| {
        let world = incline(contact, angle, heading);
        let (a, _) = slide(&world);
        let down = Vector3::new(heading.cos(), heading.sin(), 0.0);
        assert!((a - down * a.dot(&down)).norm() < 1e-5 * G, "sliding straight down by symmetry: {a:?}");
        (G * angle.sin() - a.dot(&down)) / (G * angle.cos())
    };
    let faceted = |facets: usize| format!("law = \"faceted_coulomb\"\nfriction = {friction}\nfacets = {facets}");
    // Frames of a vertical normal have their tangents along the axes.
    let (corner, side) = (opposed(&faceted(4), 0.0), opposed(&faceted(4), FRAC_PI_4));
    let exact = [0.0, FRAC_PI_4].map(|heading| opposed("law = \"coulomb\"\nfriction = 0.5", heading));
    println!("friction against a corner {corner:.7}, a side {side:.7}, ratio {:.7}; exact {exact:.7?}", corner / side);
    assert!((corner / friction - 1.0).abs() < 1e-5, "{corner}");
    assert!((corner / side * FRAC_PI_4.cos() - 1.0).abs() < 1e-5, "{corner} {side}");
    assert!(exact.iter().all(|found| (found / friction - 1.0).abs() < 1e-5), "{exact:?}");
    let many = opposed(&faceted(64), TAU / 128.0);
    assert!((many / friction - (PI / 64.0).cos()).abs() < 1e-5, "{many}");
}

/// A block that is heavier than its contacts can bear falls through the floor with `g - n limit / m`; one that is lighter
/// rests on it.
#[test]
fn a_threshold_bears_no_more_than_its_limit() {
    let contact = |limit: f64| format!("law = \"threshold\"\nlimit = {limit}");
    let world = incline(&contact(0.05), 0.0, 0.0);
    let mut sim = Simulation::new(&world).unwrap();
    let mut last = step(&mut sim, &Isometry3::identity());
    let from = velocity(&sim);
    for _ in 0..10 {
        last = step(&mut sim, &Isometry3::identity());
    }
    let a = (velocity(&sim) - from) / (10.0 * DT);
    let expected = G - 16.0 * 0.05 / mass(&world);
    println!("falls with {:.6} of {expected:.6} m/s², {} contacts at {:?} N", -a.z, last.active, last.force);
    assert_eq!(last.active, 16);
    assert!((a.z + expected).abs() < 1e-9 * G && (last.force.z.abs() - 16.0 * 0.05).abs() < 1e-12, "{a:?}");

    let world = incline(&contact(0.2), 0.0, 0.0);
    let (a, last) = slide(&world);
    assert!(a.norm() < 1e-5 * G, "{a:?}");
    assert!((last.force.z.abs() - mass(&world) * G).abs() < 1e-5 * mass(&world) * G, "{:?}", last.force);
}

/// A needle's tip, one contact: the force rises with the indentation, stays at the limit, and the tool goes on through.
#[test]
fn a_tool_presses_up_to_the_threshold_and_goes_on_by_step_and_tick() {
    let limit = 0.25;
    let world = block::world(|scene| {
        puncture(scene, limit);
        scene.device.kind = "scripted".into();
        let key = |time, z| ScriptKey { time, position: [0.037, 0.041, z], ..ScriptKey::default() };
        scene.hand.path = vec![key(0.0, SKIN + 0.006), key(1.0, SKIN - 0.008), key(1.2, SKIN - 0.008)];
    });
    let mut sim = Simulation::new(&world).unwrap();
    let (mut forces, mut gaps) = (Vec::new(), Vec::new());
    for k in 0..60 {
        let z = SKIN + 0.003 - 0.0002 * f64::from(k);
        let report = step(&mut sim, &Isometry3::translation(0.037, 0.041, z));
        forces.push(report.force.norm());
        gaps.push(report.detection.deepest_gap);
        assert!(report.error.overlap < 1e-4, "skin that gave way is no error of the compliance: {:?}", report.error);
    }
    let gave_way = forces.iter().position(|f| *f >= limit * (1.0 - 1e-7)).expect("the limit is reached");
    println!("forces {forces:.3?}\ngaps [mm] {:.2?}", gaps.iter().map(|g| 1e3 * g).collect::<Vec<_>>());
    let begin = forces.iter().position(|f| *f > 0.0).unwrap();
    assert!(gave_way >= begin + 3, "the skin is indented first");
    assert!(forces[begin..gave_way].windows(2).all(|f| f[1] > f[0]), "{forces:?}");
    // A residual of 1e-9 of the millimetres of overlap, on a compliance of a few mm/N.
    assert!(forces[gave_way..].iter().take(20).all(|f| (f / limit - 1.0).abs() < 1e-7), "{forces:?}");
    assert!(forces.iter().all(|f| *f <= limit * (1.0 + 1e-12)), "{forces:?}");
    // Held by what it indents, the skin lags behind the tip that goes on.
    assert!(gaps.iter().fold(0.0f64, |least, g| least.min(*g)) < -0.004, "{gaps:?}");

    let options =
        RunOptions { length: Length::Seconds(1.2), lockstep: true, threads: Some(1), ..RunOptions::default() };
    let (outcome, recorder) = block::record(&world, &options);
    let ticks: Vec<f64> = recorder.ticks.iter().map(|t| t.record.contact_wrench.force.norm()).collect();
    let most = ticks.iter().fold(0.0f64, |most, f| most.max(*f));
    println!("largest force of a tick {most:.6} N; {}", outcome.summary.law);
    assert!((most / limit - 1.0).abs() < 1e-9, "{most}");
    // The tick's own tolerance of 1e-3 leaves the force a little short.
    let at_limit = ticks.iter().filter(|f| **f >= limit * (1.0 - 1e-2)).count();
    assert!(at_limit > 300, "it stays at the limit: {at_limit} of {} ticks", ticks.len());
}

fn puncture(scene: &mut SceneDescription, limit: f64) {
    let contact = &mut scene.contact;
    (contact.law, contact.friction, contact.limit) = (ContactLawKind::Threshold, 0.0, Some(limit));
    contact.max_contacts = 1;
    scene.tools[0].shape = palpate::collision::shape::ToolShape::sphere(0.003).unwrap().into();
    scene.solver.tolerance = 1e-9;
}

/// On skin that does not give way the wrench of a tick shows normal and friction apart: the friction is the limit at every
/// depth, and a tool that is apart drags nothing along.
#[test]
fn the_tick_slides_with_trescas_limit_at_any_depth() {
    let limit = 0.1;
    let height = SKIN + RADIUS;
    for depth in [0.0005, 0.001] {
        let world = block::world(|scene| {
            (scene.contact.law, scene.contact.friction, scene.contact.limit) =
                (ContactLawKind::Tresca, 0.0, Some(limit));
            // Free nodes remain at half height; the ball touches only the upper wall.
            scene.bodies[0].fixed.push(NodeSelection::NodeSet("z_max".into()));
            (scene.contact.max_contacts, scene.solver.tick_tolerance) = (1, 1e-9);
            scene.device.kind = "scripted".into();
            let key = |time, x, z| ScriptKey { time, position: [x, 0.04, z], ..ScriptKey::default() };
            scene.hand.path = vec![
                key(0.0, 0.033, height + 0.003),
                key(0.2, 0.036, height + 0.003),
                key(0.5, 0.036, height - depth),
                key(1.1, 0.048, height - depth),
            ];
        });
        let options =
            RunOptions { length: Length::Seconds(1.1), lockstep: true, threads: Some(1), ..RunOptions::default() };
        let (_, recorder) = block::record(&world, &options);
        let force = |from: f64, to: f64| {
            let within = move |time: f64| time >= from && time < to;
            recorder.ticks.iter().filter(move |t| within(t.record.time)).map(|t| t.record.contact_wrench.force)
        };
        assert!(force(0.0, 0.2).all(|f| f == Vector3::zeros()), "apart, within the margin");
        let sliding: Vec<_> = force(0.9, 1.0).collect();
        println!("{depth} m deep: {:?} N", sliding[0]);
        for f in &sliding {
            assert!((f.xy().norm() / limit - 1.0).abs() < 1e-6, "{f:?}");
            assert!(f.x < 0.0 && f.z > 200.0 * depth, "{f:?}");
        }
    }
}

/// Every law with every integrator: the force that was found obeys it.
#[test]
fn every_law_goes_with_every_integrator() {
    for integrator in ["backward_euler", "newton", "explicit"] {
        for (law, friction, facets, limit) in [
            (ContactLawKind::Coulomb, 0.3, None, None),
            (ContactLawKind::Signorini, 0.0, None, None),
            (ContactLawKind::FacetedCoulomb, 0.3, Some(6), None),
            (ContactLawKind::Tresca, 0.0, None, Some(0.02)),
            (ContactLawKind::Threshold, 0.0, None, Some(0.02)),
        ] {
            let world = block::world(|scene| {
                scene.bodies[0].block.as_mut().unwrap().cells = [4, 4, 2];
                scene.bodies[0].integrator = toml::Value::String(integrator.into()).try_into().unwrap();
                let contact = &mut scene.contact;
                (contact.law, contact.friction, contact.facets, contact.limit) = (law, friction, facets, limit);
            });
            let mut sim = Simulation::new(&world).unwrap();
            let (mut most, mut held, mut unsolved) = (0, 0, 0);
            for k in 0..40 {
                let report = sim.step(&block::pose(k));
                assert_eq!(report.status, StepStatus::Advanced, "{integrator}, {law:?}");
                most = most.max(report.active);
                unsolved += usize::from(report.detection.contacts > 0 && report.solve.status != SolveStatus::Solved);
                let rows = if matches!(law, ContactLawKind::Signorini | ContactLawKind::Threshold) { 1 } else { 3 };
                for force in sim.forces().chunks_exact(rows) {
                    let friction_force = force.get(1..3).map_or(0.0, |t| t[0].hypot(t[1]));
                    let room = 1e-9 * (1.0 + force[0]);
                    let bound = match law {
                        ContactLawKind::Tresca => 0.02,
                        ContactLawKind::Coulomb | ContactLawKind::FacetedCoulomb => friction * force[0],
                        _ => 0.0,
                    };
                    assert!(force[0] >= 0.0 && friction_force <= bound + room, "{integrator}, {law:?}: {force:?}");
                    let limited = law == ContactLawKind::Threshold;
                    assert!(!limited || force[0] <= 0.02 * (1.0 + 1e-12), "{integrator}: {force:?}");
                    held += usize::from(force[0] > 0.0);
                }
            }
            println!("{integrator}, {}: {most} contacts loaded, {unsolved} of 40 steps unsolved", law.name());
            assert!(most >= 3 && held > 10 && unsolved == 0, "{integrator}, {law:?}: {most} {held} {unsolved}");
        }
    }
}

/// What a law does not read is refused, and so is what cannot solve it: with the line, the value and a remedy.
#[test]
fn combinations_without_meaning_are_refused_with_a_remedy() {
    let refusal = |contact: &str, rest: &str| {
        let text = block::TOML.replace("friction = 0.3\n", &format!("{contact}\n")) + rest;
        Scene::from_toml(&text, Path::new("")).expect_err(contact).to_string()
    };
    for (contact, rest, words) in [
        ("law = \"signorini\"\nfriction = 0.3", "", &["scene:20", "friction = 0.3", "`signorini`", "coulomb"][..]),
        ("law = \"tresca\"", "", &["scene:19", "`tresca` needs `limit`", "limit = 0.2"]),
        ("law = \"tresca\"\nlimit = 0.1\nfriction = 0.3", "", &["scene:21", "friction = 0.3 has no effect"]),
        ("law = \"threshold\"\nlimit = -1", "", &["scene:20", "limit = -1 N", "positive"]),
        ("law = \"threshold\"\nlimit = nan", "", &["scene:20", "NaN", "positive"]),
        ("law = \"threshold\"\nlimit = 1\nfacets = 4", "", &["scene:21", "facets = 4 has no effect"]),
        ("friction = 0.3\nlimit = 1", "", &["scene:20", "limit = 1 has no effect", "tresca"]),
        ("law = \"faceted_coulomb\"\nfriction = 0.3", "", &["scene:19", "`faceted_coulomb` needs `facets`"]),
        ("law = \"faceted_coulomb\"\nfriction = 0.3\nfacets = 2", "", &["scene:21", "facets = 2", "3 to 128"]),
        ("law = \"faceted_coulomb\"\nfacets = 8", "", &["scene:19", "without friction", "signorini"]),
        ("friction = 2000", "", &["scene:19", "friction = 2000", "0 to 1000"]),
        ("law = \"trescas\"\nlimit = 1", "", &["scene:19", "did you mean `tresca`?"]),
        ("law = \"tresca\"\nlimit = 1\nmethod = \"penalty\"", "", &["`penalty`", "`tresca`", "compliance"]),
        ("law = \"threshold\"\nlimit = 1\nmethod = \"lagrange\"", "", &["`lagrange`", "`threshold`"]),
        ("friction = 0.3", "[solver]\nkind = \"conic_qp\"\n", &["`conic_qp`", "friction 0.3", "conic_friction"]),
    ] {
        let said = refusal(contact, rest);
        println!("{said}");
        for word in words {
            assert!(said.contains(word), "{contact}: `{word}` in {said}");
        }
    }
}
