//! Truths that every local solve must meet.
#![allow(non_snake_case)]

use super::*;
use nalgebra::{Matrix3, Rotation3};
use proptest::prelude::*;

/// A symmetric positive definite block: random axes, eigenvalues over `decades` decades, in m/N.
fn compliance(decades: f64) -> impl Strategy<Value = Matrix3<f64>> {
    (prop::array::uniform3(-3.0..3.0_f64), prop::array::uniform3(0.0..1.0_f64)).prop_map(move |(axis, exponent)| {
        let R = Rotation3::from_scaled_axis(Vector3::from(axis)).into_inner();
        let eigenvalues = Vector3::from(exponent).map(|e| 1e-3 * 10.0_f64.powf(-decades * e));
        let W = R * Matrix3::from_diagonal(&eigenvalues) * R.transpose();
        0.5 * (W + W.transpose())
    })
}

/// Gaps of millimetres, the normal one biased to penetration.
fn gap() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1e-3..1e-3_f64).prop_map(|b| Vector3::new(b[0] - 3e-4, b[1], b[2]))
}

/// Natural-map residual of a local answer, in m relative to `|b|`.
fn local_residual(law: &Law, W: &Matrix3<f64>, b: &Vector3<f64>, lambda: &Vector3<f64>) -> f64 {
    let mut delta = W * lambda + b;
    for row in law.rows()..3 {
        delta[row] = 0.0;
    }
    let rho = natural_stiffness(W, law.rows());
    law.natural_map(rho, &delta, lambda).norm() / rho / b.norm()
}

