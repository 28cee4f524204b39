//! What must hold for any problem: sound ones converge, unsound ones end with a status and finite, admissible forces.
#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Vector3};
use palpate_constraints::law::{Bilateral, Coulomb, FacetedCoulomb, Law, Signorini, Threshold, Tresca};
use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, GaussSeidelWorkspace};
use palpate_solver::problem::{Block, ConstraintProblem, ProblemView};
use palpate_solver::report::SolveStatus;
use palpate_solver::residual;
use palpate_solver::solver::{Solver, SolverWorkspace};
use proptest::prelude::*;

fn law() -> impl Strategy<Value = Law> {
    prop_oneof![
        Just(Law::from(Signorini)),
        (0.0..0.8_f64).prop_map(|friction| Coulomb { friction }.into()),
        (0.0..0.8_f64, 4..13_usize).prop_map(|(friction, facets)| FacetedCoulomb { friction, facets }.into()),
        (0.0..0.5_f64).prop_map(|limit| Tresca { limit }.into()),
        (0.0..0.5_f64).prop_map(|limit| Threshold { limit }.into()),
        (1..4_usize).prop_map(|rows| Bilateral { rows }.into()),
    ]
}

/// Laws, and as many random numbers as a compliance `J J^T + 0.2 I` and its gaps take.
fn problem() -> impl Strategy<Value = ConstraintProblem> {
    prop::collection::vec(law(), 1..8).prop_flat_map(|laws| {
        let rows: usize = laws.iter().map(Law::rows).sum();
        (prop::collection::vec(-1.0..1.0_f64, rows * rows), prop::collection::vec(-1.0..0.5_f64, rows)).prop_map(
            move |(J, free)| {
                let J = DMatrix::from_vec(rows, rows, J) / (rows as f64).sqrt();
                let W = (&J * J.transpose() + DMatrix::identity(rows, rows) * 0.2) * 1e-3;
                let W = (&W + W.transpose()) * 0.5;
                ConstraintProblem::new(W, DVector::from_vec(free) * 1e-3, laws.clone()).unwrap()
            },
        )
    })
}

