//! Bodies whose elements are summed in several parts.

use crate::tissue_setup::{Random, block, nodes_where};
use nalgebra::Vector3;
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble, assemble_with, elastic_energy, internal_forces},
    material::NeoHookean,
    model::{FemConfig, FemModel, FemState},
};

/// Energy (J), and forces on the nodes (N).
type EnergyAndForces = (f64, Vec<Vector3<f64>>);

/// A body of several parts, which are summed on their own: along any direction forces are the slope of the energy, and `K` that
/// of the forces, to the fourth power of 2e-3 of an element, and the bits are those of one thread.
#[test]
fn parts_of_a_large_body_add_up_to_it() {
    let mesh = block([9, 9, 9], [0.09; 3], 0.1);
    let material = NeoHookean { young: 5e3, poisson: 0.4 }.into();
    let fixed = nodes_where(&mesh, |x| x.z < 1e-9);
    let config = FemConfig { material, fixed, filter: false, rayleigh_stiffness: 0.0, ..FemConfig::default() };
    let model = FemModel::new(&mesh, &config).unwrap();
    assert!(model.parts() > 3, "{} parts", model.parts());
    let mut state = model.rest_state();
    let mut random = Random(5);
    let mut direction = vec![Vector3::zeros(); mesh.nodes.len()];
    for &node in model.node_of_free() {
        state.q[node as usize] += random.vector() * 5e-4;
        direction[node as usize] = random.vector();
    }
    let mut ws = FemWorkspace::new(&model);
    ws.dt = 0.02;
    let e = 2e-5;
    let mut at = |t: f64| {
        let q = state.q.iter().zip(&direction).map(|(q, d)| q + d * (t * e)).collect();
        let moved = FemState { q, ..state.clone() };
        internal_forces(&model, &moved, &mut ws);
        (elastic_energy(&model, &moved), ws.f_int.clone())
    };
    // Differences of the fourth order.
    let [far, near, back, off] = [2.0, 1.0, -1.0, -2.0].map(&mut at);
    let slope = |f: &dyn Fn(&EnergyAndForces) -> f64| (8.0 * (f(&near) - f(&back)) - (f(&far) - f(&off))) / (12.0 * e);
    assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
    let dot = |f: &[Vector3<f64>]| -> f64 { f.iter().zip(&direction).map(|(f, d)| f.dot(d)).sum() };
    let force = dot(&ws.f_int);
    let by_energy = -slope(&|at| at.0);
    assert!((force - by_energy).abs() < 1e-8 * force.abs(), "{force} {by_energy}");
    let along: Vec<f64> =
        model.node_of_free().iter().flat_map(|&node| direction[node as usize].as_slice().to_vec()).collect();
    let mut product = vec![0.0; along.len()];
    ws.system.multiply(&along, &mut product);
    let largest = product.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (k, &node) in model.node_of_free().iter().enumerate() {
        for c in 0..3 {
            let by_forces = -slope(&|at| at.1[node as usize][c]);
            assert!((product[3 * k + c] - by_forces).abs() < 1e-7 * largest, "{} {by_forces}", product[3 * k + c]);
        }
    }
    let bits = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut ws = FemWorkspace::new(&model);
            let report = assemble(&model, &state, 0.02, &[], &mut ws);
            let forces = ws.f_int.iter().flat_map(|f| f.iter().map(|x| x.to_bits()));
            let blocks = ws.system.blocks.iter().flat_map(|b| b.iter().map(|x| x.to_bits()));
            (forces.chain(blocks).collect::<Vec<u64>>(), report)
        })
    };
    let one = bits(1);
    assert!([2, 3].into_iter().all(|threads| bits(threads) == one));
}
