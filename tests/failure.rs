//! Does a run that goes wrong say so, take the force off, and leave what it had?

#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

mod block;

use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::fem::block::{block as block_of, evenly};
use palpate::fem::element::ElementKind;
use palpate::fem::factor::FactorStatus;
use palpate::haptics::script::ScriptKey;
use palpate::refresh::{FactorSample, refresh};
use palpate::run::{Length, RunError, RunOptions};
use palpate::scene::SceneDescription;
use palpate::simulation::Simulation;
use palpate::step::StepStatus;
use palpate::summary::RunEnd;
use palpate::tick::TickFlags;
use palpate::trace::{StepFlags, Trace};

use block::{SKIN, STEPS, distance, pose, record, scene, world};

fn lockstep() -> RunOptions {
    RunOptions { length: Length::Seconds(1.2), lockstep: true, threads: Some(1), ..RunOptions::default() }
}

fn no_change(_: &mut SceneDescription) {}

/// A press through three quarters of the block, by a device that yields to nothing.
fn crush(scene: &mut SceneDescription) {
    scene.device.kind = "scripted".into();
    scene.hand.path[1].position[2] = SKIN - 0.018;
    scene.hand.path[2].position[2] = SKIN - 0.018;
}

/// The methods that bear least.
fn by_an_old_factor(scene: &mut SceneDescription) {
    let body = &mut scene.bodies[0];
    (body.compliance, body.correction) = (ComplianceMethod::Asynchronous, MotionCorrection::Matching);
    scene.rates.factor_delay = Some(0.1);
}

fn all_finite(vectors: &[Vector3<f64>]) -> bool {
    vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
}

#[test]
fn a_velocity_that_is_not_finite_is_rolled_back_without_force_and_the_body_goes_on() {
    let world = world(no_change);
    for bad in [f64::NAN, f64::INFINITY, 1e200] {
        let mut simulation = Simulation::new(&world).unwrap();
        for k in 0..15 {
            simulation.step(&pose(k));
        }
        assert!(simulation.forces().iter().any(|f| *f > 0.1), "in contact");
        let good = simulation.positions().to_vec();
        let node = world.model().node_of_free()[100] as usize;
        simulation.state_mut().fem.v[node].y = bad;
        let report = simulation.step(&pose(15));
        assert_eq!(report.status, StepStatus::RolledBack, "{bad}");
        assert_eq!((report.force, report.torque), (Vector3::zeros(), Vector3::zeros()));
        assert!(!simulation.snapshot().valid, "the tick must not use it");
        assert_eq!(distance(&good, simulation.positions()), 0.0, "the body is where it was");
        assert!(simulation.state().fem.v.iter().all(|v| *v == Vector3::zeros()), "and at rest");

        for k in 16..STEPS {
            let report = simulation.step(&pose(k));
            assert_eq!(report.status, StepStatus::Advanced, "step {k} after {bad}");
            assert!(report.solve.is_solved() && all_finite(&[report.force]));
        }
        assert!(simulation.snapshot().valid && all_finite(simulation.positions()));
    }
}

#[test]
fn a_crushed_body_ends_the_run_named_at_rest_without_force_and_traced() {
    let folder = tempfile::tempdir().unwrap();
    for (name, lockstep) in [("lockstep", true), ("real time", false)] {
        let path = folder.path().join(format!("{lockstep}.mcap"));
        let options = RunOptions { lockstep, trace: Some(path.clone()), ..self::lockstep() };
        // Moved by the factor of the block at rest for the whole run: beyond what a body bears.
        let world = world(|scene| {
            crush(scene);
            by_an_old_factor(scene);
            (scene.bodies[0].compliance, scene.bodies[0].guard) = (ComplianceMethod::Warped, false);
        });
        let (outcome, recorder) = record(&world, &options);
        let summary = &outcome.summary;
        assert_eq!(summary.end, RunEnd::BodyFailed, "{name}");
        let note = summary.notes.iter().find(|note| note.contains("rolled back")).expect("a note says so");
        println!("{name}: {note}");
        assert!(note.contains("body tissue") && note.contains(" s: "), "names body and time: {note}");
        assert!(note.contains("tetrahedron") && note.contains("region `block`"), "names an element: {note}");
        assert!(all_finite(&outcome.state.q) && outcome.state.v.iter().all(|v| *v == Vector3::zeros()), "{name}");
        assert!(summary.largest_force > 1.0, "the force must have somewhere to fall from");
        assert_eq!(recorder.forces().last(), Some(&Vector3::zeros()), "{name}: the last force is none");
        assert!(recorder.ticks.last().unwrap().record.flags.contains(TickFlags::INVALID_SNAPSHOT));

        // It falls by the limits' slew and no faster.
        let falls = recorder.forces().windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max);
        let gap = recorder.ticks.windows(2).map(|w| w[1].record.time - w[0].record.time).fold(0.0, f64::max);
        assert!(falls <= 2000.0 * gap * (1.0 + 1e-9), "{name}: {falls} N within {gap} s");

        let trace = Trace::load(&path).unwrap();
        assert_eq!(trace.ticks.len(), recorder.ticks.len());
        let (last, before) = trace.steps.split_last().unwrap();
        assert!(last.flags.contains(StepFlags::ROLLED_BACK), "{name}");
        assert!(before.iter().all(|step| !step.flags.contains(StepFlags::ROLLED_BACK)));
    }
}

