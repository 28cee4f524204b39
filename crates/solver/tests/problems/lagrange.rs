//! Lagrange multipliers over a body against the same problem with the body eliminated, and what they cannot take.
#![allow(clippy::print_stdout, non_snake_case)]

use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Bilateral, Coulomb, Law, Signorini, Tresca};
use palpate_solver::lagrange::{LagrangeConfig, LagrangeProblem, LagrangeWorkspace, gaps, solve, solve_watched};
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::report::SolveStatus;
use palpate_solver::residual;
use palpate_solver::solver::Solver;
use palpate_solver::watch::Watch;

const DT: f64 = 1.0 / 30.0;

/// A chain of `n` masses of 1 to 2 kg on springs along three axes, each tied to the ground.
fn chain(n: usize) -> DMatrix<f64> {
    DMatrix::from_fn(3 * n, 3 * n, |i, j| match i.abs_diff(j) {
        0 => 1.0 + (i % 7) as f64 / 7.0 + 2.5,
        1 => 0.2,
        3 => -0.9,
        _ => 0.0,
    })
}

/// The upper triangle by columns.
fn columns(A: &DMatrix<f64>) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let (mut start, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for j in 0..A.ncols() {
        for i in (0..=j).filter(|&i| A[(i, j)] != 0.0) {
            row.push(i);
            value.push(A[(i, j)]);
        }
        start.push(row.len());
    }
    (start, row, value)
}

/// Laws on masses 0, 2, 4, ...: rows along the axes, turned a little so that they couple.
fn case(laws: &[Law], scale: f64) -> (DMatrix<f64>, DMatrix<f64>, ConstraintProblem) {
    let n = 2 * laws.len() + 1;
    let A = chain(n) * scale;
    let rows: usize = laws.iter().map(Law::rows).sum();
    let mut H = DMatrix::zeros(rows, 3 * n);
    let mut free = DVector::zeros(rows);
    let mut row = 0;
    for (k, law) in laws.iter().enumerate() {
        for axis in 0..law.rows() {
            H[(row, 6 * k + axis)] = 0.8;
            H[(row, 6 * k + (axis + 1) % 3)] = 0.6 - 0.1 * axis as f64;
            H[(row, 6 * k + 3 + axis)] = 0.1;
            // Most contacts press, one is open; tangents slip by as much and less.
            free[row] = if axis > 0 {
                1e-3 * (k as f64 - 1.5)
            } else if k == 1 {
                4e-3
            } else {
                -2e-3
            };
            row += 1;
        }
    }
    let inverse = A.clone().cholesky().unwrap().inverse();
    let W = &H * inverse * H.transpose() * (DT * DT);
    let problem = ConstraintProblem::new((&W + W.transpose()) * 0.5, free, laws.to_vec()).unwrap();
    (A, H, problem)
}

/// Forces agree with those of the eliminated problem and balance the motion, at any scale of the body.
#[test]
fn multipliers_are_the_forces_of_the_eliminated_problem() {
    let coulomb = |friction| Law::from(Coulomb { friction });
    let sets: [(&str, Vec<Law>); 4] = [
        ("frictionless", vec![Signorini.into(); 5]),
        ("friction", vec![coulomb(0.3), coulomb(0.8), coulomb(0.1), coulomb(0.5)]),
        ("all that have a cone", vec![coulomb(0.4), Signorini.into(), Bilateral { rows: 3 }.into(), coulomb(0.0)]),
        ("closed rows", vec![Bilateral { rows: 1 }.into(), Bilateral { rows: 3 }.into()]),
    ];
    for scale in [1e-3, 1.0, 1e4] {
        for (name, laws) in &sets {
            let (A, H, problem) = case(laws, scale);
            let (column_start, row, value) = columns(&A);
            let entries = (0..H.nrows()).flat_map(|r| (0..H.ncols()).map(move |c| (r, c)));
            let jacobian: Vec<_> = entries.map(|(r, c)| (r, c, H[(r, c)])).filter(|(_, _, v)| *v != 0.0).collect();
            let view = problem.view();
            let direct = LagrangeProblem {
                column_start: &column_start,
                row: &row,
                value: &value,
                jacobian: &jacobian,
                dt: DT,
                view,
            };
            let (mut w, mut lambda) = (vec![0.0; A.nrows()], vec![0.0; problem.rows()]);
            let config = LagrangeConfig { tolerance: 1e-7, ..LagrangeConfig::default() };
            let report = solve(&direct, &config, &mut w, &mut lambda, &mut LagrangeWorkspace::default());
            assert_eq!(report.status, SolveStatus::Solved, "{name}, {scale}: {report:?}");

            let solver = Solver::from_name("automatic").unwrap().limited(1e-10, None);
            let mut expected = vec![0.0; problem.rows()];
            let reference = solver.solve(&view, &mut expected, &mut solver.workspace(problem.rows()));
            assert!(reference.is_solved(), "{name}, {scale}: {reference:?}");
            let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let away: Vec<f64> = lambda.iter().zip(&expected).map(|(a, b)| a - b).collect();
            let force = norm(&away) / norm(&expected);

            // The balance that makes multipliers forces: A w = h Hᵀ λ.
            let pull = H.transpose() * DVector::from_column_slice(&lambda) * DT;
            let balance = (&A * DVector::from_column_slice(&w) - &pull).norm() / pull.norm();
            // The motion's gaps and those of the compliance are judged alike.
            let mut delta = vec![0.0; problem.rows()];
            gaps(&direct, &w, &mut delta);
            let judged = residual::evaluate(&view, &lambda, &mut vec![0.0; problem.rows()]).relative;
            println!(
                "{name}, {scale}: {} iterations, force off by {force:.1e}, balance {balance:.1e}, residual {:.1e} and {judged:.1e}",
                report.iterations, report.residual
            );
            assert!(force < 1e-5 && balance < 1e-7 && judged < 1e-6, "{name}, {scale}");
        }
    }
}

