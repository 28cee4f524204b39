//! Compliance and correction against differences, dense algebra, and rigid rotations.

use crate::common::{DenseInverse, DenseWorkspace, find, free_nodes, patch, pose, spd};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use palpate_collision::{ContactKind, ToolShape};
use palpate_constraints::compliance::{
    ComplianceMethod, ComplianceWorkspace, WarpedInverse, assemble, correct, rotate_rows,
};
use palpate_constraints::rows::{ContactRows, Counterpart, RowInput, ToolMotion, build_rows};
use palpate_fem::nodal_rows::NodalRows;

const DT: f64 = 0.02;

fn contact_rows() -> (ContactRows, usize) {
    let (surface, positions) = patch(3, 0.006);
    let tool = ToolShape::sphere(0.008).unwrap();
    let place = pose(Vector3::new(0.0007, 0.0011, 0.0072), Vector3::zeros());
    let set = find(&surface, &positions, &tool, &place, ContactKind::Faces);
    let (free, n) = free_nodes(positions.len(), 5);
    let v_free: Vec<f64> = (0..3 * n).map(|i| 0.1 * (((i * 29) % 23) as f64 / 11.0 - 1.0)).collect();
    let input = RowInput {
        free_of_node: &free,
        v_free: &v_free,
        dt: DT,
        counterpart: Counterpart::Tool { reference: place.translation.vector, motion: ToolMotion::none() },
        friction: true,
    };
    let mut rows = ContactRows::with_capacity(set.contacts.len());
    build_rows(&set.contacts, &input, &mut rows);
    assert!(rows.len() >= 12);
    (rows, n)
}

fn dense(rows: &NodalRows, n: usize) -> DMatrix<f64> {
    let mut h = DMatrix::zeros(rows.len(), 3 * n);
    for r in 0..rows.len() {
        for (k, v) in rows.row(r) {
            for c in 0..3 {
                h[(r, 3 * k as usize + c)] += v[c];
            }
        }
    }
    h
}

/// `W` is how the gap after the corrected motion answers to a row force: `δ = H h v⁺`, `v⁺ = v_free + Δv(λ)`.
#[test]
fn compliance_is_the_derivative_of_the_gap_by_the_force() {
    let (rows, n) = contact_rows();
    let inverse = DenseInverse(spd(3 * n).try_inverse().unwrap());
    let system = WarpedInverse::new(ComplianceMethod::Exact, &inverse, &[]);
    let mut ws = ComplianceWorkspace::new(rows.len(), DenseWorkspace::default());
    let mut w = DMatrix::zeros(rows.len(), rows.len());
    let report = assemble(system, &rows.tissue, DT, &mut w, &mut ws);
    assert!(report.usable && report.asymmetry < 1e-14 && report.diagonal[0] > 0.0, "{report:?}");
    assert_eq!(w.shape(), (rows.len(), rows.len()));
    let mut dv = vec![0.0; 3 * n];
    for j in 0..rows.len() {
        let mut lambda = vec![0.0; rows.len()];
        lambda[j] = 1.0;
        assert!(correct(system, &lambda, DT, &mut dv, &mut ws));
        for i in 0..rows.len() {
            // Linear in λ: the difference is exact but for rounding.
            let gap = DT * rows.tissue.dot(i, &dv);
            assert!((gap - w[(i, j)]).abs() < 1e-12 * report.diagonal[1]);
        }
        // Momentum balance of the correction, A Δv = h Hᵀ λ: independent of how the inverse is applied.
        let mut force = vec![0.0; 3 * n];
        rows.tissue.add_transposed(&lambda, &mut force);
        let balance = spd(3 * n) * DVector::from_column_slice(&dv) - DVector::from_vec(force) * DT;
        assert!(balance.norm() < 1e-12);
    }
}

