//! Contact problems that a step did not solve: they are counted, noted with a remedy, and their forces do no harm.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use palpate::constraints::penalty::PenaltyConfig;
use palpate::prelude::*;
use palpate::scene::ContactMethod;
use palpate::solver::report::SolveStatus;
use palpate::solver::solver::SolverKind;
use palpate::step::StepReport;
use palpate::summary::RunSummary;

fn run(world: &World) -> (RunSummary, Vec<StepReport>) {
    let length = Length::Seconds(1.2);
    let options = RunOptions { length, lockstep: true, threads: Some(1), trace: None, ..RunOptions::default() };
    let (outcome, recorder) = block::record(world, &options);
    (outcome.summary, recorder.steps)
}

/// The note on unsolved contact, where there is one.
fn note(summary: &RunSummary) -> Option<&String> {
    summary.notes.iter().find(|note| note.contains("not solved"))
}

#[test]
fn steps_that_ended_short_of_the_tolerance_are_counted_in_summary_and_table_and_noted() {
    let hasty = |scene: &mut palpate::scene::SceneDescription| {
        (scene.solver.kind, scene.solver.max_sweeps) = (SolverKind::GaussSeidel, 1);
    };
    let (summary, steps) = run(&block::world(hasty));
    let column = StepReport::COLUMNS.iter().position(|name| *name == "contact_unsolved").unwrap();
    let unsolved: Vec<_> = steps.iter().filter(|r| r.row()[column] == 1.0).collect();
    assert!(unsolved.len() > 5 && unsolved.len() < steps.len(), "{}", unsolved.len());
    assert!(steps.iter().all(|r| (r.solve.residual > 1e-6) == (r.row()[column] == 1.0)));
    assert_eq!(summary.contact_unsolved, unsolved.len() as u64);
    let note = note(&summary).expect("a note");
    println!("{note}");
    let first = format!("step {} at {:.3} s", unsolved[0].step, unsolved[0].time);
    for words in [&first, "`gauss_seidel`", "limit of iterations", "automatic", "max_sweeps"] {
        assert!(note.contains(words), "{words}: {note}");
    }

    let (summary, _) = run(&block::world(|_| {}));
    assert_eq!((summary.contact_unsolved, self::note(&summary)), (0, None));
}

/// Springs far stiffer than the tissue, and no time to balance them: no force is handed out that the motion does not answer,
/// and the overlap that is left is told.
#[test]
fn forces_of_a_penalty_that_the_motion_does_not_balance_are_left_out() {
    let world = |stiffness, sweeps| {
        block::world(|scene| {
            scene.contact.method = ContactMethod::Penalty;
            scene.contact.penalty = Some(PenaltyConfig { stiffness: Some(stiffness), ..PenaltyConfig::default() });
            scene.solver.max_sweeps = sweeps;
        })
    };
    let (_, sound) = run(&world(1e6, 2000));
    let largest = sound.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
    assert!(sound.iter().all(|r| r.solve.is_solved()) && largest > 0.1, "{largest} N");

    let (summary, steps) = run(&world(1e11, 1));
    let first = steps.iter().find(|r| !r.solve.is_solved()).expect("one iteration does not do");
    println!("{:?}, overlap {:.1e} m, {:?}", first.solve, first.error.overlap, note(&summary));
    assert_eq!(first.solve.status, SolveStatus::MaxIterations);
    assert!(first.force.norm() == 0.0 && first.error.overlap > 1e-6, "{:?}", first.force);
    assert!((0.1..=1.5).contains(&first.solve.residual), "{:?}", first.solve);
    assert!(note(&summary).expect("a note").contains("lower the stiffness"), "{:?}", summary.notes);

    // As stiff as a scene may ask for: what is handed out stays in the range of the sound answer.
    let (summary, steps) = run(&world(1e11, 2000));
    let worst = steps.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
    println!("1e11 N/m: {} unsolved, up to {worst:.3} N of {largest:.3} N", summary.contact_unsolved);
    assert!(worst < 1.5 * largest, "{worst} N");
}
