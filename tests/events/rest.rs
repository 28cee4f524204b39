//! Where a body comes to rest after an event, and what a tool feels of it: as if it had always been so.

#![allow(clippy::print_stdout)] // measured numbers

use crate::block;
use crate::block::{distance, world};
use nalgebra::{Isometry3, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::fem::mesh::TetMesh;
use palpate::scene::{EventDescription, NodeSelection, SceneDescription};
use palpate::settle::at_rest;
use palpate::simulation::Simulation;
use palpate::step::StepStatus;
use palpate::world::World;

/// Away from the body.
fn away() -> Isometry3<f64> {
    Isometry3::translation(0.0, 0.0, 1.0)
}

/// Gravity that bends, and damping that ends every motion within a second.
fn heavy(scene: &mut SceneDescription) {
    scene.gravity = [4.0, 0.0, -9.0];
    (scene.bodies[0].rayleigh_mass, scene.bodies[0].tolerance) = (20.0, 1e-10);
}

fn event(time: f64) -> EventDescription {
    EventDescription { time, release: None, hold: None, remove: None }
}

/// A pocket of 27 x 27 x 20 mm in the skin, wider than the ball.
fn pocket() -> NodeSelection {
    NodeSelection::Box { min: [0.0266, 0.0266, 0.0199], max: [0.0534, 0.0534, 0.05] }
}

/// The mesh of a world after its events as one of its own, and the nodes of the world that it has.
fn alone(world: &World) -> (TetMesh, Vec<usize>) {
    let mesh = world.mesh();
    let mut used = vec![false; mesh.nodes.len()];
    mesh.tetrahedra.iter().flatten().for_each(|&n| used[n as usize] = true);
    let kept: Vec<usize> = (0..used.len()).filter(|&n| used[n]).collect();
    let number = |n: u32| kept.binary_search(&(n as usize)).unwrap() as u32;
    let mut own = TetMesh {
        nodes: kept.iter().map(|&n| mesh.nodes[n]).collect(),
        tetrahedra: mesh.tetrahedra.iter().map(|t| t.map(number)).collect(),
        ..mesh.clone()
    };
    own.node_sets.values_mut().for_each(|set| {
        set.retain(|&n| used[n as usize]);
        set.iter_mut().for_each(|n| *n = number(*n));
    });
    (own, kept)
}

/// Both are in equilibrium to nine digits of their loads; what is left of the motion after 5 s of such damping is less.
const SAME_PLACE: f64 = 1e-7;

#[test]
fn a_block_whose_clamp_is_opened_rests_where_one_rests_that_was_never_clamped() {
    let clamp = NodeSelection::Box { min: [0.079, -1.0, 0.005], max: [1.0, 1.0, 1.0] };
    let clamped = world(|scene| {
        heavy(scene);
        scene.bodies[0].fixed.push(clamp.clone());
        scene.events = vec![EventDescription { release: Some(clamp.clone()), ..event(0.2) }];
    });
    let (free, _) = at_rest(&world(heavy)).unwrap();
    let mut sim = Simulation::new(&clamped).unwrap();
    assert!(sim.settled().unwrap().is_converged());
    let begin = sim.positions().to_vec();
    let mut last = sim.step(&away());
    for k in 1..150 {
        last = sim.step(&away());
        assert_eq!(last.status, StepStatus::Advanced);
        // At rest until the event, at 0.2 s.
        let moved = distance(sim.positions(), &begin);
        assert!(k >= 6 || moved < SAME_PLACE, "step {k}: {moved:e} m");
    }
    let (swung, off) = (distance(sim.positions(), &begin), distance(sim.positions(), &free.q));
    println!("swung by {swung:.2e} m, {off:.1e} m off the rest of the free one; phase {}", last.change.phase);
    assert!(swung > 1e-3 && off < SAME_PLACE, "{swung:e} {off:e}");
}

#[test]
fn a_cut_block_rests_where_one_rests_that_was_built_without_the_elements() {
    let cut = |scene: &mut SceneDescription| {
        heavy(scene);
        scene.events = vec![EventDescription { remove: Some(pocket()), ..event(0.2) }];
    };
    let cut = world(cut);
    let (mesh, kept) = alone(cut.phase(1));
    assert_eq!(cut.mesh().tetrahedra.len() - mesh.tetrahedra.len(), 2 * 2 * 2 * 6);
    let (rest, _) = at_rest(&block::scene(heavy).build_on(mesh).unwrap()).unwrap();
    let mut sim = Simulation::new(&cut).unwrap();
    let begin: Vec<_> = kept.iter().map(|&n| sim.positions()[n]).collect();
    (0..150).for_each(|_| assert_eq!(sim.step(&away()).status, StepStatus::Advanced));
    let end: Vec<_> = kept.iter().map(|&n| sim.positions()[n]).collect();
    let (moved, off) = (distance(&begin, &end), distance(&end, &rest.q));
    println!("moved by {moved:.2e} m, {off:.1e} m off the rest of the one without; {} nodes", kept.len());
    assert!(moved > 1e-4 && off < SAME_PLACE, "{moved:e} {off:e}");
}

/// A ball that goes into the pocket that a cut has opened meets its floor, with the force of a block that was built so.
#[test]
fn a_tool_that_goes_into_a_cut_feels_the_skin_that_the_cut_has_opened() {
    let change = |scene: &mut SceneDescription| {
        scene.bodies[0].compliance = ComplianceMethod::Exact;
        (scene.bodies[0].tolerance, scene.solver.tolerance) = (1e-12, 1e-10);
    };
    let cut = world(|scene| {
        change(scene);
        scene.events = vec![EventDescription { remove: Some(pocket()), ..event(0.1) }];
    });
    let (mesh, _) = alone(cut.phase(1));
    let own = block::scene(change).build_on(mesh).unwrap();
    let (mut cut, mut own) = (Simulation::new(&cut).unwrap(), Simulation::new(&own).unwrap());
    let (mut largest, mut off) = (0.0_f64, 0.0_f64);
    for k in 0..40 {
        // From 3 mm above the skin to 4 mm into the floor of the pocket.
        let z = 0.055 - 0.001 * f64::from((k - 4).clamp(0, 27));
        let tool = Isometry3::translation(0.04, 0.04, z);
        let (a, b) = (cut.step(&tool), own.step(&tool));
        assert_eq!((a.status, a.detection.tool_inside), (StepStatus::Advanced, false), "step {k}");
        largest = largest.max(a.force.norm());
        off = off.max((a.force - b.force).norm());
        assert!(a.force.norm() == 0.0 || z < 0.033, "the mouth of the pocket is wider than the ball");
    }
    println!("largest force {largest:.3} N, at most {off:.1e} N off the block that was built so");
    assert!(largest > 0.1, "{largest} N");
    // To the tolerances of the solves.
    assert!(off < 1e-6 * largest, "{off:e} N of {largest}");
}

/// Skin that is cut away under a pressing tool lets go of it at once.
#[test]
fn a_tool_whose_skin_is_cut_away_loses_its_force() {
    let world = world(|scene| scene.events = vec![EventDescription { remove: Some(pocket()), ..event(1.0) }]);
    let mut sim = Simulation::new(&world).unwrap();
    let press = |k: u32| Vector3::new(0.04, 0.04, 0.055 - 0.0004 * f64::from(k.min(25)));
    for k in 0..45 {
        let report = sim.step(&Isometry3::from(press(k)));
        assert_eq!((report.change.phase == 0, report.status), (k < 30, StepStatus::Advanced));
        assert!(!(25..30).contains(&k) || report.force.z > 0.1, "step {k}: {:?}", report.force);
        assert!(k < 30 || report.active == 0 && report.force.norm() == 0.0, "step {k}: {:?}", report.force);
    }
    // The same, when a program says so.
    let mut sim = Simulation::new(&world).unwrap();
    (0..26).for_each(|k| _ = sim.step(&Isometry3::from(press(k))));
    assert!(sim.pass_next_event() && !sim.pass_next_event());
    let report = sim.step(&Isometry3::from(press(25)));
    assert!(report.change.changed && report.force.norm() == 0.0, "{:?}", report.force);
}
