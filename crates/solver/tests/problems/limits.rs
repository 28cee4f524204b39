//! Limits of iterations and of time, and of what numbers hold: every solver keeps them, and says so.

use crate::half_space;
use nalgebra::{DMatrix, DVector, Vector3};
use palpate_constraints::law::{Coulomb, Law, Signorini};
use palpate_solver::automatic::AutomaticConfig;
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::solver::{ConstraintSolver, Solver};
use palpate_solver::watch::Watch;

fn every_solver() -> impl Iterator<Item = Solver> {
    Solver::NAMES.iter().filter_map(|name| Solver::from_name(name))
}

fn solve(solver: &Solver, problem: &ConstraintProblem, mut watch: Watch<'_>) -> (Vec<f64>, SolveReport) {
    let mut lambda = vec![0.0; problem.rows()];
    let mut ws = solver.workspace(problem.rows());
    let report = solver.solve_watched(&problem.view(), &mut lambda, &mut ws, &mut watch);
    (lambda, report)
}

fn is_admissible(problem: &ConstraintProblem, lambda: &[f64]) -> bool {
    problem.blocks().iter().all(|block| {
        let force = Vector3::from_fn(|i, _| lambda[block.start + i]);
        force.iter().all(|f| f.is_finite())
            && (block.law.project(&force) - force).amax() <= 1e-12 * force.amax() + 1e-150
    })
}

#[test]
fn limits_of_iterations_and_time_are_kept() {
    let problem = half_space::pressed_sphere(40, 0.5, 8e-3, 1.5e-3);
    for solver in every_solver().filter(|solver| solver.name() != "conic_qp") {
        let (lambda, report) = solve(&solver.limited(1e-300, Some(2)), &problem, Watch::none());
        assert!(!report.is_solved() && is_admissible(&problem, &lambda), "{}: {report:?}", solver.name());
        // The automatic choice sums its attempts, each of which keeps the limit.
        assert!(report.iterations <= 2 || solver.name() == "automatic", "{}: {report:?}", solver.name());

        // A clock that is over at once: no more than the iteration under way.
        let (_, report) = solve(&solver.limited(1e-300, None), &problem, Watch::none().limit(1e-9));
        assert_eq!((report.status, report.iterations), (SolveStatus::TimeLimit, 0), "{}", solver.name());
    }
}

#[test]
fn every_attempt_of_the_automatic_choice_keeps_the_limit_of_iterations() {
    let problem = half_space::pressed_sphere(40, 0.5, 8e-3, 1.5e-3);
    for most in [1, 2, 40] {
        let config = AutomaticConfig::default().limited(1e-300, Some(most));
        let mut ws = config.workspace(problem.rows());
        let mut lambda = vec![0.0; problem.rows()];
        let report = config.solve_watched(&problem.view(), &mut lambda, &mut ws, &mut Watch::none());
        assert!(!report.is_solved() && ws.attempts().len() == 6, "{:?}", ws.attempts());
        for attempt in ws.attempts() {
            assert!(attempt.report.iterations <= most, "{attempt:?}");
        }
        assert!(report.iterations <= 6 * most, "{report:?}");
    }
}

/// Every iteration on these 900 rows reads 6 MB, and a factor takes longer than the time there is: no solver begins one that
/// cannot end, and none does as many iterations as it would with all the time in the world.
#[test]
fn a_limit_of_time_ends_every_solver_on_a_large_problem() {
    let problem = half_space::pressed_sphere(300, 0.5, 8e-3, 1.5e-3);
    for solver in every_solver().filter(|solver| solver.name() != "conic_qp") {
        let endless = solver.limited(1e-300, None);
        let (lambda, report) = solve(&endless, &problem, Watch::none().limit(2e-3));
        assert_eq!(report.status, SolveStatus::TimeLimit, "{}: {report:?}", solver.name());
        assert!(is_admissible(&problem, &lambda), "{}", solver.name());
        assert!(report.iterations < 150, "{}: {report:?}", solver.name());
        // Of the others one iteration takes too long to wait for.
        if ["gauss_seidel", "nncg", "accelerated_gradient"].contains(&solver.name()) {
            let (_, free) = solve(&solver.limited(1e-300, Some(300)), &problem, Watch::none());
            assert_eq!((free.status, free.iterations), (SolveStatus::MaxIterations, 300), "{}", solver.name());
        }
    }
}

