//! The multifrontal factor against faer's own numeric factorisation over the same supernodes, and its bits for any number
//! of threads.

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, relative_difference};
use nalgebra::Matrix3;
use palpate_fem::factor::{
    Factor, FactorStatus, LeftLookingFactor, ReachStatus, ReachWorkspace, SolveWorkspace, SymbolicFactor,
};
use palpate_fem::ordering::{NodeOrdering, approximate_minimum_degree, plane_dissection};
use palpate_fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::WarpedPreconditioner;

fn shuffled(nodes: usize, seed: u64) -> NodeOrdering {
    let mut random = Random(seed);
    let mut order: Vec<u32> = (0..nodes as u32).collect();
    (1..nodes).rev().for_each(|i| order.swap(i, random.below(i + 1)));
    NodeOrdering::from_elimination_order(order).unwrap()
}

#[test]
fn equals_the_left_looking_factor_for_any_ordering() {
    // one and several panels in the root front, split and unsplit trees, one node
    for (cells, seed) in [([1, 1, 1], 1), ([4, 3, 5], 2), ([9, 9, 8], 3), ([40, 2, 2], 4)] {
        let body = Body::block(cells, seed);
        let a = body.system(seed);
        let orderings = [
            palpate_fem::ordering::nested_dissection(&body.pattern, &body.positions),
            plane_dissection(&body.pattern, &body.positions),
            approximate_minimum_degree(&body.pattern),
            shuffled(body.free_nodes(), seed),
        ];
        for (k, ordering) in orderings.into_iter().enumerate() {
            let symbolic = Arc::new(SymbolicFactor::with_ordering(&body.pattern, ordering).unwrap());
            let mut yardstick = LeftLookingFactor::new(symbolic.clone(), &a).unwrap();
            let mut factor = Factor::new(symbolic);
            assert_eq!(yardstick.refactor(&a), FactorStatus::Ok);
            assert_eq!(factor.refactor(&a).status, FactorStatus::Ok);
            // both are backward stable; their difference is rounding times the condition of the leading blocks
            let difference = yardstick.difference(&factor);
            assert!(difference < 1e-12, "{cells:?}, ordering {k}: {difference:e}");
        }
    }
}

#[test]
fn the_first_bad_pivot_is_named_as_by_the_left_looking_factor() {
    let body = Body::block([9, 8, 8], 5);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let good = body.system(6);
    let mut factor = Factor::new(symbolic.clone());
    let mut random = Random(7);
    for _ in 0..20 {
        let mut a = good.clone();
        for _ in 0..3 {
            let node = random.below(body.free_nodes()) as u32;
            a.blocks[body.pattern.find(node, node).unwrap()] *= 0.2;
        }
        let expected = LeftLookingFactor::new(symbolic.clone(), &a).unwrap().refactor(&a);
        assert_eq!(factor.refactor(&a).status, expected);
        assert!(matches!(expected, FactorStatus::NotPositiveDefinite { .. }), "{expected:?}: the test tests nothing");
        assert!(!factor.is_valid());
    }
    assert_eq!(factor.refactor(&good).status, FactorStatus::Ok);
}

#[test]
fn same_bits_for_any_number_of_threads() {
    // large enough that the root front has products and panels of several tasks
    let body = Body::block([17, 15, 15], 8);
    let a = body.system(9);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let b = Random(10).vector(3 * body.free_nodes());
    let bits = |threads: Option<usize>| {
        let run = || {
            let mut factor = Factor::with_packed_copy(symbolic.clone());
            let report = factor.refactor(&a);
            assert_eq!(report.status, FactorStatus::Ok);
            let (mut x, mut y) = (b.clone(), b.clone());
            let mut workspace = SolveWorkspace::new(&symbolic);
            assert!(factor.solve(&mut x, &mut workspace).is_ok());
            assert!(factor.precondition(&mut y, &mut workspace).is_ok());
            let pivots = [report.smallest_pivot, report.largest_pivot];
            x.into_iter().chain(y).chain(pivots).map(f64::to_bits).collect::<Vec<u64>>()
        };
        match threads {
            None => run(),
            Some(n) => rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(run),
        }
    };
    let outside = bits(None);
    for threads in [1, 2, 4] {
        assert_eq!(bits(Some(threads)), outside, "{threads} threads");
    }
}

