//! A scene chooses how its body moves in time; all integrators press the same tissue.

#![allow(clippy::print_stdout)] // measured numbers

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::prelude::*;
use palpate::run::{Length, RunOptions};
use palpate::scene::{BodyDescription, ExplicitDescription, IntegratorKind, NewtonDescription, Refactor, SceneError};
use palpate::step::StepStatus;
use palpate::world::{EXPLICIT_SAFETY, Integration};

use crate::block::{RADIUS, SKIN, TOML, record, scene, world};

/// Coarse enough that a hundred explicit substeps are cheap.
fn coarse(description: &mut SceneDescription, integrator: IntegratorKind) {
    let body = &mut description.bodies[0];
    if let Some(block) = &mut body.block {
        block.cells = [4, 4, 2];
    }
    (body.integrator, body.compliance) = (integrator, ComplianceMethod::Exact);
    // Stiffness damping is cut: it shortens the explicit step.
    (body.rayleigh_mass, body.rayleigh_stiffness) = (8.0, 0.0);
    description.contact.friction = 0.0;
}

#[test]
fn every_integrator_presses_with_the_same_force() {
    let forces: Vec<f64> = [IntegratorKind::BackwardEuler, IntegratorKind::Newton, IntegratorKind::Explicit]
        .into_iter()
        .map(|kind| {
            let world = world(|d| coarse(d, kind));
            let mut simulation = Simulation::new(&world).unwrap();
            let mut force = 0.0;
            let steps = 90;
            for k in 0..steps {
                let depth = 0.005 * (f64::from(k) / 30.0).min(1.0);
                let report = simulation.step(&Isometry3::translation(0.033, 0.037, SKIN + RADIUS - depth));
                assert_eq!(report.status, StepStatus::Advanced, "{kind:?}, step {k}: {report:?}");
                assert!(report.solve.is_solved(), "{kind:?}, step {k}: {report:?}");
                // The last third of a second, so that the rest of the vibration averages out.
                force += if k >= steps - 10 { 0.1 * report.force.norm() } else { 0.0 };
            }
            println!("{kind:?}: {force:.5} N with {}", world.integration());
            force
        })
        .collect();
    assert!(forces[0] > 0.1, "{forces:?}");
    // Backward Euler both times: the same equilibrium, nearly reached in three seconds.
    assert!((forces[1] / forces[0] - 1.0).abs() < 1e-3, "{forces:?}");
    // Explicitly the vibration dies by mass damping alone: exp(-8/2 · 2 s) of it is left.
    assert!((forces[2] / forces[0] - 1.0).abs() < 1e-2, "{forces:?}");
}

#[test]
fn newton_and_explicit_runs_have_the_same_bits_for_any_number_of_threads() {
    for kind in [IntegratorKind::Newton, IntegratorKind::Explicit] {
        let world = world(|d| {
            coarse(d, kind);
            d.contact.friction = 0.3;
        });
        let run = |threads| {
            let options = RunOptions {
                length: Length::Seconds(0.6),
                lockstep: true,
                threads: Some(threads),
                ..RunOptions::default()
            };
            let (outcome, recorder) = record(&world, &options);
            assert!(outcome.summary.largest_force > 0.01, "{:?}", outcome.summary);
            assert_eq!(outcome.summary.factors, 0, "no factor of an older step is used");
            (recorder.forces(), outcome.state)
        };
        let one = run(1);
        for threads in [2, 4] {
            assert!(run(threads) == one, "{kind:?}: {threads} threads");
        }
    }
}

#[test]
fn newtons_steps_report_their_iterations_and_leave_a_smaller_residual() {
    let world = world(|d| {
        coarse(d, IntegratorKind::Newton);
        d.bodies[0].newton = Some(NewtonDescription { iterations: 30, tolerance: 1e-10 });
        d.gravity = [0.0, 0.0, -9.81];
        d.bodies[0].settle = false;
    });
    assert!(matches!(world.integration(), Integration::Newton(config) if config.iterations == 30));
    let mut simulation = Simulation::new(&world).unwrap();
    let mut most = 0;
    for _ in 0..20 {
        let report = simulation.step(&Isometry3::translation(0.0, 0.0, 1.0));
        assert_eq!(report.status, StepStatus::Advanced);
        assert!(report.free_motion.relative_residual < 1e-10, "{:?}", report.free_motion);
        most = most.max(report.free_motion.iterations);
    }
    assert!((2..30).contains(&most), "{most} iterations");
}

#[test]
fn explicit_substeps_suit_the_critical_step_and_too_few_are_refused_with_the_number_needed() {
    let world = world(|d| coarse(d, IntegratorKind::Explicit));
    let Integration::Explicit { substeps, dt, critical } = *world.integration() else { panic!("explicit") };
    assert!(dt <= EXPLICIT_SAFETY * critical.step && dt * f64::from(substeps) * 30.0 > 1.0 - 1e-12);
    let text = world.understood();
    assert!(text.contains("critical step at rest") && text.contains(&format!("{substeps} substeps")), "{text}");

    let needed = critical.substeps(1.0 / 30.0, 1.0);
    let with = |substeps, allow_unstable| {
        scene(|d| {
            coarse(d, IntegratorKind::Explicit);
            d.bodies[0].explicit = Some(ExplicitDescription { substeps: Some(substeps), allow_unstable });
        })
        .build()
    };
    assert!(with(needed, false).is_ok());
    let Err(SceneError::Invalid(error)) = with(needed - 1, false) else { panic!("refused at its place") };
    println!("{error}");
    assert!(error.text[error.span.clone()].contains(&format!("{}", needed - 1)), "points at the number");
    assert!(error.to_string().contains(&format!("substeps = {needed}")), "{error}");

    // The override: a third too few, and the body flies apart, is named and rolled back.
    let unstable = with(needed * 2 / 3, true).unwrap();
    let mut simulation = Simulation::new(&unstable).unwrap();
    let node = unstable.model().node_of_free()[40] as usize;
    simulation.state_mut().fem.v[node] = Vector3::new(0.01, 0.02, -0.01);
    let failed = (0..60).map(|_| simulation.step(&Isometry3::translation(0.0, 0.0, 1.0)));
    let failed = failed.into_iter().find(|r| r.status == StepStatus::RolledBack).expect("it blows up");
    let element = failed.failed.expect("an element is named");
    assert!((element.tetrahedron as usize) < unstable.mesh().tetrahedra.len());
    assert!(simulation.positions().iter().all(|q| q.iter().all(|x| x.is_finite())));
}

