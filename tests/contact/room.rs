//! Contacts that find no room are counted by one rule, whichever bodies touch: in report, summary, trace and statistics.

#![allow(clippy::print_stdout)] // measured numbers

use palpate::run::{Length, RunOptions};
use palpate::scene::{FixedBodyDescription, SolidShape, TickMethod};
use palpate::tick::TickFlags;
use palpate::trace::{StepFlags, Trace};

use crate::block::{record, world};

#[test]
fn contacts_of_other_bodies_without_room_are_in_the_summary_and_flagged_in_the_trace() {
    let world = world(|scene| {
        // Beside the skin of one side: thirty-five nodes within the margin, and room for four.
        scene.fixed_bodies = vec![FixedBodyDescription {
            name: "wall".into(),
            shape: SolidShape::Plane { normal: [-1.0, 0.0, 0.0] },
            position: [0.081, 0.0, 0.0],
            rotation: [0.0; 3],
            friction: None,
            max_contacts: Some(4),
        }];
    });
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("room.mcap");
    let options = RunOptions {
        length: Length::Seconds(0.2),
        lockstep: true,
        threads: Some(1),
        trace: Some(trace.clone()),
        ..RunOptions::default()
    };
    let (outcome, recorder) = record(&world, &options);
    let dropped: Vec<u64> = recorder.steps.iter().map(|step| step.dropped()).collect();
    println!("{dropped:?} contacts found no room");
    assert!(recorder.steps.iter().all(|step| step.detection.dropped == 0), "the tool has room");
    assert!(dropped.iter().all(|&n| n > 20));
    assert_eq!(outcome.summary.contacts_dropped, dropped.iter().sum::<u64>());
    let trace = Trace::load(&trace).unwrap();
    assert_eq!(trace.steps.len(), recorder.steps.len());
    assert!(trace.steps.iter().all(|step| step.flags.contains(StepFlags::CONTACTS_DROPPED)));
}

#[test]
fn ticks_without_room_for_their_contacts_or_without_convergence_are_counted_and_the_former_noted() {
    let run = |method: TickMethod, most: usize, sweeps: u32| {
        let world = world(|scene| {
            (scene.tick.method, scene.contact.max_contacts) = (method, most);
            scene.solver.tick_sweeps = sweeps;
            // One sweep does not reach it in all ticks of a slide.
            scene.solver.tick_tolerance = 1e-9;
        });
        let options =
            RunOptions { length: Length::Seconds(1.2), lockstep: true, threads: Some(1), ..RunOptions::default() };
        let (outcome, recorder) = record(&world, &options);
        let told = |flag| recorder.ticks.iter().filter(|tick| tick.record.flags.contains(flag)).count() as u64;
        let (truncated, unconverged) = (told(TickFlags::TRUNCATED), told(TickFlags::NOT_CONVERGED));
        let counts = outcome.summary.port.contact;
        println!(
            "{method:?}, room for {most}, {sweeps} sweeps: {truncated} ticks truncated, {unconverged} not converged"
        );
        assert_eq!((counts.truncated, counts.not_converged), (truncated, unconverged));
        let said = format!("{truncated} ticks had more contacts than room, the first at");
        let note = outcome.summary.notes.iter().find(|note| note.contains(&said));
        assert_eq!(note.is_some(), truncated > 0, "{:?}", outcome.summary.notes);
        assert!(note.is_none_or(|note| note.contains(&format!("`max_contacts` above {most}"))), "{note:?}");
        (truncated, unconverged)
    };
    assert!(run(TickMethod::Local, 2, 1000).0 > 50);
    let (truncated, unconverged) = run(TickMethod::Local, 64, 1);
    assert!(truncated == 0 && unconverged > 0);
}
