//! A symbolic factor serves the pattern that it was made for, and no other of the same size.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use palpate_fem::factor::{Factor, FactorStatus, SymbolicFactor};
use palpate_fem::sparse::{BlockPattern, SystemMatrix};

#[test]
fn a_matrix_of_another_pattern_with_as_many_blocks_is_refused() {
    let positions: Vec<_> = (0..5).map(|k| Vector3::new(f64::from(k), f64::from(k * k), 0.0)).collect();
    let matrix = |elements: &[[u32; 4]]| {
        let mut a = SystemMatrix::zeros(Arc::new(BlockPattern::from_elements(5, elements)));
        let (rows, pattern) = (a.pattern.rows(), Arc::clone(&a.pattern));
        (0..rows as u32).filter_map(|i| pattern.find(i, i)).for_each(|p| a.blocks[p] = Matrix3::identity());
        a
    };
    // Nodes 0 and 4 are apart in one, 1 and 4 in the other.
    let (a, b) = (matrix(&[[0, 1, 2, 3], [1, 2, 3, 4]]), matrix(&[[0, 1, 2, 3], [0, 2, 3, 4]]));
    assert_eq!(a.pattern.blocks(), b.pattern.blocks());
    let mut factor = Factor::new(Arc::new(SymbolicFactor::new(&a.pattern, &positions).unwrap()));
    assert_eq!(factor.refactor(&a).status, FactorStatus::Ok);
    let revision = factor.revision();
    assert_eq!(factor.refactor(&b).status, FactorStatus::OtherPattern);
    assert_eq!(factor.revision(), revision, "the factor of the right one is kept");
}
