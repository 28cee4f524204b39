//! A cantilever under its own weight against Timoshenko's beam, with the convergence of linear tetrahedra.
#![allow(clippy::print_stdout)]

use crate::tissue_setup::{all_materials, block, conjugate_gradients, move_free, nodes_where};
use nalgebra::Vector3;
use palpate_fem::{
    assembly::{Coefficients, FemWorkspace, assemble_with},
    material::{Law, Material},
    model::{FemConfig, FemModel},
};

const YOUNG: f64 = 1e5;
const DENSITY: f64 = 1000.0;
const LENGTH: f64 = 0.16;
const WIDTH: f64 = 0.02;

/// Mean deflection of the end face (m) of a square beam along x, with `n` cells over its width.
///
/// One linear solve at rest: gravity is small, so that deflections stay linear.
fn deflection(material: Material, n: usize, gravity: f64) -> f64 {
    let mesh = block([8 * n, n, n], [LENGTH, WIDTH, WIDTH], 0.0);
    let config = FemConfig {
        material,
        density: DENSITY,
        gravity: Vector3::new(0.0, 0.0, -gravity),
        fixed: nodes_where(&mesh, |x| x.x < 1e-9),
        filter: false,
        ..FemConfig::default()
    };
    let model = FemModel::new(&mesh, &config).unwrap();
    let mut state = model.rest_state();
    let mut ws = FemWorkspace::new(&model);
    assemble_with(&model, &state, Coefficients::STATIC, &[], &mut ws);
    let step = conjugate_gradients(&ws, &ws.rhs, 1e-8);
    let rest = state.q.clone();
    move_free(&model, &rest, &step, 1.0, &mut state);
    let end = nodes_where(&mesh, |x| x.x > LENGTH - 1e-9);
    end.iter().map(|&i| rest[i as usize].z - state.q[i as usize].z).sum::<f64>() / end.len() as f64
}

/// Timoshenko's beam: `w = ρ g A L⁴ / (8 E I) + ρ g L² / (2 κ G)`, `I = A b² / 12`, `κ = 5/6` for `ν = 0`.
fn theory(gravity: f64) -> f64 {
    let load = DENSITY * gravity * LENGTH * LENGTH;
    let bending = load * LENGTH * LENGTH * 12.0 / (8.0 * YOUNG * WIDTH * WIDTH);
    let shear = load / (2.0 * (5.0 / 6.0) * YOUNG / 2.0);
    bending + shear
}

#[test]
fn the_deflection_converges_to_beam_theory_with_second_order() {
    // Poisson's ratio zero: the clamp then restrains nothing that the beam's theory leaves free.
    let material = all_materials(YOUNG, 0.0)[0];
    let exact = theory(1e-3);
    let errors = [2, 4, 8].map(|n| (exact - deflection(material, n, 1e-3)) / exact);
    let orders = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    println!("relative errors for 2, 4, 8 cells over the width: {errors:.3?}, orders {orders:.2?}");
    // Linear tetrahedra are too stiff in bending (a share of the energy goes into parasitic shear), and less so by four
    // times for every halving; on coarse meshes 1 / w rather than w converges, hence the smaller first order.
    assert!(errors.iter().all(|&e| e > 0.0));
    assert!(orders[0] > 1.0 && orders[1] > orders[0] && orders[1] < 2.1, "{orders:?}");
    // Stiffness instead of deflection shows the order of the element: (1/w - 1/exact) falls by four.
    let stiffness = errors.map(|e| 1.0 / (1.0 - e) - 1.0);
    for pair in stiffness.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.15, "order {order} of the stiffness");
    }
    // What is left after Richardson's extrapolation is the beam theory's own error at this slenderness.
    let limit = stiffness[2] - (stiffness[1] - stiffness[2]) / 3.0;
    println!("extrapolated stiffness differs from Timoshenko's by {limit:.4}");
    assert!(limit.abs() < 0.01, "{limit}");
}

#[test]
fn every_law_bends_alike_at_small_deflection() {
    let reference = deflection(all_materials(YOUNG, 0.3)[0], 2, 1e-3);
    for material in all_materials(YOUNG, 0.3) {
        let difference = (deflection(material, 2, 1e-3) - reference).abs();
        // Tangents at rest are those of linear elasticity; conjugate gradients stop at 1e-8.
        assert!(difference < 1e-6 * reference, "{}", material.name());
        assert!(material.validate().is_ok());
    }
}
