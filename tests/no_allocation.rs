//! Do step and tick allocate nothing once they have run for a while?

#![allow(clippy::print_stdout)] // measured numbers, and why a test was skipped

mod allocations;
mod block;

use palpate::constraints::compliance::ComplianceMethod;
use palpate::fem::assembly::assemble;
use palpate::fem::element::ElementKind;
use palpate::fem::material::PronyTerm;
use palpate::haptics::exchange::latest;
use palpate::haptics::script::ScriptKey;
use palpate::refresh::{FactorSample, refresh};
use palpate::scene::{ContactMethod, IntegratorKind};
use palpate::simulation::Simulation;
use palpate::step::{StepInput, StepState, StepStatus, StepWorkspace, step};
use palpate::tick::Ticker;
use palpate::world::World;

use allocations::{on_a_worker, violations};
use block::{STEPS, pose};

fn worlds() -> impl Iterator<Item = (ComplianceMethod, f64, World)> {
    let methods = [ComplianceMethod::Asynchronous, ComplianceMethod::Exact, ComplianceMethod::Warped];
    let pairs = methods.into_iter().flat_map(|method| [(method, 0.3), (method, 0.0)]);
    pairs.map(|(method, friction)| {
        let change = |scene: &mut palpate::scene::SceneDescription| {
            scene.bodies[0].compliance = method;
            // Columns are compared, and steps that miss the accuracy are followed by exact ones.
            (scene.bodies[0].error_sampling, scene.bodies[0].accuracy) = (100.0, Some(0.02));
            scene.contact.friction = friction;
            // Elastic tissue without friction, viscous tissue with it.
            if friction > 0.0 {
                scene.bodies[0].material.viscosity = vec![PronyTerm { modulus: 0.3, time: 0.2 }];
            }
            // The same press over and over.
            let once = scene.hand.path.clone();
            let later = |time: f64| move |key: &ScriptKey| ScriptKey { time: time + key.time, ..*key };
            scene.hand.path = (0..11).flat_map(|n| once.iter().map(later(1.3 * f64::from(n)))).collect();
        };
        (method, friction, block::world(change))
    })
}

#[test]
fn the_guard_sees_an_allocation() {
    assert!(violations(|| drop(std::hint::black_box(vec![0_u8; 64]))) > 0);
}

/// An old factor, so that every step refines its forces; and a ladder whose rungs are all climbed.
#[test]
fn steps_that_refine_their_forces_and_climb_the_ladder_allocate_nothing() {
    for accuracy in [None, Some(0.02)] {
        let world = block::world(|scene| {
            let method = if accuracy.is_some() { ComplianceMethod::Automatic } else { ComplianceMethod::Asynchronous };
            let body = &mut scene.bodies[0];
            (body.compliance, body.accuracy, body.error_sampling) = (method, accuracy, 100.0);
        });
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap().refresh_every(0);
            // A press, and as long without contact as it takes to come down again.
            let all = STEPS + 4 * u64::from(palpate::world::CALM_STEPS);
            (0..all).for_each(|k| _ = simulation.step(&pose(k)));
            let (mut refined, mut rungs) = (0, Vec::with_capacity(all as usize));
            let seen = violations(|| {
                for k in 0..all {
                    let report = simulation.step(&pose(k));
                    refined += u32::from(report.error.refined);
                    rungs.extend(report.rung);
                }
            });
            assert_eq!(seen, 0, "accuracy {accuracy:?}");
            rungs.sort_unstable();
            rungs.dedup();
            assert!(refined > if accuracy.is_some() { 0 } else { 15 }, "{refined} refined");
            assert!(accuracy.is_none() || rungs.len() >= 3, "{rungs:?}");
        });
    }
}

#[test]
fn a_step_allocates_nothing_while_contacts_come_and_go() {
    for (method, friction, world) in worlds() {
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap().refresh_every(3);
            // One press warms up; the memory of the second is that of the first.
            let (mut most, mut free, mut touching) = (0, 0, 0);
            let mut press = |count: bool| {
                for k in 0..STEPS {
                    let report = simulation.step(&pose(k));
                    if count {
                        most = most.max(report.detection.contacts);
                        free += usize::from(report.active == 0);
                        touching += usize::from(report.active > 0);
                    }
                }
            };
            press(false);
            let seen = violations(|| press(true));
            assert_eq!(seen, 0, "{method:?}, friction {friction}");
            assert!(most > 5 && free > 5 && touching > 30, "{most} contacts, {free} steps free, {touching} touching");
        });
    }
}

/// To this tolerance thirty sweeps do not settle the problem, and Newton's method does.
#[test]
fn a_step_whose_contact_solver_falls_back_allocates_nothing() {
    let world = block::world(|scene| scene.solver.tolerance = 1e-11);
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        let mut press = || (0..STEPS).filter(|&k| simulation.step(&pose(k)).attempts > 1).count();
        press();
        let mut fell_back = 0;
        let seen = violations(|| fell_back = press());
        assert_eq!(seen, 0);
        assert!(fell_back > 10, "{fell_back}");
    });
}

