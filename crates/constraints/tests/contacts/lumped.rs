//! The compliance of a lumped mass against the dense one.

use nalgebra::{DMatrix, DVector, Vector3};
use palpate_constraints::compliance::{ComplianceWorkspace, WarpedInverse, assemble, correct};
use palpate_constraints::lumped::LumpedInverse;
use palpate_fem::nodal_rows::NodalRows;

#[test]
fn compliance_and_correction_are_those_of_the_diagonal_matrix() {
    let mass = [0.5, 2.0, 1.0, 4.0];
    let mut rows = NodalRows::with_capacity(3, 3);
    rows.push_row([(0, Vector3::new(0.2, 0.1, 0.7)), (1, Vector3::new(0.0, 0.3, -0.2))]);
    rows.push_row([(1, Vector3::new(1.0, 0.5, 0.0)), (3, Vector3::new(0.0, 0.0, 0.4))]);
    rows.push_row([(2, Vector3::new(0.0, 1.0, 0.0))]);
    let mut dense = DMatrix::zeros(3, 12);
    for r in 0..3 {
        for (k, v) in rows.row(r) {
            (0..3).for_each(|c| dense[(r, 3 * k as usize + c)] = v[c]);
        }
    }
    let inverse = DMatrix::from_diagonal(&DVector::from_fn(12, |i, _| 1.0 / mass[i / 3]));
    let lumped = LumpedInverse::new(mass);
    let system = WarpedInverse { inverse: &lumped, rotations: None };
    let mut ws = ComplianceWorkspace::new(3, NodalRows::with_capacity(3, 3));
    let h = 1e-3;
    let mut w = DMatrix::zeros(3, 3);
    let report = assemble(system, &rows, h, &mut w, &mut ws);
    assert!(report.usable && report.asymmetry == 0.0, "{report:?}");
    let expected = &dense * &inverse * dense.transpose() * (h * h);
    // Sums of a few products: rounding.
    assert!((&w - &expected).amax() < 1e-15 * expected.amax(), "{w} {expected}");
    assert_eq!(w[(0, 2)], 0.0, "rows without a common node do not feel each other");

    let lambda = [1.0, -2.0, 3.0];
    let mut delta_v = vec![0.0; 12];
    assert!(correct(system, &lambda, h, &mut delta_v, &mut ws));
    let expected = &inverse * dense.transpose() * DVector::from_column_slice(&lambda) * h;
    assert!((DVector::from_vec(delta_v.clone()) - &expected).amax() < 1e-15 * expected.amax());
    assert!(!correct(system, &lambda[..2], h, &mut delta_v, &mut ws), "other rows than the last ones");
    assert!(delta_v.iter().all(|&v| v == 0.0));
}
