//! Factors that are computed in single precision: how far they are from those in double, and that matrices which single
//! precision does not suffice for are factored in double.

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, relative_difference};
use nalgebra::{DMatrix, Matrix3};
use palpate_fem::factor::{
    Factor, FactorPrecision, FactorReport, FactorStatus, ReachWorkspace, SolveWorkspace, SymbolicFactor,
};
use palpate_fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::WarpedPreconditioner;
use palpate_fem::sparse::SystemMatrix;

fn symbolic(body: &Body) -> Arc<SymbolicFactor> {
    Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap())
}

/// A factor of `a` computed in this precision, with a copy in 16 bits.
fn factored(symbolic: &Arc<SymbolicFactor>, a: &SystemMatrix, precision: FactorPrecision) -> (Factor, FactorReport) {
    let mut factor = Factor::with_packed_copy(symbolic.clone()).computed_in(precision);
    let report = factor.refactor(a);
    (factor, report)
}

fn solved(factor: &Factor, b: &[f64]) -> Vec<f64> {
    let mut x = b.to_vec();
    assert!(factor.solve(&mut x, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
    x
}

#[test]
fn solves_and_compliances_differ_by_rounding_in_single_precision() {
    // fronts without a panel below, of several panels, and cut into tasks
    for (cells, seed) in [([1, 1, 1], 1), ([4, 3, 5], 2), ([40, 2, 2], 3), ([13, 13, 12], 4)] {
        let body = Body::block(cells, seed);
        let (symbolic, a) = (symbolic(&body), body.system(seed));
        let (double, exact) = factored(&symbolic, &a, FactorPrecision::Double);
        let (single, report) = factored(&symbolic, &a, FactorPrecision::Single);
        assert_eq!((exact.status, exact.precision), (FactorStatus::Ok, FactorPrecision::Double));
        assert_eq!((report.status, report.precision), (FactorStatus::Ok, FactorPrecision::Single));
        assert!((report.smallest_pivot / exact.smallest_pivot - 1.0).abs() < 1e-3, "{report:?}");

        // rounding by 6e-8 times the condition of A, some 1e3; and it is single precision that was computed with
        let b = Random(seed).vector(3 * body.free_nodes());
        let difference = relative_difference(&solved(&single, &b), &solved(&double, &b));
        assert!((1e-9..1e-4).contains(&difference), "{cells:?}: solve {difference:e}");
        let rows = body.contact_rows(3, seed);
        let compliance = |factor: &Factor| {
            let mut w = DMatrix::zeros(rows.len(), rows.len());
            let _ = factor.compliance_into(&rows, 1.0, &mut w, &mut ReachWorkspace::new(&symbolic, rows.len()));
            w
        };
        let (w, exact) = (compliance(&single), compliance(&double));
        let difference = (&w - &exact).norm() / exact.norm();
        assert!(exact.norm() > 0.0 && difference < 1e-4, "{cells:?}: W {difference:e}");
    }
}

#[test]
fn a_preconditioner_computed_in_single_precision_costs_no_iterations() {
    // stiffness ratio 10 within the body; the factor is of a matrix with other stiffnesses
    let body = Body::block([10, 9, 9], 11);
    let (old, new) = (body.system(12), body.system(13));
    let symbolic = symbolic(&body);
    let b = Random(14).vector(3 * body.free_nodes());
    let rotations = vec![Matrix3::identity(); body.free_nodes()];
    let iterations = |precision| {
        let (factor, report) = factored(&symbolic, &old, precision);
        assert_eq!((report.status, report.precision), (FactorStatus::Ok, precision));
        let (mut x, mut workspace) = (vec![0.0; b.len()], SolveWorkspace::new(&symbolic));
        let mut preconditioner =
            WarpedPreconditioner { factor: &factor, rotations: &rotations, workspace: &mut workspace };
        let config = PcgConfig { relative_tolerance: 1e-9, max_iterations: 200 };
        let report = pcg(&new, &b, &mut x, &mut preconditioner, config, &mut PcgWorkspace::new(body.free_nodes()));
        assert_eq!(report.status, PcgStatus::Converged);
        report.iterations
    };
    let [double, single] = [FactorPrecision::Double, FactorPrecision::Single].map(iterations);
    assert!(double > 5, "{double} iterations: the two matrices are too alike");
    assert!(single.abs_diff(double) <= 1, "{single} iterations instead of {double}");
}

#[test]
fn a_matrix_beyond_single_precision_is_factored_in_double() {
    let body = Body::block([5, 4, 4], 21);
    let symbolic = symbolic(&body);
    let good = body.system(22);
    let b = Random(23).vector(3 * body.free_nodes());
    // a pivot that is left with 1e-5 of the diagonal: what its neighbours hold is all but all that holds the last node
    let nearly_singular = {
        let mut a = good.clone();
        let (factor, _) = factored(&symbolic, &good, FactorPrecision::Double);
        let mut unit = vec![0.0; b.len()];
        unit[0] = 1.0;
        // A - c e eᵀ is singular where c = 1 / (A⁻¹)₀₀
        a.blocks[body.pattern.find(0, 0).unwrap()][(0, 0)] -= (1.0 - 1e-7) / solved(&factor, &unit)[0];
        a
    };
    let scaled = |scale: f64| {
        let mut a = good.clone();
        a.blocks.iter_mut().for_each(|block| *block *= scale);
        a
    };
    for a in [nearly_singular, scaled(1e-45), scaled(1e-30), scaled(1e30), scaled(1e60)] {
        let (double, exact) = factored(&symbolic, &a, FactorPrecision::Double);
        let (single, report) = factored(&symbolic, &a, FactorPrecision::Single);
        assert_eq!(report, exact, "and says so");
        assert_eq!((report.status, report.precision), (FactorStatus::Ok, FactorPrecision::Double));
        assert_eq!(solved(&single, &b), solved(&double, &b));
    }
    // by a power of two nothing is rounded otherwise, so what decides is the matrix and not its unit
    let (reference, _) = factored(&symbolic, &good, FactorPrecision::Single);
    let (other, report) = factored(&symbolic, &scaled(2f64.powi(-40)), FactorPrecision::Single);
    assert_eq!(report.precision, FactorPrecision::Single);
    let x: Vec<f64> = solved(&other, &b).iter().map(|x| x * 2f64.powi(-40)).collect();
    assert_eq!(x, solved(&reference, &b));
}

#[test]
fn faults_are_reported_as_in_double_precision() {
    let body = Body::block([5, 4, 4], 31);
    let symbolic = symbolic(&body);
    let good = body.system(32);
    let mut random = Random(33);
    for kind in 0..10 {
        let mut a = good.clone();
        let node = random.below(body.free_nodes()) as u32;
        let place = body.pattern.find(node, node).unwrap();
        if kind % 2 == 0 {
            a.blocks[place] *= 0.1;
        } else {
            a.blocks[place][(1, 1)] = [f64::NAN, f64::INFINITY][kind / 2 % 2];
        }
        let (_, exact) = factored(&symbolic, &a, FactorPrecision::Double);
        let (factor, report) = factored(&symbolic, &a, FactorPrecision::Single);
        assert_ne!(exact.status, FactorStatus::Ok, "the test tests nothing");
        assert_eq!(report, exact);
        assert!(!factor.is_valid());
    }
}

#[test]
fn single_precision_gives_the_same_bits_for_any_number_of_threads_and_whatever_came_before() {
    let body = Body::block([13, 13, 12], 41);
    let (symbolic, a, other) = (symbolic(&body), body.system(42), body.system(43));
    let b = Random(44).vector(3 * body.free_nodes());
    let bits = |before: Option<FactorPrecision>| {
        let mut factor = Factor::with_packed_copy(symbolic.clone());
        if let Some(precision) = before {
            factor = factor.computed_in(precision);
            assert_eq!(factor.refactor(&other).status, FactorStatus::Ok);
        }
        let mut factor = factor.computed_in(FactorPrecision::Single);
        assert_eq!(factor.refactor(&a).precision, FactorPrecision::Single);
        let x = solved(&factor, &b);
        // a copy of it refactors as it does
        let mut copy = factor.clone();
        assert_eq!(copy.refactor(&a).precision, FactorPrecision::Single);
        assert_eq!(solved(&copy, &b), x);
        x
    };
    let outside = bits(None);
    assert_eq!(bits(Some(FactorPrecision::Single)), outside);
    assert_eq!(bits(Some(FactorPrecision::Double)), outside);
    for threads in [1, 2, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| bits(None)), outside, "{threads} threads");
    }
}
