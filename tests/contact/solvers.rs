//! The contact solver of the step: it falls back where its first choice does not do, says so everywhere, and starts from the
//! forces of the step before.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use std::collections::BTreeSet;

use nalgebra::Isometry3;
use palpate::prelude::*;
use palpate::solver::report::SolveStatus;
use palpate::solver::solver::SolverKind;
use palpate::step::StepReport;

/// The press-and-slide scene with a solver and a tolerance.
fn world(kind: SolverKind, tolerance: f64) -> World {
    block::world(|scene| (scene.solver.kind, scene.solver.tolerance) = (kind, tolerance))
}

fn slide(world: &World, mut before: impl FnMut(&mut Simulation<'_>)) -> Vec<StepReport> {
    let mut sim = Simulation::new(world).unwrap();
    let step = |k| {
        before(&mut sim);
        sim.step(&block::pose(k))
    };
    (0..block::STEPS).map(step).collect()
}

/// The default takes Gauss-Seidel's answer where it is good after 30 sweeps, to the bit, and Newton's where it is not.
#[test]
fn the_default_is_gauss_seidel_until_that_takes_too_long() {
    assert_eq!(palpate::scene::SolverDescription::default().kind, SolverKind::Automatic);
    let (sweeps, automatic) = (world(SolverKind::GaussSeidel, 1e-6), world(SolverKind::Automatic, 1e-6));
    let (expected, found) = (slide(&sweeps, |_| {}), slide(&automatic, |_| {}));
    // After the first fall-back the two are alike to the tolerance only.
    let alike = expected.iter().take_while(|r| r.solve.iterations <= 30).count();
    let easy = expected[..alike].iter().filter(|r| r.detection.contacts > 0).count();
    println!("{easy} steps in contact before the first that takes more than 30 sweeps");
    assert!(easy > 5, "{easy}");
    for (a, b) in expected[..alike].iter().zip(&found) {
        assert_eq!((a.force, a.solve, a.attempts, a.solver), (b.force, b.solve, b.attempts, b.solver));
    }

    let hard = world(SolverKind::Automatic, 1e-11);
    let reports = slide(&hard, |_| {});
    let touching = || reports.iter().filter(|r| r.detection.contacts > 0);
    let fell_back = touching().filter(|r| r.attempts > 1).count();
    println!("{fell_back} of {} steps in contact fell back", touching().count());
    assert!(fell_back > 10 && touching().all(|r| r.solve.status == SolveStatus::Solved));
    assert!(touching().filter(|r| r.attempts > 1).all(|r| r.solver == "semismooth_newton"));
    assert!(reports.iter().filter(|r| r.detection.contacts == 0).all(|r| (r.attempts, r.solver) == (0, "")));
    // The same answer as many sweeps give; sixty steps carry what the tolerances leave through a stable body.
    let expected = slide(&world(SolverKind::GaussSeidel, 1e-11), |_| {});
    let largest = expected.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
    let off = expected.iter().zip(&reports).map(|(a, b)| (a.force - b.force).norm()).fold(0.0, f64::max);
    println!("forces differ by {off:.1e} of {largest:.3} N");
    assert!(off < 1e-8 * largest, "{off} of {largest}");
}

/// Summary, table and trace tell of the same fall-backs; the record replays to the bit.
#[test]
fn fall_backs_are_told_in_summary_table_and_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.mcap");
    let world = world(SolverKind::Automatic, 1e-11);
    let options = RunOptions {
        length: Length::Seconds(1.2),
        lockstep: true,
        threads: Some(1),
        trace: Some(path.clone()),
        ..RunOptions::default()
    };
    let (outcome, recorder) = block::record(&world, &options);
    let summary = &outcome.summary;
    let fell_back = recorder.steps.iter().filter(|r| r.attempts > 1).count() as u64;
    println!("{:?}, {} fall-backs", summary.answered, summary.fall_backs);
    assert!(fell_back > 0);
    assert_eq!(summary.fall_backs, fell_back);
    let touching = recorder.steps.iter().filter(|r| r.attempts > 0).count() as u64;
    assert_eq!(summary.answered.values().sum::<u64>(), touching);
    assert_eq!(summary.answered.get("semismooth_newton"), Some(&fell_back));
    let column = StepReport::COLUMNS.iter().position(|name| *name == "solver_attempts").unwrap();
    let trace = palpate::trace::Trace::load(&path).unwrap();
    assert_eq!(trace.steps.len(), recorder.steps.len());
    for (record, report) in trace.steps.iter().zip(&recorder.steps) {
        assert_eq!(record.solver_attempts, report.attempts);
        assert_eq!(report.row()[column], f64::from(report.attempts));
    }
    assert!(palpate::replay::replay(&path).unwrap().is_identical());
}

/// Contacts come, go and slide over the skin; forces that are carried by feature, and to the nearest where a feature is new,
/// save sweeps against a start from nothing: the fewer digits are asked for, the larger a share. The motion is the same to
/// the tolerance.
#[test]
fn warm_starts_by_feature_save_sweeps_in_a_slide() {
    let shares = [1e-2, 1e-3, 1e-6].map(sweeps_of_a_slide);
    // Sweeps converge linearly: a better begin saves a number of them that does not depend on where they end.
    assert!(shares[0] < 0.5 && shares[1] < 0.75 && shares[2] < 1.0, "{shares:?}");
}

/// Sweeps with a warm start by sweeps without.
fn sweeps_of_a_slide(tolerance: f64) -> f64 {
    const STEPS: u64 = 40;
    let world = world(SolverKind::GaussSeidel, tolerance);
    let tool = |k: u64| {
        // Pressed in, then dragged by 15 mm: 0.5 mm a step, through cells of 13 mm.
        let (down, aside) = (k.min(10) as f64, k.saturating_sub(10) as f64);
        Isometry3::translation(0.03 + 0.0005 * aside, 0.037, block::SKIN + block::RADIUS + 0.001 - 0.0005 * down)
    };
    let run = |warm: bool| {
        let mut sim = Simulation::new(&world).unwrap();
        let mut features = Vec::new();
        let step = |k| {
            if !warm {
                sim.state_mut().warm_start.clear();
            }
            let report = sim.step(&tool(k));
            features.push(sim.state().contacts.contacts.iter().map(|c| c.feature).collect::<BTreeSet<_>>());
            report
        };
        let reports: Vec<_> = (0..STEPS).map(step).collect();
        (reports, features)
    };
    let ((warm, features), (cold, _)) = (run(true), run(false));
    let (come, go) = features.windows(2).fold((0, 0), |(come, go), pair| {
        (come + pair[1].difference(&pair[0]).count(), go + pair[0].difference(&pair[1]).count())
    });
    let sweeps = |reports: &[StepReport]| reports[10..].iter().map(|r| r.solve.iterations).sum::<u32>();
    let (few, many) = (sweeps(&warm), sweeps(&cold));
    println!("to {tolerance}: {few} sweeps warm, {many} cold, in 30 sliding steps; {come} contacts came, {go} went");
    assert!(come > 5 && go > 5, "{come} {go}");
    assert!(warm[10..].iter().all(|r| r.active > 0 && r.tangential_force > 0.0), "it slides");
    let largest = cold.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
    let off = warm.iter().zip(&cold).map(|(a, b)| (a.force - b.force).norm()).fold(0.0, f64::max);
    assert!(off < 100.0 * tolerance * largest, "{off} of {largest}");
    f64::from(few) / f64::from(many)
}
