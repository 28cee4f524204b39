//! A stated accuracy of the contact forces is kept by the lowest method that does: up when it is missed, down when the rung
//! below would do.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use crate::block::{RADIUS, SKIN, record};
use nalgebra::Isometry3;
use palpate::constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate::prelude::*;
use palpate::replay::replay;
use palpate::scene::{ContactMethod, Refactor};
use palpate::step::StepReport;
use palpate::world::{CALM_STEPS, LOWER_SHARE, Rung};

/// What forces that are refined miss in a deep press, and keep to under a light touch.
const ACCURACY: f64 = 0.005;

/// The same for `W` itself, which is what is known without an exact correction.
const OF_COMPLIANCE: f64 = 0.1;

/// The block with an accuracy to keep, and columns compared to the end.
fn block(compliance: ComplianceMethod, change: impl FnOnce(&mut SceneDescription)) -> World {
    block::world(|scene| {
        let body = &mut scene.bodies[0];
        (body.compliance, body.accuracy, body.error_sampling) = (compliance, Some(ACCURACY), 100.0);
        change(scene);
    })
}

/// The ball so far below the skin (m).
fn at(depth: f64) -> Isometry3<f64> {
    Isometry3::translation(0.033, 0.037, SKIN + RADIUS - depth)
}

/// Depths (m): touching lightly, pressed deep within a third of a second, held, let go.
fn depth(k: u64) -> f64 {
    match k {
        0..20 => 0.0005,
        20..30 => 0.0005 + 0.0012 * (k - 20) as f64,
        30..70 => 0.0125,
        70..75 => 0.0125 - 0.003 * (k - 70) as f64,
        _ => -0.003,
    }
}

const LENGTH: u64 = 140;

fn steps(world: &World, depth: impl Fn(u64) -> f64) -> Vec<StepReport> {
    let mut simulation = Simulation::new(world).unwrap().refresh_every(3).refresh_early();
    (0..LENGTH).map(|k| simulation.step(&at(depth(k)))).collect()
}

fn rung(report: &StepReport) -> Rung {
    report.rung.expect("there is a ladder")
}

#[test]
fn a_deep_press_climbs_and_comes_down_after_it() {
    let world = block(ComplianceMethod::Automatic, |_| ());
    assert_eq!(world.plan().ladder.unwrap().rungs(), [Rung::Asynchronous, Rung::Early, Rung::Exact]);
    let all = steps(&world, depth);
    let line = |k: usize, r: &StepReport| {
        println!(
            "step {k:3}: {:20} error {:.4} below {:.4}",
            rung(r).name(),
            r.error.of_forces().unwrap_or(f64::NAN),
            r.error.lower
        );
    };
    (15..100).step_by(3).for_each(|k| line(k, &all[k]));
    assert!(all[..20].iter().all(|r| rung(r) == Rung::Asynchronous), "a light touch is left to the lowest");
    let highest = all.iter().map(rung).max().unwrap();
    assert!(highest >= Rung::Early, "the press climbs, not only to {highest:?}");

    // A step that misses the accuracy is followed by one a rung higher, and no other goes up: after the climb it is kept.
    let mut missed = 0;
    for (before, after) in all.iter().zip(&all[1..]) {
        let misses = before.active > 0
            && before.method != ComplianceMethod::Exact
            && before.error.of_forces().is_some_and(|e| e > ACCURACY);
        assert_eq!(misses, before.error.missed_accuracy);
        assert_eq!(rung(after) > rung(before), misses && rung(before) != Rung::Exact, "after step {}", before.step);
        missed += usize::from(misses);
    }
    let climbed = all.iter().rposition(|r| r.error.missed_accuracy).unwrap();
    println!("highest {highest:?}, {missed} steps missed the accuracy, the last is {climbed}");
    assert!((2..=8).contains(&missed), "{missed}");

    // Released, it comes down a rung every CALM_STEPS, and ends where it began.
    let free = all.iter().rposition(|r| r.active > 0).unwrap();
    let down = all.iter().skip(free).position(|r| rung(r) == Rung::Asynchronous).unwrap();
    assert!(down <= 2 * CALM_STEPS as usize + 1, "{down} steps after step {free}");
    assert!(all[free + down..].iter().all(|r| rung(r) == Rung::Asynchronous));
}

