//! What is told about the error of an old factor's compliance, and what is done about it.

#![allow(clippy::print_stdout)] // measured numbers

use std::time::{Duration, Instant};

use crate::block;
use nalgebra::DMatrix;
use palpate::collision::contact::Contact;
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate::fem::preconditioner::BlockJacobi;
use palpate::prelude::*;
use palpate::scene::Refactor;
use palpate::step::StepReport;

use crate::block::{STEPS, pose, record};

/// The block with these methods and tight solves.
fn block(change: impl FnOnce(&mut SceneDescription)) -> World {
    block::world(|scene| {
        let body = &mut scene.bodies[0];
        (body.compliance, body.tolerance, body.max_iterations) = (ComplianceMethod::Asynchronous, 1e-10, 1000);
        body.error_sampling = 100.0;
        change(scene);
    })
}

/// `h² H A⁻¹ Hᵀ` of the simulation's last step, by conjugate gradients without any factor.
fn exact_compliance(simulation: &Simulation<'_>) -> DMatrix<f64> {
    let (world, ws) = (simulation.world(), simulation.workspace());
    let (model, rows, dt) = (world.model(), &ws.rows().tissue, world.dt());
    let mut jacobi = BlockJacobi::new(model.free_nodes());
    jacobi.update(&ws.fem.system);
    let mut pcg_ws = PcgWorkspace::new(model.free_nodes());
    let config = PcgConfig { relative_tolerance: 1e-12, max_iterations: 5000 };
    let m = rows.len();
    let mut w = DMatrix::zeros(m, m);
    for j in 0..m {
        let (mut b, mut x) = (vec![0.0; 3 * model.free_nodes()], vec![0.0; 3 * model.free_nodes()]);
        let mut unit = vec![0.0; m];
        unit[j] = 1.0;
        rows.add_transposed(&unit, &mut b);
        let report = pcg(&ws.fem.system, &b, &mut x, &mut jacobi, config, &mut pcg_ws);
        assert!(report.status == PcgStatus::Converged || report.relative_residual < 1e-10, "{report:?}");
        (0..m).for_each(|i| w[(i, j)] = dt * dt * rows.dot(i, &x));
    }
    w
}

/// The sampled error is that of the column, the error along the forces that of `W λ`: both found again with neither the
/// factor nor the step's solves. Tolerances: the sampled column is solved to 1e-6 of its right side.
#[test]
fn the_error_of_an_old_factor_is_what_is_told() {
    let world = block(|_| ());
    let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
    let mut checked = 0;
    for k in 0..45 {
        let report = simulation.step(&pose(k));
        if report.active < 3 || k % 4 != 0 {
            continue;
        }
        let (w, exact) = (simulation.workspace().problem().compliance().into_owned(), exact_compliance(&simulation));
        let row = report.error.sampled_row as usize;
        let sampled = (w.column(row) - exact.column(row)).amax() / exact.column(row).amax();
        let lambda = nalgebra::DVector::from_column_slice(simulation.forces());
        let along = ((&exact - &w) * &lambda).norm() / (&exact * &lambda).norm();
        println!("step {k}: sampled {:.4}, along the forces {:.4}", report.error.sampled, report.error.along_forces);
        assert!((report.error.sampled - sampled).abs() < 1e-3 * sampled + 1e-5, "{} {sampled}", report.error.sampled);
        assert!(
            (report.error.along_forces - along).abs() < 1e-5 * along + 1e-7,
            "{} {along}",
            report.error.along_forces
        );
        assert!(sampled > 0.01, "a factor that is never refreshed is wrong, not by {sampled}");
        checked += 1;
    }
    assert!(checked >= 3);
}

/// The overlap is what the positions say after the correction by an old factor: the gap of each contact, moved on with the
/// skin along the contact's normal.
#[test]
fn the_overlap_is_that_of_the_positions_after_the_correction() {
    let world = block(|_| ());
    let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
    let (mut touching, mut deepest) = (0, 0.0_f64);
    for k in 0..STEPS {
        let before = simulation.positions().to_vec();
        let report = simulation.step(&pose(k));
        if report.active == 0 {
            continue;
        }
        let moved = |node: u32| simulation.positions()[node as usize] - before[node as usize];
        let gap = |contact: &Contact| {
            let skin = contact.nodes.iter().zip(contact.weights).filter(|(_, w)| *w != 0.0);
            contact.gap + contact.normal.dot(&skin.map(|(node, weight)| weight * moved(*node)).sum())
        };
        let overlap = simulation.state().contacts.contacts.iter().map(|c| -gap(c)).fold(0.0, f64::max);
        // The tolerance of the solves, 1e-10 of motions of centimetres.
        assert!((overlap - report.error.overlap).abs() < 1e-11, "step {k}: {overlap:e} {:e}", report.error.overlap);
        (touching, deepest) = (touching + 1, deepest.max(overlap));
    }
    println!("{touching} steps, at most {deepest:.1e} m");
    assert!(touching > 20 && deepest > 1e-8, "an old factor leaves some: {deepest:e} m");
}

