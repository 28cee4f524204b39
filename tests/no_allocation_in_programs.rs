//! Do steps whose contact is solved by interior-point programs allocate nothing while the contacts stay the same?

mod allocations;
mod block;

use palpate::collision::detection::ContactKind;
use palpate::scene::{ContactMethod, SceneDescription};
use palpate::simulation::Simulation;
use palpate::solver::solver::SolverKind;

use allocations::{on_a_worker, violations};
use block::pose;

/// Steps of a still press after it has come to rest, and the contacts with a force in all of them.
fn still(change: impl FnOnce(&mut SceneDescription)) -> (u32, usize) {
    let world = block::world(|scene| {
        // A program of the whole body is slow: 108 free nodes.
        scene.bodies[0].block.as_mut().unwrap().cells = [5, 5, 3];
        scene.contact.at = ContactKind::Nodes;
        change(scene);
    });
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        (0..12).for_each(|k| assert!(simulation.step(&pose(k)).solve.is_solved()));
        (0..15).for_each(|_| assert!(simulation.step(&pose(12)).solve.is_solved()));
        let mut active = 0;
        let seen = violations(|| {
            for _ in 0..10 {
                let report = simulation.step(&pose(12));
                active += if report.solve.is_solved() { report.active } else { 0 };
            }
        });
        (seen, active)
    })
}

#[test]
fn a_still_press_by_lagrange_multipliers_allocates_nothing() {
    let (seen, active) = still(|scene| scene.contact.method = ContactMethod::Lagrange);
    assert!(seen == 0 && active >= 10, "{seen} allocations, {active} contacts");
}

#[test]
fn a_still_press_by_cone_programs_allocates_nothing() {
    let (seen, active) = still(|scene| scene.solver.kind = SolverKind::ConicFriction);
    assert!(seen == 0 && active >= 10, "{seen} allocations, {active} contacts");
    let frictionless = |scene: &mut SceneDescription| {
        (scene.solver.kind, scene.contact.friction) = (SolverKind::ConicQp, 0.0);
        scene.contact.law = palpate::scene::ContactLawKind::Signorini;
    };
    let (seen, active) = still(frictionless);
    assert!(seen == 0 && active >= 10, "{seen} allocations, {active} contacts");
}
