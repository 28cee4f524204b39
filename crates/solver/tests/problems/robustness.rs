//! Every solver on problems at and beyond the edge: bounded forces, a status, and a report that is true.

use crate::half_space;

use crate::rigid_bodies::{GRAVITY, STEP, between_walls, painleve_rod, rigid_stool, stack};
use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Bilateral, Coulomb, FacetedCoulomb, Law, Signorini, Threshold, Tresca};
use palpate_solver::automatic::AutomaticConfig;
use palpate_solver::problem::{ConstraintProblem, ProblemError, ProblemView};
use palpate_solver::report::{SolveReport, SolveStatus};
use palpate_solver::residual;
use palpate_solver::solver::{ConstraintSolver, Solver};
use palpate_solver::watch::Watch;
use proptest::prelude::*;

fn every_solver() -> impl Iterator<Item = Solver> {
    Solver::NAMES.iter().filter_map(|name| Solver::from_name(name))
}

fn solve(solver: &Solver, problem: &ConstraintProblem) -> (Vec<f64>, Vec<f64>, SolveReport) {
    let (mut lambda, mut delta) = (vec![0.0; problem.rows()], vec![0.0; problem.rows()]);
    let report = solver.solve(&problem.view(), &mut lambda, &mut solver.workspace(problem.rows()));
    problem.view().gap(&lambda, &mut delta);
    (lambda, delta, report)
}

fn is_admissible(problem: &ConstraintProblem, lambda: &[f64]) -> bool {
    lambda.iter().all(|force| force.is_finite())
        && problem.blocks().iter().all(|block| {
            let force =
                nalgebra::Vector3::from_fn(|i, _| if i < block.law.rows() { lambda[block.start + i] } else { 0.0 });
            // Squares of numbers below 1e-154 vanish in a norm.
            (block.law.project(&force) - force).amax() <= 1e-12 * force.amax() + 1e-150
        })
}

#[test]
fn four_rigid_legs_rest_by_every_solver() {
    for solver in every_solver() {
        let (lambda, delta, report) = solve(&solver.limited(1e-8, None), &rigid_stool());
        assert_eq!(report.status, SolveStatus::Solved, "{}", solver.name());
        assert!(delta.iter().all(|gap| gap.abs() <= 1e-7 * STEP * STEP * GRAVITY), "{}: {delta:?}", solver.name());
        let load: f64 = lambda.iter().sum();
        assert!((load - GRAVITY).abs() < 1e-6 && lambda.iter().all(|leg| *leg <= load), "{}", solver.name());
    }
}

#[test]
fn a_wedged_block_hangs_by_every_frictional_solver() {
    let press = 20.0 * STEP * STEP;
    let wedge = between_walls([-press, press], -STEP * STEP * GRAVITY, 0.6);
    for solver in every_solver().filter(|solver| solver.name() != "conic_qp") {
        let (lambda, delta, report) = solve(&solver.limited(1e-8, None), &wedge);
        assert_eq!(report.status, SolveStatus::Solved, "{}", solver.name());
        assert!(delta.iter().all(|gap| gap.abs() < 1e-6 * press), "{}: {delta:?}", solver.name());
        assert!((lambda[1] + lambda[4] - GRAVITY).abs() < 1e-4, "{}: carries the weight", solver.name());
        // Forces are not unique, but a solver that starts from none has no reason to invent large ones.
        assert!(lambda.iter().all(|force| force.abs() <= 1e3), "{}: {lambda:?}", solver.name());
    }
}

/// Overlap on both sides: no motion opens both gaps, and forces could grow for ever.
#[test]
fn conflicting_walls_are_not_solved_and_forces_stay_bounded() {
    let overlap = 50.0 * STEP * STEP;
    let wedge = between_walls([-overlap, -overlap], 0.0, 0.6);
    for solver in every_solver() {
        let (lambda, _, report) = solve(&solver, &wedge);
        assert_ne!(report.status, SolveStatus::Solved, "{}", solver.name());
        // The walls ask for 50 N each; a method that creeps along the ray is stopped within a few thousand times that.
        assert!(lambda.iter().all(|force| force.abs() <= 1e6), "{}: {lambda:?}", solver.name());
        assert!(is_admissible(&wedge, &lambda), "{}: {lambda:?}", solver.name());
    }
}

