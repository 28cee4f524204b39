//! Conjugate gradients: convergence with exact, stale and warped factors, and what they do with bad input.
#![allow(clippy::print_stdout)] // counts are shown beside their bounds

use std::sync::Arc;

use crate::factor_bodies::{Body, Random};
use nalgebra::{Matrix3, Rotation3, Vector3};
use palpate_fem::factor::{Factor, FactorStatus, SolveWorkspace, SymbolicFactor};
use palpate_fem::pcg::{PcgConfig, PcgReport, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::{BlockJacobi, FactorPreconditioner, Preconditioner, WarpedPreconditioner};
use palpate_fem::sparse::SystemMatrix;

fn factored(body: &Body, a: &SystemMatrix) -> Factor {
    let mut factor = Factor::new(Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap()));
    assert_eq!(factor.refactor(a).status, FactorStatus::Ok);
    factor
}

fn true_residual(a: &SystemMatrix, b: &[f64], x: &[f64]) -> f64 {
    let mut ax = vec![0.0; x.len()];
    a.multiply(x, &mut ax);
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    (square(&mut b.iter().zip(&ax).map(|(b, ax)| b - ax)) / square(&mut b.iter().copied())).sqrt()
}

fn run(a: &SystemMatrix, b: &[f64], preconditioner: &mut impl Preconditioner, tolerance: f64) -> (PcgReport, Vec<f64>) {
    let mut x = vec![0.0; b.len()];
    let config = PcgConfig { relative_tolerance: tolerance, max_iterations: 2000 };
    let report = pcg(a, b, &mut x, preconditioner, config, &mut PcgWorkspace::new(b.len() / 3));
    (report, x)
}

#[test]
fn exact_factor_needs_one_iteration() {
    let body = Body::block([5, 5, 5], 1);
    let a = body.system(2);
    let factor = factored(&body, &a);
    let b = Random(3).vector(3 * body.free_nodes());
    let workspace = &mut SolveWorkspace::new(factor.symbolic());
    let (report, x) = run(&a, &b, &mut FactorPreconditioner { factor: &factor, workspace }, 1e-9);
    assert_eq!((report.status, report.iterations), (PcgStatus::Converged, 1));
    // two evaluations of a residual that is itself rounding differ by rounding
    assert!((report.relative_residual - true_residual(&a, &b, &x)).abs() < 1e-12);
}

#[test]
fn stale_factor_converges_to_the_tolerance_and_block_jacobi_later() {
    let body = Body::block([6, 6, 6], 1);
    let (old, a) = (body.system(2), body.system(7));
    let factor = factored(&body, &old);
    let b = Random(3).vector(3 * body.free_nodes());
    let workspace = &mut SolveWorkspace::new(factor.symbolic());
    let (stale, x) = run(&a, &b, &mut FactorPreconditioner { factor: &factor, workspace }, 1e-8);
    let mut jacobi = BlockJacobi::new(body.free_nodes());
    assert_eq!(jacobi.update(&a), 0);
    let (plain, y) = run(&a, &b, &mut jacobi, 1e-8);
    println!("stale factor {} iterations, block Jacobi {}", stale.iterations, plain.iterations);
    for (report, x) in [(stale, &x), (plain, &y)] {
        assert_eq!(report.status, PcgStatus::Converged);
        assert!(report.relative_residual <= 1e-8);
        assert!(true_residual(&a, &b, x) <= 1.001e-8);
    }
    assert!(1 < stale.iterations && stale.iterations < plain.iterations);
}

#[test]
fn warping_by_nodal_rotations_saves_iterations() {
    let body = Body::block([4, 4, 8], 1);
    // a twist: elements turn by up to 40 degrees about z with height; nodes carry the same rotation
    let turn = |z: f64| Rotation3::from_axis_angle(&Vector3::z_axis(), 40f64.to_radians() * z / 0.08).into_inner();
    let (old, a) = (body.system(2), body.system_turned(2, |x| turn(x.z)));
    let rotations: Vec<Matrix3<f64>> = body.positions.iter().map(|x| turn(x.z)).collect();
    let factor = factored(&body, &old);
    let b = Random(3).vector(3 * body.free_nodes());
    let workspace = &mut SolveWorkspace::new(factor.symbolic());
    let (plain, _) = run(&a, &b, &mut FactorPreconditioner { factor: &factor, workspace }, 1e-6);
    let (warped, x) =
        run(&a, &b, &mut WarpedPreconditioner { factor: &factor, rotations: &rotations, workspace }, 1e-6);
    println!("as it is {} iterations, warped {}", plain.iterations, warped.iterations);
    assert_eq!(warped.status, PcgStatus::Converged);
    assert!(true_residual(&a, &b, &x) <= 1.001e-6);
    assert!(2 * warped.iterations <= plain.iterations);
}

