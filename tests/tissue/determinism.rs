//! Does a lockstep run give the same bits whenever and wherever it runs?

#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

use crate::block;
use std::path::Path;

use nalgebra::Vector3;
use palpate::fem::material::{Material, PronyTerm};
use palpate::fem::model::FemState;
use palpate::replay::{ReplayError, replay};
use palpate::run::{Length, RunOptions, RunOutcome};
use palpate::scene::{IntegratorKind, SceneDescription};
use palpate::simulation::Simulation;
use palpate::trace::{Attachment, Trace, TraceConfig, TraceWriter};

use crate::block::Recorder;

fn lockstep(threads: Option<usize>, trace: Option<&Path>) -> RunOptions {
    RunOptions {
        length: Length::Seconds(1.2),
        lockstep: true,
        threads,
        trace: trace.map(Into::into),
        ..RunOptions::default()
    }
}

fn bits(v: &Vector3<f64>) -> [u64; 3] {
    [v.x.to_bits(), v.y.to_bits(), v.z.to_bits()]
}

/// Everything that must not differ.
#[derive(PartialEq)]
struct Fingerprint {
    forces: Vec<[u64; 3]>,
    torques: Vec<[u64; 3]>,
    positions: Vec<[u64; 3]>,
    velocities: Vec<[u64; 3]>,
}

impl Fingerprint {
    fn new((outcome, recorder): &(RunOutcome, Recorder)) -> Self {
        let FemState { q, v, .. } = &outcome.state;
        Self {
            forces: recorder.ticks.iter().map(|t| bits(&t.record.wrench.force)).collect(),
            torques: recorder.ticks.iter().map(|t| bits(&t.record.wrench.torque)).collect(),
            positions: q.iter().map(bits).collect(),
            velocities: v.iter().map(bits).collect(),
        }
    }

    fn assert_same(&self, other: &Self, what: &str) {
        let first = self.forces.iter().zip(&other.forces).position(|(a, b)| a != b);
        assert!(first.is_none() && self.forces.len() == other.forces.len(), "{what}: forces differ at tick {first:?}");
        assert!(self == other, "{what}: torques, positions or velocities differ");
    }
}

fn any_change(_: &mut SceneDescription) {}

fn exact(scene: &mut SceneDescription) {
    scene.bodies[0].compliance = palpate::constraints::compliance::ComplianceMethod::Exact;
}

#[test]
fn one_two_and_four_threads_give_the_same_bits_and_the_same_file_twice() {
    let folder = tempfile::tempdir().unwrap();
    for (name, change) in [("async", any_change as fn(&mut SceneDescription)), ("exact", exact)] {
        let world = block::world(change);
        let mut first: Option<(Fingerprint, Vec<u8>)> = None;
        for (threads, repeat) in [(1, 0), (2, 0), (4, 0), (1, 1), (2, 1), (4, 1)] {
            let path = folder.path().join(format!("{name}-{threads}-{repeat}.mcap"));
            let result = block::record(&world, &lockstep(Some(threads), Some(&path)));
            assert!(result.0.summary.largest_force > 0.3, "the run must touch: {:?}", result.0.summary.largest_force);
            assert_eq!(result.0.summary.trace.as_ref().unwrap().dropped, 0);
            let (print, file) = (Fingerprint::new(&result), std::fs::read(&path).unwrap());
            let what = format!("{name}, {threads} threads, run {repeat}");
            match &first {
                None => first = Some((print, file)),
                Some((expected, bytes)) => {
                    expected.assert_same(&print, &what);
                    assert!(bytes == &file, "{what}: the traces differ in {} or more bytes", differing(bytes, &file));
                }
            }
        }
    }
}

fn differing(a: &[u8], b: &[u8]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count() + a.len().abs_diff(b.len())
}

#[test]
fn a_trace_changes_no_bit_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let world = block::world(any_change);
    let silent = Fingerprint::new(&block::record(&world, &lockstep(Some(1), None)));
    let traced = block::record(&world, &lockstep(Some(1), Some(&folder.path().join("t.mcap"))));
    silent.assert_same(&Fingerprint::new(&traced), "with a trace");
}

/// Writes a trace again, as far as a replay reads it, with a change of its ticks and metadata.
fn rewrite(from: &Path, to: &Path, change: impl FnOnce(&mut Trace)) {
    let mut trace = Trace::load(from).unwrap();
    change(&mut trace);
    let mut engine = trace.metadata["engine"].clone();
    engine.remove("start_unix_ns");
    let attachments: Vec<Attachment> = trace.attachments.clone();
    let config = TraceConfig { engine, attachments, ..TraceConfig::default() };
    let mut writer = TraceWriter::create(to, &config).unwrap();
    trace.ticks.iter().for_each(|tick| writer.write_tick(tick).unwrap());
    let (_, _, error) = writer.finish();
    assert!(error.is_none());
}