/// The correction by the old inverse tells nothing of its error: a column is compared in every step, whatever the scene
/// grants for it, and the run climbs as by the exact one.
#[test]
fn a_run_climbs_also_where_the_correction_does_not_tell_the_error() {
    let world = block(ComplianceMethod::Asynchronous, |scene| {
        let body = &mut scene.bodies[0];
        (body.correction, body.error_sampling) = (MotionCorrection::Matching, 1e-9);
        body.accuracy = Some(OF_COMPLIANCE);
    });
    assert_eq!(world.plan().sampling.every, 1);
    let all = steps(&world, depth);
    let measured = |r: &&StepReport| r.error.measured().is_some();
    let inexact = |r: &&StepReport| r.active > 0 && r.method != ComplianceMethod::Exact;
    let (of, known) = (all.iter().filter(inexact).count(), all.iter().filter(inexact).filter(measured).count());
    println!("{known} of {of} steps know their error; highest {:?}", all.iter().map(rung).max());
    assert!(known == of && of > 20, "{known} of {of}");
    assert!(all.iter().all(|r| r.error.along_forces.is_nan()), "the correction tells nothing");
    let mut missed = 0;
    for (before, after) in all.iter().zip(&all[1..]) {
        let misses = inexact(&before) && before.error.measured().is_some_and(|error| error > OF_COMPLIANCE);
        assert_eq!(rung(after) > rung(before), misses && rung(before) != Rung::Exact, "after step {}", before.step);
        missed += usize::from(misses);
    }
    assert!(missed > 0 && all.iter().map(rung).max() >= Some(Rung::Early), "{missed}");
}

/// The direct approaches find their forces without compliance: no rung of the ladder would make them nearer.
#[test]
fn an_accuracy_is_refused_where_contact_forces_come_from_no_compliance() {
    for (method, nearer) in [(ContactMethod::Penalty, "stiffer `penalty`"), (ContactMethod::Lagrange, "`tolerance`")] {
        for compliance in [ComplianceMethod::Automatic, ComplianceMethod::Exact] {
            let edit = |accuracy| {
                block::scene(|_| ())
                    .edit(|scene| {
                        scene.contact.method = method;
                        (scene.bodies[0].compliance, scene.bodies[0].accuracy) = (compliance, accuracy);
                    })
                    .map_err(|e| e.to_string())
            };
            let refused = edit(Some(ACCURACY)).unwrap_err();
            let key = format!("accuracy = {ACCURACY} has no effect");
            for words in [&key, method.name(), "method = \"compliance\"", nearer] {
                assert!(refused.contains(words), "{words}: {refused}");
            }
            edit(None).unwrap();
        }
    }
}

#[test]
fn an_accuracy_that_nothing_measures_is_refused() {
    let edit = |change: &dyn Fn(&mut SceneDescription)| {
        let mut scene = block::scene(|scene| scene.bodies[0].accuracy = Some(ACCURACY));
        scene
            .edit(|scene| {
                (scene.bodies[0].correction, scene.bodies[0].error_sampling) = (MotionCorrection::Matching, 0.0);
                change(scene);
            })
            .map_err(|e| e.to_string())
    };
    let refused = edit(&|_| ()).unwrap_err();
    assert!(refused.contains("accuracy") && refused.contains("error_sampling"), "{refused}");
    // Each of these tells the error, or has none.
    edit(&|scene| scene.bodies[0].error_sampling = 1e-6).unwrap();
    edit(&|scene| scene.bodies[0].correction = MotionCorrection::Exact).unwrap();
    edit(&|scene| scene.bodies[0].compliance = ComplianceMethod::Exact).unwrap();
    edit(&|scene| {
        let linear = palpate::fem::material::Material::from_young_poisson("linear", 6e3, 0.45).unwrap();
        scene.bodies[0].material = linear.into();
    })
    .unwrap();
}

/// Steps at the poses of the block's path with factors two steps old: forces, and reports.
fn path(world: &World) -> Vec<StepReport> {
    let mut simulation = Simulation::new(world).unwrap().refresh_every(3);
    (0..block::STEPS).map(|k| simulation.step(&block::pose(k))).collect()
}

/// Where the latest factor serves, an accuracy changes nothing, to the bit: it costs nothing then.
#[test]
fn what_asynchronous_steps_serve_is_left_to_them() {
    let plain = path(&block(ComplianceMethod::Asynchronous, |scene| scene.bodies[0].accuracy = None));
    for accuracy in [0.9, 0.17] {
        for method in [ComplianceMethod::Automatic, ComplianceMethod::Asynchronous] {
            let all = path(&block(method, |scene| scene.bodies[0].accuracy = Some(accuracy)));
            assert!(all.iter().all(|r| rung(r) == Rung::Asynchronous && r.method != ComplianceMethod::Exact));
            assert!(all.iter().zip(&plain).all(|(a, b)| a.force == b.force), "{accuracy}, {method:?}");
        }
    }
    let known = |r: &&StepReport| r.error.of_forces().is_some();
    let (w, forces) = plain.iter().filter(known).fold((0.0_f64, 0.0_f64), |(w, forces), r| {
        (w.max(r.error.measured().unwrap_or(0.0)), forces.max(r.error.of_forces().unwrap_or(0.0)))
    });
    println!("W is wrong by {w:.4}, forces miss {forces:.5}");
    assert!(w > 0.17 && forces < 0.17, "`W` alone would have climbed: {w}, {forces}");
}

