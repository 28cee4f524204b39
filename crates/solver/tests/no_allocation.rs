//! Once problem and workspace exist, and the workspace is prepared for the sequence of laws where cone programs come of it,
//! filling and solving allocate nothing.

mod half_space;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use palpate_constraints::law::{Bilateral, Coulomb, Signorini};
use palpate_solver::automatic::AutomaticConfig;
use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, SweepOrder};
use palpate_solver::lagrange::{self, LagrangeConfig, LagrangeProblem, LagrangeWorkspace};
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::report::SolveStatus;
use palpate_solver::residual;
use palpate_solver::solver::{ConstraintSolver, Solver, SolverWorkspace};
use palpate_solver::watch::Watch;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// One test: the counter belongs to the thread, the message to the process.
#[test]
fn filling_and_solving_allocate_nothing() {
    let source = half_space::pressed_sphere(30, 0.5, 2e-3, 1.5e-3);
    let mut problem = ConstraintProblem::with_capacity(90);
    let configs = [
        GaussSeidelConfig::default(),
        GaussSeidelConfig { max_sweeps: 3, order: SweepOrder::Symmetric, relaxation: 0.8, ..Default::default() },
    ];
    let mut lambda = vec![0.0; 90];
    let mut scratch = vec![0.0; 90];

    // The guard works: it sees an allocation.
    assert_no_alloc(|| drop(std::hint::black_box(vec![0_u8; 64])));
    assert!(violation_count() > 0);
    reset_violation_count();

    let swept = configs.map(Solver::GaussSeidel);
    // Cone programs are laid out as they are met; the automatic choice comes to them only where all else has failed.
    let named =
        Solver::NAMES.iter().filter(|name| !name.starts_with("conic")).filter_map(|name| Solver::from_name(name));
    for solver in swept.into_iter().chain(named) {
        let few = matches!(solver, Solver::GaussSeidel(config) if config.max_sweeps == 3);
        let mut ws: SolverWorkspace = solver.workspace(90);
        let (mut solved, mut swept) = (0, 0);
        assert_no_alloc(|| {
            for contacts in [1_usize, 30, 7, 30, 0, 12] {
                let rows = 3 * contacts;
                assert!(problem.reset(rows).is_ok());
                problem.compliance_mut().copy_from(&source.compliance().view((0, 0), (rows, rows)));
                problem.delta_free_mut().copy_from_slice(&source.delta_free()[..rows]);
                for _ in 0..contacts {
                    problem.push_block(Coulomb { friction: 0.5 }.into());
                }
                lambda.fill(0.0);
                let report = solver.solve(&problem.view(), &mut lambda[..rows], &mut ws);
                solved += usize::from(report.status == SolveStatus::Solved);
                let judged = residual::evaluate(&problem.view(), &lambda[..rows], &mut scratch[..rows]);
                swept += usize::from(judged.relative.is_finite());
            }
            // Past the capacity: a report, and still no memory.
            assert!(problem.reset(91).is_err());
            assert!(problem.reset(1).is_ok());
            problem.push_block(Signorini.into());
            if let SolverWorkspace::GaussSeidel(ws) = &mut ws {
                assert!(gauss_seidel::prepare(&problem.view(), &mut lambda[..1], ws).is_ok());
                assert!(gauss_seidel::sweep(&problem.view(), &mut lambda[..1], 1.0, false, ws));
            }
        });
        assert_eq!(violation_count(), 0, "{}", solver.name());
        assert_eq!(swept, 6);
        // Three damped sweeps solve the empty problem only.
        assert!(if few { solved == 1 } else { solved == 6 }, "{}: {solved}", solver.name());
    }

    // On conflicting joints the automatic choice goes past Newton, whose factorisations are then singular, to Lemke,
    // many sweeps and the gradient, each of which is looked at here, and at last to cone programs.
    let mut conflict = ConstraintProblem::with_capacity(2);
    assert!(conflict.reset(2).is_ok());
    conflict.compliance_mut().fill(1.0);
    conflict.delta_free_mut().copy_from_slice(&[-1.0, 1.0]);
    (0..2).for_each(|_| conflict.push_block(Bilateral { rows: 1 }.into()));
    for name in ["semismooth_newton", "lemke", "gauss_seidel", "accelerated_gradient"] {
        let solver = Solver::from_name(name).unwrap();
        let mut ws = solver.workspace(90);
        lambda.fill(0.0);
        let report = assert_no_alloc(|| solver.solve(&conflict.view(), &mut lambda[..2], &mut ws));
        assert!(!report.is_solved(), "{name}: {report:?}");
        assert_eq!(violation_count(), 0, "{name}");
    }

    let config = AutomaticConfig::default();
    let mut ws = config.workspace(90);
    let mut again = || {
        lambda.fill(0.0);
        config.solve_watched(&conflict.view(), &mut lambda[..2], &mut ws, &mut Watch::none()).iterations
    };
    let laid_out = again();
    assert_eq!(assert_no_alloc(again), laid_out);
    assert_eq!(violation_count(), 0);
    let mut prepared = config.workspace(90);
    assert_eq!(config.prepare(&conflict.view(), &mut prepared), Ok(()));
    lambda.fill(0.0);
    let solve = || config.solve_watched(&conflict.view(), &mut lambda[..2], &mut prepared, &mut Watch::none());
    assert_eq!(assert_no_alloc(solve).iterations, laid_out);
    assert_eq!(violation_count(), 0);
    assert_eq!(ws.attempts().last().map(|attempt| attempt.solver), Some("conic_friction"));

    // A problem that the first sweeps of the automatic choice do not solve: it goes on to Newton.
    let hard = half_space::pressed_sphere(30, 0.5, 8e-3, 1.5e-3);
    let config = AutomaticConfig::default().limited(1e-10, None);
    let mut ws = config.workspace(90);
    lambda.fill(0.0);
    let report = assert_no_alloc(|| config.solve_watched(&hard.view(), &mut lambda, &mut ws, &mut Watch::none()));
    assert!(report.is_solved() && ws.attempts().len() > 1, "{:?}", ws.attempts());
    assert_eq!(violation_count(), 0);

    on_another_thread(&hard);
    cone_programs();
    multipliers();
}

