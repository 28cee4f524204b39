//! Linear solves that run out of iterations: what the step does about it, and what a run says.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use crate::block::{pose, record, world};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::fem::pcg::PcgStatus;
use palpate::run::{Length, RunOptions};
use palpate::simulation::Simulation;
use palpate::step::{FactorFit, StepReport};
use palpate::trace::{StepFlags, Trace};
use palpate::world::World;

/// Steps with a factor that is never made anew, and this many iterations for each.
fn steps(most: usize, method: ComplianceMethod) -> (World, Vec<StepReport>) {
    let world = world(|scene| {
        scene.gravity = [0.0, 0.0, -9.81];
        let body = &mut scene.bodies[0];
        (body.settle, body.max_iterations, body.tolerance) = (false, most, 1e-10);
        body.compliance = method;
        scene.solver.tolerance = 1e-9;
    });
    let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
    let reports = (0..block::STEPS).map(|k| simulation.step(&pose(k))).collect();
    (world, reports)
}

fn iterations(report: &StepReport) -> usize {
    report.free_motion.iterations + report.error.correction_iterations as usize
}

/// The budget is one for all solves of a step. Where it is spent the step factors its own matrix, after which each solve
/// needs a few iterations, and everything converges.
#[test]
fn a_step_that_has_spent_its_iterations_goes_on_with_a_factor_of_its_own() {
    let (_, free) = steps(2000, ComplianceMethod::Asynchronous);
    let (_, exact) = steps(2000, ComplianceMethod::Exact);
    assert!(free.iter().all(|r| !r.rescued));
    let needed = free.iter().map(iterations).max().unwrap();
    for most in [1, 4, 20] {
        let (world, all) = steps(most, ComplianceMethod::Asynchronous);
        let (mut rescued, mut apart) = (0, 0.0_f64);
        for (r, exact) in all.iter().zip(&exact) {
            assert_eq!(r.free_motion.status, PcgStatus::Converged, "{most}, step {}", r.step);
            assert!(!r.error.correction_unconverged && r.error.correction_residual <= 1e-10, "step {}", r.step);
            // The budget, and at most ten with the own factor in each of five solves.
            assert!(iterations(r) <= most + 50, "{most}, step {}: {} iterations", r.step, iterations(r));
            assert!(iterations(r) <= most || r.rescued, "{most}, step {}: {} iterations", r.step, iterations(r));
            assert_eq!(r.change.factor, FactorFit::Own);
            rescued += usize::from(r.rescued);
            apart = apart.max((r.force - exact.force).norm());
        }
        println!(
            "{most} iterations a step, of {needed} needed: {rescued} of {} rescued, forces {apart:.1e} N from exact ones",
            all.len()
        );
        // The motion and the forces of exact steps then, to the tolerances of the solves.
        assert!(most > 1 || apart < 1e-6, "{apart}");
        assert!(rescued > 10 && world.plan().has_factor_thread(), "{rescued}");
    }
}