/// The force of a run on a ladder against that of exact steps, as share of the largest force.
#[test]
fn the_contact_forces_meet_the_accuracy_where_the_ladder_says_so() {
    let deep = |world: &World| steps(world, depth);
    let sliding = |world: &World| path(world);
    for (name, run) in [("pressed deep", &deep as &dyn Fn(&World) -> Vec<StepReport>), ("sliding", &sliding)] {
        let exact = run(&block(ComplianceMethod::Exact, |scene| scene.bodies[0].accuracy = None));
        let largest = exact.iter().map(|r| r.force.norm()).fold(0.0, f64::max);
        for accuracy in [0.3, 0.1, 0.03, 0.01, 0.003, 0.001] {
            let all = run(&block(ComplianceMethod::Automatic, |scene| scene.bodies[0].accuracy = Some(accuracy)));
            let errors = || all.iter().zip(&exact).map(|(a, b)| (a.force - b.force).norm() / largest);
            let (worst, kept) = all.iter().zip(errors()).fold((0.0_f64, 0.0_f64), |(worst, kept), (r, error)| {
                (worst.max(error), if r.error.missed_accuracy { kept } else { kept.max(error) })
            });
            let missed = all.iter().filter(|r| r.error.missed_accuracy).count();
            let of = |wanted| all.iter().filter(|r| r.active > 0 && rung(r) == wanted).count();
            let told = all.iter().filter_map(|r| r.error.of_forces()).fold(0.0, f64::max);
            println!(
                "{name}, {accuracy}: {} async, {} early, {} exact; {missed} missed; told up to {told:.4}; off by {kept:.5} \
                 where met, {worst:.5} at worst",
                of(Rung::Asynchronous),
                of(Rung::Early),
                of(Rung::Exact)
            );
            assert!(kept <= accuracy, "{name}, {accuracy}: {kept}");
        }
    }
}

#[test]
fn a_still_press_stays_on_the_lowest_method() {
    let world = block(ComplianceMethod::Automatic, |_| ());
    let all = steps(&world, |_| 0.001);
    assert!(all.iter().all(|r| rung(r) == Rung::Asynchronous && r.rows.rows > 0));
    assert!(all.iter().all(|r| r.method == ComplianceMethod::Asynchronous));
    let worst = all.iter().filter_map(|r| r.error.of_forces()).fold(0.0, f64::max);
    println!("largest error {worst:.4}");
    assert!(worst > 0.0 && worst <= ACCURACY, "{worst}");
}

/// What is told of the rung below is what that rung then has: at the step that goes down, and only while it is calm.
#[test]
fn the_error_of_the_rung_below_is_foretold() {
    let world = block(ComplianceMethod::Automatic, |_| ());
    // Pressed deep, and half way back: the latest factor would do again.
    let all = steps(&world, |k| match k {
        0..30 => 0.0005 * k as f64,
        30..40 => 0.0145 - 0.0014 * (k - 30) as f64,
        _ => 0.0005,
    });
    let mut descents = 0;
    for (before, after) in all.iter().zip(&all[1..]).filter(|(a, b)| rung(b) < rung(a)) {
        let measured = after.error.of_forces().unwrap();
        println!("{:?} -> {:?}: foretold {:.4}, is {measured:.4}", rung(before), rung(after), before.error.lower);
        assert!(before.error.lower <= LOWER_SHARE * ACCURACY);
        assert!(measured <= ACCURACY, "step {}", after.step);
        descents += 1;
    }
    assert!(descents >= 2, "{descents}");
    assert_eq!(all.last().map(rung), Some(Rung::Asynchronous));
}