#[test]
fn zero_right_side_and_exact_guess_take_no_iteration() {
    let body = Body::block([3, 3, 3], 1);
    let a = body.system(2);
    let n = 3 * body.free_nodes();
    let mut jacobi = BlockJacobi::new(body.free_nodes());
    jacobi.update(&a);
    let mut workspace = PcgWorkspace::new(body.free_nodes());
    let mut x = Random(3).vector(n);
    let report = pcg(&a, &vec![0.0; n], &mut x, &mut jacobi, PcgConfig::default(), &mut workspace);
    assert_eq!(report, PcgReport { status: PcgStatus::Converged, iterations: 0, relative_residual: 0.0 });
    assert!(x.iter().all(|&v| v == 0.0));

    let guess = Random(4).vector(n);
    let mut b = vec![0.0; n];
    a.multiply(&guess, &mut b);
    let mut x = guess.clone();
    let report = pcg(&a, &b, &mut x, &mut jacobi, PcgConfig::default(), &mut workspace);
    assert_eq!((report.status, report.iterations), (PcgStatus::Converged, 0));
    assert_eq!(x, guess);
}

#[test]
fn a_good_guess_saves_iterations_and_a_bad_one_is_dropped() {
    let body = Body::block([5, 5, 5], 1);
    let a = body.system(2);
    let n = 3 * body.free_nodes();
    let b = Random(3).vector(n);
    let mut jacobi = BlockJacobi::new(body.free_nodes());
    jacobi.update(&a);
    let (cold, solution) = run(&a, &b, &mut jacobi, 1e-6);
    let mut iterations = |guess: f64| {
        let mut x: Vec<f64> = solution.iter().map(|v| v * guess).collect();
        let config = PcgConfig { relative_tolerance: 1e-6, max_iterations: 2000 };
        let report = pcg(&a, &b, &mut x, &mut jacobi, config, &mut PcgWorkspace::new(n / 3));
        assert_eq!(report.status, PcgStatus::Converged);
        report.iterations
    };
    assert!(iterations(1.001) < cold.iterations);
    assert_eq!(iterations(1e6), cold.iterations);
    assert_eq!(iterations(f64::NAN), cold.iterations);
}

#[test]
fn indefinite_matrix_and_preconditioner_are_reported_with_a_finite_iterate() {
    let body = Body::block([4, 4, 4], 1);
    let mut a = body.system(2);
    let b = Random(3).vector(3 * body.free_nodes());
    for i in (0..body.free_nodes() as u32).step_by(5) {
        let p = a.pattern.find(i, i).unwrap();
        let trace = a.blocks[p].trace();
        a.blocks[p] -= Matrix3::identity() * (3.0 * trace);
    }
    let mut jacobi = BlockJacobi::new(body.free_nodes());
    assert_eq!(jacobi.update(&a), body.free_nodes().div_ceil(5));
    let (report, x) = run(&a, &b, &mut jacobi, 1e-8);
    assert_eq!(report.status, PcgStatus::Indefinite);
    assert!(report.relative_residual.is_finite() && x.iter().all(|v| v.is_finite()));
    assert!((report.relative_residual - true_residual(&a, &b, &x)).abs() < 1e-9 * report.relative_residual);

    struct Negative;
    impl Preconditioner for Negative {
        fn apply(&mut self, r: &[f64], z: &mut [f64]) -> palpate_fem::factor::SolveStatus {
            z.iter_mut().zip(r).for_each(|(z, r)| *z = -r);
            palpate_fem::factor::SolveStatus::Ok
        }
    }
    let (report, x) = run(&body.system(2), &b, &mut Negative, 1e-8);
    assert_eq!((report.status, report.iterations), (PcgStatus::Indefinite, 0));
    assert!(x.iter().all(|&v| v == 0.0));
}

