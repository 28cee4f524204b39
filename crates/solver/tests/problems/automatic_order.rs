//! The order in which the automatic choice tries its solvers.

use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Bilateral, Law};
use palpate_solver::automatic::AutomaticConfig;
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::solver::ConstraintSolver;
use palpate_solver::watch::Watch;

/// Two joints that pull one coordinate apart: nobody solves it, so that all are tried.
fn tried(config: &AutomaticConfig) -> Vec<&'static str> {
    let w = DMatrix::from_element(2, 2, 1.0);
    let free = DVector::from_column_slice(&[-1.0, 1.0]);
    let problem = ConstraintProblem::new(w, free, [Law::from(Bilateral { rows: 1 }); 2]).unwrap();
    let mut ws = config.workspace(2);
    let report = config.solve_watched(&problem.view(), &mut [0.0; 2], &mut ws, &mut Watch::none());
    assert!(!report.is_solved());
    ws.attempts().iter().map(|attempt| attempt.solver).collect()
}

#[test]
fn cheap_solvers_come_before_lemke_and_the_cones_last() {
    let all = tried(&AutomaticConfig::default());
    let order =
        ["gauss_seidel", "semismooth_newton", "accelerated_gradient", "lemke", "gauss_seidel", "conic_friction"];
    assert_eq!(all, order);
}

#[test]
fn a_thread_that_must_be_in_time_gets_neither_lemke_nor_the_cones() {
    let bounded = tried(&AutomaticConfig { bounded: true, ..AutomaticConfig::default() });
    assert_eq!(bounded, ["gauss_seidel", "semismooth_newton", "accelerated_gradient", "gauss_seidel"]);
}