/// So many steps, every tenth of them of a body with a velocity that is no number; how many were rolled back.
fn spoiled(simulation: &mut Simulation<'_>, steps: u64) -> usize {
    let mut failed = 0;
    for k in 0..steps {
        if k % 10 == 9 {
            simulation.state_mut().fem.v[200].x = f64::NAN;
        }
        failed += usize::from(simulation.step(&pose(k)).status == StepStatus::RolledBack);
    }
    failed
}

#[test]
fn a_step_that_fails_allocates_nothing_either() {
    let (_, _, world) = worlds().next().unwrap();
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        for k in 0..STEPS {
            simulation.step(&pose(k));
        }
        let mut failed = 0;
        let seen = violations(|| failed = spoiled(&mut simulation, STEPS));
        assert_eq!((seen, failed), (0, 6));
    });
}

/// The three stages of a lockstep run and the buffers between them, as the engine drives them.
#[test]
fn step_factor_and_tick_together_allocate_nothing_over_ten_thousand_ticks() {
    for (method, friction, world) in worlds() {
        on_a_worker(|| {
            let rest = world.model().rest_state();
            let mut ws = StepWorkspace::new(&world);
            assemble(world.model(), &rest, world.dt(), &[], &mut ws.fem);
            let first = FactorSample::new(&world, 0, 0, 0.0, &rest.q, &ws.fem.system).unwrap();
            let (mut port, mut factors) = refresh(&first, &ws.fem.system);
            let mut state = StepState::new(&world, rest);
            let (mut snapshots, snapshot_reader) = latest(&world.empty_snapshot());
            let (pose_writer, mut poses) = latest(&world.first_tool());
            let mut ticker = Ticker::open(&world, snapshot_reader, pose_writer).unwrap();
            let (mut touching, mut free, mut refreshed, mut on, mut offs) = (0, 0, 0, false, 0);
            let mut beat = |from: u64, to: u64| {
                for index in from..to {
                    let time = index as f64 * 1e-3;
                    if index % 33 == 0 {
                        if index % 99 == 0 {
                            refreshed += usize::from(factors.refresh(|| time).is_some_and(|r| r.is_ok()));
                            factors.want();
                        }
                        let input = StepInput { time, tool: *poses.latest(), factor: port.factor() };
                        let report = step(&world, &input, &mut state, &mut ws, snapshots.value_mut());
                        snapshots.publish();
                        port.offer(report.step, time, state.state_before(), &ws.fem.system, &[]);
                        offs += usize::from(on && report.active == 0);
                        on = report.active > 0;
                    }
                    let record = ticker.tick(time, 1e-3);
                    touching += usize::from(record.active > 0);
                    free += usize::from(record.active == 0);
                }
            };
            beat(0, 3300);
            let seen = violations(|| beat(3300, 13_300));
            assert_eq!(seen, 0, "{method:?}, friction {friction}");
            println!("{method:?}, friction {friction}: {touching} ticks with force, {free} without, {offs} partings");
            assert!(touching > 5000 && free > 500 && offs >= 4 && refreshed > 100, "{refreshed} factors");
        });
    }
}

#[test]
fn steps_by_newtons_method_and_explicit_ones_allocate_nothing_either() {
    for integrator in [IntegratorKind::Newton, IntegratorKind::Explicit] {
        let world = block::world(|scene| {
            let body = &mut scene.bodies[0];
            (body.integrator, body.rayleigh_mass, body.rayleigh_stiffness) = (integrator, 8.0, 1e-5);
        });
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap();
            let mut touching = 0;
            let mut press = || (0..STEPS).for_each(|k| touching += simulation.step(&pose(k)).active);
            press();
            assert_eq!(violations(press), 0, "{integrator:?}");
            assert!(touching > 0);
        });
    }
}

#[test]
fn steps_with_penalty_contact_allocate_nothing_either() {
    let world = block::world(|scene| scene.contact.method = ContactMethod::Penalty);
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        let mut touching = 0;
        let mut press = || (0..STEPS).for_each(|k| touching += simulation.step(&pose(k)).active);
        press();
        assert_eq!(violations(press), 0);
        assert!(touching > 0);
    });
}

#[test]
fn steps_of_quadratic_and_averaged_elements_allocate_nothing_either() {
    for element in [ElementKind::Quadratic, ElementKind::Averaged] {
        let world = block::world(|scene| {
            scene.bodies[0].element = element;
            scene.bodies[0].block.as_mut().unwrap().cells = [4, 4, 2];
            scene.bodies[0].material.viscosity = vec![PronyTerm { modulus: 0.3, time: 0.2 }];
        });
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap();
            let mut touching = 0;
            let mut press = || (0..STEPS).for_each(|k| touching += simulation.step(&pose(k)).active);
            press();
            assert_eq!(violations(press), 0, "{element:?}");
            assert!(touching > 0, "{element:?}");
        });
    }
}

