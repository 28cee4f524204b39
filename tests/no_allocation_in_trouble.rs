//! Do steps of tissue in trouble allocate nothing: begun inside out, or twisted until it slips through itself?

mod allocations;
mod block;
mod ordeals;

use nalgebra::Isometry3;
use palpate::fem::element::ElementKind;
use palpate::simulation::Simulation;

use allocations::{on_a_worker, violations};
use block::pose;

#[test]
fn the_guard_of_a_body_that_begins_inside_out_allocates_nothing() {
    for element in [ElementKind::Linear, ElementKind::Quadratic, ElementKind::Averaged] {
        let world = block::world(|scene| {
            scene.bodies[0].element = element;
            scene.bodies[0].block.as_mut().unwrap().cells = [4, 4, 2];
        });
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap();
            let mut acted = 0;
            let mut recover = || {
                for &node in world.model().node_of_free() {
                    simulation.state_mut().fem.q[node as usize].z = block::SKIN - world.mesh().nodes[node as usize].z;
                }
                (0..10).for_each(|k| {
                    let report = simulation.step(&pose(k));
                    acted += report.cuts + report.repeated;
                });
            };
            recover();
            assert_eq!(violations(&mut recover), 0, "{element:?}");
            assert!(acted > 0, "{element:?}: the guard had nothing to do");
        });
    }
}

/// Twisted by a full turn, the block slips through itself and is led home.
#[test]
fn finding_a_tangle_and_leading_it_home_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    ordeals::mesh(folder.path(), 2);
    let world = ordeals::world(folder.path(), "mooney_rivlin", ElementKind::Averaged, 1.0, true).unwrap();
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        let rest = &world.mesh().nodes;
        let (mut tangled, mut led) = (0, 0);
        let seen = violations(|| {
            for k in 1..=120 {
                let q = &mut simulation.state_mut().fem.q;
                for (q, x) in q.iter_mut().zip(rest).filter(|(_, x)| x.z > ordeals::HEIGHT - 1e-9) {
                    *q = ordeals::Ordeal::Twisted.driven(*x, ordeals::share(k));
                }
                let report = simulation.step(&Isometry3::translation(1.0, 1.0, 1.0));
                tangled += u32::from(report.tangle.is_some());
                led += u32::from(report.led);
            }
        });
        assert_eq!(seen, 0);
        assert!(tangled > 0 && led > 0, "{tangled} steps tangled, {led} led");
    });
}
