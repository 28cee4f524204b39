//! Prints the cost of assembly per tetrahedron: `cargo run --release -p palpate-fem --example assembly_cost`.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use nalgebra::Vector3;
use palpate_fem::{
    assembly::{FemWorkspace, assemble, internal_forces},
    material::Material,
    mesh::TetMesh,
    model::{FemConfig, FemModel},
    rotation::nodal_rotations,
};

#[path = "../tests/tissue_setup/mod.rs"]
mod tissue_setup;
use tissue_setup::{block, nodes_where};

/// Best of many runs, in ns per tetrahedron.
fn cost(mesh: &TetMesh, mut work: impl FnMut()) -> f64 {
    let best = (0..30).map(|_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    });
    best.fold(f64::INFINITY, f64::min) * 1e9 / mesh.tetrahedra.len() as f64
}

fn main() {
    println!("{:>8} {:>14} {:>7} {:>8} {:>10} {:>10}", "tets", "law", "filter", "threads", "ns/tet", "filtered");
    for cells in [10, 18] {
        let mesh = block([cells; 3], [0.1; 3], 0.15);
        for name in Material::NAMES {
            for filter in [false, true] {
                for threads in [1, 2] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                    pool.install(|| {
                        let config = FemConfig {
                            material: Material::from_young_poisson(name, 5e3, 0.45).expect("registered"),
                            fixed: nodes_where(&mesh, |x| x.z < 1e-9),
                            filter,
                            ..FemConfig::default()
                        };
                        let model = FemModel::new(&mesh, &config).expect("model");
                        let mut state = model.rest_state();
                        // Bent, so that half of the body is compressed.
                        for q in &mut state.q {
                            *q += Vector3::new(2.0 * q.z * q.z, 0.0, -q.x * q.z);
                        }
                        let mut ws = FemWorkspace::new(&model);
                        let report = assemble(&model, &state, 1.0 / 30.0, &[], &mut ws);
                        let ns = cost(&mesh, || {
                            assemble(&model, &state, 1.0 / 30.0, &[], &mut ws);
                        });
                        let (tets, filtered) = (mesh.tetrahedra.len(), report.filtered);
                        println!("{tets:>8} {name:>14} {filter:>7} {threads:>8} {ns:>10.0} {filtered:>10}");
                        if threads == 1 && filter {
                            let force = cost(&mesh, || {
                                internal_forces(&model, &state, &mut ws);
                            });
                            let rest = model.rest_state();
                            let mut rotations = vec![nalgebra::Matrix3::identity(); model.free_nodes()];
                            let rotation = cost(&mesh, || nodal_rotations(&model, &rest.q, &state.q, &mut rotations));
                            println!("{:>8} {name:>14} forces {force:.0}, nodal rotations {rotation:.0} ns/tet", "");
                        }
                    });
                }
            }
        }
    }
}
