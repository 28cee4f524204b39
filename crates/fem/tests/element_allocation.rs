//! Assembly, forces and rotations of every kind of element allocate nothing after set-up.

mod tissue_setup;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use nalgebra::{Matrix3, Vector3};
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble, assemble_with, elastic_energy, internal_forces},
    element::ElementKind,
    model::{FemConfig, FemModel},
    rotation::nodal_rotations,
};
use tissue_setup::{block, laws_for, mesh_for, nodes_where};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn run_paths_allocate_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for kind in ElementKind::ALL {
        let mesh = mesh_for(&block([3, 3, 3], [0.06, 0.06, 0.06], 0.1), kind);
        for material in laws_for(kind, 5e3, 0.45) {
            for filter in [false, true] {
                let fixed = nodes_where(&mesh, |x| x.z < 1e-9);
                let config = FemConfig { element: kind, material, fixed, filter, ..FemConfig::default() };
                let model = FemModel::new(&mesh, &config).unwrap();
                let mut state = model.rest_state();
                for q in &mut state.q {
                    *q += Vector3::new(4.0 * q.z * q.z, 0.0, -2.0 * q.x * q.z);
                }
                let violations = pool.install(|| {
                    let mut ws = FemWorkspace::new(&model);
                    let mut rotations = vec![Matrix3::identity(); model.free_nodes()];
                    reset_violation_count();
                    let energy = assert_no_alloc(|| {
                        assemble(&model, &state, 0.03, &[], &mut ws);
                        assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
                        internal_forces(&model, &state, &mut ws);
                        nodal_rotations(&model, model.q_rest(), &state.q, &mut rotations);
                        elastic_energy(&model, &state)
                    });
                    assert!(energy > 0.0);
                    violation_count()
                });
                assert_eq!(violations, 0, "{} {} filter {filter}", kind.name(), material.name());
            }
        }
    }
}
