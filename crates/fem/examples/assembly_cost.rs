//! Prints the cost of assembly per tetrahedron by kind of element, for one law or all:
//! `cargo run --release -p palpate-fem --example assembly_cost [-- <law>]`.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use nalgebra::Vector3;
use palpate_fem::{
    assembly::{FemWorkspace, assemble, internal_forces},
    element::ElementKind,
    material::Material,
    mesh::TetMesh,
    model::{FemConfig, FemModel},
    rotation::nodal_rotations,
};

#[path = "../tests/tissue_setup/mod.rs"]
mod tissue_setup;
use tissue_setup::{block, laws_for, mesh_for, nodes_where};

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
    let only = std::env::args().nth(1);
    println!(
        "{:>9} {:>8} {:>19} {:>7} {:>8} {:>10} {:>10}",
        "element", "tets", "law", "filter", "threads", "ns/tet", "filtered"
    );
    for kind in ElementKind::ALL {
        for cells in [10, 18] {
            let mesh = mesh_for(&block([cells; 3], [0.1; 3], 0.15), kind);
            for law in laws_for(kind, 5e3, 0.45) {
                if only.as_ref().is_some_and(|only| only != law.name()) {
                    continue;
                }
                for (filter, threads) in [(false, 1), (true, 1), (false, 2), (true, 2)] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                    pool.install(|| print_costs(kind, &mesh, law, filter));
                }
            }
        }
    }
}

fn print_costs(element: ElementKind, mesh: &TetMesh, material: Material, filter: bool) {
    let fixed = nodes_where(mesh, |x| x.z < 1e-9);
    let config = FemConfig { element, material, fixed, filter, ..FemConfig::default() };
    let model = FemModel::new(mesh, &config).expect("model");
    let mut state = model.rest_state();
    // Bent, so that half of the body is compressed.
    for q in &mut state.q {
        *q += Vector3::new(2.0 * q.z * q.z, 0.0, -q.x * q.z);
    }
    let mut ws = FemWorkspace::new(&model);
    let report = assemble(&model, &state, 1.0 / 30.0, &[], &mut ws);
    let ns = cost(mesh, || {
        assemble(&model, &state, 1.0 / 30.0, &[], &mut ws);
    });
    let (name, law, threads) = (element.name(), material.name(), rayon::current_num_threads());
    let (tets, filtered) = (mesh.tetrahedra.len(), report.filtered);
    println!("{name:>9} {tets:>8} {law:>19} {filter:>7} {threads:>8} {ns:>10.0} {filtered:>10}");
    if threads == 1 && filter {
        let force = cost(mesh, || {
            internal_forces(&model, &state, &mut ws);
        });
        let rest = model.rest_state();
        let mut rotations = vec![nalgebra::Matrix3::identity(); model.free_nodes()];
        let rotation = cost(mesh, || nodal_rotations(&model, &rest.q, &state.q, &mut rotations));
        println!("{:>38} forces {force:.0}, nodal rotations {rotation:.0} ns/tet", "");
    }
}