/// Relative distance by which a force leaves the cone.
fn outside(friction: f64, lambda: &Vector3<f64>) -> f64 {
    (lambda.yz().norm() - friction * lambda.x).max(-lambda.x) / lambda.norm().max(f64::MIN_POSITIVE)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    // The residual of a backward stable solve is eps |W| |lambda| <= eps cond(W) |b| = 2e-10 |b|; the factor covers
    // the handful of operations.
    #[test]
    fn coulomb_local_answer_is_exact_and_inside_the_cone(
        W in compliance(6.0), b in gap(), friction in 0.0..2.0_f64,
    ) {
        let law = Law::from(Coulomb { friction });
        let local = LocalCompliance::new(&W, 3);
        let lambda = law.resolve(&local, &b);
        prop_assert!(local_residual(&law, &W, &b, &lambda) <= 1e-9);
        prop_assert!(outside(friction, &lambda) <= 1e-14);
        let delta = W * lambda + b;
        // Friction never pushes along the slip (rounding as above).
        prop_assert!(lambda.yz().dot(&delta.yz()) <= 1e-9 * lambda.norm() * b.norm());
    }

    #[test]
    fn local_answers_are_finite_and_admissible_for_any_numbers(
        w in prop::array::uniform9(prop::num::f64::ANY), b in prop::array::uniform3(prop::num::f64::ANY),
        friction in prop_oneof![prop::num::f64::ANY, 0.0..MAX_FRICTION], rows in 1..4_usize,
    ) {
        let W = Matrix3::from_row_slice(&w);
        for law in [Law::from(Signorini), Law::from(Coulomb { friction }), Law::from(Bilateral { rows })] {
            let local = LocalCompliance::new(&W, law.rows());
            let lambda = law.resolve(&local, &Vector3::from(b));
            prop_assert!(is_finite(&lambda), "{law:?} {lambda}");
            prop_assert!(is_finite(&law.project(&Vector3::from(b))), "{law:?}");
            if let Law::Coulomb(_) = law {
                prop_assert!(lambda.x >= 0.0);
                if (0.0..=MAX_FRICTION).contains(&friction) {
                    // Squares of numbers below 1e-154 vanish in a norm.
                    let tangential = lambda.y.hypot(lambda.z);
                    prop_assert!(tangential <= friction * lambda.x * (1.0 + 1e-12) + 1e-150);
                }
            }
        }
    }

    #[test]
    fn no_friction_is_signorini_to_the_bit(W in compliance(6.0), b in gap()) {
        let frictional = Law::from(Coulomb { friction: 0.0 }).resolve(&LocalCompliance::new(&W, 3), &b);
        let frictionless = Law::from(Signorini).resolve(&LocalCompliance::new(&W, 1), &b);
        prop_assert_eq!(frictional, frictionless);
    }

    #[test]
    fn bilateral_rows_close(W in compliance(6.0), b in gap(), rows in 1..4_usize) {
        let law = Law::from(Bilateral { rows });
        let b = Vector3::from_fn(|i, _| if i < rows { b[i] } else { 0.0 });
        let lambda = law.resolve(&LocalCompliance::new(&W, rows), &b);
        prop_assert!(local_residual(&law, &W, &b, &lambda) <= 1e-9);
        prop_assert!((rows..3).all(|row| lambda[row] == 0.0));
    }

    // A projection is idempotent, and the difference is orthogonal to the projected force over a cone.
    #[test]
    fn cone_projection_is_the_nearest_force(
        force in prop::array::uniform3(-10.0..10.0_f64), other in prop::array::uniform3(-10.0..10.0_f64),
        friction in 0.0..2.0_f64,
    ) {
        let law = Law::from(Coulomb { friction });
        let force = Vector3::from(force);
        let nearest = law.project(&force);
        prop_assert!((law.project(&nearest) - nearest).norm() <= 1e-14 * force.norm());
        prop_assert!((force - nearest).dot(&nearest).abs() <= 1e-13 * force.norm_squared());
        let admissible = law.project(&Vector3::from(other));
        prop_assert!((force - nearest).norm() <= (force - admissible).norm() * (1.0 + 1e-14));
    }

    // The start only saves steps: the answer solves the local problem whatever it was.
    #[test]
    fn a_start_does_not_change_that_the_local_problem_is_solved(
        W in compliance(4.0), b in gap(), start in prop::array::uniform3(prop::num::f64::ANY), friction in 0.01..1.5_f64,
    ) {
        let (law, local) = (Law::from(Coulomb { friction }), LocalCompliance::new(&W, 3));
        for start in [Vector3::from(start), law.resolve(&local, &b) * 1.1] {
            let lambda = law.resolve_from(&local, &b, &start);
            prop_assert!(local_residual(&law, &W, &b, &lambda) <= 1e-9, "{lambda}");
        }
    }

    #[test]
    fn eight_natural_maps_are_those_of_one_contact_to_the_bit(
        numbers in prop::collection::vec(prop_oneof![-1.0..1.0_f64, Just(0.0), prop::num::f64::ANY], 48),
        friction in prop::array::uniform8(0.0..1.5_f64), rho in prop::array::uniform8(0.1..1e4_f64),
    ) {
        let rows = |first: usize| std::array::from_fn(|c| std::array::from_fn(|k| numbers[first + 8 * c + k]));
        let eight = EightContacts { friction, rho, delta: rows(0), lambda: rows(24) };
        let maps = eight.natural_maps();
        for k in 0..8 {
            let row = |of: &[[f64; 8]; 3]| Vector3::new(of[0][k], of[1][k], of[2][k]);
            let law = Law::from(Coulomb { friction: friction[k] });
            let (delta, lambda) = (row(&eight.delta), row(&eight.lambda));
            let one = law.natural_map(rho[k], &delta, &lambda);
            let same = |c: usize| one[c].to_bits() == maps[c][k].to_bits() || one[c].is_nan() && maps[c][k].is_nan();
            prop_assert!((0..3).all(same), "{one} {:?}", row(&maps));
            // And what the projection says.
            let shifted = lambda - law.corrected_gap(&delta) * rho[k];
            if is_finite(&shifted) && shifted.norm() < 1e100 {
                let by_projection = lambda - law.project(&shifted);
                prop_assert!((one - by_projection).norm() <= 1e-14 * (shifted.norm() + lambda.norm()));
            } else {
                prop_assert!(is_finite(&shifted) || one.iter().any(|x| x.is_nan()));
            }
        }
    }

    #[test]
    fn a_singular_block_gets_a_bounded_force(direction in prop::array::uniform3(-1.0..1.0_f64), b in gap()) {
        let d = Vector3::from(direction);
        let W = d * d.transpose() * 1e-3;
        let largest = W.diagonal().max();
        let lambda = Law::from(Coulomb { friction: 0.7 }).resolve(&LocalCompliance::new(&W, 3), &b);
        // lambda^T (W + s I) lambda = -lambda^T b for stick and slip; the factor covers rounding in W.
        prop_assert!(largest == 0.0 || lambda.norm() <= 1.01 * b.norm() / (COMPLIANCE_FLOOR * largest));
    }
}

