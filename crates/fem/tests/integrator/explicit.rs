//! Central differences: the critical step, and what is refused. Order, period and both sides of the critical step are held
//! by the steps of the program, in `tests/tissue/free_vibration.rs` at the root.
#![allow(clippy::print_stdout)]

use crate::integrator_setup::{Modes, bar, bar_of, body, clamped};
use palpate_fem::{
    integrator::{
        critical_step::{CriticalStep, critical_for, critical_step},
        explicit::{ExplicitError, ExplicitWorkspace, check_mass, check_step, explicit_velocity},
    },
    model::FemConfig,
};

#[test]
fn the_critical_step_is_that_of_the_largest_eigenvalue() {
    for cells in [[4, 1, 1], [5, 2, 1]] {
        let mesh = bar_of(cells);
        for beta in [0.0, 2e-4] {
            let config = FemConfig { rayleigh_stiffness: beta, ..clamped(&mesh, "neo_hookean") };
            let (model, symbolic, _) = body(&mesh, &config);
            let exact = *Modes::new(&model).omega.last().unwrap();
            let critical = critical_step(&model, &model.rest_state(), &symbolic);
            println!(
                "{cells:?}, β = {beta}: ω = {exact:.3} in {:.3}..{:.3} rad/s, h < {:.4e} s from {} vectors",
                critical.lower, critical.upper, critical.step, critical.vectors
            );
            // A Ritz value is a lower bound up to rounding, a certificate an upper one.
            assert!(critical.lower <= exact * (1.0 + 1e-12) && exact < critical.upper);
            // The Lanczos residual of 1e-3 bounds the eigenvalue's error; its root halves it.
            assert!(critical.upper / critical.lower < 1.002, "{critical:?}");
            assert_eq!(critical.step, critical_for(critical.upper, beta));
        }
    }
}

#[test]
fn a_step_above_the_critical_one_is_refused_with_the_substeps_that_it_needs() {
    let critical = CriticalStep { lower: 1000.0, upper: 1000.0, step: 2e-3, vectors: 9 };
    assert_eq!(check_step(2e-3, 1, &critical), Ok(()));
    let error = check_step(0.032, 4, &critical).unwrap_err();
    let expected = ExplicitError::Unstable { substeps: 4, dt: 8e-3, critical: 2e-3, omega: 1000.0, needed: 16 };
    assert_eq!(error, expected);
    assert!(error.to_string().contains("at least 16") && error.to_string().contains("2.0000e-3"), "{error}");
    assert_eq!(check_step(0.032, 16, &critical), Ok(()));
    assert_eq!(critical.substeps(1.0 / 30.0, 0.5), 34);
    assert_eq!(critical.substeps(1e-3, 0.9), 1);

    let mesh = bar();
    let (model, _, _) = body(&mesh, &FemConfig { density: 0.0, ..clamped(&mesh, "neo_hookean") });
    assert!(matches!(check_mass(&model), Err(ExplicitError::Massless { .. })));
}

#[test]
fn a_motion_that_is_not_finite_names_its_node() {
    let mesh = bar();
    let (model, _, _) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let mut ws = ExplicitWorkspace::new(&model);
    let mut state = model.rest_state();
    let last = *model.node_of_free().last().unwrap();
    state.v[last as usize].y = f64::INFINITY;
    assert_eq!(explicit_velocity(&model, 1e-4, &[], &state, &mut ws).non_finite, Some(last));
    state.v[last as usize].y = 1.0;
    let report = explicit_velocity(&model, 1e-4, &[], &state, &mut ws);
    // At rest the forces are rounding.
    assert!(report.non_finite.is_none() && (report.fastest - 1.0).abs() < 1e-9, "{report:?}");
}

#[test]
fn no_step_is_stable_at_an_infinite_frequency() {
    for beta in [0.0, 1e-3] {
        assert_eq!(critical_for(f64::INFINITY, beta), 0.0);
        // The limit is approached from above.
        assert!((0.0..1e-99).contains(&critical_for(1e100, beta)));
    }
}
