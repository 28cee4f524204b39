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
}

#[test]
fn register_names_match_the_text_form() {
    assert_eq!(Law::NAMES, ["signorini", "coulomb", "bilateral"]);
}