#[test]
fn painleve_rod_has_a_finite_impulse_by_every_solver_that_claims_one() {
    for friction in [0.5, 4.0 / 3.0, 2.0, 100.0] {
        for speed in [-1.0, 0.1, 1.0] {
            let rod = painleve_rod(friction, speed);
            for solver in every_solver() {
                let (lambda, delta, report) = solve(&solver.limited(1e-8, None), &rod);
                let case = format!("{}, friction {friction}, speed {speed}: {report:?}", solver.name());
                assert!(is_admissible(&rod, &lambda), "{case}");
                assert!(lambda[0] < 10.0 / STEP, "{case}: {lambda:?}");
                if report.is_solved() {
                    assert!(delta[0] >= -1e-7 * STEP, "{case}: {delta:?}");
                }
                // Beyond the critical friction a fixed point of cone programs need not exist; these find a solution.
                if ["gauss_seidel", "semismooth_newton", "automatic"].contains(&solver.name()) {
                    assert!(report.is_solved(), "{case}");
                }
            }
        }
    }
}

#[test]
fn ratios_of_mass_and_stiffness_up_to_a_million_are_solved_untold() {
    for ratio in [1.0, 1e2, 1e4, 1e6] {
        let above: Vec<f64> = (0..8).map(|k| if k % 2 == 0 { 1.0 } else { ratio }).collect();
        for law in [Law::from(Signorini), Coulomb { friction: 0.4 }.into()] {
            let problem = stack(&above, law);
            let (lambda, _, report) = solve(&Solver::from_name("automatic").unwrap().limited(1e-8, None), &problem);
            assert_eq!(report.status, SolveStatus::Solved, "{ratio}");
            // The floor carries all.
            let weight = GRAVITY * above.iter().sum::<f64>();
            assert!((lambda[0] - weight).abs() <= 1e-4 * weight, "{ratio}: {} of {weight}", lambda[0]);
        }
        // Springs side by side, coupled: no scale of the problem suits all.
        let stiffness: Vec<f64> = (0..12).map(|k| 1e2 * ratio.powf(k as f64 / 11.0)).collect();
        let w = DMatrix::from_fn(12, 12, |i, j| {
            let pair = 1.0 / (stiffness[i] * stiffness[j]).sqrt();
            if i == j { pair } else { 0.3 * pair }
        });
        let laws = [Law::from(Coulomb { friction: 0.5 }); 4];
        let free = DVector::from_fn(12, |i, _| if i % 3 == 0 { -1e-3 } else { 2e-4 });
        let problem = ConstraintProblem::new(w, free, laws).unwrap();
        let (_, _, report) = solve(&Solver::from_name("automatic").unwrap().limited(1e-8, None), &problem);
        assert_eq!(report.status, SolveStatus::Solved, "{ratio}");
    }
}

/// A stack that stalls the sweeps: the automatic choice goes on, and says what it tried.
#[test]
fn a_stalled_solver_is_followed_by_another_and_reported() {
    let problem = stack(&[1.0, 1e2, 1e-1, 1e3, 1e-3], Signorini.into());
    let config = AutomaticConfig::default();
    let mut ws = config.workspace(problem.rows());
    let mut lambda = vec![0.0; problem.rows()];
    let report = config.solve_watched(&problem.view(), &mut lambda, &mut ws, &mut Watch::none());
    assert!(report.is_solved());
    let tried: Vec<_> = ws.attempts().iter().map(|attempt| (attempt.solver, attempt.report.is_solved())).collect();
    assert_eq!(tried, [("gauss_seidel", false), ("semismooth_newton", true)]);
}

/// Two joints that pull one coordinate apart: the report tells of the conflict, not of the limit of the first sweeps.
#[test]
fn the_automatic_choice_says_how_its_run_ended() {
    let w = DMatrix::from_element(2, 2, 1.0);
    let free = DVector::from_column_slice(&[-1.0, 1.0]);
    let problem = ConstraintProblem::new(w, free, [Law::from(Bilateral { rows: 1 }); 2]).unwrap();
    let config = AutomaticConfig::default();
    let mut ws = config.workspace(2);
    let mut lambda = [0.0; 2];
    let report = config.solve_watched(&problem.view(), &mut lambda, &mut ws, &mut Watch::none());
    assert!(matches!(report.status, SolveStatus::NoSolution | SolveStatus::Stalled), "{report:?}");
    let (all, least) = ws.attempts().iter().fold((0, f64::INFINITY), |(all, least), attempt| {
        (all + attempt.report.iterations, f64::min(least, attempt.report.residual))
    });
    assert_eq!((report.iterations, report.residual), (all, least));
    assert!(lambda.iter().all(|force| force.abs() <= 1e6), "{lambda:?}");
    let told = report.explain(&problem);
    assert!(told.contains("bilateral") && told.contains("row") && told.contains("block"), "{told}");
}

