//! A block on an incline: it sticks below `atan(friction)` and slides above with `a = g (sin θ - friction cos θ)`.
//!
//! The floor is level and gravity leans. The block is a free body: nothing holds it but contact with the floor, a tool
//! at rest. Momentum is told from the positions and velocities of its nodes, not from reports.

#![allow(clippy::print_stdout)] // tables of what was measured

use crate::slope;
use crate::slope::{DT, G, leaning};
use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::solver::report::SolveStatus;
use palpate::step::{StepReport, StepStatus};

const FRICTION: f64 = 0.5;

/// Steps in which the block's elastic motion dies out, and steps that are measured.
const SETTLE: usize = 40;
const MEASURE: usize = 20;

/// The block with friction.
fn world(gravity: Vector3<f64>) -> World {
    slope::world(gravity, &format!("friction = {FRICTION}"))
}

/// Momentum of the body (kg m/s).
fn momentum(sim: &Simulation<'_>) -> Vector3<f64> {
    sim.state().fem.v.iter().zip(sim.world().model().mass()).map(|(v, m)| v * *m).sum()
}

fn mass(world: &World) -> f64 {
    world.model().mass().iter().sum()
}

/// One step on the resting floor; the laws that hold in every step are asserted here.
fn step(sim: &mut Simulation<'_>) -> StepReport {
    let before = momentum(sim);
    let report = sim.step(&Isometry3::identity());
    assert_eq!(report.status, StepStatus::Advanced);
    assert!(report.detection.contacts == 0 || report.solve.status == SolveStatus::Solved, "{report:?}");

    // Third law: the forces on the nodes and the force on the floor cancel, to the rounding of sums of some 50 terms.
    let rows = sim.workspace().rows();
    let mut nodal = vec![0.0; 3 * sim.world().model().free_nodes()];
    rows.tissue.add_transposed(sim.forces(), &mut nodal);
    let on_block: Vector3<f64> = nodal.chunks_exact(3).map(|f| Vector3::new(f[0], f[1], f[2])).sum();
    let size: f64 = sim.forces().iter().map(|l| l.abs()).sum();
    assert!((on_block + report.force).norm() <= 1e-13 * size, "{on_block:?} {:?}", report.force);

    // Momentum: m dv/dt = m g + contact, to the residual of the linear solves. Inner forces add nothing.
    let m = mass(sim.world());
    let gravity = Vector3::from(sim.world().description().gravity);
    let balance = (momentum(sim) - before) / DT - gravity * m + report.force;
    assert!(balance.norm() < 1e-8 * m * G, "{balance:?} N unaccounted for");
    report
}

/// Acceleration (m/s²) after settling, and the last report.
fn slide(world: &World) -> (Vector3<f64>, StepReport) {
    let mut sim = Simulation::new(world).unwrap();
    (0..SETTLE).for_each(|_| _ = step(&mut sim));
    let from = momentum(&sim);
    let last = (0..MEASURE).map(|_| step(&mut sim)).last().unwrap();
    ((momentum(&sim) - from) / (mass(world) * MEASURE as f64 * DT), last)
}

/// Backward Euler gives velocities under a constant force exactly (positions to first order), so the tolerance of 1e-5
/// is only for elastic motion that has not quite died out when the measurement begins.
#[test]
fn block_slides_with_the_acceleration_of_coulomb_above_the_angle_of_friction() {
    for angle in [0.5f64, 0.6, 0.8] {
        let world = world(leaning(angle, 0.3));
        let (a, last) = slide(&world);
        let expected = G * (angle.sin() - FRICTION * angle.cos());
        let down = Vector3::new(0.3f64.cos(), 0.3f64.sin(), 0.0);
        let (normal, friction) = (last.force.z, last.force.xy().norm());
        println!(
            "{angle} rad: a = {:.6} of {expected:.6} m/s², friction / normal force {:.8}, {} contacts, {} sweeps",
            a.dot(&down),
            friction / normal,
            last.active,
            last.solve.iterations
        );
        assert!((a - down * expected).norm() < 1e-5 * expected, "{a:?}");
        assert!((friction / normal.abs() - FRICTION).abs() < 1e-6, "the total force is on the cone");
    }
}

/// Below the angle nothing creeps: a hundred steps move no node by more than the solver's tolerance.
#[test]
fn block_sticks_below_the_angle_of_friction() {
    for (angle, heading) in [(0.3f64, 0.0), (0.46, 0.4), (0.46, 2.0)] {
        assert!(angle.tan() < FRICTION);
        let world = world(leaning(angle, heading));
        let mut sim = Simulation::new(&world).unwrap();
        (0..150).for_each(|_| _ = step(&mut sim));
        let before = sim.positions().to_vec();
        let mut last = step(&mut sim);
        (1..100).for_each(|_| last = step(&mut sim));
        let moved = sim.positions().iter().zip(&before).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max);
        let ratio = last.force.xy().norm() / last.force.z.abs();
        println!("{angle} rad towards {heading}: moved by {moved:.1e} m in 100 steps, friction / normal {ratio:.6}");
        assert!(moved < 1e-11, "{moved}");
        // At rest the floor carries the weight: the ratio of forces is the slope.
        assert!((ratio - angle.tan()).abs() < 1e-5, "{ratio}");
    }
}

/// Neither the tangents of the contact frames nor the grain of the mesh give friction a preferred direction.
#[test]
fn friction_is_the_same_in_16_headings() {
    let angle = 0.6f64;
    let expected = G * (angle.sin() - FRICTION * angle.cos());
    for k in 0..16 {
        let heading = std::f64::consts::TAU * f64::from(k) / 16.0 + 0.05;
        let (a, _) = slide(&world(leaning(angle, heading)));
        let down = Vector3::new(heading.cos(), heading.sin(), 0.0);
        let error = (a - down * expected).norm() / expected;
        println!("heading {heading:.3}: error {error:.2e}");
        // The requirement is 1e-3; what is left of elastic motion is four orders below.
        assert!(error < 1e-5, "{error}");
    }
}

/// A free body far from the floor keeps its linear momentum through any deformation, to the residual of the solves.
#[test]
fn free_body_keeps_its_momentum() {
    let world = world(Vector3::zeros());
    let mut sim = Simulation::new(&world).unwrap();
    let fem = &mut sim.state_mut().fem;
    for (q, v) in fem.q.iter_mut().zip(&mut fem.v) {
        *v = Vector3::new(0.3, -0.2, 0.5)
            + Vector3::new(5.0, 3.0, -4.0).cross(q)
            + q.component_mul(&Vector3::new(3.0, -4.0, 2.0));
        q.z += 0.5;
    }
    let (before, shape) = (momentum(&sim), sim.positions().to_vec());
    for _ in 0..100 {
        step(&mut sim);
    }
    let drift = (momentum(&sim) - before).norm() / before.norm();
    let (moved, turned) = (sim.positions()[0] - shape[0], sim.positions()[5] - shape[5]);
    println!("momentum drifts by {drift:.1e} in 100 steps");
    assert!((moved - turned).norm() > 1e-3, "the body must do more than fly straight");
    assert!(drift < 1e-10, "{drift}");
}
