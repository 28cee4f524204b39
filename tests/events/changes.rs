//! A clamp that opens or closes, and elements that are cut away, while the body runs.

#![allow(clippy::print_stdout)] // tables of what was measured

use crate::block;
use crate::block::{distance, world};
use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::factor::{Factor, FactorStatus, ReachStatus, ReachWorkspace, SolveWorkspace};
use palpate::fem::sparse::FIXED;
use palpate::scene::{EventDescription, NodeSelection, SceneDescription};
use palpate::simulation::Simulation;
use palpate::step::{FactorFit, StepStatus};
use palpate::world::World;

const FAR: Isometry3<f64> = Isometry3::<f64> {
    rotation: nalgebra::Unit::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)),
    translation: nalgebra::Translation3::new(0.0, 0.0, 1.0),
};

fn event(time: f64) -> EventDescription {
    EventDescription { time, release: None, hold: None, remove: None }
}

fn corner() -> NodeSelection {
    NodeSelection::Box { min: [0.0; 3], max: [0.03, 0.03, 0.001] }
}

fn slit() -> NodeSelection {
    NodeSelection::Box { min: [0.026, 0.026, 0.02], max: [0.054, 0.04, 0.05] }
}

fn top() -> NodeSelection {
    NodeSelection::Box { min: [0.06, 0.06, 0.039], max: [0.08, 0.08, 0.041] }
}

