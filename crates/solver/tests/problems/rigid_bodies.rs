//! Contact problems of rigid bodies: rank-deficient compliances and large ratios of mass.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Matrix3};
use palpate_constraints::law::{Coulomb, Law, Signorini};
use palpate_solver::problem::ConstraintProblem;

pub(crate) const GRAVITY: f64 = 9.81; // m/s²
pub(crate) const STEP: f64 = 1e-3; // s

pub(crate) fn problem(W: DMatrix<f64>, delta_free: &[f64], laws: Vec<Law>) -> ConstraintProblem {
    let problem = ConstraintProblem::new(W, DVector::from_column_slice(delta_free), laws).unwrap();
    problem.validate().unwrap();
    problem
}

/// A stool of unit mass and inertia on four rigid legs: `W` has rank 3, the load of a leg is not unique.
pub(crate) fn rigid_stool() -> ConstraintProblem {
    let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    // Rows over (height, roll, pitch).
    let H = DMatrix::from_fn(4, 3, |leg, dof| [1.0, corners[leg][1], -corners[leg][0]][dof]);
    problem(&H * H.transpose() * (STEP * STEP), &[-STEP * STEP * GRAVITY; 4], vec![Signorini.into(); 4])
}

/// A block of 1 kg between two walls along x; rows `[n, t, s]` of each wall.
pub(crate) fn between_walls(free_normal: [f64; 2], free_tangent: f64, friction: f64) -> ConstraintProblem {
    let left = Matrix3::identity();
    let right = Matrix3::new(-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let mut H = DMatrix::zeros(6, 3);
    H.fixed_view_mut::<3, 3>(0, 0).copy_from(&left);
    H.fixed_view_mut::<3, 3>(3, 0).copy_from(&right);
    let W = &H * H.transpose() * (STEP * STEP);
    let free = [free_normal[0], free_tangent, 0.0, free_normal[1], free_tangent, 0.0];
    problem(W, &free, vec![Coulomb { friction }.into(); 2])
}

/// A slender rod of unit mass on its tip, at the angle of the smallest critical friction: 4/3 at tan(angle) = 2.
pub(crate) fn painleve_rod(friction: f64, speed: f64) -> ConstraintProblem {
    let (sin, cos) = 2.0_f64.atan().sin_cos();
    let n = 1.0 + 3.0 * cos * cos;
    let nt = -3.0 * sin * cos;
    let W = DMatrix::from_row_slice(3, 3, &[n, nt, 0.0, nt, 1.0 + 3.0 * sin * sin, 0.0, 0.0, 0.0, 4.0]) * STEP * STEP;
    problem(W, &[-GRAVITY * STEP * STEP, speed * STEP, 0.0], vec![Coulomb { friction }.into()])
}

/// Blocks on one another, the first on the floor, with masses in kg from below: contact `k` carries all above it.
pub(crate) fn stack(masses: &[f64], law: Law) -> ConstraintProblem {
    let n = masses.len();
    let rows = law.rows();
    // Contact k: block k moves apart from block k - 1.
    let H = DMatrix::from_fn(n * rows, 3 * n, |row, dof| {
        let (k, axis, body) = (row / rows, row % rows, dof / 3);
        let sign = f64::from(i8::from(body == k)) - f64::from(i8::from(body + 1 == k));
        if axis == dof % 3 { sign } else { 0.0 }
    });
    let inverse = DMatrix::from_fn(3 * n, 3 * n, |i, j| if i == j { STEP * STEP / masses[i / 3] } else { 0.0 });
    // All blocks fall alike, so that only the floor sees a closing gap; they are also pushed along t.
    let fall = DVector::from_fn(3 * n, |dof, _| match dof % 3 {
        0 => -GRAVITY * STEP * STEP,
        1 => 0.1 * GRAVITY * STEP * STEP,
        _ => 0.0,
    });
    let W = &H * inverse * H.transpose();
    problem((&W + W.transpose()) * 0.5, (&H * fall).as_slice(), vec![law; n])
}