#[test]
fn settings_of_another_integrator_are_refused_at_their_place() {
    let with =
        |lines: &str| Scene::from_toml(&TOML.replacen("density", &format!("{lines}\ndensity"), 1), Path::new(""));
    for (lines, place, remedy) in [
        ("newton = { iterations = 3 }", "iterations", "integrator = \"newton\""),
        ("explicit = { substeps = 3 }", "substeps", "integrator = \"explicit\""),
        ("integrator = \"newton\"\nnewton = { iterations = 0 }", "0", "at least 1"),
        ("integrator = \"newton\"\nnewton = { tolerance = -1.0 }", "-1", "positive"),
        ("integrator = \"newton\"\nnewton = { tolerance = 1.0 }", "1.0", "use 1e-9"),
        ("integrator = \"explicit\"\nexplicit = { substeps = 0 }", "0", "at least 1"),
    ] {
        let Err(SceneError::Invalid(error)) = with(lines) else { panic!("{lines} is refused") };
        assert!(error.remedy.as_ref().is_some_and(|r| r.contains(remedy)), "{lines}: {error}");
        assert!(!error.span.is_empty() && lines.contains(place), "{lines}: {error}");
    }
    let Err(SceneError::Invalid(error)) = with("integrator = \"explicitt\"") else { panic!("unknown") };
    assert!(error.to_string().contains("explicit"), "{error}");
    assert!(with("integrator = \"newton\"").is_ok() && with("integrator = \"explicit\"").is_ok());
}

#[test]
fn a_body_that_fails_names_an_element_and_its_region() {
    let world = world(|_| {});
    let mut simulation = Simulation::new(&world).unwrap();
    let node = world.model().node_of_free()[100];
    simulation.state_mut().fem.v[node as usize].y = f64::NAN;
    let report = simulation.step(&Isometry3::translation(0.0, 0.0, 1.0));
    assert_eq!(report.status, StepStatus::RolledBack);
    let failed = report.failed.expect("named");
    assert!((failed.tetrahedron as usize) < world.mesh().tetrahedra.len());
    assert_eq!(failed.region, world.mesh().regions[failed.tetrahedron as usize]);
}

#[test]
fn explicit_steps_report_the_worst_of_their_forces_and_name_the_element_that_is_not_finite() {
    let world = world(|d| coarse(d, IntegratorKind::Explicit));
    let mut simulation = Simulation::new(&world).unwrap();
    let report = simulation.step(&Isometry3::translation(0.033, 0.037, SKIN + RADIUS - 0.004));
    assert!(report.assembly.min_jacobian < 0.99 && report.assembly.min_jacobian > 0.2, "{:?}", report.assembly);
    let node = world.model().node_of_free()[20];
    simulation.state_mut().fem.q[node as usize].y = f64::NAN;
    let report = simulation.step(&Isometry3::translation(0.0, 0.0, 1.0));
    assert_eq!(report.status, StepStatus::RolledBack);
    let failed = report.failed.expect("named").tetrahedron;
    assert_eq!(report.assembly.non_finite, Some(failed));
    assert!(world.mesh().tetrahedra[failed as usize].contains(&node));
}

#[test]
fn keys_that_the_integrator_never_reads_are_warned_of_by_name() {
    let keys = BodyDescription::OF_BACKWARD_EULER;
    for kind in [IntegratorKind::BackwardEuler, IntegratorKind::Newton, IntegratorKind::Explicit] {
        let world = world(|d| {
            coarse(d, kind);
            let body = &mut d.bodies[0];
            (body.guard, body.definiteness_filter) = (false, false);
            (body.tolerance, body.max_iterations) = (1e-8, 500);
            (body.correction, body.refactor) = (MotionCorrection::Matching, Some(Refactor::Step));
            (body.accuracy, body.error_sampling) = (Some(0.01), 0.2);
        });
        let warned = |key: &str| world.warnings().iter().any(|w| w.contains(&format!("`{key}`")));
        assert!(
            keys.iter().all(|(key, _)| warned(key) == (kind != IntegratorKind::BackwardEuler)),
            "{:?}",
            world.warnings()
        );
        // An accuracy that is kept, between several methods, is promised to linearised steps only.
        let accurate = self::world(|d| {
            coarse(d, kind);
            (d.bodies[0].compliance, d.bodies[0].accuracy) = (ComplianceMethod::Automatic, Some(0.01));
        });
        assert_eq!(accurate.plan().ladder.is_some(), kind == IntegratorKind::BackwardEuler, "{}", accurate.plan());
    }
    let plain = world(|d| (d.bodies[0].integrator, d.bodies[0].rayleigh_stiffness) = (IntegratorKind::Newton, 0.0));
    assert!(plain.warnings().is_empty(), "{:?}", plain.warnings());
}