/// At 10 kHz no factorisation fits into a step, and there is no memory for one: what has not converged is told in the
/// report, the trace, the summary and a note with a remedy.
#[test]
fn solves_that_do_not_converge_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spent.mcap");
    let world = world(|scene| {
        (scene.rates.step, scene.rates.tick) = (10_000.0, 10_000.0);
        scene.hand.path[0].position[2] = block::SKIN + block::RADIUS + 1e-5;
        scene.hand.path[1].position[2] = block::SKIN + block::RADIUS - 2e-3;
        scene.hand.path[1].time = 0.01;
        scene.device.kind = "scripted".into();
        let body = &mut scene.bodies[0];
        (body.max_iterations, body.tolerance, body.compliance) = (1, 1e-12, ComplianceMethod::Asynchronous);
    });
    let options = RunOptions {
        length: Length::Seconds(0.015),
        lockstep: true,
        threads: Some(1),
        trace: Some(path.clone()),
        ..RunOptions::default()
    };
    let (outcome, recorder) = record(&world, &options);
    let told = outcome.summary.unconverged;
    println!("{told:?}\n{:?}", outcome.summary.notes);
    assert_eq!(told.rescued, 0);
    assert!(told.free_motions > 20 && told.corrections > 20, "{told:?}");
    assert!(told.free_motion_residual > 1e-12 && told.correction_residual > 1e-12, "{told:?}");
    let of = |what: fn(&StepReport) -> bool| recorder.steps.iter().filter(|r| what(r)).count() as u64;
    assert_eq!(told.free_motions, of(|r| r.free_motion.status != PcgStatus::Converged));
    assert_eq!(told.corrections, of(|r| r.error.correction_unconverged));
    assert!(recorder.steps.iter().all(|r| iterations(r) <= 1), "one for the whole step");
    let note = outcome.summary.notes.iter().find(|note| note.contains("ended without convergence"));
    assert!(note.is_some_and(|note| note.contains("max_iterations = 1 a step")), "{:?}", outcome.summary.notes);
    let trace = Trace::load(&path).unwrap();
    let flagged = trace.steps.iter().filter(|s| s.flags.contains(StepFlags::CORRECTION_UNCONVERGED)).count() as u64;
    assert_eq!(flagged, told.corrections);
    assert!(trace.log.iter().any(|line| line.message().contains("ended without convergence")));
}

/// Few iterations for a comparison with a factor of the undeformed block: those that end without convergence are told in the
/// report, the trace, the table, the summary and a note with a remedy, and give no error.
#[test]
fn comparisons_that_do_not_converge_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("compared.mcap");
    let compared = |share: f64| {
        world(|scene| {
            // 18 mm deep, by the factor of the block at rest.
            (1..3).for_each(|k| scene.hand.path[k].position[2] = block::SKIN + block::RADIUS - 0.018);
            let body = &mut scene.bodies[0];
            (body.compliance, body.error_sampling) = (ComplianceMethod::Warped, share);
        })
    };
    let share = 6.5 * compared(1.0).plan().sampling.iteration * compared(1.0).description().rates.step;
    let world = compared(share);
    assert_eq!((world.plan().sampling.every, world.plan().sampling.iterations), (1, 6));
    let options = RunOptions {
        length: Length::Seconds(1.2),
        lockstep: true,
        threads: Some(1),
        trace: Some(path.clone()),
        ..RunOptions::default()
    };
    let (outcome, recorder) = record(&world, &options);
    let told = outcome.summary.unconverged;
    let failed: Vec<_> = recorder.steps.iter().filter(|r| r.error.sample_unconverged).collect();
    let measured = recorder.steps.iter().filter(|r| !r.error.sampled.is_nan()).count();
    println!("{} failed, {measured} measured: {told:?}\n{:?}", failed.len(), outcome.summary.notes);
    assert!(failed.len() > 5 && measured > 0 && told.comparisons == failed.len() as u64);
    assert!(failed.iter().all(|r| r.error.sampled.is_nan() && r.error.sample_residual > 1e-6));
    assert!(
        (told.comparison_residual - failed.iter().map(|r| r.error.sample_residual).fold(0.0, f64::max)).abs() == 0.0
    );
    let column = StepReport::COLUMNS.iter().position(|name| *name == "sample_unconverged").unwrap();
    assert!(recorder.steps.iter().all(|r| (r.row()[column] == 1.0) == r.error.sample_unconverged));
    let note = outcome.summary.notes.iter().find(|note| note.contains("the error there is not known")).unwrap();
    for words in [&format!("{} comparisons", failed.len()), "at most 6 iterations", "error_sampling above", "\"async\""]
    {
        assert!(note.contains(words), "{words}: {note}");
    }
    let trace = Trace::load(&path).unwrap();
    let flagged = trace.steps.iter().filter(|s| s.flags.contains(StepFlags::SAMPLE_UNCONVERGED)).count();
    assert_eq!(flagged, failed.len());

    // As many iterations as it takes: nothing to tell.
    let (outcome, _) = record(&compared(100.0), &RunOptions { trace: None, ..options });
    assert_eq!(outcome.summary.unconverged.comparisons, 0);
    assert!(!outcome.summary.notes.iter().any(|note| note.contains("comparison")), "{:?}", outcome.summary.notes);
}
