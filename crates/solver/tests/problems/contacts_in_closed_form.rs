//! Contact problems whose answer is known on paper.
#![allow(non_snake_case)]

use crate::half_space;

use crate::rigid_bodies::{GRAVITY, STEP, between_walls, painleve_rod, problem, rigid_stool};
use nalgebra::{DMatrix, DVector, Vector3};
use palpate_constraints::law::{Bilateral, Coulomb, Signorini};
use palpate_solver::gauss_seidel::{self, GaussSeidelConfig, GaussSeidelWorkspace, SweepOrder};
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::report::{SolveReport, SolveStatus};

fn tight() -> GaussSeidelConfig {
    GaussSeidelConfig { tolerance: 1e-12, max_sweeps: 20_000, ..GaussSeidelConfig::default() }
}

fn solve_from(
    start: &[f64],
    problem: &ConstraintProblem,
    config: &GaussSeidelConfig,
) -> (Vec<f64>, Vec<f64>, SolveReport) {
    let mut lambda = start.to_vec();
    let mut ws = GaussSeidelWorkspace::with_capacity(problem.rows());
    let report = gauss_seidel::solve(&problem.view(), &mut lambda, config, &mut ws);
    (lambda, ws.delta().to_vec(), report)
}

fn solve(problem: &ConstraintProblem, config: &GaussSeidelConfig) -> (Vec<f64>, Vec<f64>, SolveReport) {
    solve_from(&vec![0.0; problem.rows()], problem, config)
}

/// A point mass on an incline, stepped from rest by backward Euler; returns its speed along the slope.
fn speed_on_incline(slope: f64, heading: f64, friction: f64, steps: usize) -> Vector3<f64> {
    let mass = 0.2;
    let W = DMatrix::identity(3, 3) * (STEP * STEP / mass);
    let (mut v, mut lambda) = (Vector3::zeros(), vec![0.0; 3]);
    let downhill = Vector3::new(0.0, heading.cos(), heading.sin());
    let g = GRAVITY * (downhill * slope.sin() - Vector3::x() * slope.cos());
    for _ in 0..steps {
        let free = (v + g * STEP) * STEP;
        let step = problem(W.clone(), free.as_slice(), vec![Coulomb { friction }.into()]);
        let (force, delta, report) = solve_from(&lambda, &step, &tight());
        assert_eq!(report.status, SolveStatus::Solved);
        v = Vector3::from_column_slice(&delta) / STEP;
        lambda = force;
    }
    v
}

#[test]
fn block_on_incline_sticks_below_the_friction_angle_and_slides_above() {
    let friction: f64 = 0.4;
    let critical = friction.atan();
    for below in [0.1, 0.5, 0.9, 0.999] {
        // Speed gained without friction is GRAVITY * t; what is left is rounding.
        let v = speed_on_incline(below * critical, 0.3, friction, 100);
        assert!(v.norm() < 1e-12, "slides at {below} of the friction angle: {v}");
    }
    for above in [1.001, 1.1, 1.5] {
        let slope = above * critical;
        let v = speed_on_incline(slope, 0.3, friction, 100);
        let expected = GRAVITY * (slope.sin() - friction * slope.cos()) * 100.0 * STEP;
        assert!((v.norm() - expected).abs() < 1e-10 * GRAVITY, "at {above}: {} instead of {expected}", v.norm());
    }
}

#[test]
fn friction_is_isotropic_over_64_headings() {
    let slope: f64 = 0.6;
    let expected = GRAVITY * (slope.sin() - 0.3 * slope.cos()) * 10.0 * STEP;
    for k in 0..64 {
        let heading = std::f64::consts::TAU * f64::from(k) / 64.0;
        let v = speed_on_incline(slope, heading, 0.3, 10);
        let along = Vector3::new(0.0, heading.cos(), heading.sin()) * expected;
        assert!((v - along).norm() < 1e-9 * expected, "heading {k}: {v}");
    }
}