/// Programs of several structures, each prepared for with other numbers: no memory, and the bits of a new workspace.
fn cone_programs() {
    let cases = [("conic_friction", 0.3, 0.7), ("conic_friction", 0.9, 0.2), ("conic_qp", 0.0, 0.0)];
    for (name, before, after) in cases {
        let solver = Solver::from_name(name).unwrap().limited(1e-8, None);
        let mut ws = solver.workspace(90);
        let sizes = [1_usize, 30, 7, 12];
        for contacts in sizes {
            let problem = half_space::pressed_sphere(contacts, before, 1e-3, 1e-3);
            assert_eq!(solver.prepare(&problem.view(), &mut ws), Ok(()), "{name}, {contacts}");
        }
        for contacts in sizes.into_iter().rev() {
            let problem = half_space::pressed_sphere(contacts, after, 2e-3, 1.5e-3);
            let (mut lambda, mut expected) = (vec![0.0; 3 * contacts], vec![0.0; 3 * contacts]);
            let mut new = solver.workspace(90);
            let fresh = solver.solve(&problem.view(), &mut expected, &mut new);
            let report = assert_no_alloc(|| solver.solve(&problem.view(), &mut lambda, &mut ws));
            assert_eq!(violation_count(), 0, "{name}, {contacts}");
            assert!(report.is_solved() && report == fresh, "{name}, {contacts}: {report:?} {fresh:?}");
            assert_eq!(lambda, expected, "{name}, {contacts}");
        }
    }
}

/// Multipliers over a body whose entries stay where they are: what was laid out in the first step serves the second.
fn multipliers() {
    let problem = half_space::pressed_sphere(10, 0.4, 2e-3, 1e-3);
    let n = problem.rows();
    // The body's matrix has the diagonal of what the compliance would be the inverse of.
    let column_start: Vec<usize> = (0..=n).collect();
    let row: Vec<usize> = (0..n).collect();
    let jacobian: Vec<_> = (0..n).map(|r| (r, r, 1.0)).collect();
    let config = LagrangeConfig { tolerance: 1e-8, ..LagrangeConfig::default() };
    let mut ws = LagrangeWorkspace::default();
    let (mut w, mut lambda) = (vec![0.0; n], vec![0.0; n]);
    for heavier in [1.0, 3.0] {
        let value: Vec<f64> = (0..n).map(|i| heavier * (1.0 + (i % 5) as f64)).collect();
        let step = LagrangeProblem {
            column_start: &column_start,
            row: &row,
            value: &value,
            jacobian: &jacobian,
            dt: 1.0 / 30.0,
            view: problem.view(),
        };
        let fresh = lagrange::solve(&step, &config, &mut w, &mut lambda, &mut LagrangeWorkspace::default());
        let expected = lambda.clone();
        let mut again = || lagrange::solve(&step, &config, &mut w, &mut lambda, &mut ws);
        let report = if heavier == 1.0 { again() } else { assert_no_alloc(again) };
        assert_eq!(violation_count(), 0);
        assert!(report.is_solved() && report == fresh && lambda == expected, "{report:?} {fresh:?}");
    }
}

/// A workspace made here and used elsewhere: its thread is warmed, and then the factorisations of Newton, which conflicting
/// joints ask for, allocate nothing from the first on.
fn on_another_thread(hard: &ConstraintProblem) {
    let conflict = bilateral_conflict(30);
    let solver = Solver::from_name("semismooth_newton").unwrap().limited(1e-10, None);
    let mut ws = solver.workspace(90);
    let allocations = std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            let mut lambda = vec![0.0; 90];
            palpate_solver::solver::warm_thread();
            for problem in [&conflict, hard] {
                lambda.fill(0.0);
                assert_no_alloc(|| solver.solve(&problem.view(), &mut lambda[..problem.rows()], &mut ws));
            }
            violation_count()
        });
        thread.join().unwrap()
    });
    assert_eq!(allocations, 0);
}

/// Pairs of joints that pull one coordinate apart: the system of Newton is singular but for its shift.
fn bilateral_conflict(pairs: usize) -> ConstraintProblem {
    let mut problem = ConstraintProblem::with_capacity(2 * pairs);
    assert!(problem.reset(2 * pairs).is_ok());
    for pair in 0..pairs {
        problem.compliance_mut().view_mut((2 * pair, 2 * pair), (2, 2)).fill(1.0);
        problem.delta_free_mut()[2 * pair..2 * pair + 2].copy_from_slice(&[-1.0, 1.0]);
    }
    (0..2 * pairs).for_each(|_| problem.push_block(Bilateral { rows: 1 }.into()));
    problem
}