#[test]
fn an_indefinite_compliance_is_named_with_its_row() {
    let problem = |w: &[f64], n: usize| {
        let (w, free) = (DMatrix::from_row_slice(n, n, w), DVector::from_element(n, -1.0));
        ConstraintProblem::new(w, free, vec![Law::from(Signorini); n]).unwrap()
    };
    let told = problem(&[1.0, 2.0, 2.0, 1.0], 2).validate().unwrap_err();
    assert!(matches!(told, ProblemError::Indefinite { row: 0, column: 1, .. }), "{told}");
    // Every pair of rows is sound, the three together are not: only a factorisation sees it.
    let hidden = problem(&[1.0, -0.8, -0.8, -0.8, 1.0, -0.8, -0.8, -0.8, 1.0], 3);
    assert!(hidden.validate().is_ok());
    let told = hidden.check_semidefinite().unwrap_err();
    assert!(matches!(told, ProblemError::NegativePivot { row: 2, .. }), "{told}");
    // Rank one is no mistake, nor is rounding of it.
    let redundant = problem(&[1.0, 1.0, 1.0, 1.0 + 1e-12], 2);
    assert!(redundant.validate().is_ok() && redundant.check_semidefinite().is_ok());
    assert!(rigid_stool().check_semidefinite().is_ok());
}

#[test]
fn lemke_has_room_for_any_number_of_facets() {
    for facets in [16, 32] {
        let law = Law::from(FacetedCoulomb { friction: 0.4, facets });
        let source = half_space::pressed_sphere(6, 0.4, 8e-3, 1.5e-3);
        let w = source.compliance().into_owned();
        // Lemke is for any W; the sweeps that judge it are for symmetric ones.
        let w = (&w + w.transpose()) * 0.5;
        let free = DVector::from_column_slice(source.delta_free());
        let problem = ConstraintProblem::new(w, free, vec![law; 6]).unwrap();
        let (lambda, _, report) = solve(&Solver::from_name("lemke").unwrap().limited(1e-8, None), &problem);
        assert_eq!(report.status, SolveStatus::Solved, "{facets}: {report:?}");
        let (expected, _, _) = solve(&Solver::from_name("gauss_seidel").unwrap().limited(1e-10, None), &problem);
        let size = expected.iter().fold(0.0_f64, |size, force| size.max(force.abs()));
        for (force, expected) in lambda.iter().zip(&expected) {
            // The condition of the problem, below 1e2, times the residual.
            assert!((force - expected).abs() <= 1e-6 * size, "{facets}: {force} {expected}");
        }
    }
}

#[test]
fn mistakes_of_size_are_a_status_of_every_solver() {
    let problem = half_space::pressed_sphere(4, 0.5, 2e-3, 1e-3);
    for solver in every_solver() {
        let mut small = solver.workspace(6);
        let mut lambda = vec![1.0; 12];
        let report = solver.solve(&problem.view(), &mut lambda, &mut small);
        assert_eq!((report.status, lambda), (SolveStatus::CapacityExceeded, vec![0.0; 12]), "{}", solver.name());

        let mut ws = solver.workspace(12);
        let mut short = vec![1.0; 11];
        assert_eq!(solver.solve(&problem.view(), &mut short, &mut ws).status, SolveStatus::Invalid);
        let cut = ProblemView { delta_free: &problem.delta_free()[..11], ..problem.view() };
        assert_eq!(solver.solve(&cut, &mut short, &mut ws).status, SolveStatus::Invalid, "{}", solver.name());
        let empty = ConstraintProblem::default();
        assert!(solver.solve(&empty.view(), &mut [], &mut ws).is_solved(), "{}", solver.name());
        // After the mistakes the workspace is as good as before.
        let mut lambda = vec![0.0; 12];
        let report = solver.solve(&problem.view(), &mut lambda, &mut ws);
        assert!(report.is_solved() || ["lemke", "conic_qp"].contains(&solver.name()), "{}: {report:?}", solver.name());
    }
    let mut other = Solver::from_name("lemke").unwrap().workspace(12);
    let report = Solver::from_name("nncg").unwrap().solve(&problem.view(), &mut [1.0; 12], &mut other);
    assert_eq!(report.status, SolveStatus::Invalid);
}