/// A comparison is not what a step is late for; a ladder goes by what it finds, and always has it.
#[test]
fn a_step_without_time_compares_no_column_and_has_the_same_forces() {
    let hour = Duration::from_secs(3600);
    let climbing = |scene: &mut SceneDescription| scene.bodies[0].accuracy = Some(0.5);
    for (world, goes_by_it) in [(block(|_| ()), false), (block(climbing), true)] {
        let simulation = || Simulation::new(&world).unwrap().refresh_every(0);
        let (mut unhurried, mut early, mut late) = (simulation(), simulation(), simulation());
        let mut compared = 0;
        for k in 0..STEPS {
            early.end_by(Instant::now() + hour);
            late.end_by(Instant::now());
            let [free, early, hurried] =
                [&mut unhurried, &mut early, &mut late].map(|simulation| simulation.step(&pose(k)));
            let same = |a: f64, b: f64| a.to_bits() == b.to_bits();
            assert!(same(free.error.sampled, early.error.sampled) && !early.error.sample_left_out, "step {k}");
            assert_eq!(unhurried.forces(), late.forces(), "step {k}");
            assert_eq!(unhurried.positions(), late.positions(), "step {k}");
            if !free.error.sampled.is_nan() {
                compared += 1;
                assert_eq!(hurried.error.sampled.is_nan(), !goes_by_it, "step {k}");
                assert_eq!(hurried.error.sample_left_out, !goes_by_it, "step {k}");
            }
        }
        assert!(compared > 20, "{compared} steps had a column to compare");
    }
}

#[test]
fn exact_compliance_has_no_error_and_sampling_can_be_left_out() {
    let exact = block(|scene| scene.bodies[0].compliance = ComplianceMethod::Exact);
    let off = block(|scene| {
        (scene.bodies[0].error_sampling, scene.bodies[0].correction) = (0.0, MotionCorrection::Matching);
    });
    for world in [exact, off] {
        let mut simulation = Simulation::new(&world).unwrap();
        for k in 0..30 {
            let report = simulation.step(&pose(k));
            assert_eq!(report.error.measured(), None);
        }
    }
    let world = block(|scene| scene.bodies[0].compliance = ComplianceMethod::Exact);
    let mut simulation = Simulation::new(&world).unwrap();
    (0..30).for_each(|k| _ = simulation.step(&pose(k)));
    let (w, exact) = (simulation.workspace().problem().compliance().into_owned(), exact_compliance(&simulation));
    assert!((&w - &exact).amax() < 1e-8 * exact.amax(), "{:e}", (&w - &exact).amax() / exact.amax());
}