/// Whether each block's force is finite and inside its cone, up to rounding.
fn admissible(blocks: &[Block], lambda: &[f64]) -> bool {
    lambda.iter().all(|force| force.is_finite())
        && blocks.iter().all(|block| match block.law {
            Law::Bilateral(_) => true,
            Law::Signorini(_) => lambda[block.start] >= 0.0,
            Law::Coulomb(law) => {
                let force = &lambda[block.start..block.start + 3];
                // Squares of numbers below 1e-154 vanish in a norm.
                force[0] >= 0.0 && force[1].hypot(force[2]) <= law.friction * force[0] * (1.0 + 1e-12) + 1e-150
            }
            Law::Threshold(law) => (0.0..=law.limit).contains(&lambda[block.start]),
            Law::Tresca(law) => {
                let force = &lambda[block.start..block.start + 3];
                force[0] >= 0.0 && force[1].hypot(force[2]) <= law.limit * (1.0 + 1e-12) + 1e-150
            }
            law @ Law::FacetedCoulomb(_) => {
                let force = Vector3::from_column_slice(&lambda[block.start..block.start + 3]);
                (law.project(&force) - force).norm() <= 1e-12 * force.norm()
            }
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn positive_definite_problems_are_solved(problem in problem()) {
        problem.validate().unwrap();
        let config = GaussSeidelConfig { tolerance: 1e-9, max_sweeps: 20_000, ..Default::default() };
        let mut ws = GaussSeidelWorkspace::with_capacity(problem.rows());
        let mut lambda = vec![0.0; problem.rows()];
        let report = gauss_seidel::solve(&problem.view(), &mut lambda, &config, &mut ws);
        prop_assert_eq!(report.status, SolveStatus::Solved);
        prop_assert!(admissible(problem.blocks(), &lambda));

        // An independent look: gaps from scratch, and complementarity row by row.
        let mut delta = vec![0.0; problem.rows()];
        let judged = residual::evaluate(&problem.view(), &lambda, &mut delta);
        prop_assert!(judged.relative <= 1.01e-9, "{}", judged.relative);
        let size = problem.delta_free().iter().map(|x| x * x).sum::<f64>().sqrt();
        for block in problem.blocks() {
            let (gap, force) = (delta[block.start], lambda[block.start]);
            match block.law {
                Law::Bilateral(_) => prop_assert!(gap.abs() <= 1e-8 * size),
                // Gives way at its limit.
                Law::Threshold(law) if force >= law.limit => prop_assert!(gap <= 1e-8 * size),
                _ => prop_assert!(gap >= -1e-8 * size && (gap <= 1e-8 * size || force * 1e-4 <= 1e-8 * size)),
            }
        }
    }

    #[test]
    fn an_early_stop_leaves_admissible_forces(problem in problem(), sweeps in 0..4_u32, start in -5.0..5.0_f64) {
        let config = GaussSeidelConfig { tolerance: 0.0, max_sweeps: sweeps, ..Default::default() };
        let mut ws = GaussSeidelWorkspace::with_capacity(problem.rows());
        let mut lambda = vec![start; problem.rows()];
        let report = gauss_seidel::solve(&problem.view(), &mut lambda, &config, &mut ws);
        prop_assert!(report.iterations <= sweeps);
        prop_assert!(admissible(problem.blocks(), &lambda));
        let gap = ws.delta().to_vec();
        let mut expected = vec![0.0; problem.rows()];
        problem.view().gap(&lambda, &mut expected);
        for (gap, expected) in gap.iter().zip(&expected) {
            prop_assert!((gap - expected).abs() <= 1e-13);
        }
    }

    #[test]
    fn any_numbers_end_with_finite_admissible_forces(
        w in prop::collection::vec(prop::num::f64::ANY, 49), free in prop::array::uniform7(prop::num::f64::ANY),
        start in prop::array::uniform7(prop::num::f64::ANY), friction in 0.0..1e3_f64,
    ) {
        let laws: [Law; 3] = [Coulomb { friction }.into(), Signorini.into(), Bilateral { rows: 3 }.into()];
        let problem =
            ConstraintProblem::new(DMatrix::from_vec(7, 7, w), DVector::from_column_slice(&free), laws).unwrap();
        let mut lambda = start.to_vec();
        let mut ws = GaussSeidelWorkspace::with_capacity(7);
        let config = GaussSeidelConfig { max_sweeps: 50, ..Default::default() };
        let report = gauss_seidel::solve(&problem.view(), &mut lambda, &config, &mut ws);
        prop_assert!(admissible(problem.blocks(), &lambda), "{report:?} {lambda:?}");
        prop_assert!(report.is_solved() == (report.residual <= config.tolerance));
    }

    #[test]
    fn sizes_that_disagree_are_a_status(
        w in 0..20_usize, stride in 0..6_usize, rows in 0..6_usize, forces in 0..6_usize, start in 0..3_usize,
        laws in prop::collection::vec(law(), 0..3),
    ) {
        let w = vec![1e-3; w];
        let free = vec![-1e-3; rows];
        let mut next = start;
        let blocks: Vec<Block> = laws.into_iter().map(|law| {
            let block = Block { start: next, law };
            next += law.rows();
            block
        }).collect();
        let view = ProblemView { compliance: &w, stride, delta_free: &free, blocks: &blocks };
        let mut lambda = vec![1.0; forces];
        let mut ws = GaussSeidelWorkspace::with_capacity(6);
        let report = gauss_seidel::solve(&view, &mut lambda, &GaussSeidelConfig::default(), &mut ws);
        let enough = rows == 0 || w.len() >= (rows - 1) * stride + rows;
        let sound = stride >= rows && enough && (start == 0 || blocks.is_empty()) && next - start == rows && forces == rows;
        prop_assert_eq!(report.status == SolveStatus::Invalid, !sound);
        if !sound {
            prop_assert!(lambda.iter().all(|force| *force == 0.0));
            prop_assert!(!gauss_seidel::sweep(&view, &mut lambda, 1.0, false, &mut ws) || rows == 0 && forces == 0);
        }
    }
}

#[test]
fn a_problem_larger_than_the_workspace_is_reported() {
    let mut problem = ConstraintProblem::with_capacity(2);
    problem.reset(2).unwrap();
    problem.compliance_mut().fill_with_identity();
    problem.delta_free_mut().fill(-1.0);
    problem.push_block(Signorini.into());
    problem.push_block(Signorini.into());
    let mut ws = GaussSeidelWorkspace::with_capacity(1);
    let mut lambda = [3.0; 2];
    let report = gauss_seidel::solve(&problem.view(), &mut lambda, &GaussSeidelConfig::default(), &mut ws);
    assert_eq!((report.status, lambda), (SolveStatus::CapacityExceeded, [0.0; 2]));
}

#[test]
fn a_number_that_is_not_finite_ends_the_run_without_force() {
    for (w, free) in [(f64::NAN, -1.0), (1.0, f64::NAN), (1.0, f64::NEG_INFINITY)] {
        let W = DMatrix::from_row_slice(2, 2, &[1.0, w, w, 1.0]);
        let free = DVector::from_column_slice(&[-1.0, free]);
        let problem = ConstraintProblem::new(W, free, [Signorini.into(), Signorini.into()]).unwrap();
        let mut ws = GaussSeidelWorkspace::with_capacity(2);
        let mut lambda = [1.0; 2];
        let report = gauss_seidel::solve(&problem.view(), &mut lambda, &GaussSeidelConfig::default(), &mut ws);
        assert_eq!((report.status, lambda), (SolveStatus::NotFinite, [0.0; 2]));
        assert!(problem.validate().is_err());
    }
}

#[test]
fn a_padded_matrix_is_the_same_problem() {
    let W = DMatrix::from_row_slice(3, 3, &[2e-3, 3e-4, 0.0, 3e-4, 1e-3, 0.0, 0.0, 0.0, 1e-3]);
    let free = [-1e-3, 4e-4, -2e-4];
    let tight =
        ConstraintProblem::new(W.clone(), DVector::from_column_slice(&free), [Coulomb { friction: 0.3 }.into()])
            .unwrap();
    let mut padded = DMatrix::from_element(5, 3, f64::NAN);
    padded.rows_mut(0, 3).copy_from(&W);
    let view = ProblemView { compliance: padded.as_slice(), stride: 5, delta_free: &free, blocks: tight.blocks() };
    let solver = Solver::default();
    let mut ws: SolverWorkspace = solver.workspace(3);
    let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
    let reports = (solver.solve(&tight.view(), &mut a, &mut ws), solver.solve(&view, &mut b, &mut ws));
    assert!(reports.0.is_solved());
    assert_eq!((reports.0, a), (reports.1, b));
}

#[test]
fn documented_defaults_are_the_defaults() {
    let config = GaussSeidelConfig::default();
    assert_eq!((config.tolerance, config.max_sweeps, config.relaxation, config.stall_sweeps), (1e-6, 1000, 1.0, 200));
    assert_eq!(config.order, gauss_seidel::SweepOrder::Forward);
}