/// Two contacts pressed by given loads and coupled along one tangent, dragged by `d`: `W_t = [a c; c a]`.
#[test]
fn two_coupled_contacts_pass_from_stick_to_slip_one_after_the_other() {
    let (a, c, k_n, friction) = (1e-3, 4e-4, 2e-3, 0.5);
    let normal = [2.0, 1.0]; // N, contact 1 carries more and slips last
    let mut W = DMatrix::zeros(6, 6);
    for (i, w) in [k_n, a, a, k_n, a, a].into_iter().enumerate() {
        W[(i, i)] = w;
    }
    (W[(1, 4)], W[(4, 1)]) = (c, c);
    let both = |d: f64| -d / (a + c);
    // Contact 2 slips when its stick force reaches the cone, contact 1 when it has taken over enough.
    let first_slip = friction * normal[1] * (a + c);
    let second_slip = friction * (normal[0] * a + normal[1] * c);
    for d in [
        0.2 * first_slip,
        0.99 * first_slip,
        1.01 * first_slip,
        0.99 * second_slip,
        1.01 * second_slip,
        3.0 * second_slip,
    ] {
        let free = [-k_n * normal[0], d, 0.0, -k_n * normal[1], d, 0.0];
        let (lambda, delta, report) = solve(&problem(W.clone(), &free, vec![Coulomb { friction }.into(); 2]), &tight());
        assert_eq!(report.status, SolveStatus::Solved);
        let expected = if d < first_slip {
            [both(d), both(d)]
        } else if d < second_slip {
            [-(d - c * friction * normal[1]) / a, -friction * normal[1]]
        } else {
            [-friction * normal[0], -friction * normal[1]]
        };
        assert!((lambda[1] - expected[0]).abs() < 1e-9 && (lambda[4] - expected[1]).abs() < 1e-9, "{d}: {lambda:?}");
        assert_eq!(delta[4].abs() > 1e-9, d > first_slip, "contact 2 at {d}");
        assert_eq!(delta[1].abs() > 1e-9, d > second_slip, "contact 1 at {d}");
    }
}

#[test]
fn two_frictionless_contacts_in_all_four_states() {
    let W = DMatrix::from_row_slice(2, 2, &[2e-3, 1e-3, 1e-3, 3e-3]);
    // Open, open; closed, lifted by the other; closed, closed; open, closed.
    let cases = [
        ([1e-3, 1e-3], [0.0, 0.0]),
        ([-2e-3, -5e-4], [1.0, 0.0]),
        ([-4e-3, -7e-3], [1.0, 2.0]),
        ([-1e-3, -6e-3], [0.0, 2.0]),
    ];
    for (free, expected) in cases {
        let (lambda, delta, report) = solve(&problem(W.clone(), &free, vec![Signorini.into(); 2]), &tight());
        assert_eq!(report.status, SolveStatus::Solved);
        for row in 0..2 {
            assert!((lambda[row] - expected[row]).abs() < 1e-10, "{free:?}: {lambda:?}");
            assert!(delta[row] > -1e-14 && (delta[row] * lambda[row]).abs() < 1e-14, "{free:?}: {delta:?}");
        }
    }
}

#[test]
fn four_legged_stool_has_one_motion_and_bounded_forces() {
    let weight = GRAVITY; // 1 kg
    for start in [[0.0; 4], [8.0, 0.0, 8.0, 0.0], [0.0, 0.0, 0.0, 30.0]] {
        let stool = rigid_stool();
        let (lambda, delta, report) = solve_from(&start, &stool, &tight());
        assert_eq!(report.status, SolveStatus::Solved);
        assert!(delta.iter().all(|gap| gap.abs() < 1e-15), "the stool rests: {delta:?}");
        assert!(
            (lambda.iter().sum::<f64>() - weight).abs() < 1e-8 && lambda.iter().all(|leg| *leg <= weight),
            "{lambda:?}"
        );
    }
}

#[test]
fn elastic_legs_share_the_load_by_their_stiffness() {
    // Two soft legs and two stiff ones; the seat cannot tilt, so that all legs shorten alike.
    let stiffness = [1e4, 1e4, 4e4, 4e4]; // N/m
    let seat = 1e-3; // m/N, the motion common to all
    let W = DMatrix::from_fn(4, 4, |i, j| seat + if i == j { 1.0 / stiffness[i] } else { 0.0 });
    let (lambda, _, report) = solve(&problem(W, &[-1e-3; 4], vec![Signorini.into(); 4]), &tight());
    assert_eq!(report.status, SolveStatus::Solved);
    for leg in 1..4 {
        let share = lambda[leg] / lambda[0];
        assert!((share - stiffness[leg] / stiffness[0]).abs() < 1e-8, "leg {leg} carries {share} of the first");
    }
}

#[test]
fn wedged_block_keeps_bounded_forces_and_one_motion() {
    // Pressed into the left wall by 20 N so that it just touches the right one: forces are not unique, the motion is.
    let press = 20.0 * STEP * STEP;
    let wedge = between_walls([-press, press], -STEP * STEP * GRAVITY, 0.6);
    for start in [0.0, 1.0, 100.0] {
        let (lambda, delta, report) = solve_from(&[start, 0.0, 0.0, start, 0.0, 0.0], &wedge, &tight());
        assert_eq!(report.status, SolveStatus::Solved);
        assert!(delta.iter().all(|gap| gap.abs() < 1e-12 * STEP), "held by friction: {delta:?}");
        assert!((lambda[1] + lambda[4] - GRAVITY).abs() < 1e-6, "carries the weight");
        assert!(lambda[0] <= 20.0 + start + 1e-9, "from {start} N to {} N", lambda[0]);
    }
}