/// With what scenes grant by default in every step of contact, with factors as old as a run has them; where less is granted,
/// in fewer steps.
#[test]
fn a_run_of_the_bundled_liver_compares_a_column_whenever_the_plan_says_so() {
    for (share, most_apart) in [(None, 1), (Some(0.005), 20)] {
        let mut scene = Scene::bundled("liver").unwrap();
        scene.edit(|scene| scene.bodies[0].error_sampling = share.unwrap_or(scene.bodies[0].error_sampling)).unwrap();
        let world = scene.build().unwrap();
        let sampling = world.plan().sampling;
        println!("{share:?}: {sampling:?}");
        assert!(sampling.every >= 1 && sampling.every <= most_apart, "{sampling:?}");
        let granted = world.description().bodies[0].error_sampling * world.dt();
        let worth = sampling.iterations as f64 * sampling.iteration / sampling.every as f64;
        assert!(worth <= granted, "{worth:e} s of {granted:e} s a step");

        let length = Length::Seconds(2.6);
        let (_, recorder) = record(&world, &RunOptions { length, lockstep: true, ..RunOptions::default() });
        let touching: Vec<_> = recorder.steps.iter().filter(|step| step.rows.rows > 0).collect();
        let sampled = |step: &&&StepReport| !step.error.sampled.is_nan();
        let due = touching.iter().filter(|step| sampling.is_due(step.step));
        let (of, count) = (due.clone().count(), due.filter(sampled).count());
        println!("{count} of {of} columns, in {} steps", touching.len());
        let iterations = |s: &&StepReport| s.free_motion.iterations + s.error.correction_iterations as usize;
        let mut of_steps: Vec<_> = touching.iter().map(iterations).collect();
        of_steps.sort_unstable();
        let (median, most) = (of_steps[of_steps.len() / 2], of_steps[of_steps.len() - 1]);
        println!("conjugate gradients in a step of contact: {median} iterations at the median, {most} at most");
        assert!(most <= 10, "an old factor at 10 Hz still serves: {most}");
        assert!(of as u64 >= touching.len() as u64 / sampling.every && of > 0, "{of} of {}", touching.len());
        assert_eq!(count, of);
        assert_eq!(touching.iter().filter(sampled).count(), count, "and in no other step");
        let rows: std::collections::BTreeSet<u32> =
            touching.iter().filter(sampled).map(|step| step.error.sampled_row).collect();
        assert!(2 * rows.len() >= count, "the rows have their turns: {rows:?}");
    }
}

/// `M (v⁺ - v) = h (f + Hᵀ λ) - ...`: the step's end is the solution of its linear system under the forces that were found,
/// however old the factor. Solved again with the forces in the right side and without the factor.
#[test]
fn the_exact_correction_satisfies_the_equations_of_motion_for_any_age_of_the_factor() {
    for compliance in [ComplianceMethod::Asynchronous, ComplianceMethod::Warped] {
        let world = block(|scene| scene.bodies[0].compliance = compliance);
        let model = world.model();
        let mut simulation = Simulation::new(&world).unwrap().refresh_every(7);
        let (mut fem, mut jacobi) = (FemWorkspace::new(model), BlockJacobi::new(model.free_nodes()));
        let mut pcg_ws = PcgWorkspace::new(model.free_nodes());
        let (mut touched, mut worst) = (0, 0.0_f64);
        for k in 0..STEPS {
            let before = simulation.state().fem.clone();
            let report = simulation.step(&pose(k));
            if report.active == 0 || report.cuts > 0 {
                continue;
            }
            let rows = &simulation.workspace().rows().tissue;
            let mut load = vec![0.0; 3 * model.free_nodes()];
            rows.add_transposed(simulation.forces(), &mut load);
            let mut forces = vec![nalgebra::Vector3::zeros(); model.nodes()];
            for (f, &node) in load.chunks_exact(3).zip(model.node_of_free()) {
                forces[node as usize] = nalgebra::Vector3::new(f[0], f[1], f[2]);
            }
            assemble(model, &before, world.dt(), &forces, &mut fem);
            jacobi.update(&fem.system);
            let mut dv = vec![0.0; 3 * model.free_nodes()];
            let config = PcgConfig { relative_tolerance: 1e-12, max_iterations: 5000 };
            pcg(&fem.system, &fem.rhs, &mut dv, &mut jacobi, config, &mut pcg_ws);
            let size = dv.iter().map(|x| x * x).sum::<f64>().sqrt();
            let mut missed = 0.0;
            for (dv, &node) in dv.chunks_exact(3).zip(model.node_of_free()) {
                let n = node as usize;
                let really = simulation.state().fem.v[n] - before.v[n];
                missed += (really - nalgebra::Vector3::new(dv[0], dv[1], dv[2])).norm_squared();
            }
            worst = worst.max(missed.sqrt() / size);
            touched += 1;
        }
        println!("{compliance:?}: {touched} steps in contact, motion within {worst:.1e}");
        // Both solves stop at 1e-10 of their right sides, of matrices whose condition is some thousands.
        assert!(touched > 20 && worst < 1e-6, "{compliance:?}: {worst:e}");
    }
}