/// Contacts on a compliance so small that their forces have no norm: an honest end, not the zero that passes for a solution.
#[test]
fn forces_beyond_the_range_of_norms_are_not_called_a_solution() {
    for (w, slip) in [(1e-160, 1e-4), (1e-160, 0.0), (1e-300, 1e-4)] {
        for friction in [0.0, 0.5, 900.0] {
            let free = DVector::from_fn(27, |i, _| [-1e-3, slip, 0.0][i % 3]);
            let laws = [Law::from(Coulomb { friction }); 9];
            let problem = ConstraintProblem::new(DMatrix::from_diagonal_element(27, 27, w), free, laws).unwrap();
            for solver in every_solver() {
                let (lambda, report) = solve(&solver, &problem, Watch::none());
                let case = format!("{}, {w:e}, {slip}, {friction}: {report:?}", solver.name());
                assert!(lambda.iter().all(|force| force.is_finite()), "{case}");
                // Where the forces are found after all, they close the gap.
                if report.is_solved() {
                    assert!((w * lambda[0] - 1e-3).abs() < 1e-8, "{case}: {}", lambda[0]);
                } else {
                    assert!(report.residual > 1e-6, "{case}");
                }
            }
        }
    }
    // Far from the end of the range the same problem is solved, whatever its unit.
    for w in [1e-140, 1e-60, 1e60, 1e140] {
        let laws = [Law::from(Coulomb { friction: 0.5 })];
        let free = DVector::from_column_slice(&[-1e-3, 1e-4, 0.0]);
        let problem = ConstraintProblem::new(DMatrix::from_diagonal_element(3, 3, w), free, laws).unwrap();
        let (lambda, report) = solve(&Solver::from_name("automatic").unwrap(), &problem, Watch::none());
        assert!(report.is_solved() && (w * lambda[0] - 1e-3).abs() < 1e-8, "{w:e}: {report:?} {lambda:?}");
    }
}

/// Two contacts that know nothing of one another, 24 powers of ten apart: a program sees but the softer one.
#[test]
fn cone_programs_solve_blocks_of_any_stiffness() {
    let w = DMatrix::from_fn(6, 6, |i, j| {
        if i != j {
            0.0
        } else if i < 3 {
            1e-12
        } else {
            1e12
        }
    });
    let free = DVector::from_fn(6, |i, _| [-1e-3, 1e-4, 0.0][i % 3]);
    let problem = ConstraintProblem::new(w, free, [Law::from(Coulomb { friction: 0.5 }); 2]).unwrap();
    let solver = Solver::from_name("conic_friction").unwrap().limited(1e-8, None);
    let (lambda, report) = solve(&solver, &problem, Watch::none());
    assert!(report.is_solved(), "{report:?}");
    // By hand: both stick, with a force of the gap over the compliance.
    for (k, w) in [(0, 1e-12), (3, 1e12)] {
        assert!((lambda[k] * w - 1e-3).abs() < 1e-10 && (lambda[k + 1] * w + 1e-4).abs() < 1e-10, "{lambda:?}");
    }
}

/// The sentence tells a problem that is not finite from a run that diverged, and names the row that is at fault.
#[test]
fn a_run_that_diverged_is_told_from_numbers_that_are_not_finite() {
    let problem = |w: [f64; 3], gap: f64| {
        let free = DVector::from_column_slice(&[gap, 0.1, 0.0]);
        ConstraintProblem::new(
            DMatrix::from_diagonal(&DVector::from_column_slice(&w)),
            free,
            [Law::from(Coulomb { friction: 0.5 })],
        )
    };
    let negative = problem([-1.0, 1.0, 1.0], -1.0).unwrap();
    for solver in every_solver() {
        let (_, report) = solve(&solver, &negative, Watch::none());
        assert!(!report.is_solved(), "{report:?}");
        let told = report.explain(&negative);
        let unsupported = report.status == SolveStatus::Unsupported;
        assert!(unsupported || told.contains("W[0, 0] = -1 m/N is negative"), "{}: {told}", solver.name());
        assert!(!told.contains("not finite"), "{}: {told}", solver.name());
    }
    let endless = problem([1.0, f64::NAN, 1.0], -1.0).unwrap();
    let (lambda, report) = solve(&Solver::from_name("gauss_seidel").unwrap(), &endless, Watch::none());
    let told = report.explain(&endless);
    assert!(told.contains("W[1, 1] = NaN is not finite") && lambda == [0.0; 3], "{told} {lambda:?}");
}

/// A row without compliance of its own that is coupled to another all the same: no number measures that asymmetry.
#[test]
fn an_asymmetry_that_has_no_measure_is_told_in_words() {
    let w = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, 1.0]);
    let problem = ConstraintProblem::new(w, DVector::from_element(2, -1.0), [Law::from(Signorini); 2]).unwrap();
    let told = problem.validate().unwrap_err().to_string();
    assert!(told.contains("W[0, 1] = 1 but W[1, 0] = -1") && !told.contains("inf"), "{told}");
}
