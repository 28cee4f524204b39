//! Contacts that find no room are counted by one rule, whichever bodies touch: in report, summary, trace and statistics.

#![allow(clippy::print_stdout)] // measured numbers

mod block;

use palpate::run::{Length, RunOptions};
use palpate::scene::{FixedBodyDescription, SolidShape};
use palpate::trace::{StepFlags, Trace};

use block::{record, world};

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