#[test]
fn separation_stick_and_slip_in_closed_form() {
    let law = Law::from(Coulomb { friction: 0.5 });
    // Normal and tangential coupled, W in m/N.
    let W = Matrix3::new(2e-3, 5e-4, 0.0, 5e-4, 1e-3, 0.0, 0.0, 0.0, 1e-3);
    let local = LocalCompliance::new(&W, 3);

    assert_eq!(law.resolve(&local, &Vector3::new(1e-4, 1e-3, 0.0)), Vector3::zeros());

    // Stick: b = -W (2, 0.6, 0) has the answer (2, 0.6, 0), inside the cone.
    let stick = Vector3::new(2.0, 0.6, 0.0);
    assert!((law.resolve(&local, &(-W * stick)) - stick).norm() < 1e-14);

    // Slip along +t: lambda = (2, -1, 0) on the cone, delta = (0, 3e-4, 0).
    let slip = Vector3::new(2.0, -1.0, 0.0);
    let b = Vector3::new(0.0, 3e-4, 0.0) - W * slip;
    assert!((law.resolve(&local, &b) - slip).norm() < 1e-13);
}

#[test]
fn a_block_without_compliance_gets_no_force() {
    let b = Vector3::new(-1e-3, 1e-3, 0.0);
    for law in [Law::from(Signorini), Law::from(Coulomb { friction: 0.3 }), Law::from(Bilateral { rows: 3 })] {
        let local = LocalCompliance::new(&Matrix3::zeros(), law.rows());
        assert_eq!(law.resolve(&local, &b), Vector3::zeros());
    }
}

#[test]
fn sliding_force_opposes_every_heading_alike() {
    let law = Law::from(Coulomb { friction: 0.3 });
    let local = LocalCompliance::new(&Matrix3::from_diagonal_element(1e-3), 3);
    for heading in 0..64 {
        let angle = std::f64::consts::TAU * f64::from(heading) / 64.0;
        let lambda = law.resolve(&local, &Vector3::new(-1e-3, 5e-3 * angle.cos(), 5e-3 * angle.sin()));
        let expected = Vector3::new(1.0, -0.3 * angle.cos(), -0.3 * angle.sin());
        assert!((lambda - expected).norm() < 1e-14, "heading {heading}: {lambda}");
    }
}

#[test]
fn parameters_outside_their_range_are_named() {
    for friction in [-0.1, f64::NAN, f64::INFINITY, 2.0 * MAX_FRICTION] {
        let error = Law::from(Coulomb { friction }).validate().unwrap_err();
        assert_eq!((error.law, error.parameter), ("coulomb", "friction"));
        assert!(error.to_string().contains(&friction.to_string()));
    }
    assert!(Law::from(Bilateral { rows: 4 }).validate().is_err());
    assert!(Law::from(Bilateral { rows: 0 }).validate().is_err());
    assert!(Law::from(Coulomb { friction: 0.0 }).validate().is_ok());
    assert!(Law::from(Signorini).validate().is_ok());
    for limit in [-1.0, f64::NAN, f64::INFINITY] {
        let error = Law::from(Tresca { limit }).validate().unwrap_err();
        assert_eq!((error.law, error.parameter), ("tresca", "limit"));
        let error = Law::from(Threshold { limit }).validate().unwrap_err();
        assert_eq!((error.law, error.parameter), ("threshold", "limit"));
    }
    for facets in [0, 2, MAX_FACETS + 1] {
        let error = Law::from(FacetedCoulomb { friction: 0.1, facets }).validate().unwrap_err();
        assert_eq!((error.law, error.parameter), ("faceted_coulomb", "facets"));
    }
}