#[test]
fn a_named_method_is_the_lowest_rung_and_skin_without_room_is_left_to_half_solves() {
    let rungs = |world: &World| world.plan().ladder.map(|ladder| ladder.rungs().to_vec());
    let named = block(ComplianceMethod::Asynchronous, |_| ());
    assert_eq!(rungs(&named), Some(vec![Rung::Asynchronous, Rung::Early, Rung::Exact]));
    let warped = block(ComplianceMethod::Warped, |_| ());
    assert_eq!(rungs(&warped), Some(vec![Rung::Warped, Rung::Exact]));
    assert_eq!((warped.plan().refactor, warped.plan().has_factor_thread()), (Refactor::Once, false));
    assert_eq!(rungs(&block(ComplianceMethod::Exact, |_| ())), None);
    // The precomputed inverse is for the named method alone: beside a factor thread it costs more than it spares.
    assert_eq!(rungs(&block(ComplianceMethod::Automatic, |_| ())), rungs(&named));
    assert!(block(ComplianceMethod::Automatic, |_| ()).plan().precomputed.is_none());
    let tight = block(ComplianceMethod::Warped, |scene| scene.bodies[0].surface_memory = 0.01);
    assert_eq!(rungs(&tight), Some(vec![Rung::Warped, Rung::Exact]));
    let text = tight.plan().to_string();
    assert!(text.contains("`surface_memory`") && text.contains("MB"), "it says why and what to do: {text}");
    let wide = warped.plan().precomputed.unwrap();
    assert!(wide.fits() && wide.bytes == wide.nodes * (wide.nodes + 1) / 2 * 36, "{wide:?}");

    // The same press on warped alone: exact steps where it misses.
    let all = steps(&warped, depth);
    assert!(all.iter().any(|r| rung(r) == Rung::Exact) && rung(&all[LENGTH as usize - 1]) == Rung::Warped);
    assert!(all.iter().all(|r| matches!(rung(r), Rung::Warped | Rung::Exact)));
}

#[test]
fn a_run_on_a_ladder_repeats_to_the_bit_on_any_number_of_threads_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("ladder.mcap");
    let world = block(ComplianceMethod::Automatic, |scene| scene.bodies[0].accuracy = Some(0.001));
    let run = |threads, trace| {
        let (length, threads) = (Length::Seconds(1.2), Some(threads));
        let (outcome, recorder) =
            record(&world, &RunOptions { length, lockstep: true, threads, trace, ..RunOptions::default() });
        (outcome.state.q, recorder.forces(), outcome.summary)
    };
    let one = run(1, Some(trace.clone()));
    let other = run(3, None);
    assert!(one.0 == other.0 && one.1 == other.1);
    println!("{:?}, {} climbs", one.2.rungs, one.2.climbs);
    assert!(one.2.rungs.len() >= 2 && one.2.climbs > 0, "{:?}", one.2.rungs);
    assert!(replay(&trace).unwrap().is_identical());
    let trace = palpate::trace::Trace::load(&trace).unwrap();
    let highest = trace.steps.iter().map(|s| s.rung).max().unwrap();
    let highest_in_summary = one.2.rungs.last().unwrap().0;
    assert_eq!(Rung::ALL[highest as usize].name(), highest_in_summary);
    assert!(trace.steps.iter().any(|s| s.lower_error > 0.0));
    // What the accuracy is held against, in the steps in which it was known and in no others.
    let errors: Vec<f64> = trace.steps.iter().filter_map(|s| s.force_error).collect();
    assert!(errors.len() as u64 == one.2.force_errors && errors.len() < trace.steps.len(), "{}", errors.len());
    let worst = errors.iter().copied().fold(0.0, f64::max);
    assert!(worst > 0.0 && (worst - one.2.force_error.max).abs() <= 2e-3 * worst, "{worst}: kept to three digits");
}

/// In virtual time with nothing but defaults the factor thread is free for most of a period, as it is in real time: on
/// the rung of early refreshes the factor is made anew before its turn.
#[test]
fn a_run_in_lockstep_at_defaults_refreshes_early() {
    let mut early = 0;
    for accuracy in [0.0005, 0.001, 0.002, 0.005] {
        let world = block(ComplianceMethod::Asynchronous, |scene| scene.bodies[0].accuracy = Some(accuracy));
        // A tick is more than a block of this size takes.
        let rates = world.description().rates;
        assert_eq!(world.factor_delay(), 1.0 / rates.tick, "{} s predicted", world.plan().factorization);
        let length = Length::Seconds(1.2);
        let options = RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() };
        let summary = record(&world, &options).0.summary;
        println!("{accuracy}: {} factors, {} early, {:?}", summary.factors, summary.factors_early, summary.rungs);
        // A factor comes into use a step after its matrix, and gives way a step after the next one's.
        assert!(summary.factor_age.max <= 1.0 / rates.factor + 2.0 * world.dt(), "{}", summary.factor_age.max);
        early += summary.factors_early;
    }
    assert!(early > 0);
}