#[test]
fn a_field_beyond_all_numbers_fails_the_first_step() {
    for gravity in [-1e60, -1e100, -1e200, -1e300] {
        let world = world(|scene| {
            scene.gravity = [0.0, 0.0, gravity];
            scene.bodies[0].settle = false;
        });
        let (outcome, recorder) = record(&world, &lockstep());
        assert_eq!(outcome.summary.end, RunEnd::BodyFailed, "{gravity} m/s²");
        assert_eq!(recorder.steps.len(), 1);
        assert_eq!(distance(&outcome.state.q, &world.mesh().nodes), 0.0, "back where it began");
    }
}

#[test]
fn a_body_without_mass_and_support_is_refused_at_set_up() {
    let world = world(|scene| {
        scene.bodies[0].total_mass = Some(1e-30);
        scene.bodies[0].fixed.clear();
    });
    for lockstep in [true, false] {
        let options = RunOptions { lockstep, ..self::lockstep() };
        let error =
            palpate::run::run(&world, &options, &AtomicBool::new(false), &mut palpate::run::Unobserved).unwrap_err();
        assert!(matches!(error, RunError::Factorization { .. }), "{error:?}");
        let text = error.to_string();
        assert!(text.contains("NotPositiveDefinite") && text.contains("fixed nodes"), "{text}");
    }
    assert!(matches!(Simulation::new(&world), Err(RunError::Factorization { .. })));
}

#[test]
fn a_matrix_that_cannot_be_factored_leaves_the_last_good_factor_in_use() {
    let world = world(no_change);
    let mut simulation = Simulation::new(&world).unwrap();
    simulation.step(&pose(0));
    let good = simulation.workspace().fem.system.clone();
    let at = world.model().rest_state();
    let q = at.q.clone();
    let first = FactorSample::new(&world, 0, 0, 0.0, &q, &good).unwrap();
    let (mut port, mut stage) = refresh(&first, &good);
    let revision = port.factor().factor.revision();

    let mut indefinite = good.clone();
    indefinite.blocks.iter_mut().for_each(|block| *block = -*block);
    let mut broken = good.clone();
    broken.blocks[0].m11 = f64::NAN;
    for (step, bad) in [(1, &indefinite), (2, &broken), (3, &indefinite), (4, &indefinite)] {
        stage.want();
        port.offer(step, 0.1, &at, bad, &[]);
        let report = stage.refresh(|| 0.2).expect("a matrix has arrived");
        assert!(!report.is_ok(), "{report:?}");
        assert_eq!(matches!(report.status, FactorStatus::NonFinite { .. }), step == 2, "{report:?}");
        let factor = port.factor();
        assert!(factor.factor.is_valid());
        assert_eq!((factor.epoch, factor.step, factor.factor.revision()), (0, 0, revision));
    }
    stage.want();
    port.offer(5, 0.3, &at, &good, &[]);
    assert!(stage.refresh(|| 0.4).unwrap().is_ok());
    let factor = port.factor();
    assert_eq!((factor.epoch, factor.step, factor.time), (1, 5, 0.3), "the next good matrix is taken again");
    assert!(FactorSample::new(&world, 0, 0, 0.0, &q, &indefinite).is_err(), "no first factor");
}

#[test]
fn without_the_filter_a_crushed_body_has_matrices_that_are_refused_and_counted() {
    let world = world(|scene| {
        crush(scene);
        by_an_old_factor(scene);
        scene.hand.path[1].position[2] = SKIN - 0.010;
        scene.hand.path[2].position[2] = SKIN - 0.010;
        scene.bodies[0].definiteness_filter = false;
    });
    let (outcome, recorder) = record(&world, &lockstep());
    let refused = outcome.summary.factors_refused;
    println!("{refused} of {} refused, {:?}", outcome.summary.factors, outcome.summary.end);
    assert!(refused > 0);
    assert!(outcome.summary.factors > refused, "and some were not");
    // A refused factor is never used: epochs rise by the good ones only.
    let used = recorder.steps.iter().map(|r| r.factor_epoch).max().unwrap();
    assert!(used <= outcome.summary.factors - refused, "epoch {used}");
    assert!(recorder.steps.windows(2).all(|w| w[0].factor_epoch <= w[1].factor_epoch));
}