#[test]
fn register_names_match_the_text_form() {
    assert_eq!(Law::NAMES, ["signorini", "coulomb", "faceted_coulomb", "tresca", "threshold", "bilateral"]);
    for (law, name) in one_of_each().into_iter().zip(Law::NAMES) {
        assert_eq!(law.name(), *name);
        // Only dry friction has a gap of its own in the complementarity.
        assert_eq!(law.is_associated(), law.corrected_gap(&Vector3::new(0.0, 1.0, 0.0)) == Vector3::new(0.0, 1.0, 0.0));
    }
}

/// One law of each kind, in the order of the register.
fn one_of_each() -> [Law; 6] {
    [
        Signorini.into(),
        Coulomb { friction: 0.4 }.into(),
        FacetedCoulomb { friction: 0.4, facets: 8 }.into(),
        Tresca { limit: 0.3 }.into(),
        Threshold { limit: 0.5 }.into(),
        Bilateral { rows: 3 }.into(),
    ]
}

/// Any law with parameters of the size of the forces that gaps of millimetres give.
fn any_law() -> impl Strategy<Value = Law> {
    prop_oneof![
        Just(Law::from(Signorini)),
        (0.0..2.0_f64).prop_map(|friction| Coulomb { friction }.into()),
        ((0.0..2.0_f64), 3..33_usize).prop_map(|(friction, facets)| FacetedCoulomb { friction, facets }.into()),
        (0.0..3.0_f64).prop_map(|limit| Tresca { limit }.into()),
        (0.0..3.0_f64).prop_map(|limit| Threshold { limit }.into()),
        (1..4_usize).prop_map(|rows| Bilateral { rows }.into()),
    ]
}

