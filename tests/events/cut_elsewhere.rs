//! Tissue is cut away beside a tool that is held by friction: edges and triangles have other numbers from then on. Does the hand
//! feel anything at the snapshot that brings them?

#![allow(clippy::print_stdout)] // measured numbers

use crate::block::{Recorder, record, scene};
use nalgebra::Vector3;
use palpate::run::{Length, RunOptions};
use palpate::scene::{EventDescription, NodeSelection};
use palpate::tick::TickFlags;

/// When the corner goes (s).
const CUT: f64 = 1.0;

/// The ball is pressed in, pushed aside within friction, and held; a corner of the skin is cut away or not.
fn run(cut: bool) -> Recorder {
    let held = scene(|_| ()).text().replace("friction = 0.3", "friction = 0.8").replace(
        "    { time = 0.9, position = [0.046, 0.042, 0.042] },\n    { time = 1.2, position = [0.046, 0.042, 0.060] },",
        "    { time = 0.7, position = [0.037, 0.038, 0.042] },",
    );
    let mut scene = palpate::scene::Scene::from_toml(&held, std::path::Path::new("")).unwrap();
    scene
        .edit(|scene| {
            let corner = NodeSelection::Ball { center: [0.08, 0.08, 0.04], radius: 0.02 };
            scene.events.extend(cut.then_some(EventDescription {
                time: CUT,
                release: None,
                hold: None,
                remove: Some(corner),
            }));
        })
        .unwrap();
    let options = RunOptions { length: Length::Seconds(1.5), lockstep: true, ..RunOptions::default() };
    record(&scene.build().unwrap(), &options).1
}

#[test]
fn a_cut_beside_the_tool_is_felt_by_what_it_frees_and_not_by_new_numbers() {
    let (cut, whole) = (run(true), run(false));
    let step = cut.steps.iter().position(|step| step.change.changed).expect("it is cut");
    assert!(step > 20 && cut.steps[step].change.phase == 1 && cut.steps[step].active > 2);
    let new = |k: &usize| cut.ticks[*k].record.flags.contains(TickFlags::NEW_SNAPSHOT);
    let swaps: Vec<usize> = (0..cut.ticks.len()).filter(new).collect();
    let swap =
        swaps.iter().copied().find(|&k| cut.ticks[k].record.snapshot_step == step as u64 + 1).expect("its snapshot");
    let force = |run: &Recorder, k: usize| run.ticks[k].record.contact_wrench.force;
    let (before, at) = (force(&cut, swap - 1), cut.ticks[swap].record);
    let aside = Vector3::new(before.x, before.y, 0.0).norm();
    assert!(aside > 0.1 && before.z > 0.5, "friction holds it: {before}");

    let jump = at.force_jump;
    let others = swaps.iter().filter(|&&k| k != swap && cut.ticks[k].record.time > 0.8);
    let usual = others.map(|&k| cut.ticks[k].record.force_jump).fold(0.0, f64::max);
    let apart = (swap..swap + 33).map(|k| (force(&cut, k) - force(&whole, k)).norm()).fold(0.0, f64::max);
    println!(
        "of {:.3} N, {aside:.3} aside: the force jumps by {jump:.1e} N at the cut, by {usual:.1e} at others",
        before.norm()
    );
    println!("until the next step it is {apart:.1e} N from that without a cut");
    // With features taken for others the jump was 24 mN, ten times that of other snapshots.
    assert!(jump < 3.0 * usual && jump < 0.01 * before.norm(), "{jump} N");
    // What the cut frees moves the skin under the tool, a little.
    assert!(apart < 0.03 * before.norm(), "{apart} N");
}