#[test]
fn a_copy_in_16_bits_costs_no_iterations() {
    // stiffness ratio 10 within the body; the factor is of a matrix with other stiffnesses
    let body = Body::block([10, 9, 9], 11);
    let (old, new) = (body.system(12), body.system(13));
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let b = Random(14).vector(3 * body.free_nodes());
    let rotations = vec![Matrix3::identity(); body.free_nodes()];
    let mut workspace = SolveWorkspace::new(&symbolic);
    let mut solve = |mut factor: Factor| {
        assert_eq!(factor.refactor(&old).status, FactorStatus::Ok);
        let mut x = vec![0.0; b.len()];
        let mut direct = b.clone();
        assert!(factor.precondition(&mut direct, &mut workspace).is_ok());
        let mut preconditioner =
            WarpedPreconditioner { factor: &factor, rotations: &rotations, workspace: &mut workspace };
        let config = PcgConfig { relative_tolerance: 1e-9, max_iterations: 200 };
        let report = pcg(&new, &b, &mut x, &mut preconditioner, config, &mut PcgWorkspace::new(body.free_nodes()));
        assert_eq!(report.status, PcgStatus::Converged);
        (report.iterations, x, direct)
    };
    let (double, x, exact) = solve(Factor::new(symbolic.clone()));
    let (packed, y, rounded) = solve(Factor::with_packed_copy(symbolic.clone()));
    assert!(double > 5, "{double} iterations: the two matrices are too alike");
    assert!(packed.abs_diff(double) <= 1, "{packed} iterations instead of {double}");
    // residuals of 1e-9 times the condition of A, some 1e3
    assert!(relative_difference(&y, &x) < 1e-6);
    // rounding of L by 1.5e-5 of a column's largest number, times the condition of L; and it is the copy that was used
    let difference = relative_difference(&rounded, &exact);
    assert!((1e-7..5e-4).contains(&difference), "{difference:e}");
}

#[test]
fn the_copy_in_16_bits_solves_as_the_factor_for_any_shape_of_front() {
    // one node; fronts whose columns and rows are no multiples of eight; a root front of one and of several panels
    for (cells, seed) in [([1, 1, 1], 18), ([2, 1, 1], 19), ([4, 3, 5], 20), ([40, 2, 2], 21), ([17, 15, 15], 22)] {
        let body = Body::block(cells, seed);
        let a = body.system(seed);
        for ordering in [
            palpate_fem::ordering::nested_dissection(&body.pattern, &body.positions),
            approximate_minimum_degree(&body.pattern),
        ] {
            let symbolic = Arc::new(SymbolicFactor::with_ordering(&body.pattern, ordering).unwrap());
            let mut factor = Factor::with_packed_copy(symbolic.clone());
            assert_eq!(factor.refactor(&a).status, FactorStatus::Ok);
            let b = Random(seed).vector(3 * body.free_nodes());
            let (mut x, mut y) = (b.clone(), b.clone());
            let mut workspace = SolveWorkspace::new(&symbolic);
            // what an earlier solve leaves in the workspace must not matter
            let mut other = vec![1e30; b.len()];
            assert!(factor.precondition(&mut other, &mut workspace).is_ok());
            assert!(factor.solve(&mut x, &mut workspace).is_ok());
            assert!(factor.precondition(&mut y, &mut workspace).is_ok());
            // rounding of L by 1.5e-5 of a column's largest number, times the condition of L, the root of that of A of some 1e3
            let difference = relative_difference(&y, &x);
            assert!(difference < 5e-4, "{cells:?}: {difference:e}");
        }
    }
}

