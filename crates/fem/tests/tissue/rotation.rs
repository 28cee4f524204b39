//! Signed singular values, polar decomposition and nodal rotations.
#![allow(non_snake_case)]

use crate::tissue_setup::{block, nodes_where};
use nalgebra::{Matrix3, Rotation3, Vector3};
use palpate_fem::{
    model::{FemConfig, FemModel},
    rotation::{nodal_rotations, polar_rotation, signed_svd},
};
use proptest::prelude::*;

fn assert_rotation(R: &Matrix3<f64>) {
    assert!((R.transpose() * R - Matrix3::identity()).amax() < 2e-14, "{R}");
    assert!((R.determinant() - 1.0).abs() < 2e-14, "{R}");
}

fn assert_decomposes(F: &Matrix3<f64>) {
    let svd = signed_svd(F);
    assert_rotation(&svd.U);
    assert_rotation(&svd.V);
    let s = svd.sigma;
    assert!(s.x >= s.y && s.y >= s.z.abs() * (1.0 - 1e-14), "{s}");
    let back = svd.U * Matrix3::from_diagonal(&s) * svd.V.transpose();
    assert!((back - F).amax() <= 1e-14 * F.amax(), "{F} {back}");
    assert_rotation(&polar_rotation(F));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_matrix_is_decomposed_into_proper_rotations(
        entries in prop::array::uniform9(-1.0..1.0_f64),
        // Scales columns over many orders of magnitude, so that nearly flat and linear matrices occur.
        exponents in prop::array::uniform3(-200..200_i32),
    ) {
        let scale = Vector3::from(exponents.map(|e| 10.0_f64.powi(e / 10)));
        assert_decomposes(&(Matrix3::from_row_slice(&entries) * Matrix3::from_diagonal(&scale)));
    }

    #[test]
    fn the_polar_rotation_is_the_nearest_rotation(
        entries in prop::array::uniform9(-1.0..1.0_f64), angles in prop::array::uniform3(-3.2..3.2_f64),
    ) {
        let F = Matrix3::from_row_slice(&entries);
        let R = polar_rotation(&F);
        let other = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
        prop_assert!((F - R).norm() <= (F - other).norm() + 1e-14);
    }
}

#[test]
fn degenerate_matrices_are_decomposed() {
    let d = |a, b, c| Matrix3::from_diagonal(&Vector3::new(a, b, c));
    let turn = Rotation3::from_euler_angles(0.3, 2.0, -1.0).into_inner();
    for F in [
        Matrix3::zeros(),
        Matrix3::identity(),
        -Matrix3::identity(),
        d(1.0, 1.0, 0.0),
        d(1.0, 0.0, 0.0) * turn,
        d(1.0, -1.0, 0.0) * turn,
        turn * d(2.0, 1.0, -1.0),
        Matrix3::repeat(1.0),
        Matrix3::repeat(1e-300),
        d(1e200, 1e-200, 1.0),
    ] {
        assert_decomposes(&F);
    }
    assert_eq!(polar_rotation(&Matrix3::zeros()), Matrix3::identity());
    assert!(signed_svd(&Matrix3::repeat(f64::NAN)).sigma.x.is_nan());
    assert_rotation(&polar_rotation(&Matrix3::repeat(f64::INFINITY)));
}

/// A block with its bottom fixed, for the numbering, at rest.
fn body() -> FemModel {
    let mesh = block([3, 3, 3], [0.1; 3], 0.15);
    let fixed = nodes_where(&mesh, |x| x.z < 1e-9);
    FemModel::new(&mesh, &FemConfig { fixed, ..FemConfig::default() }).unwrap()
}

fn rotations(model: &FemModel, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    let mut rotations = vec![Matrix3::zeros(); model.free_nodes()];
    nodal_rotations(model, from, to, &mut rotations);
    rotations
}

fn moved(q: &[Vector3<f64>], F: &Matrix3<f64>) -> Vec<Vector3<f64>> {
    q.iter().map(|x| F * x + Vector3::new(0.5, -0.2, 0.1)).collect()
}

#[test]
fn nodal_rotations_recover_a_rigid_rotation_between_deformed_configurations() {
    let model = body();
    let bent: Vec<_> = model.q_rest().iter().map(|x| x + Vector3::new(3.0 * x.z * x.z, x.x * x.y, 0.0)).collect();
    for angle in [0.01, 1.0, std::f64::consts::PI, -2.5] {
        let R = Rotation3::from_axis_angle(&Vector3::y_axis(), angle).into_inner();
        for from in [model.q_rest(), &bent[..]] {
            for found in rotations(&model, from, &moved(from, &R)) {
                assert!((found - R).amax() < 1e-12, "{angle}: {found}");
            }
        }
    }
}

#[test]
fn nodal_rotations_are_the_identity_under_pure_stretch() {
    let model = body();
    let turn = Rotation3::from_euler_angles(0.3, 2.0, -1.0);
    let stretch = turn * Matrix3::from_diagonal(&Vector3::new(1.8, 0.7, 1.1)) * turn.inverse();
    for found in rotations(&model, model.q_rest(), &moved(model.q_rest(), &stretch)) {
        assert!((found - Matrix3::identity()).amax() < 1e-13, "{found}");
    }
}

#[test]
fn nodal_rotations_are_rotations_where_elements_are_flat_inverted_or_not_finite() {
    let model = body();
    let rest = model.q_rest();
    let flat = moved(rest, &Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)));
    let mirrored = moved(rest, &Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)));
    let point = vec![Vector3::zeros(); rest.len()];
    let broken = vec![Vector3::repeat(f64::NAN); rest.len()];
    for (from, to) in [(rest, &flat[..]), (&flat, rest), (rest, &mirrored), (&mirrored, &flat), (rest, &point)] {
        rotations(&model, from, to).iter().for_each(assert_rotation);
    }
    for (from, to) in [(&point[..], rest), (&broken, rest), (rest, &broken)] {
        assert!(rotations(&model, from, to).iter().all(|R| *R == Matrix3::identity()));
    }
}