/// Zeros in the rows that a law does not have.
fn of_rows(law: &Law, v: Vector3<f64>) -> Vector3<f64> {
    Vector3::from_fn(|i, _| if i < law.rows() { v[i] } else { 0.0 })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000, failure_persistence: None, ..ProptestConfig::default() })]

    // The bound is that of the backward stable solve above; cond(W) <= 1e4 here, the factor covers the operations.
    #[test]
    fn every_local_answer_is_exact(law in any_law(), W in compliance(4.0), b in gap()) {
        let b = of_rows(&law, b);
        let lambda = law.resolve(&LocalCompliance::new(&W, law.rows()), &b);
        prop_assert!(local_residual(&law, &W, &b, &lambda) <= 1e-10, "{law:?} {lambda}");
        prop_assert!((law.project(&lambda) - lambda).norm() <= 1e-14 * lambda.norm());
    }

    // A projection is the nearest force: no other admissible one is nearer, and it stays where it is.
    #[test]
    fn every_projection_is_the_nearest_force(
        law in any_law(), force in prop::array::uniform3(-10.0..10.0_f64), other in prop::array::uniform3(-10.0..10.0_f64),
    ) {
        let (force, other) = (of_rows(&law, Vector3::from(force)), law.project(&of_rows(&law, Vector3::from(other))));
        let nearest = law.project(&force);
        prop_assert!((law.project(&nearest) - nearest).norm() <= 1e-14 * force.norm());
        // The set is convex: the way to any admissible force turns away from the one projected.
        prop_assert!((force - nearest).dot(&(other - nearest)) <= 1e-12 * force.norm() * (force.norm() + other.norm()));
    }

    // The equation's zeros are those of the natural map, and its derivatives those of its value.
    #[test]
    fn every_linearization_is_the_derivative_of_its_value(
        law in any_law(), delta in prop::array::uniform3(-1.0..1.0_f64), lambda in prop::array::uniform3(-1.0..1.0_f64),
        direction in prop::array::uniform6(-1.0..1.0_f64), rho in 0.5..2.0_f64,
    ) {
        let (delta, lambda) = (of_rows(&law, Vector3::from(delta)), of_rows(&law, Vector3::from(lambda)));
        let d_delta = of_rows(&law, Vector3::new(direction[0], direction[1], direction[2]));
        let d_lambda = of_rows(&law, Vector3::new(direction[3], direction[4], direction[5]));
        let step = 1e-6;
        let at = |t: f64| law.linearize(rho, &(delta + d_delta * t), &(lambda + d_lambda * t)).value();
        let (forward, backward) = ((at(step) - at(0.0)) / step, (at(0.0) - at(-step)) / step);
        let equation = law.linearize(rho, &delta, &lambda);
        let exact = {
            let (by_lambda, by_delta) = equation.derivatives(rho);
            of_rows(&law, by_delta * d_delta + by_lambda * d_lambda)
        };
        let (forward, backward) = (of_rows(&law, forward), of_rows(&law, backward));
        // Away from kinks the one-sided differences agree; second derivatives are of order 1 / |x_t|.
        let bent = 1e-5 / (lambda - delta * rho).yz().norm().max(1e-3);
        prop_assume!((forward - backward).norm() <= bent);
        prop_assert!((exact - forward).norm() <= 2.0 * bent, "{law:?} {exact} {forward}");
    }

    #[test]
    fn the_equation_vanishes_at_local_answers(law in any_law(), W in compliance(4.0), b in gap()) {
        let b = of_rows(&law, b);
        let lambda = law.resolve(&LocalCompliance::new(&W, law.rows()), &b);
        let delta = of_rows(&law, W * lambda + b);
        let rho = natural_stiffness(&W, law.rows());
        let value = of_rows(&law, law.linearize(rho, &delta, &lambda).value());
        prop_assert!(value.norm() <= 1e-10 * rho * b.norm() * 10.0, "{law:?} {value}");
    }

    #[test]
    fn every_answer_is_finite_and_admissible_for_any_numbers(
        law in any_law(), w in prop::array::uniform9(prop::num::f64::ANY), b in prop::array::uniform3(prop::num::f64::ANY),
    ) {
        let lambda = law.resolve(&LocalCompliance::new(&Matrix3::from_row_slice(&w), law.rows()), &Vector3::from(b));
        prop_assert!(is_finite(&lambda), "{law:?} {lambda}");
        let nearest = law.project(&lambda);
        prop_assert!((nearest - lambda).amax() <= 1e-12 * lambda.amax() + 1e-150, "{law:?} {lambda} {nearest}");
        prop_assert!(is_finite(&law.project(&Vector3::from(b))), "{law:?}");
    }

    // Facets lose at most 1 - cos(pi / k) of the friction, so that their answers come to those of the exact cone.
    #[test]
    fn facets_come_to_the_cone(b in gap(), friction in 0.1..1.0_f64) {
        let local = LocalCompliance::new(&Matrix3::from_diagonal(&Vector3::new(1e-3, 8e-4, 8e-4)), 3);
        let exact = Law::from(Coulomb { friction }).resolve(&local, &b);
        for facets in [8_usize, 16, 32, 64] {
            let lambda = Law::from(FacetedCoulomb { friction, facets }).resolve(&local, &b);
            // Uncoupled rows: the normal force is the same, the friction errs by the lost part and the angle between.
            let half = std::f64::consts::PI / facets as f64;
            let bound = friction * exact.x * (half.sin().powi(2) + (1.0 - half.cos()).powi(2)).sqrt();
            prop_assert!((lambda.x - exact.x).abs() <= 1e-12 * exact.x);
            prop_assert!((lambda - exact).norm() <= bound * (1.0 + 1e-9) + 1e-12, "{facets}: {lambda} {exact}");
        }
    }
}