#[test]
fn a_replay_finds_the_same_forces_and_notices_one_changed_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (folder.path().join("run.mcap"), folder.path().join("copy.mcap"));
    let world = block::world(any_change);
    let (outcome, _) = block::record(&world, &lockstep(Some(2), Some(&path)));
    let report = replay(&path).unwrap();
    assert!(report.is_identical(), "{report:?}");
    assert_eq!(report.ticks as u64, outcome.summary.ticks);

    rewrite(&path, &copy, |_| {});
    assert!(replay(&copy).unwrap().is_identical(), "the copy itself changes nothing");

    // The last bit of one component of one force.
    rewrite(&path, &copy, |trace| {
        let force = &mut trace.ticks[777].force[2];
        assert!(*force != 0.0, "the ball touches at tick 777");
        *force = f64::from_bits(force.to_bits() ^ 1);
    });
    let report = replay(&copy).unwrap();
    assert!(!report.is_identical());
    assert_eq!(report.first_difference, Some(777));
    assert!(report.largest_difference > 0.0 && report.largest_difference < 1e-14, "{report:?}");

    rewrite(&path, &copy, |trace| trace.ticks.truncate(trace.ticks.len() - 1));
    assert_eq!(replay(&copy).unwrap().unmatched, 1, "a tick is missing");

    rewrite(&path, &copy, |trace| {
        trace.metadata.get_mut("engine").unwrap().insert("mode".into(), "real time".into());
    });
    assert!(matches!(replay(&copy), Err(ReplayError::RealTime { .. })));
    rewrite(&path, &copy, |trace| trace.attachments.clear());
    assert!(matches!(replay(&copy), Err(ReplayError::NoScene { .. })));
}

#[test]
fn a_number_of_steps_replays_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("steps.mcap");
    let world = block::world(any_change);
    let options = RunOptions { length: Length::Steps(20), ..lockstep(Some(1), Some(&path)) };
    let (outcome, _) = block::record(&world, &options);
    assert_eq!(outcome.summary.steps, 20);
    assert!(replay(&path).unwrap().is_identical());
}

#[test]
fn a_viscous_body_replays_with_its_memory_and_every_integrator() {
    let folder = tempfile::tempdir().unwrap();
    for integrator in [IntegratorKind::BackwardEuler, IntegratorKind::Newton, IntegratorKind::Explicit] {
        let path = folder.path().join(format!("{integrator:?}.mcap"));
        let world = block::world(|d| {
            let body = &mut d.bodies[0];
            body.block.as_mut().unwrap().cells = [4, 4, 2];
            (body.integrator, body.rayleigh_mass, body.rayleigh_stiffness) = (integrator, 8.0, 0.0);
            body.material.viscosity = vec![PronyTerm { modulus: 0.3, time: 0.2 }];
        });
        let options = RunOptions { length: Length::Seconds(0.7), ..lockstep(Some(1), Some(&path)) };
        let (outcome, _) = block::record(&world, &options);
        assert!(outcome.summary.largest_force > 0.1, "{integrator:?}: {}", outcome.summary.largest_force);
        assert!(outcome.state.memory.iter().any(|s| s.amax() > 1.0), "{integrator:?}: the tissue is under stress");
        assert!(replay(&path).unwrap().is_identical(), "{integrator:?}");
    }
}

/// Exact compliance and solvers run to the end of their digits, so that what is left to the machine is rounding.
fn settled(scene: &mut SceneDescription) {
    exact(scene);
    scene.bodies[0].tolerance = 1e-13;
    (scene.solver.tolerance, scene.solver.max_sweeps) = (1e-12, 100_000);
}

/// Force of the tissue on the ball (N) at steps of [`block::pose`]: touching, pressing, sliding, parting.
const GOLDEN: [(u64, [f64; 3]); 6] = [
    (6, [-0.020823803994999397, -0.02083934249359695, 0.2775826623416983]),
    (12, [-0.12589041882867147, -0.11467195628491907, 1.509603737181264]),
    (20, [-0.33461679747456147, -0.28196680092148807, 3.6133408009888393]),
    (30, [-0.6615324911724357, -0.2868351240930055, 3.4415151876625463]),
    (44, [-1.0480135386726877, -0.3778763573341342, 3.5554233036426397]),
    (50, [-0.5085001746341152, -0.07250950726803268, 1.1212810285224788]),
];

fn forces(change: impl FnOnce(&mut SceneDescription)) -> Vec<Vector3<f64>> {
    let world = block::world(change);
    let mut simulation = Simulation::new(&world).unwrap();
    (0..block::STEPS).map(|k| simulation.step(&block::pose(k)).force).collect()
}

/// Bits cannot be golden: functions like `cbrt` come from the platform's libm, and the factorisation takes the widest vector
/// unit that the processor has, so sums differ in their last bits from one machine to the next. Instead the run is made
/// to depend on its solvers by less than 1e-12, and held to a table within 1e-9 of its largest force. That a
/// difference of rounding grows by less than that is measured here, by another of the same size: the last bits of
/// Young's modulus.
#[test]
fn forces_are_those_of_the_table_on_every_machine() {
    let computed = forces(settled);
    let largest = computed.iter().map(Vector3::norm).fold(0.0, f64::max);
    let nudged = forces(|scene| {
        settled(scene);
        let Material::NeoHookean(law) = &mut scene.bodies[0].material.law else { panic!("the block is neo-Hookean") };
        law.young = f64::from_bits(law.young.to_bits() + 8);
    });
    let growth = computed.iter().zip(&nudged).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / largest;
    println!("a relative change of 1e-15 in Young's modulus moves forces by {growth:.1e} of {largest:.2} N");
    assert!(growth > 0.0 && growth < 1e-10, "rounding grows to {growth:e}: the table means nothing");
    for (step, _) in GOLDEN {
        let force = computed[step as usize];
        println!("    ({step}, [{:?}, {:?}, {:?}]),", force.x, force.y, force.z);
    }
    for (step, expected) in GOLDEN {
        let difference = (computed[step as usize] - Vector3::from(expected)).norm();
        assert!(difference <= 1e-9 * largest, "step {step}: {difference:e} N from the table");
    }
}
