//! The factor against dense Cholesky, its reports, and what a warped factor is good for.

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, dense, factored, relative_difference};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3};
use palpate_fem::factor::{
    Factor, FactorError, FactorStatus, ReachStatus, ReachWorkspace, SolveStatus, SolveWorkspace, SymbolicFactor,
};
use palpate_fem::ordering::{NodeOrdering, approximate_minimum_degree};
use palpate_fem::preconditioner::{Preconditioner, WarpedPreconditioner, rotate};
use palpate_fem::sparse::BlockPattern;

#[test]
fn solve_agrees_with_dense_cholesky() {
    for (cells, seed) in [([1, 1, 1], 1), ([2, 3, 2], 2), ([5, 4, 6], 3), ([7, 7, 2], 4)] {
        let body = Body::block(cells, seed);
        let a = body.system(seed + 10);
        let factor = factored(&body, &a);
        let n = 3 * body.free_nodes();
        let b = Random(seed).vector(n);
        let exact = dense(&a).cholesky().unwrap().solve(&DVector::from_column_slice(&b));
        let mut x = b;
        assert!(factor.solve(&mut x, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
        // the condition number is about 1e4 here: 1e-10 leaves two digits over what it costs
        assert!(relative_difference(&x, exact.as_slice()) < 1e-10);
    }
}

#[test]
fn pivots_bound_the_spectrum() {
    let body = Body::block([3, 3, 3], 1);
    let a = body.system(2);
    let mut factor = factored(&body, &a);
    let report = factor.refactor(&a);
    let eigenvalues = dense(&a).symmetric_eigenvalues();
    // a pivot is a Schur complement: never below the smallest eigenvalue nor above the largest
    assert!(report.smallest_pivot >= eigenvalues.min() * (1.0 - 1e-10));
    assert!(report.largest_pivot <= eigenvalues.max() * (1.0 + 1e-10));
    assert!(report.smallest_pivot < report.largest_pivot);
}

#[test]
fn columns_solved_together_equal_columns_solved_alone() {
    let body = Body::block([4, 4, 4], 1);
    let factor = factored(&body, &body.system(2));
    let n = 3 * body.free_nodes();
    let together = Random(3).vector(5 * n);
    let mut alone = together.clone();
    let mut x = together;
    assert!(factor.solve_columns(&mut x, &mut SolveWorkspace::with_columns(factor.symbolic(), 8)).is_ok());
    let mut workspace = SolveWorkspace::new(factor.symbolic());
    for column in alone.chunks_exact_mut(n) {
        assert!(factor.solve(column, &mut workspace).is_ok());
    }
    assert!(relative_difference(&x, &alone) < 1e-12);
}

#[test]
fn every_ordering_gives_the_same_solution() {
    let body = Body::block([4, 3, 4], 1);
    let a = body.system(2);
    let n = body.free_nodes();
    let b = Random(3).vector(3 * n);
    let mut reference = b.clone();
    let nested = factored(&body, &a);
    assert!(nested.solve(&mut reference, &mut SolveWorkspace::new(nested.symbolic())).is_ok());
    let natural = NodeOrdering::from_elimination_order((0..n as u32).rev().collect()).unwrap();
    for ordering in [approximate_minimum_degree(&body.pattern), natural] {
        let mut factor = Factor::new(Arc::new(SymbolicFactor::with_ordering(&body.pattern, ordering).unwrap()));
        assert_eq!(factor.refactor(&a).status, FactorStatus::Ok);
        let mut x = b.clone();
        assert!(factor.solve(&mut x, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
        assert!(relative_difference(&x, &reference) < 1e-10);
    }
}

#[test]
fn refactorisation_into_used_memory_equals_a_fresh_factor_to_the_bit() {
    let body = Body::block([5, 5, 4], 1);
    let (old, new) = (body.system(2), body.system(3));
    let mut used = factored(&body, &old);
    let first = used.revision();
    let mut broken = new.clone();
    broken.blocks.iter_mut().for_each(|block| *block = -*block);
    assert_ne!(used.refactor(&broken).status, FactorStatus::Ok);
    assert_eq!(used.revision(), 0);
    let report = used.refactor(&new);
    let mut fresh = factored(&body, &new);
    assert_eq!(report, fresh.refactor(&new));
    assert!(used.revision() > first && used.revision() != fresh.revision());
    let mut x = Random(4).vector(3 * body.free_nodes());
    let mut y = x.clone();
    assert!(used.solve(&mut x, &mut SolveWorkspace::new(used.symbolic())).is_ok());
    assert!(fresh.solve(&mut y, &mut SolveWorkspace::new(fresh.symbolic())).is_ok());
    assert_eq!(x, y);
}

#[test]
fn indefinite_matrix_is_reported_at_its_node_and_every_solve_refuses() {
    let body = Body::block([4, 4, 4], 1);
    let mut a = body.system(2);
    let p = a.pattern.find(17, 17).unwrap();
    a.blocks[p][(1, 1)] = -1.0;
    let mut factor = factored(&body, &body.system(2));
    // rows can be reached before the factor breaks, and not be used after
    let rows = body.contact_rows(2, 1);
    let mut reach = ReachWorkspace::new(factor.symbolic(), 6);
    assert_eq!(factor.half_solve(&rows, &mut reach).status, ReachStatus::Ok);

    let report = factor.refactor(&a);
    assert_eq!(report.status, FactorStatus::NotPositiveDefinite { node: 17, component: 1 });
    assert_eq!((report.smallest_pivot, report.largest_pivot), (0.0, 0.0));
    assert!(!factor.is_valid());
    let before = Random(3).vector(3 * body.free_nodes());
    let mut x = before.clone();
    let status = factor.solve(&mut x, &mut SolveWorkspace::new(factor.symbolic()));
    assert_eq!(status, SolveStatus::InvalidFactor);
    assert_eq!(factor.correct(&[0.0; 6], &mut x, &mut reach), SolveStatus::InvalidFactor);
    assert_eq!(x, before);
    assert_eq!(factor.half_solve(&rows, &mut reach).status, ReachStatus::InvalidFactor);
    assert_eq!(reach.gram_into(1.0, &mut DMatrix::zeros(0, 0)), ReachStatus::InvalidFactor);
    assert_eq!(factor.refactor(&body.system(2)).status, FactorStatus::Ok);
}

#[test]
fn values_that_are_not_finite_are_reported() {
    let body = Body::block([3, 3, 3], 1);
    let good = body.system(2);
    let mut factor = factored(&body, &good);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut a = good.clone();
        let p = a.pattern.find(5, 5).unwrap();
        a.blocks[p][(2, 0)] = bad;
        assert_eq!(factor.refactor(&a).status, FactorStatus::NonFinite { node: 5 });
        assert!(!factor.is_valid());
    }
    // finite entries that overflow during the elimination
    let mut a = good.clone();
    let p = a.pattern.find(5, 5).unwrap();
    a.blocks[p] = Matrix3::new(1e-300, 1e300, 0.0, 1e300, 1e300, 0.0, 0.0, 0.0, 1e300);
    assert!(matches!(factor.refactor(&a).status, FactorStatus::NotPositiveDefinite { node: 5, .. }));
    assert!(!factor.is_valid());
}

/// A body that turned as a whole has `A = R A₀ Rᵀ`: the warped old factor is then exact, in solves and in `W`.
#[test]
fn warped_factor_is_exact_for_a_rigid_rotation() {
    let body = Body::block([4, 4, 5], 1);
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0).into_inner();
    let (rest, turned) = (body.system(2), body.system_turned(2, |_| turn));
    let (old, new) = (factored(&body, &rest), factored(&body, &turned));
    let rotations: Vec<Matrix3<f64>> = vec![turn; body.free_nodes()];
    let b = Random(3).vector(3 * body.free_nodes());

    let mut exact = b.clone();
    let mut workspace = SolveWorkspace::new(old.symbolic());
    assert!(new.solve(&mut exact, &mut workspace).is_ok());
    let mut z = vec![0.0; b.len()];
    let mut warped = WarpedPreconditioner { factor: &old, rotations: &rotations, workspace: &mut workspace };
    assert!(warped.apply(&b, &mut z).is_ok());
    assert!(relative_difference(&z, &exact) < 1e-10);

    let rows = body.contact_rows(5, 6);
    let mut rows_in_old_frame = rows.clone();
    rows_in_old_frame.map_values(|k, v| rotations[k as usize].tr_mul(&v));
    let (mut w, mut w_exact) = (DMatrix::zeros(15, 15), DMatrix::zeros(15, 15));
    let mut reach = ReachWorkspace::new(old.symbolic(), 15);
    assert_eq!(new.compliance_into(&rows, 1.0, &mut w_exact, &mut reach).status, ReachStatus::Ok);
    assert_eq!(old.compliance_into(&rows_in_old_frame, 1.0, &mut w, &mut reach).status, ReachStatus::Ok);
    assert!((&w - &w_exact).norm() < 1e-11 * w_exact.norm());

    let lambda = Random(5).vector(15);
    let mut correction = vec![0.0; b.len()];
    assert!(old.correct(&lambda, &mut correction, &mut reach).is_ok());
    rotate(&rotations, &mut correction);
    let mut exact = vec![0.0; b.len()];
    rows.add_transposed(&lambda, &mut exact);
    assert!(new.solve(&mut exact, &mut SolveWorkspace::new(new.symbolic())).is_ok());
    assert!(relative_difference(&correction, &exact) < 1e-10);
}

#[test]
fn set_up_mistakes_are_errors_that_say_what_to_do() {
    let body = Body::block([2, 2, 2], 1);
    let empty = BlockPattern::from_elements(0, &[]);
    let error = SymbolicFactor::new(&empty, &[]).unwrap_err();
    assert_eq!(error, FactorError::NoFreeNodes);
    assert!(error.to_string().contains("release"));
    let error = SymbolicFactor::new(&body.pattern, &body.positions[1..]).unwrap_err();
    assert_eq!(error, FactorError::PositionCount { positions: body.free_nodes() - 1, nodes: body.free_nodes() });
    let short = NodeOrdering::from_elimination_order(vec![0, 1]).unwrap();
    let error = SymbolicFactor::with_ordering(&body.pattern, short).unwrap_err();
    assert_eq!(error, FactorError::OrderingCount { ordered: 2, nodes: body.free_nodes() });
}

#[test]
fn factors_move_between_threads() {
    fn is_send_and_sync<T: Send + Sync>() {}
    is_send_and_sync::<Factor>();
    is_send_and_sync::<SymbolicFactor>();
    is_send_and_sync::<SolveWorkspace>();
    is_send_and_sync::<ReachWorkspace>();
}