/// Mean friction of a slide at many headings: the loss that methods state for an inscribed polygon.
#[test]
fn facets_lose_the_friction_that_geometry_says() {
    let local = LocalCompliance::new(&Matrix3::from_diagonal_element(1e-3), 3);
    for facets in [4_usize, 8, 16, 32] {
        let law = Law::from(FacetedCoulomb { friction: 0.5, facets });
        let along = |angle: f64| {
            let lambda = law.resolve(&local, &Vector3::new(-1e-3, 5e-3 * angle.cos(), 5e-3 * angle.sin()));
            -(lambda.y * angle.cos() + lambda.z * angle.sin())
        };
        // Along a corner all of the friction, along a side's normal what is left of it.
        let side = std::f64::consts::PI / facets as f64;
        assert!((along(0.0) - 0.5).abs() < 1e-12, "{facets}: {}", along(0.0));
        assert!((along(side) - 0.5 * side.cos()).abs() < 1e-12, "{facets}: {}", along(side));
        // Over all headings a third of the loss along a side: (pi / k)^2 / 6 of (pi / k)^2 / 2, to leading order. With few
        // facets the next order shows.
        let headings = 64 * facets;
        let mean: f64 =
            (0..headings).map(|i| 0.5 - along(std::f64::consts::TAU * i as f64 / headings as f64)).sum::<f64>()
                / headings as f64;
        let part = mean / (0.5 * (1.0 - side.cos()));
        assert!((0.28..=0.40).contains(&part), "{facets}: {part}");
    }
}

#[test]
fn tresca_sticks_slides_and_holds_what_is_apart() {
    let law = Law::from(Tresca { limit: 0.2 });
    let local = LocalCompliance::new(&Matrix3::from_diagonal_element(1e-3), 3);
    let near = |b: [f64; 3], expected: [f64; 3]| {
        let lambda = law.resolve(&local, &Vector3::from(b));
        assert!((lambda - Vector3::from(expected)).norm() < 1e-14, "{lambda}");
    };
    near([-1e-3, 1e-4, 0.0], [1.0, -0.1, 0.0]);
    near([-1e-3, 3e-4, 4e-4], [1.0, -0.12, -0.16]);
    near([1e-3, 1e-4, 0.0], [0.0, -0.1, 0.0]);
    // Coulomb is Tresca at the strength that its own normal force gives.
    let W = Matrix3::new(2e-3, 5e-4, 0.0, 5e-4, 1e-3, 1e-4, 0.0, 1e-4, 1.5e-3);
    let (local, b) = (LocalCompliance::new(&W, 3), Vector3::new(-2e-3, 3e-3, -1e-3));
    let coulomb = Law::from(Coulomb { friction: 0.3 }).resolve(&local, &b);
    let tresca = Law::from(Tresca { limit: 0.3 * coulomb.x }).resolve(&local, &b);
    assert!((coulomb - tresca).norm() < 1e-12 * coulomb.norm(), "{coulomb} {tresca}");
}

#[test]
fn a_threshold_holds_up_to_its_limit() {
    let law = Law::from(Threshold { limit: 0.5 });
    let local = LocalCompliance::new(&Matrix3::from_diagonal_element(1e-3), 1);
    let force = |gap: f64| law.resolve(&local, &Vector3::new(gap, 0.0, 0.0)).x;
    assert_eq!((force(1e-3), force(-1e-3)), (0.0, 0.5));
    assert!((force(-2e-4) - 0.2).abs() < 1e-15);
    let residual =
        |delta, lambda| law.natural_map(1e3, &Vector3::new(delta, 0.0, 0.0), &Vector3::new(lambda, 0.0, 0.0));
    assert_eq!(residual(-1e-3, 0.5), Vector3::zeros());
    assert_eq!(residual(0.0, 0.3), Vector3::zeros());
    assert!(residual(1e-3, 0.5) != Vector3::zeros() && residual(-1e-3, 0.3) != Vector3::zeros());
}