fn one_of_each(friction: f64, limit: f64) -> Vec<Law> {
    vec![
        Coulomb { friction }.into(),
        Signorini.into(),
        Tresca { limit }.into(),
        Bilateral { rows: 2 }.into(),
        Threshold { limit }.into(),
        FacetedCoulomb { friction, facets: 6 }.into(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_numbers_end_with_finite_admissible_forces_by_every_solver(
        w in prop::collection::vec(prop_oneof![prop::num::f64::ANY, -1.0..1.0_f64, Just(0.0)], 169),
        free in prop::collection::vec(prop_oneof![prop::num::f64::ANY, -1.0..1.0_f64], 13),
        start in prop::collection::vec(prop::num::f64::ANY, 13),
        friction in 0.0..1e3_f64, limit in 0.0..1e3_f64,
    ) {
        let (w, free) = (DMatrix::from_vec(13, 13, w), DVector::from_vec(free));
        let problem = ConstraintProblem::new(w, free, one_of_each(friction, limit)).unwrap();
        for solver in every_solver() {
            let solver = solver.limited(1e-6, Some(60));
            let mut lambda = start.clone();
            let report = solver.solve(&problem.view(), &mut lambda, &mut solver.workspace(13));
            prop_assert!(is_admissible(&problem, &lambda), "{}: {report:?} {lambda:?}", solver.name());
            prop_assert!(report.is_solved() == (report.residual <= 1e-6), "{}: {report:?}", solver.name());
        }
    }

    // Stewart and Trinkle's matrix is copositive for W positive semidefinite and friction >= 0: pivoting ends with a solution.
    #[test]
    fn lemke_solves_friction_on_any_definite_compliance(
        j in prop::collection::vec(-1.0..1.0_f64, 18 * 18), free in prop::collection::vec(-1.0..0.5_f64, 18),
        friction in 0.0..0.8_f64, facets in 3..12_usize,
    ) {
        let j = DMatrix::from_vec(18, 18, j) / 18.0_f64.sqrt();
        let w = (&j * j.transpose() + DMatrix::identity(18, 18) * 0.2) * 1e-3;
        let w = (&w + w.transpose()) * 0.5;
        for law in [Law::from(FacetedCoulomb { friction, facets }), Coulomb { friction }.into()] {
            let problem = ConstraintProblem::new(w.clone(), DVector::from_column_slice(&free) * 1e-3, [law; 6]).unwrap();
            let (lambda, delta, report) = solve(&Solver::from_name("lemke").unwrap().limited(1e-8, None), &problem);
            prop_assert!(report.is_solved(), "{law:?}: {report:?}");
            let judged = residual::evaluate(&problem.view(), &lambda, &mut delta.clone());
            prop_assert!(judged.relative <= 1.01e-8 && is_admissible(&problem, &lambda));
            // A faceted law needs no sweeps.
            prop_assert!(report.iterations <= 1 || law == Coulomb { friction }.into(), "{report:?}");
        }
    }

    // Rank-deficient but consistent: W = J J^T with fewer columns than rows, and a motion that opens every gap.
    #[test]
    fn rank_deficient_problems_are_solved_untold(
        j in prop::collection::vec(-1.0..1.0_f64, 18 * 6), motion in prop::array::uniform6(-1.0..1.0_f64),
        slack in prop::collection::vec(0.0..0.3_f64, 18), friction in 0.0..0.8_f64,
    ) {
        let j = DMatrix::from_vec(18, 6, j);
        let motion = DVector::from_column_slice(&motion);
        // delta_free = slack - J motion: the motion itself leaves every normal gap open by its slack.
        let free = DVector::from_fn(18, |i, _| if i % 3 == 0 { slack[i] } else { 0.0 }) - &j * motion;
        let w = &j * j.transpose();
        let problem = ConstraintProblem::new((&w + w.transpose()) * 0.5, free, [Law::from(Coulomb { friction }); 6]).unwrap();
        let (lambda, delta, report) = solve(&Solver::from_name("automatic").unwrap(), &problem);
        prop_assert!(report.is_solved(), "{report:?}");
        let judged = residual::evaluate(&problem.view(), &lambda, &mut delta.clone());
        prop_assert!(judged.relative <= 1.01e-6);
        prop_assert!(is_admissible(&problem, &lambda));
    }
}
