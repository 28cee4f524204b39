//! Integrators allocate nothing after set-up, and give the same bits for any number of threads.

mod integrator_setup;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use integrator_setup::{bar_of, body, clamped};
use nalgebra::Vector3;
use palpate_fem::{
    integrator::{
        backward_euler::newton_step,
        equilibrium::{EquilibriumConfig, Loads, Prescribed, equilibrium},
        explicit::{ExplicitWorkspace, explicit_velocity},
        newton::NewtonConfig,
    },
    model::{FemConfig, FemModel},
};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// Bodies whose every path of the integrators is taken: damping, gravity, driven nodes.
fn config() -> (palpate_fem::mesh::TetMesh, FemConfig) {
    let mesh = bar_of([8, 3, 3]);
    let mut config = FemConfig {
        rayleigh_mass: 1.0,
        rayleigh_stiffness: 1e-4,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        ..clamped(&mesh, "neo_hookean")
    };
    config.fixed.extend(&mesh.node_sets["x_max"]);
    (mesh, config)
}

fn pulled(model: &FemModel, nodes: &[u32]) -> Vec<Prescribed> {
    let place = |node: u32| model.q_rest()[node as usize] + Vector3::new(0.02, 0.0, 0.01);
    nodes.iter().map(|&node| Prescribed { node, position: place(node) }).collect()
}

#[test]
fn no_integrator_allocates() {
    let (mesh, config) = config();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let violations = pool.install(|| {
        let (model, _, mut ws) = body(&mesh, &config);
        let mut explicit = ExplicitWorkspace::new(&model);
        let prescribed = pulled(&model, &mesh.node_sets["x_max"]);
        let (mut a, mut d) = (model.rest_state(), model.rest_state());
        let mut round = || {
            assert_no_alloc(|| {
                let newton = newton_step(&model, 0.02, &[], &NewtonConfig::default(), &mut a, &mut ws);
                let step = explicit_velocity(&model, 1e-4, &[], &a, &mut explicit);
                d.q.copy_from_slice(model.q_rest());
                let loads = Loads { prescribed: &prescribed, ..Loads::default() };
                let still = equilibrium(&model, &loads, &EquilibriumConfig::default(), &mut d, &mut ws);
                newton.is_converged() && step.non_finite.is_none() && still.is_ok_and(|r| r.is_converged())
            })
        };
        assert!((0..2).all(|_| round()));
        reset_violation_count();
        assert!((0..5).all(|_| round()));
        violation_count()
    });
    assert_eq!(violations, 0);
    reset_violation_count();
    assert_no_alloc(|| drop(std::hint::black_box(vec![1.0; 100])));
    assert!(violation_count() > 0, "the counter counts");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (mesh, config) = config();
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let (model, _, mut ws) = body(&mesh, &config);
            let mut explicit = ExplicitWorkspace::new(&model);
            let mut newton = model.rest_state();
            let mut kicks = Vec::new();
            for _ in 0..5 {
                newton_step(&model, 0.02, &[], &NewtonConfig::default(), &mut newton, &mut ws);
                explicit_velocity(&model, 1e-4, &[], &newton, &mut explicit);
                kicks.extend_from_slice(explicit.velocity());
            }
            let prescribed = pulled(&model, &mesh.node_sets["x_max"]);
            let mut still = model.rest_state();
            let loads = Loads { prescribed: &prescribed, ..Loads::default() };
            let report = equilibrium(&model, &loads, &EquilibriumConfig::default(), &mut still, &mut ws).unwrap();
            assert!(report.is_converged());
            (newton, kicks, still, report.reaction)
        })
    };
    let one = run(1);
    assert!(one.1.iter().any(|v| *v != 0.0), "gravity moves it");
    for threads in [2, 4] {
        assert!(run(threads) == one, "{threads} threads");
    }
}
