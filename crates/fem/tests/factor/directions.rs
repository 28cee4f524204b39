//! Conjugate gradients that keep their directions from solve to solve with one matrix.
#![allow(clippy::print_stdout)] // counts are shown beside their bounds

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, relative_difference};
use palpate_fem::factor::{Factor, FactorStatus, SolveWorkspace, SymbolicFactor};
use palpate_fem::pcg::{PcgConfig, PcgReport, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::FactorPreconditioner;
use palpate_fem::sparse::SystemMatrix;

/// A body, its matrix, and the factor of another.
struct Case {
    body: Body,
    a: SystemMatrix,
    factor: Factor,
    solve: SolveWorkspace,
}

impl Case {
    fn new() -> Self {
        let body = Body::block([7, 6, 6], 1);
        let (old, a) = (body.system(2), body.system(7));
        let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
        let mut factor = Factor::new(symbolic.clone());
        assert_eq!(factor.refactor(&old).status, FactorStatus::Ok);
        Self { body, a, factor, solve: SolveWorkspace::new(&symbolic) }
    }

    fn keeping(&self, most: usize) -> PcgWorkspace {
        PcgWorkspace::new(self.body.free_nodes()).keeping_directions(most)
    }

    /// A push on one patch of nodes, another by some hundredths for every seed.
    fn load(&self, seed: u64) -> Vec<f64> {
        let mut b = vec![0.0; 3 * self.body.free_nodes()];
        let (same, other) = (Random(0).vector(30), Random(seed).vector(30));
        b[60..90].iter_mut().zip(same.iter().zip(&other)).for_each(|(b, (same, other))| *b = same + 0.02 * other);
        b
    }

    fn run(&mut self, b: &[f64], x: &mut [f64], tolerance: f64, workspace: &mut PcgWorkspace) -> PcgReport {
        let config = PcgConfig { relative_tolerance: tolerance, max_iterations: 500 };
        let mut preconditioner = FactorPreconditioner { factor: &self.factor, workspace: &mut self.solve };
        let report = pcg(&self.a, b, x, &mut preconditioner, config, workspace);
        assert_eq!(report.status, PcgStatus::Converged);
        report
    }
}

/// Directions are conjugate, so that what was found along one of them never changes again: stopping early and going on
/// costs no iteration, where a fresh start would lose the history.
#[test]
fn a_solve_that_was_stopped_early_goes_on_as_if_it_had_not() {
    let mut case = Case::new();
    let b = case.load(3);
    let n = b.len();
    let mut whole = vec![0.0; n];
    let at_once = case.run(&b, &mut whole, 1e-8, &mut PcgWorkspace::new(n / 3)).iterations;
    let mut in_parts = |mut workspace: PcgWorkspace| {
        let mut x = vec![0.0; n];
        let iterations: usize =
            [1e-1, 1e-2, 1e-4, 1e-8].iter().map(|&t| case.run(&b, &mut x, t, &mut workspace).iterations).sum();
        assert!(relative_difference(&x, &whole) < 1e-6);
        iterations
    };
    let (kept, fresh) = (in_parts(PcgWorkspace::new(n / 3).keeping_directions(60)), in_parts(PcgWorkspace::new(n / 3)));
    println!("{at_once} iterations at once; in four parts {kept} with directions kept, {fresh} without");
    assert!(kept <= at_once, "{kept} instead of {at_once}");
    assert!(fresh > at_once, "{fresh}: the test tests nothing");
}

#[test]
fn later_solves_with_one_matrix_take_fewer_iterations_to_the_same_solution() {
    let mut case = Case::new();
    let n = 3 * case.body.free_nodes();
    let (mut kept, mut plain) = (case.keeping(40), PcgWorkspace::new(n / 3));
    let (mut with, mut without) = (0, 0);
    for seed in 3..8 {
        let b = case.load(seed);
        let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
        let report = case.run(&b, &mut x, 1e-9, &mut kept);
        assert!(report.relative_residual <= 1e-9);
        with += report.iterations;
        without += case.run(&b, &mut y, 1e-9, &mut plain).iterations;
        // residuals of 1e-9 times the condition of A, some 1e3
        assert!(relative_difference(&x, &y) < 1e-6, "seed {seed}");
    }
    println!("five loads: {with} iterations with directions kept, {without} without");
    assert!(10 * with <= 9 * without, "{with} instead of {without}");
    // what lies in the span of the directions needs no iteration
    let b = case.load(3);
    let mut x = vec![0.0; n];
    assert_eq!(case.run(&b, &mut x, 1e-7, &mut kept).iterations, 0);
    // after forgetting, it is a first solve again
    kept.forget();
    let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
    let first = case.run(&b, &mut x, 1e-7, &mut kept);
    assert_eq!(first, case.run(&b, &mut y, 1e-7, &mut plain));
    assert_eq!(x, y);
}

/// Directions of another matrix lead astray, and the residual that is computed afresh brings the iteration back.
#[test]
fn directions_of_another_matrix_cost_iterations_and_not_the_solution() {
    let mut case = Case::new();
    let n = 3 * case.body.free_nodes();
    let mut workspace = case.keeping(40);
    let b = case.load(3);
    case.run(&b, &mut vec![0.0; n], 1e-9, &mut workspace);
    case.a = case.body.system(9);
    let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
    case.run(&b, &mut x, 1e-9, &mut workspace);
    case.run(&b, &mut y, 1e-9, &mut PcgWorkspace::new(n / 3));
    assert!(relative_difference(&x, &y) < 1e-6);
}

#[test]
fn as_many_directions_are_kept_as_there_is_room_for() {
    let mut case = Case::new();
    let n = 3 * case.body.free_nodes();
    let mut solution = vec![0.0; n];
    let b = case.load(4);
    case.run(&b, &mut solution, 1e-9, &mut PcgWorkspace::new(n / 3));
    for most in [0, 1, 3] {
        let mut workspace = case.keeping(most);
        for seed in 3..5 {
            let mut x = vec![0.0; n];
            let load = case.load(seed);
            case.run(&load, &mut x, 1e-9, &mut workspace);
            assert!(seed == 3 || relative_difference(&x, &solution) < 1e-6);
        }
    }
}