/// If the matrix has only turned, node by node, the warped inverse of the old one is exact: `A = R A₀ Rᵀ`.
#[test]
fn warping_is_exact_under_rotation() {
    let (rows, n) = contact_rows();
    let rotations: Vec<Matrix3<f64>> =
        (0..n).map(|k| Rotation3::from_scaled_axis(Vector3::new(0.7, -0.3 * k as f64, 1.1)).into_inner()).collect();
    let mut turn = DMatrix::zeros(3 * n, 3 * n);
    for (k, r) in rotations.iter().enumerate() {
        turn.fixed_view_mut::<3, 3>(3 * k, 3 * k).copy_from(r);
    }
    let old = spd(3 * n);
    let now = &turn * &old * turn.transpose();
    let old = DenseInverse(old.try_inverse().unwrap());
    let now = DenseInverse(now.try_inverse().unwrap());
    let lambda: Vec<f64> = (0..rows.len()).map(|r| (r % 5) as f64 - 1.0).collect();
    let run = |method, inverse: &DenseInverse| {
        let system = WarpedInverse::new(method, inverse, &rotations);
        let mut ws = ComplianceWorkspace::new(rows.len(), DenseWorkspace::default());
        let (mut w, mut dv) = (DMatrix::zeros(rows.len(), rows.len()), vec![0.0; 3 * n]);
        assemble(system, &rows.tissue, DT, &mut w, &mut ws);
        correct(system, &lambda, DT, &mut dv, &mut ws);
        (w, DVector::from_vec(dv))
    };
    let (w, dv) = run(ComplianceMethod::Asynchronous, &old);
    let (w_exact, dv_exact) = run(ComplianceMethod::Exact, &now);
    assert!((&w - &w_exact).norm() < 1e-11 * w_exact.norm(), "{}", (&w - &w_exact).norm() / w_exact.norm());
    assert!((&dv - &dv_exact).norm() < 1e-11 * dv_exact.norm());
    // Without the warp the old factor is far off: the test can fail.
    let (w_stale, _) = run(ComplianceMethod::Exact, &old);
    assert!((&w_stale - &w_exact).norm() > 0.05 * w_exact.norm());
}

#[test]
fn rotated_rows_are_h_times_r() {
    let (mut rows, n) = contact_rows();
    let rotations: Vec<Matrix3<f64>> =
        (0..n).map(|k| Rotation3::from_scaled_axis(Vector3::new(0.1 * k as f64, 0.4, -0.2)).into_inner()).collect();
    let mut turn = DMatrix::zeros(3 * n, 3 * n);
    for (k, r) in rotations.iter().enumerate() {
        turn.fixed_view_mut::<3, 3>(3 * k, 3 * k).copy_from(r);
    }
    let expected = dense(&rows.tissue, n) * turn;
    rotate_rows(&mut rows.tissue, &rotations);
    assert!((dense(&rows.tissue, n) - expected).norm() < 1e-14);
}

#[test]
fn unusable_matrices_are_told() {
    let (rows, n) = contact_rows();
    let mut ws = ComplianceWorkspace::new(rows.len(), DenseWorkspace::default());
    let mut w = DMatrix::zeros(rows.len(), rows.len());
    let nan = DenseInverse(DMatrix::from_element(3 * n, 3 * n, f64::NAN));
    assert!(
        !assemble(WarpedInverse::new(ComplianceMethod::Exact, &nan, &[]), &rows.tissue, DT, &mut w, &mut ws).usable
    );
    let zero = DenseInverse(DMatrix::zeros(3 * n, 3 * n));
    assert!(
        !assemble(WarpedInverse::new(ComplianceMethod::Exact, &zero, &[]), &rows.tissue, DT, &mut w, &mut ws).usable
    );
    // Forces of other rows correct nothing.
    let good = DenseInverse(spd(3 * n).try_inverse().unwrap());
    let system = WarpedInverse::new(ComplianceMethod::Exact, &good, &[]);
    assert!(assemble(system, &rows.tissue, DT, &mut w, &mut ws).usable);
    let mut dv = vec![7.0; 3 * n];
    assert!(!correct(system, &[1.0], DT, &mut dv, &mut ws) && dv.iter().all(|x| *x == 0.0));
    let none = NodalRows::with_capacity(0, 0);
    let exact = WarpedInverse::new(ComplianceMethod::Exact, &zero, &[]);
    assert!(!assemble(exact, &none, DT, &mut w, &mut ws).usable, "a matrix of another size");
    let report = assemble(exact, &none, DT, w.view_mut((0, 0), (0, 0)), &mut ws);
    assert!(report.usable && report.rows == 0);
}