#[test]
fn numbers_beyond_single_precision_are_solved_for_all_the_same() {
    let body = Body::block([3, 3, 3], 23);
    let mut a = body.system(24);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let mut workspace = SolveWorkspace::new(&symbolic);
    let mut solve = |a: &palpate_fem::sparse::SystemMatrix, b: &[f64]| {
        let mut factor = Factor::with_packed_copy(symbolic.clone());
        assert_eq!(factor.refactor(a).status, FactorStatus::Ok);
        let (mut x, mut y) = (b.to_vec(), b.to_vec());
        assert!(factor.solve(&mut x, &mut workspace).is_ok());
        assert!(factor.precondition(&mut y, &mut workspace).is_ok());
        (x, y)
    };
    // right-hand sides that single precision does not reach, and none
    for size in [1e-100, 1e-45, 1.0, 1e45, 1e100] {
        let b: Vec<f64> = Random(25).vector(3 * body.free_nodes()).iter().map(|b| b * size).collect();
        let (x, y) = solve(&a, &b);
        let difference = relative_difference(&y, &x);
        assert!((1e-7..5e-4).contains(&difference), "{size:e}: {difference:e}");
    }
    assert!(solve(&a, &vec![0.0; 3 * body.free_nodes()]).1.iter().all(|y| *y == 0.0));
    // what is not finite stays so
    let mut b = Random(25).vector(3 * body.free_nodes());
    b[4] = f64::NAN;
    assert!(solve(&a, &b).1.iter().any(|y| y.is_nan()));
    // a factor whose copy is not sound is the factor itself
    a.blocks.iter_mut().for_each(|block| *block *= 1e-30);
    let (x, y) = solve(&a, &Random(25).vector(3 * body.free_nodes()));
    assert_eq!(x, y);
}

#[test]
fn a_copy_that_would_overflow_is_not_used() {
    let body = Body::block([3, 3, 3], 15);
    let mut a = body.system(16);
    a.blocks.iter_mut().for_each(|block| *block *= 1e90);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let mut factor = Factor::with_packed_copy(symbolic.clone());
    let report = factor.refactor(&a);
    assert_eq!((report.status, report.copy_refused), (FactorStatus::Ok, true));
    let b = Random(17).vector(3 * body.free_nodes());
    let (mut x, mut y) = (b.clone(), b);
    let mut workspace = SolveWorkspace::new(&symbolic);
    assert!(factor.solve(&mut x, &mut workspace).is_ok());
    assert_eq!(workspace.take_in_full(), 0, "no copy was asked for");
    assert!(factor.precondition(&mut y, &mut workspace).is_ok());
    assert_eq!(x, y);
    assert_eq!([workspace.take_in_full(), workspace.take_in_full()], [1, 0]);
    // the first correction that begins an iteration as well
    let rows = body.contact_rows(4, 18);
    let mut reach = ReachWorkspace::new(&symbolic, 12);
    assert_eq!(factor.half_solve(&rows, &mut reach).status, ReachStatus::Ok);
    assert!(factor.guess_correction(&vec![1.0; rows.len()], &mut x, &mut reach).is_ok());
    assert!(factor.correct(&vec![1.0; rows.len()], &mut y, &mut reach).is_ok());
    assert_eq!((x == y, reach.take_in_full()), (true, 1));
    // a copy that serves is used, and a factor without one is not asked for it
    a.blocks.iter_mut().for_each(|block| *block *= 1e-90);
    let mut plain = Factor::new(symbolic);
    for factor in [&mut factor, &mut plain] {
        let report = factor.refactor(&a);
        assert_eq!((report.status, report.copy_refused), (FactorStatus::Ok, false));
        assert!(factor.precondition(&mut x, &mut workspace).is_ok());
        assert_eq!(workspace.take_in_full(), 0);
    }
}
