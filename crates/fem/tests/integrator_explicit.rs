//! Central differences: order, period, and the critical step on both sides.
#![allow(clippy::print_stdout)]

mod integrator_setup;

use integrator_setup::{Modes, bar, bar_of, body, clamped, distance};
use nalgebra::Vector3;
use palpate_fem::{
    integrator::{
        critical_step::{CriticalStep, critical_for, critical_step},
        explicit::{ExplicitError, ExplicitWorkspace, check_mass, check_step, explicit_step, stagger, synchronise},
    },
    model::{FemConfig, FemModel},
};

/// Largest displacement (m) after `steps` from a small deflection that holds every mode.
fn largest_after(model: &FemModel, dt: f64, steps: u32) -> f64 {
    let mut ws = ExplicitWorkspace::new(model);
    let mut state = model.rest_state();
    let mut sign = 1.0;
    for &node in model.node_of_free() {
        state.q[node as usize] += Vector3::new(1.0, 0.6, -0.8) * (sign * 1e-8);
        sign = -sign;
    }
    for _ in 0..steps {
        if explicit_step(model, dt, &[], &mut state, &mut ws).non_finite.is_some() {
            return f64::INFINITY;
        }
    }
    state.q.iter().zip(model.q_rest()).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max)
}

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
fn it_blows_up_just_above_the_critical_step_and_not_below() {
    let mesh = bar();
    for (alpha, beta) in [(0.0, 0.0), (20.0, 0.0), (0.0, 5e-4), (20.0, 5e-3)] {
        let config = FemConfig { rayleigh_mass: alpha, rayleigh_stiffness: beta, ..clamped(&mesh, "neo_hookean") };
        let (model, symbolic, _) = body(&mesh, &config);
        let h = critical_step(&model, &model.rest_state(), &symbolic).step;
        // Growth by 1 % above: exp(√(8 · 0.01) n), about a hundred decades in a thousand steps; with strong damping the
        // growth is (1 + 0.02 or so) a step.
        let (below, above) = (largest_after(&model, 0.99 * h, 3000), largest_after(&model, 1.01 * h, 3000));
        println!("α = {alpha}, β = {beta}: h = {h:.4e} s: {below:.2e} m below, {above:.2e} m above");
        assert!(below < 1e-6, "stable: {below} m at 0.99 h");
        assert!(above.is_nan() || above > 1e-4, "unstable: {above} m at 1.01 h");
    }
}

#[test]
fn the_period_of_a_free_mode_is_that_of_the_scheme() {
    let mesh = bar();
    let (model, _, _) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let modes = Modes::new(&model);
    let mut ws = ExplicitWorkspace::new(&model);
    for (k, product) in [(0, 0.02), (modes.omega.len() - 11, 0.5), (modes.omega.len() - 1, 1.0)] {
        let h = product / modes.omega[k];
        let phase = 2.0 * (0.5 * product).asin();
        let (mut state, amplitude) = modes.deflected(&model, k, 1e-8);
        stagger(&model, h, &[], &mut state, &mut ws);
        for n in 1..=60 {
            explicit_step(&model, h, &[], &mut state, &mut ws);
            let x = modes.of(&model, &state, k)[0] / amplitude;
            // No damping at all; a strain of 1e-6 keeps the law linear to that share.
            assert!((x - (phase * f64::from(n)).cos()).abs() < 1e-5, "mode {k}, step {n}: {x}");
        }
        let period = product / phase;
        println!(
            "mode {k}, ωh = {product}: period {period:.6} of the true one, theory {:.6}",
            1.0 - product * product / 24.0
        );
        // The next term of the series is 3/640 (ωh)⁴ or so.
        assert!((period - (1.0 - product * product / 24.0)).abs() < 0.01 * product * product);
    }
}

#[test]
fn central_differences_converge_with_second_order_and_with_first_where_stiffness_damps() {
    let mesh = bar();
    for (beta, expected) in [(0.0, 2.0), (1e-3, 1.0)] {
        let config = FemConfig { rayleigh_mass: 2.0, rayleigh_stiffness: beta, ..clamped(&mesh, "neo_hookean") };
        let (model, _, _) = body(&mesh, &config);
        let mut ws = ExplicitWorkspace::new(&model);
        let mut run = |steps: u32| {
            let h = 0.08 / f64::from(steps);
            let mut state = model.rest_state();
            for (v, x) in state.v.iter_mut().zip(model.q_rest()) {
                *v = Vector3::new(0.0, 0.0, 60.0 * x.x * x.x);
            }
            stagger(&model, h, &[], &mut state, &mut ws);
            (0..steps).for_each(|_| assert!(explicit_step(&model, h, &[], &mut state, &mut ws).non_finite.is_none()));
            synchronise(&model, h, &[], &mut state, &mut ws);
            state
        };
        let states = [200, 400, 800].map(&mut run);
        let differences = [distance(&states[0], &states[1]), distance(&states[1], &states[2])];
        let order = (differences[0] / differences[1]).log2();
        println!("β = {beta}: differences {differences:?} m, order {order:.3}");
        assert!((order - expected).abs() < 0.15, "{order}");
    }
}

#[test]
fn staggering_and_synchronising_undo_each_other() {
    let mesh = bar();
    let config = FemConfig { rayleigh_mass: 5.0, ..clamped(&mesh, "neo_hookean") };
    let (model, _, _) = body(&mesh, &config);
    let mut ws = ExplicitWorkspace::new(&model);
    let mut state = model.rest_state();
    for (k, &node) in model.node_of_free().iter().enumerate() {
        state.v[node as usize] = Vector3::new(0.1, -0.2, 0.01 * k as f64);
        state.q[node as usize].x *= 1.1;
    }
    let before = state.clone();
    stagger(&model, 1e-3, &[], &mut state, &mut ws);
    assert_ne!(before.v, state.v);
    synchronise(&model, 1e-3, &[], &mut state, &mut ws);
    let difference = before.v.iter().zip(&state.v).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(difference < 1e-15, "rounding of 0.2 m/s: {difference:e}");
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
fn a_motion_that_is_not_finite_leaves_the_state() {
    let mesh = bar();
    let (model, _, _) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let mut ws = ExplicitWorkspace::new(&model);
    let mut state = model.rest_state();
    let last = *model.node_of_free().last().unwrap();
    state.v[last as usize].y = f64::INFINITY;
    let before = state.q.clone();
    let report = explicit_step(&model, 1e-4, &[], &mut state, &mut ws);
    assert_eq!(report.non_finite, Some(last));
    assert_eq!(state.q, before);
}

#[test]
fn no_step_is_stable_at_an_infinite_frequency() {
    for beta in [0.0, 1e-3] {
        assert_eq!(critical_for(f64::INFINITY, beta), 0.0);
        // The limit is approached from above.
        assert!((0.0..1e-99).contains(&critical_for(1e100, beta)));
    }
}