#[test]
fn numbers_that_are_not_finite_end_in_a_report() {
    let body = Body::block([3, 3, 3], 1);
    let good = body.system(2);
    let n = 3 * body.free_nodes();
    let mut jacobi = BlockJacobi::new(body.free_nodes());
    jacobi.update(&good);
    let b = Random(3).vector(n);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut a = good.clone();
        a.blocks[40][(0, 1)] = bad;
        let (report, x) = run(&a, &b, &mut jacobi, 1e-8);
        assert_eq!(report.status, PcgStatus::NonFinite);
        assert!(x.iter().all(|v| v.is_finite()));
        let mut b = b.clone();
        b[5] = bad;
        let (report, x) = run(&good, &b, &mut jacobi, 1e-8);
        assert_eq!(report.status, PcgStatus::NonFinite);
        assert!(x.iter().all(|&v| v == 0.0));
    }
}

#[test]
fn refusals_and_limits_are_reported() {
    let body = Body::block([4, 4, 4], 1);
    let a = body.system(2);
    let n = 3 * body.free_nodes();
    let b = Random(3).vector(n);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let (never, mut solve) = (Factor::new(symbolic.clone()), SolveWorkspace::new(&symbolic));
    let (report, _) = run(&a, &b, &mut FactorPreconditioner { factor: &never, workspace: &mut solve }, 1e-8);
    assert_eq!((report.status, report.iterations), (PcgStatus::PreconditionerFailed, 0));

    let mut jacobi = BlockJacobi::new(body.free_nodes());
    jacobi.update(&a);
    let mut x = vec![0.0; n];
    let mut workspace = PcgWorkspace::new(n / 3);
    let config = PcgConfig { relative_tolerance: 1e-12, max_iterations: 3 };
    let report = pcg(&a, &b, &mut x, &mut jacobi, config, &mut workspace);
    assert_eq!((report.status, report.iterations), (PcgStatus::OutOfIterations, 3));
    assert!((report.relative_residual - true_residual(&a, &b, &x)).abs() < 1e-9 * report.relative_residual);

    let report = pcg(&a, &b[1..], &mut x, &mut jacobi, config, &mut workspace);
    assert_eq!(report.status, PcgStatus::WrongSize);
}

#[test]
fn a_tolerance_below_rounding_ends_with_the_true_residual() {
    let body = Body::block([4, 4, 5], 1);
    let a = body.system(2);
    let factor = factored(&body, &a);
    let b = Random(3).vector(3 * body.free_nodes());
    let mut x = vec![0.0; b.len()];
    let workspace = &mut SolveWorkspace::new(factor.symbolic());
    let config = PcgConfig { relative_tolerance: 1e-18, max_iterations: 25 };
    let mut preconditioner = FactorPreconditioner { factor: &factor, workspace };
    let report = pcg(&a, &b, &mut x, &mut preconditioner, config, &mut PcgWorkspace::new(body.free_nodes()));
    // the recurrence alone would claim 1e-18 after two steps; rounding of A x leaves about 1e-15
    assert_eq!((report.status, report.iterations), (PcgStatus::OutOfIterations, 25));
    assert!((1e-17..1e-12).contains(&report.relative_residual), "{:e}", report.relative_residual);
    assert!((report.relative_residual - true_residual(&a, &b, &x)).abs() < 1e-15);
}

#[test]
fn iterates_have_the_same_bits_on_one_two_and_four_threads() {
    let body = Body::block([6, 6, 7], 1);
    let (old, a) = (body.system(2), body.system(7));
    let factor = factored(&body, &old);
    let b = Random(3).vector(3 * body.free_nodes());
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let workspace = &mut SolveWorkspace::new(factor.symbolic());
            run(&a, &b, &mut FactorPreconditioner { factor: &factor, workspace }, 1e-8)
        })
    };
    let one = on(1);
    assert!(one.0.iterations > 3);
    assert_eq!(one, on(2));
    assert_eq!(one, on(4));
}