#[test]
fn what_has_no_place_in_the_program_is_a_status() {
    let (A, H, problem) = case(&[Signorini.into(), Tresca { limit: 1.0 }.into()], 1.0);
    let (column_start, row, mut value) = columns(&A);
    let jacobian: Vec<_> = (0..H.nrows()).map(|r| (r, r, 1.0)).collect();
    let run = |value: &[f64], jacobian: &[(usize, usize, f64)], problem: &ConstraintProblem| {
        let view = problem.view();
        let direct = LagrangeProblem { column_start: &column_start, row: &row, value, jacobian, dt: DT, view };
        let (mut w, mut lambda) = (vec![1.0; A.nrows()], vec![1.0; problem.rows()]);
        let report = solve(&direct, &LagrangeConfig::default(), &mut w, &mut lambda, &mut LagrangeWorkspace::default());
        assert!(w.iter().chain(&lambda).all(|x| *x == 0.0), "{report:?}");
        report.status
    };
    assert_eq!(run(&value, &jacobian, &problem), SolveStatus::Unsupported);
    let (_, _, sound) = case(&[Signorini.into(); 2], 1.0);
    assert_eq!(run(&value, &[(7, 0, 1.0)], &sound), SolveStatus::Invalid);
    value[0] = f64::NAN;
    assert_eq!(run(&value, &[(0, 0, 1.0)], &sound), SolveStatus::NotFinite);
}

/// Without time there is neither program nor force, and what a workspace holds is used afterwards as if nothing had been;
/// with time enough a limit changes no bit, and the record has an entry for each program.
#[test]
fn a_limit_of_time_is_obeyed_between_factorisations() {
    for law in [Law::from(Signorini), Law::from(Coulomb { friction: 0.4 })] {
        let (A, H, problem) = case(&[law; 3], 1.0);
        let (column_start, row, value) = columns(&A);
        let entries = (0..H.nrows()).flat_map(|r| (0..H.ncols()).map(move |c| (r, c)));
        let jacobian: Vec<_> = entries.map(|(r, c)| (r, c, H[(r, c)])).filter(|(_, _, v)| *v != 0.0).collect();
        let (column_start, row, value) = (column_start.as_slice(), row.as_slice(), value.as_slice());
        let direct = LagrangeProblem { column_start, row, value, jacobian: &jacobian, dt: DT, view: problem.view() };
        let (config, mut ws) = (LagrangeConfig::default(), LagrangeWorkspace::default());
        let mut run = |watch: &mut Watch<'_>| {
            let (mut w, mut lambda) = (vec![1.0; A.nrows()], vec![1.0; problem.rows()]);
            (solve_watched(&direct, &config, &mut w, &mut lambda, &mut ws, watch), w, lambda)
        };
        let free = run(&mut Watch::none());
        assert!(free.0.is_solved() && free.0.iterations > 0, "{:?}", free.0);
        let late = run(&mut Watch::none().limit(0.0));
        assert_eq!((late.0.status, late.0.iterations), (SolveStatus::TimeLimit, 0));
        assert!(late.1.iter().chain(&late.2).all(|x| *x == 0.0), "{late:?}");
        // An hour.
        let mut samples = Vec::with_capacity(200);
        assert_eq!(run(&mut Watch::none().limit(3600.0).record(&mut samples)), free);
        assert!(samples.is_sorted_by(|a, b| a.iteration < b.iteration), "{samples:?}");
        assert_eq!(samples.last().map(|sample| sample.iteration), Some(free.0.iterations));
        assert!(samples.len() == 1 || !law.is_associated(), "one program without friction: {samples:?}");
    }
}