/// The scene's accuracy is kept by steps that factor their own matrix, and by no more of them than it takes.
#[test]
fn a_stated_accuracy_makes_steps_exact_where_it_is_missed() {
    let errors = |accuracy: Option<f64>| {
        let world = block(|scene| scene.bodies[0].accuracy = accuracy);
        let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
        let (mut above, mut exact, mut cheap) = (0, 0, 0);
        for k in 0..STEPS {
            let report = simulation.step(&pose(k));
            if report.rows.rows > 0 {
                exact += usize::from(report.method == ComplianceMethod::Exact);
                cheap += usize::from(report.method == ComplianceMethod::Asynchronous);
            }
            above += usize::from(report.error.of_forces().is_some_and(|e| e > 0.02));
        }
        (above, exact, cheap)
    };
    let (without, with) = (errors(None), errors(Some(0.02)));
    println!("steps above 2 %, exact, not exact: {without:?} without accuracy, {with:?} with it");
    assert_eq!(without.1, 0);
    assert!(with.1 > 0 && with.2 > 0, "some steps are exact, some are not: {with:?}");
    assert!(2 * with.0 < without.0, "{with:?} {without:?}");
}

#[test]
fn a_plan_names_the_cheapest_method_that_serves() {
    let plan = |change: &dyn Fn(&mut SceneDescription)| block::world(change).plan().clone();
    let small = plan(&|_| ());
    assert_eq!((small.compliance, small.refactor), (ComplianceMethod::Exact, Refactor::Step));
    assert!(!small.has_factor_thread() && small.to_string().contains("fits in the step"), "{small}");
    let linear = plan(&|scene| {
        let law = palpate::fem::material::Material::from_young_poisson("linear", 6e3, 0.45).unwrap();
        scene.bodies[0].material = law.into();
    });
    assert_eq!((linear.constant, linear.refactor), (true, Refactor::Once));
    let hurried = plan(&|scene| (scene.rates.step, scene.rates.tick) = (5000.0, 5000.0));
    assert_eq!((hurried.compliance, hurried.refactor), (ComplianceMethod::Asynchronous, Refactor::Thread));
    // Prediction is of operations: as many as the factor has.
    assert!(small.factorization > 0.0 && small.solve > 0.0 && small.factorization < 0.4 / 30.0);
}

/// A linear body needs no second factor: its steps in contact satisfy the equations with the first.
#[test]
fn a_linear_body_is_computed_exactly_by_its_first_factor() {
    let law = palpate::fem::material::Material::from_young_poisson("linear", 6e3, 0.4).unwrap();
    let run = |compliance| {
        let world = block(|scene| {
            (scene.bodies[0].material, scene.bodies[0].compliance) = (law.into(), compliance);
        });
        let mut simulation = Simulation::new(&world).unwrap();
        let last = (0..40).map(|k| simulation.step(&pose(k))).last().unwrap();
        (simulation.positions().to_vec(), last)
    };
    let (once, report) = run(ComplianceMethod::Automatic);
    assert_eq!((report.method, report.factor_epoch), (ComplianceMethod::Exact, 0));
    assert!(report.free_motion.iterations <= 2, "{}", report.free_motion.iterations);
    let (exact, _) = run(ComplianceMethod::Exact);
    // Solves to 1e-10, contact to 1e-6 of forces that indent by millimetres.
    let distance = block::distance(&once, &exact);
    assert!(distance < 1e-8, "{distance:e} m");
}

/// The same bits for any number of workers, for every method, with early refreshes, sampling and accuracy at work.
#[test]
fn every_method_repeats_to_the_bit_on_any_number_of_threads() {
    for compliance in
        [ComplianceMethod::Automatic, ComplianceMethod::Asynchronous, ComplianceMethod::Warped, ComplianceMethod::Exact]
    {
        let run = |threads| {
            let world = block(|scene| {
                // Less than refined forces miss.
                (scene.bodies[0].compliance, scene.bodies[0].accuracy) = (compliance, Some(0.005));
                scene.rates.factor = 2.0;
            });
            let options = RunOptions {
                length: Length::Seconds(1.0),
                lockstep: true,
                threads: Some(threads),
                ..RunOptions::default()
            };
            let (outcome, recorder) = record(&world, &options);
            (outcome.state.q, recorder.forces(), outcome.summary.factors_early)
        };
        let one = run(1);
        for threads in [2, 4] {
            let other = run(threads);
            assert!(one == other, "{compliance:?}: {threads} threads differ from one");
        }
        // With an accuracy the automatic choice climbs a ladder that begins with a factor thread.
        let has_thread = matches!(compliance, ComplianceMethod::Asynchronous | ComplianceMethod::Automatic);
        assert_eq!(one.2 > 0, has_thread, "{compliance:?}: {} early", one.2);
    }
}