#[test]
fn contacts_beyond_the_capacity_are_counted_and_the_deepest_kept() {
    let wide = |scene: &mut SceneDescription| scene.contact.merge_distance = 0.0;
    let (all, few) = (
        world(wide),
        world(|scene| {
            wide(scene);
            scene.contact.max_contacts = 4;
        }),
    );
    // The same state and the same pose: the first step that touches.
    let at = Isometry3::translation(0.033, 0.037, SKIN + 0.009);
    let (mut unlimited, mut limited) = (Simulation::new(&all).unwrap(), Simulation::new(&few).unwrap());
    let (expected, report) = (unlimited.step(&at), limited.step(&at));
    assert!(expected.detection.contacts > 4 && expected.detection.dropped == 0, "{:?}", expected.detection);
    assert_eq!(report.detection.contacts, 4);
    assert_eq!(report.detection.contacts + report.detection.dropped, expected.detection.contacts);
    let mut gaps: Vec<_> = unlimited.state().contacts.contacts.iter().map(|c| c.gap).collect();
    gaps.sort_by(f64::total_cmp);
    let kept = &limited.state().contacts.contacts;
    assert!(kept.iter().all(|c| c.gap <= gaps[3]), "the four deepest of {gaps:?}");
    assert_eq!(report.detection.deepest_gap, gaps[0]);

    let (outcome, recorder) = record(&few, &lockstep());
    assert!(outcome.summary.contacts_dropped > 0 && outcome.summary.end == RunEnd::Completed);
    let dropped: usize = recorder.steps.iter().map(|r| r.detection.dropped).sum();
    assert_eq!(outcome.summary.contacts_dropped, dropped as u64);
    assert!(outcome.summary.contacts.max <= 4.0 && outcome.summary.largest_force > 0.3);
}

#[test]
fn a_tool_that_jumps_sends_no_wild_force() {
    let key = |time, z| ScriptKey { time, position: [0.033, 0.037, z], ..ScriptKey::default() };
    // 0.1 m in less than a step: into the skin, into the middle, through the block, and back out.
    for depth in [0.045, 0.030, 0.010, -0.020] {
        for compliance in [ComplianceMethod::Asynchronous, ComplianceMethod::Exact] {
            let world = world(|scene| {
                scene.device.kind = "scripted".into();
                scene.bodies[0].compliance = compliance;
                let high = depth + 0.1;
                scene.hand.path =
                    vec![key(0.0, high), key(0.3, high), key(0.32, depth), key(0.6, depth), key(0.62, high)];
            });
            let (outcome, recorder) = record(&world, &lockstep());
            let summary = &outcome.summary;
            println!("{compliance:?}, to z = {depth}: {:?}, up to {:.2} N", summary.end, summary.largest_force);
            assert!(all_finite(&outcome.state.q) && all_finite(&outcome.state.v));
            // It left again, or was taken off: what came out below the held bottom cannot come back up through it.
            assert_eq!(recorder.forces().last(), Some(&Vector3::zeros()), "to z = {depth}");
            assert!(summary.end != RunEnd::Completed || summary.port.counts.jumped > 0, "0.1 m in 20 ms is told");
            let jump = recorder.forces().windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max);
            assert!(jump <= 2.0 * (1.0 + 1e-9), "{jump} N in a millisecond: above the slew limit");
            // Up to a crush of the block against its support, exact compliance bears the jump; what does not is named.
            let bears = compliance == ComplianceMethod::Exact && depth >= 0.030;
            assert!(!bears || summary.end == RunEnd::Completed, "to {depth}");
            assert_eq!(summary.end == RunEnd::BodyFailed, summary.notes.iter().any(|n| n.contains("was rolled back")));
        }
    }
}

/// The tool teleports anywhere, also to where no tool can be.
#[test]
fn poses_beyond_reason_give_no_contact_and_harm_nothing() {
    let world = world(no_change);
    let mut simulation = Simulation::new(&world).unwrap();
    for k in 0..20 {
        simulation.step(&pose(k));
    }
    for z in [f64::NAN, f64::INFINITY, 1e300, -1e9, SKIN / 2.0, 1e9] {
        let report = simulation.step(&Isometry3::translation(0.033, 0.037, z));
        assert!(all_finite(&[report.force, report.torque]), "{z}: {:?}", report.force);
        assert!(all_finite(simulation.positions()), "{z}");
    }
    for k in 45..STEPS {
        simulation.step(&pose(k));
    }
    assert!(distance(simulation.positions(), simulation.state().rest()) < SKIN, "the block is still one");
}

#[test]
fn a_mesh_of_the_caller_that_names_a_node_that_does_not_exist_is_refused_for_every_element() {
    for element in [ElementKind::Linear, ElementKind::Averaged, ElementKind::Quadratic] {
        let scene = scene(|d| d.bodies[0].element = element);
        let mut mesh = block_of(&evenly(0.0, 0.08, 2), &evenly(0.0, 0.08, 2), &evenly(0.0, 0.04, 2));
        assert!(scene.build_on(mesh.clone()).is_ok(), "{element:?}");
        mesh.tetrahedra[5][2] = 1000;
        let Err(error) = scene.build_on(mesh) else { panic!("{element:?}: refused") };
        assert!(error.to_string().contains("1000"), "{error}");
    }
}