/// One event of each kind, and all in one.
fn events() -> [(&'static str, EventDescription); 4] {
    let time = 10.5 / 30.0;
    [
        ("release", EventDescription { release: Some(corner()), ..event(time) }),
        ("hold", EventDescription { hold: Some(top()), ..event(time) }),
        ("remove", EventDescription { remove: Some(slit()), ..event(time) }),
        ("all", EventDescription { release: Some(corner()), hold: Some(top()), remove: Some(slit()), ..event(time) }),
    ]
}

fn with(method: ComplianceMethod, tolerance: f64, event: &EventDescription) -> World {
    world(|scene: &mut SceneDescription| {
        (scene.bodies[0].compliance, scene.bodies[0].tolerance) = (method, tolerance);
        scene.gravity = [0.0, 0.0, -9.81];
        scene.events = vec![event.clone()];
    })
}

/// Right after each kind of event the factor of the body before is that of a factorisation of the new one: solutions,
/// compliance and correction. The condition number of these matrices is about 1e4, so that rounding leaves eleven digits.
#[test]
fn right_after_an_event_the_old_factor_is_one_of_the_new_body() {
    for (name, event) in events() {
        for method in [ComplianceMethod::Asynchronous, ComplianceMethod::Warped] {
            let world = with(method, 1e-6, &event);
            let mut sim = Simulation::new(&world).unwrap().refresh_every(4);
            let mut report = sim.step(&block::pose(0));
            for k in 1..=11 {
                report = sim.step(&block::pose(k + 9));
                assert_eq!(report.change.changed, k == 11, "{name}");
            }
            assert_eq!((report.change.phase, report.change.factor), (1, FactorFit::Updated), "{name}");
            assert_eq!(report.status, StepStatus::Advanced);
            println!(
                "{name}, {method:?}: {} nodes touched, {} iterations, {} contacts",
                report.change.touched, report.free_motion.iterations, report.active
            );
            assert!(report.free_motion.iterations <= 15, "{name}: {}", report.free_motion.iterations);

            let (model, factor) = (sim.world().model(), sim.factor());
            let at = palpate::fem::model::FemState { q: factor.q.clone(), ..model.rest_state() };
            let mut fem = FemWorkspace::new(model);
            let _ = assemble(model, &at, world.dt(), &[], &mut fem);
            let mut fresh = Factor::new(world.symbolic().clone());
            assert_eq!(fresh.refactor(&fem.system).status, FactorStatus::Ok);
            let mut ws = SolveWorkspace::new(world.symbolic());
            let (mut x, mut y) = (fem.rhs.clone(), fem.rhs.clone());
            assert!(factor.factor.solve(&mut x, &mut ws).is_ok() && fresh.solve(&mut y, &mut ws).is_ok());
            agree(&x, &y, "solution");

            let rows = &sim.workspace().rows().tissue;
            assert!(rows.len() >= 9, "{name}: the ball must touch");
            let mut reach = ReachWorkspace::new(world.symbolic(), rows.len());
            let m = rows.len();
            let (mut w, mut w_fresh) = (nalgebra::DMatrix::zeros(m, m), nalgebra::DMatrix::zeros(m, m));
            let lambda = vec![1.0; m];
            let (mut dv, mut dv_fresh) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            assert_eq!(factor.factor.compliance_into(rows, 1.0, &mut w, &mut reach).status, ReachStatus::Ok);
            assert!(factor.factor.correct(&lambda, &mut dv, &mut reach).is_ok());
            assert_eq!(fresh.compliance_into(rows, 1.0, &mut w_fresh, &mut reach).status, ReachStatus::Ok);
            assert!(fresh.correct(&lambda, &mut dv_fresh, &mut reach).is_ok());
            agree(w.as_slice(), w_fresh.as_slice(), "compliance");
            agree(&dv, &dv_fresh, "correction");
        }
    }
}

fn agree(x: &[f64], y: &[f64], what: &str) {
    let largest = y.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    let error = x.iter().zip(y).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
    assert!(largest > 0.0 && error < 1e-9 * largest, "{what}: {error:e} of {largest:e}");
}

/// To the tolerance of the solves the motion is that of steps which factor their own matrix, whatever the factor is.
#[test]
fn the_free_motion_after_an_event_is_that_of_exact_steps() {
    for (name, event) in events() {
        let exact = with(ComplianceMethod::Exact, 1e-9, &event);
        let mut exact = Simulation::new(&exact).unwrap();
        let old = with(ComplianceMethod::Asynchronous, 1e-9, &event);
        let mut old = Simulation::new(&old).unwrap().refresh_every(0);
        let mut most = 0;
        for _ in 0..25 {
            let (a, b) = (exact.step(&FAR), old.step(&FAR));
            assert_eq!((a.status, b.status), (StepStatus::Advanced, StepStatus::Advanced));
            assert_eq!(a.change.factor, FactorFit::Own);
            most = most.max(b.free_motion.iterations);
            assert_eq!(b.free_motion.status, palpate::fem::pcg::PcgStatus::Converged, "{name}");
        }
        let moved = distance(old.positions(), old.state().rest());
        let apart = distance(exact.positions(), old.positions());
        println!("{name}: moved {moved:.2e} m, apart {apart:.1e} m, at most {most} iterations to 1e-9");
        assert!(apart < 1e-7 * 0.04, "{name}: {apart:e}");
        assert!(name == "hold" || moved > 1e-5, "{name}: {moved:e}");
    }
}

/// A body that is let go of, and then cut in two in flight: nothing but gravity changes the momentum of what is left, in the
/// steps of the events neither. The tolerance is that of the solves.
#[test]
fn momentum_is_conserved_by_a_cut_in_flight() {
    let release = EventDescription { release: Some(NodeSelection::NodeSet("z_min".into())), ..event(0.1) };
    let cut = EventDescription {
        remove: Some(NodeSelection::Box { min: [0.04, -1.0, -1.0], max: [0.053, 1.0, 1.0] }),
        ..event(0.4)
    };
    let world = world(|scene| {
        scene.bodies[0].tolerance = 1e-12;
        scene.bodies[0].rayleigh_mass = 0.0;
        scene.gravity = [0.0, 0.0, -9.81];
        scene.events = vec![cut.clone(), release.clone()];
    });
    assert_eq!(world.changes()[0].text(), "49 nodes released");
    let mut sim = Simulation::new(&world).unwrap();
    let (mut falling, mut changed) = (0, 0);
    for k in 0..18 {
        let before = sim.state().fem.v.clone();
        let report = sim.step(&FAR);
        assert_eq!(report.status, StepStatus::Advanced);
        if report.change.phase == 0 {
            continue;
        }
        let (model, v) = (sim.world().model(), &sim.state().fem.v);
        // Nodes that lost all their elements stay behind.
        let moving: Vec<usize> = (0..model.nodes()).filter(|&i| model.free_of_node()[i] != FIXED).collect();
        let mass: f64 = moving.iter().map(|&i| model.mass()[i]).sum();
        let gained: Vector3<f64> = moving.iter().map(|&i| (v[i] - before[i]) * model.mass()[i]).sum();
        let off = gained - Vector3::new(0.0, 0.0, -9.81 * mass * world.dt());
        assert!(off.norm() < 1e-9 * mass, "step {k}, {:?}: {off:?} kg m/s", report.change);
        falling += 1;
        changed += usize::from(report.change.changed);
    }
    assert_eq!((falling, changed), (15, 2));
}

/// A layer of elements across the block.
fn across() -> NodeSelection {
    NodeSelection::Box { min: [0.0266, -1.0, -1.0], max: [0.0401, 1.0, 1.0] }
}

#[test]
fn a_strip_that_is_cut_through_falls_apart_and_the_loose_piece_falls_freely() {
    let world = world(|scene| {
        scene.bodies[0].fixed = vec![NodeSelection::NodeSet("x_min".into())];
        (scene.bodies[0].rayleigh_mass, scene.bodies[0].tolerance) = (0.0, 1e-12);
        (scene.bodies[0].settle, scene.gravity) = (false, [0.0, 0.0, -9.81]);
        scene.events = vec![EventDescription { remove: Some(across()), ..event(0.2) }];
    });
    let mut sim = Simulation::new(&world).unwrap();
    let mut speeds = Vec::new();
    for _ in 0..20 {
        let report = sim.step(&FAR);
        assert_eq!(report.status, StepStatus::Advanced);
        let (model, state) = (sim.world().model(), &sim.state().fem);
        if report.change.phase == 1 {
            let loose: Vec<usize> = (0..model.nodes()).filter(|&i| model.q_rest()[i].x > 0.0399).collect();
            let mass: f64 = loose.iter().map(|&i| model.mass()[i]).sum();
            speeds.push(loose.iter().map(|&i| state.v[i] * model.mass()[i]).sum::<Vector3<f64>>() / mass);
        }
    }
    assert!(speeds.len() > 10);
    for pair in speeds.windows(2) {
        let a = (pair[1] - pair[0]) / world.dt();
        // To the tolerance of the solves.
        assert!((a - Vector3::new(0.0, 0.0, -9.81)).norm() < 1e-7, "{a:?}");
    }
    let held =
        world.mesh().node_sets["x_min"].iter().map(|&n| sim.positions()[n as usize] - world.mesh().nodes[n as usize]);
    assert_eq!(held.map(|d| d.norm()).fold(0.0, f64::max), 0.0);
}