#[test]
fn a_newton_step_that_fails_allocates_nothing_either() {
    let world = block::world(|scene| scene.bodies[0].integrator = IntegratorKind::Newton);
    on_a_worker(|| {
        let mut simulation = Simulation::new(&world).unwrap();
        for k in 0..STEPS {
            simulation.step(&pose(k));
        }
        let mut failed = 0;
        let seen = violations(|| failed = spoiled(&mut simulation, 30));
        assert_eq!((seen, failed), (0, 3));
    });
}

/// A brick on a floor, a ball that falls on the tissue and rolls off it on the brick, and the tool in between, by a wall.
#[test]
fn steps_with_fixed_and_rigid_bodies_allocate_nothing_either() {
    for integrator in [IntegratorKind::BackwardEuler, IntegratorKind::Newton] {
        let world = block::world(|scene| {
            scene.bodies[0].integrator = integrator;
            scene.gravity = [0.0, 0.0, -9.81];
            let bodies = r#"
                fixed_body = [{ name = "floor", shape = { kind = "plane", normal = [0, 0, 1] } },
                    { name = "wall", shape = { kind = "box", size = [0.01, 0.06, 0.03] }, position = [0.016, 0.037, 0.061] }]
                [[rigid_body]]
                name = "brick"
                shape = { kind = "box", size = [0.06, 0.06, 0.02] }
                mass = 0.1
                position = [0.12, 0.04, 0.01]
                [[rigid_body]]
                name = "pellet"
                shape = { kind = "sphere", radius = 0.01 }
                mass = 0.05
                position = [0.07, 0.04, 0.055]
                velocity = [0.5, 0, 0]
            "#;
            let bodies: toml::Table = bodies.parse().unwrap();
            scene.fixed_bodies = bodies["fixed_body"].clone().try_into().unwrap();
            scene.rigid_bodies = bodies["rigid_body"].clone().try_into().unwrap();
        });
        on_a_worker(|| {
            let mut simulation = Simulation::new(&world).unwrap();
            let start = simulation.state().rigid.clone();
            let (mut touching, mut most, mut at_wall) = (0, 0, 0);
            let mut fall = || {
                simulation.state_mut().rigid.copy_from_slice(&start);
                for k in 0..STEPS {
                    let report = simulation.step(&pose(k));
                    assert_eq!(report.status, StepStatus::Advanced);
                    (touching, most) = (touching + report.active, most.max(report.bodies.active));
                    at_wall += usize::from(report.bodies.handed_over > 0);
                }
            };
            fall();
            assert_eq!(violations(&mut fall), 0, "{integrator:?}");
            assert!(touching > 0 && most >= 5 && at_wall > 0, "{integrator:?}: {touching}, {most}");
        });
    }
}

/// The bundled grasp twice: five parts, two jaws, a gripper, a body that nothing else holds.
#[test]
fn a_grasper_that_closes_lifts_and_lets_go_allocates_nothing() {
    let mut scene = palpate::scene::Scene::bundled("grasp").unwrap();
    let again = |scene: &mut palpate::scene::SceneDescription| {
        let once = scene.hand.path.clone();
        scene.hand.path.extend(once.iter().map(|key| ScriptKey { time: 2.9 + key.time, ..*key }));
    };
    scene.edit(again).unwrap();
    let world = scene.build().unwrap();
    on_a_worker(|| {
        let mut ws = StepWorkspace::new(&world);
        let rest = world.model().rest_state();
        assemble(world.model(), &rest, world.dt(), &[], &mut ws.fem);
        let factor = FactorSample::new(&world, 0, 0, 0.0, &rest.q, &ws.fem.system).unwrap();
        let mut state = StepState::new(&world, rest);
        let (mut snapshots, snapshot_reader) = latest(&world.empty_snapshot());
        let (pose_writer, mut poses) = latest(&world.first_tool());
        let mut ticker = Ticker::open(&world, snapshot_reader, pose_writer).unwrap();
        let (mut squeezed, mut most) = (0, 0);
        let mut beat = |from: u64, to: u64| {
            for index in from..to {
                let time = index as f64 * 1e-3;
                if index % 33 == 0 {
                    let input = StepInput { time, tool: *poses.latest(), factor: &factor };
                    most =
                        most.max(step(&world, &input, &mut state, &mut ws, snapshots.value_mut()).detection.contacts);
                    snapshots.publish();
                }
                squeezed += usize::from(ticker.tick(time, 1e-3).gripper.torque > 0.0);
            }
        };
        beat(0, 2900);
        let seen = violations(|| beat(2900, 5800));
        assert_eq!(seen, 0);
        assert!(squeezed > 2000 && most > 20, "{squeezed} ticks with a force, {most} contacts");
    });
}