#[test]
fn walls_closer_than_the_block_is_wide_stall_with_bounded_forces() {
    // Overlap on both sides: no motion opens both gaps, and forces could grow for ever.
    let overlap = 50.0 * STEP * STEP;
    let wedge = between_walls([-overlap, -overlap], 0.0, 0.6);
    let (lambda, _, report) = solve(&wedge, &tight());
    assert_eq!(report.status, SolveStatus::Stalled);
    assert!(report.iterations <= 2 * tight().stall_sweeps, "{report:?}");
    assert!(lambda.iter().all(|force| force.abs() <= 100.0), "{lambda:?}");
}

#[test]
fn painleve_rod_beyond_critical_friction_gets_a_finite_admissible_force() {
    for friction in [0.5, 1.3, 4.0 / 3.0, 1.4, 2.0, 5.0, 100.0] {
        for speed in [-1.0, -0.1, 0.1, 1.0] {
            let rod = painleve_rod(friction, speed);
            let (lambda, delta, report) = solve(&rod, &tight());
            assert_eq!(report.status, SolveStatus::Solved, "friction {friction}, speed {speed}: {report:?}");
            assert!(delta[0] >= -1e-12 * STEP && lambda[0] >= 0.0);
            assert!(lambda[1].hypot(lambda[2]) <= friction * lambda[0] * (1.0 + 1e-12), "{lambda:?}");
            assert!(lambda[0] < 10.0 / STEP, "finite: {lambda:?}");
        }
    }
}

#[test]
fn friction_dissipates_under_a_dragged_sphere() {
    for friction in [0.1, 0.5, 1.0] {
        let pressed = half_space::pressed_sphere(30, friction, 2e-3, 1e-3);
        pressed.validate().unwrap();
        let (lambda, delta, report) = solve(&pressed, &GaussSeidelConfig { tolerance: 1e-10, ..tight() });
        assert_eq!(report.status, SolveStatus::Solved);
        let mut closed = 0;
        for row in (0..90).step_by(3) {
            let power = lambda[row + 1] * delta[row + 1] + lambda[row + 2] * delta[row + 2];
            assert!(power <= 1e-10 * 1e-3 * lambda[row].abs().max(1e-3), "block {}: {power}", row / 3);
            closed += usize::from(lambda[row] > 0.0);
        }
        assert!(closed > 10, "only {closed} contacts closed");
    }
}

#[test]
fn bilateral_rows_match_a_dense_solve_beside_contacts() {
    let contact = half_space::pressed_sphere(6, 0.3, 2e-3, 0.0);
    let W = contact.compliance().into_owned();
    let free = DVector::from_column_slice(contact.delta_free());
    let held = ConstraintProblem::new(W.clone(), free.clone(), vec![Bilateral { rows: 3 }.into(); 6]).unwrap();
    let (lambda, _, report) = solve(&held, &tight());
    assert_eq!(report.status, SolveStatus::Solved);
    let expected = -W.cholesky().unwrap().solve(&free);
    // The residual bounds the gap error; cond(W) turns it into a force error.
    assert!((DVector::from_vec(lambda) - &expected).norm() <= 1e-9 * expected.norm());
}

#[test]
fn a_warm_start_from_the_solution_takes_no_sweep() {
    let pressed = half_space::pressed_sphere(20, 0.5, 2e-3, 1e-3);
    let (lambda, _, cold) = solve(&pressed, &GaussSeidelConfig::default());
    let (again, _, warm) = solve_from(&lambda, &pressed, &GaussSeidelConfig::default());
    assert!(cold.iterations > 5 && warm.iterations == 0, "{cold:?} {warm:?}");
    assert_eq!(lambda, again);
}

#[test]
fn order_and_relaxation_change_the_path_and_not_the_answer() {
    let pressed = half_space::pressed_sphere(20, 0.3, 2e-3, 1e-3);
    let config = GaussSeidelConfig { tolerance: 1e-11, ..tight() };
    let (plain, _, _) = solve(&pressed, &config);
    let norm = plain.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (relaxation, order) in [(1.0, SweepOrder::Symmetric), (0.7, SweepOrder::Forward), (0.7, SweepOrder::Symmetric)]
    {
        let (other, _, report) = solve(&pressed, &GaussSeidelConfig { relaxation, order, ..config });
        assert_eq!(report.status, SolveStatus::Solved);
        let difference = plain.iter().zip(&other).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(difference <= 1e-7 * norm, "{relaxation} {order:?}: {difference}");
    }
}

#[test]
fn the_same_problem_gives_the_same_bits() {
    let pressed = half_space::pressed_sphere(30, 0.5, 2e-3, 1.5e-3);
    let bits = |lambda: &[f64]| lambda.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let (first, _, _) = solve(&pressed, &GaussSeidelConfig::default());
    for _ in 0..3 {
        assert_eq!(bits(&solve(&pressed, &GaussSeidelConfig::default()).0), bits(&first));
    }
}
