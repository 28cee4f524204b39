//! A tool of many parts on a rigid plate that lies on tissue: more contacts than a patch has room for.

#![allow(clippy::print_stdout)] // measured numbers

use std::path::Path;

use palpate::haptics::script::ScriptKey;
use palpate::prelude::*;
use palpate::run::{Length, RunOptions};
use palpate::summary::RunEnd;
use palpate::tick::TickFlags;

use crate::block::{MAX_FORCE, SKIN, TOML, record};

/// Radius (m) of each of the tool's balls, and how they stand: `N` times `N` of them, `APART` (m) from one another.
const BALL: f64 = 0.002;
const APART: f64 = 0.004;

/// Height of the plate (m), and how far it lies above the skin at first.
const PLATE: f64 = 0.006;
const ABOVE: f64 = 2e-4;

/// Contacts of bodies in a patch.
const ROOM: u64 = 24;

/// A brush of `n` times `n` balls comes down on the plate, presses it 3 mm into the tissue, and holds it there.
fn world(n: usize) -> World {
    let place = |k: usize| APART * (k as f64 - 0.5 * (n - 1) as f64);
    let balls: Vec<String> = (0..n * n)
        .map(|k| {
            let (x, y) = (place(k % n), place(k / n));
            format!("{{ shape = {{ kind = \"sphere\", radius = {BALL} }}, position = [{x}, {y}, 0] }}")
        })
        .collect();
    let brush = format!("kind = \"compound\", parts = [{}]", balls.join(", "));
    let tool = TOML.replace("kind = \"sphere\", radius = 0.012", &brush).replace("at = \"faces\"", "at = \"nodes\"");
    let centre = SKIN + ABOVE + 0.5 * PLATE;
    let text = format!(
        "{tool}\n[[rigid_body]]\nname = \"plate\"\nshape = {{ kind = \"box\", size = [0.03, 0.03, {PLATE}] }}\nmass = 0.05\n\
         position = [0.04, 0.04, {centre}]\n"
    );
    let mut scene = Scene::from_toml(&text, Path::new("")).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let touch = SKIN + ABOVE + PLATE + BALL;
    let key = |time, z| ScriptKey { time, position: [0.04, 0.04, z], ..ScriptKey::default() };
    scene
        .edit(|scene| {
            scene.bodies[0].rayleigh_stiffness = 0.02;
            let (above, below) = (touch + 4e-3, touch - 3e-3);
            scene.hand.path = vec![key(0.0, above), key(0.1, above), key(0.5, below), key(1.0, below)];
        })
        .unwrap();
    scene.build().unwrap()
}

/// Sixteen contacts fit, twenty-five do not; the tick goes on with the deepest, tells so, and feels what the step feels: the
/// plate is stiff, so that what some contacts do not carry the others do.
#[test]
fn a_tool_with_more_contacts_on_a_rigid_body_than_a_patch_holds_keeps_the_deepest() {
    for n in [4, 5] {
        let world = world(n);
        let options =
            RunOptions { length: Length::Seconds(1.0), lockstep: true, threads: Some(1), ..RunOptions::default() };
        let (outcome, recorder) = record(&world, &options);
        let s = &outcome.summary;
        let most = recorder.steps.iter().map(|step| step.bodies.left_of_tool).max().unwrap_or(0);
        let told = s.notes.iter().find(|note| note.contains("rigid bodies found no room"));
        println!("{n} x {n}: {most} left out, {} frozen, {:.2} N; {told:?}", s.frozen_at_rigid, s.largest_force);
        assert_eq!((s.end, s.frozen_at_rigid), (RunEnd::Completed, 0));
        assert_eq!(u64::from(most), ((n * n) as u64).saturating_sub(ROOM));
        assert_eq!(told.is_some_and(|note| note.contains("24 deepest")), most > 0, "{:?}", s.notes);
        assert_eq!(s.contacts_dropped > 0, most > 0);

        let held: Vec<_> = recorder.ticks.iter().filter(|t| t.record.time > 0.8).collect();
        assert!(held.iter().all(|t| t.record.flags.contains(TickFlags::LOCAL) && t.record.active > 0));
        let by_tick = held.iter().map(|t| t.record.contact_wrench.force.z).sum::<f64>() / held.len() as f64;
        let steps: Vec<_> = recorder.steps.iter().filter(|step| step.time > 0.8).collect();
        let by_step = steps.iter().map(|step| step.force.z).sum::<f64>() / steps.len() as f64;
        println!("held: {by_tick:.4} N by ticks, {by_step:.4} N by steps");
        assert!(by_step > 0.1 && (by_tick / by_step - 1.0).abs() < 0.05, "{by_tick} {by_step}");
        assert!(recorder.forces().iter().all(|f| f.iter().all(|x| x.is_finite()) && f.norm() <= MAX_FORCE));
    }
}
