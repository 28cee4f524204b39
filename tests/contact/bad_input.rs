//! Problems that no compliance gives, handed to every solver through the API: forces stay finite and admissible, the status
//! says what happened, and the check before names the row.

use nalgebra::{DMatrix, DVector};
use palpate::constraints::law::{Bilateral, Coulomb, Law, Signorini, Threshold};
use palpate::solver::problem::ConstraintProblem;
use palpate::solver::report::{SolveReport, SolveStatus};
use palpate::solver::solver::Solver;

fn problem(w: &[f64], free: &[f64], laws: &[Law]) -> ConstraintProblem {
    let n = free.len();
    ConstraintProblem::new(DMatrix::from_row_slice(n, n, w), DVector::from_column_slice(free), laws.to_vec()).unwrap()
}

/// Every solver's report and forces; these are finite and no contact pulls.
fn reports(problem: &ConstraintProblem) -> Vec<(&'static str, SolveReport, Vec<f64>)> {
    let solve = |name: &&'static str| {
        let solver = Solver::from_name(name).unwrap().limited(1e-8, Some(300));
        let mut lambda = vec![0.0; problem.rows()];
        let report = solver.solve(&problem.view(), &mut lambda, &mut solver.workspace(problem.rows()));
        assert!(lambda.iter().all(|l| l.is_finite()), "{name}: {lambda:?}");
        for block in problem.blocks().iter().filter(|block| block.law.name() != "bilateral") {
            assert!(lambda[block.start] >= 0.0, "{name}: {lambda:?}");
        }
        assert_eq!(report.is_solved(), report.residual <= 1e-8, "{name}: {report:?}");
        (*name, report, lambda)
    };
    Solver::NAMES.iter().map(solve).collect()
}

fn contacts(n: usize) -> Vec<Law> {
    vec![Signorini.into(); n]
}

#[test]
fn asymmetry_and_indefiniteness_are_named_and_survived() {
    for (w, words) in [
        ([2.0, 0.5, 1.0, 2.0], &["W[0, 1]", "W[1, 0]"][..]),
        ([1.0, 2.0, 2.0, 1.0], &["W[0, 1] = 2"]),
        ([1.0, 0.0, 0.0, -1.0], &["W[1, 1] = -1"]),
    ] {
        let problem = problem(&w, &[-1.0, -1.0], &contacts(2));
        let told = problem.validate().unwrap_err().to_string();
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
        for (name, report, _) in reports(&problem) {
            let told = report.explain(&problem);
            assert!(words.iter().all(|word| told.contains(word)), "{name}, {:?}: {told}", report.status);
        }
    }
}

#[test]
fn numbers_that_are_not_finite_end_as_such_with_zero_force() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let in_w = problem(&[1.0, bad, bad, 1.0], &[-1.0, -1.0], &contacts(2));
        assert!(in_w.validate().unwrap_err().to_string().contains("W["));
        let in_gap = problem(&[1.0, 0.0, 0.0, 1.0], &[-1.0, bad], &contacts(2));
        assert!(in_gap.validate().unwrap_err().to_string().contains("delta_free[1]"));
        for (name, report, lambda) in reports(&in_w).into_iter().chain(reports(&in_gap)) {
            assert_eq!(report.status, SolveStatus::NotFinite, "{name}, {bad}: {report:?}");
            assert!(lambda == [0.0; 2] && report.residual == f64::INFINITY, "{name}, {bad}: {lambda:?}");
        }
    }
}

/// A law whose parameter is out of its range gives no force by mistake: no solver begins, and the row is named.
#[test]
fn laws_out_of_their_range_are_refused_by_every_solver_and_named() {
    let w: Vec<f64> = (0..9).map(|k| if k % 4 == 0 { 1.0 } else { 0.0 }).collect();
    let coulomb = |friction| problem(&w, &[-1.0, 0.5, 0.0], &[Coulomb { friction }.into()]);
    let threshold = |limit| problem(&[1.0, 0.0, 0.0, 1.0], &[-1.0; 2], &[Signorini.into(), Threshold { limit }.into()]);
    for (problem, words) in [
        (coulomb(-0.3), ["block 0", "rows from 0", "friction = -0.3"]),
        (coulomb(f64::NAN), ["block 0", "rows from 0", "friction = NaN"]),
        (coulomb(f64::INFINITY), ["block 0", "rows from 0", "friction = inf"]),
        (threshold(-1.0), ["block 1", "rows from 1", "limit = -1"]),
        (threshold(f64::NAN), ["block 1", "rows from 1", "limit = NaN"]),
    ] {
        let told = problem.validate().unwrap_err().to_string();
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
        for (name, report, lambda) in reports(&problem) {
            assert_eq!(report.status, SolveStatus::Invalid, "{name}: {report:?}");
            assert!(lambda.iter().all(|l| *l == 0.0) && report.residual == f64::INFINITY, "{name}: {lambda:?}");
            let told = report.explain(&problem);
            assert!(words.iter().all(|word| told.contains(word)), "{name}: {told}");
        }
    }
}

#[test]
fn sizes_that_disagree_are_refused_before_there_is_a_problem() {
    let w = DMatrix::identity(2, 3);
    let told = ConstraintProblem::new(w, DVector::zeros(2), contacts(2)).unwrap_err().to_string();
    assert!(told.contains("2 x 3") && told.contains("2 rows"), "{told}");
    let told = ConstraintProblem::new(DMatrix::identity(2, 2), DVector::zeros(2), contacts(1)).unwrap_err().to_string();
    assert!(told.contains("rows 1..2"), "{told}");
    let told = ConstraintProblem::new(DMatrix::identity(2, 2), DVector::zeros(2), contacts(3)).unwrap_err().to_string();
    assert!(told.contains("block 2"), "{told}");
}

/// Two closed rows on one motion that want two gaps.
#[test]
fn closed_rows_that_conflict_are_not_solved_and_named() {
    let closed = || Law::from(Bilateral { rows: 1 });
    let problem = problem(&[1.0, 1.0, 1.0, 1.0], &[-1.0, 1.0], &[closed(), closed()]);
    assert!(problem.validate().is_ok(), "each number is sound");
    for (name, report, _) in reports(&problem) {
        assert!(!report.is_solved(), "{name}: {report:?}");
        let told = report.explain(&problem);
        assert!(report.status == SolveStatus::Unsupported || told.contains("`bilateral`, row"), "{name}: {told}");
    }
}
