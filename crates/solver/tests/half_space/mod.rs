//! Contact problems on an elastic half-space: the dense, smoothly decaying compliance that tissue has.

// Each program that includes this file uses a part of it.
#![allow(dead_code, unreachable_pub)]

use nalgebra::{DMatrix, DVector, Matrix3};
use palpate_constraints::law::Coulomb;
use palpate_solver::problem::ConstraintProblem;
use std::f64::consts::{PI, TAU};

const SHEAR: f64 = 2e3; // Pa
const POISSON: f64 = 0.45;

/// Displacement (m) at a distance (x, y) from a force of 1 N on the surface, rows and columns `[n, t, s]` [Boussinesq,
/// Cerruti]. The force is spread over `radius` (m), which keeps the matrix finite and positive definite.
fn point_compliance(x: f64, y: f64, radius: f64) -> Matrix3<f64> {
    let r = (x * x + y * y + radius * radius).sqrt();
    let k = 1.0 / (TAU * SHEAR);
    let (a, b) = (k * (1.0 - POISSON) / r, k * POISSON / (r * r * r));
    let c = k * (0.5 - POISSON) / (r * r);
    Matrix3::new(a, c * x, c * y, -c * x, a + b * x * x, b * x * y, -c * y, b * x * y, a + b * y * y)
}

/// `contacts` points on a sunflower spiral over a disc of 10 mm: even spacing without symmetry.
pub fn points(contacts: usize) -> Vec<[f64; 2]> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..contacts)
        .map(|k| {
            let radius = 0.01 * ((k as f64 + 0.5) / contacts as f64).sqrt();
            [radius * (golden * k as f64).cos(), radius * (golden * k as f64).sin()]
        })
        .collect()
}

/// A sphere of 40 mm pressed `depth` (m) into the half-space and dragged by `drag` (m) along the first tangent.
pub fn pressed_sphere(contacts: usize, friction: f64, depth: f64, drag: f64) -> ConstraintProblem {
    let points = points(contacts);
    let patch = 0.01 / (contacts as f64).sqrt();
    let mut w = DMatrix::zeros(3 * contacts, 3 * contacts);
    for (a, p) in points.iter().enumerate() {
        for (b, q) in points.iter().enumerate() {
            // Point `a` moves under a force on `b`.
            let block = point_compliance(p[0] - q[0], p[1] - q[1], 0.8 * patch);
            w.fixed_view_mut::<3, 3>(3 * a, 3 * b).copy_from(&block);
        }
    }
    let mut delta_free = DVector::zeros(3 * contacts);
    for (a, p) in points.iter().enumerate() {
        delta_free[3 * a] = (p[0] * p[0] + p[1] * p[1]) / 0.08 - depth;
        delta_free[3 * a + 1] = drag;
    }
    ConstraintProblem::new(w, delta_free, points.iter().map(|_| Coulomb { friction }.into())).unwrap()
}
