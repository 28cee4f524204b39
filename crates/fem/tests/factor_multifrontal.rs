//! The multifrontal factor against faer's own numeric factorisation over the same supernodes, and its bits for any number
//! of threads.

mod factor_bodies;

use std::sync::Arc;

use factor_bodies::{Body, Random};
use palpate_fem::factor::{Factor, FactorStatus, LeftLookingFactor, SolveWorkspace, SymbolicFactor};
use palpate_fem::ordering::{NodeOrdering, approximate_minimum_degree, plane_dissection};

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
    let body = Body::block([14, 13, 12], 8);
    let a = body.system(9);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let b = Random(10).vector(3 * body.free_nodes());
    let bits = |threads: Option<usize>| {
        let run = || {
            let mut factor = Factor::new(symbolic.clone());
            let report = factor.refactor(&a);
            assert_eq!(report.status, FactorStatus::Ok);
            let mut x = b.clone();
            assert!(factor.solve(&mut x, &mut SolveWorkspace::new(&symbolic)).is_ok());
            let pivots = [report.smallest_pivot, report.largest_pivot];
            x.into_iter().chain(pivots).map(f64::to_bits).collect::<Vec<u64>>()
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
