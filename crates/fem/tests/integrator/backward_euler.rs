//! Backward Euler by Newton's method: order, numerical damping, energy. The same of steps with one linearisation is held by
//! those of the program, in `tests/tissue/free_vibration.rs` at the root.
#![allow(clippy::print_stdout)]

use crate::integrator_setup::{Modes, bar, bar_of, body, clamped, distance, energy};
use nalgebra::Vector3;
use palpate_fem::{
    integrator::{
        backward_euler::newton_step,
        newton::{ImplicitWorkspace, NewtonConfig, NewtonStatus},
    },
    material::Material,
    model::{FemConfig, FemModel, FemState},
};

fn step(model: &FemModel, dt: f64, state: &mut FemState, ws: &mut ImplicitWorkspace) {
    let report = newton_step(model, dt, &[], &NewtonConfig::default(), state, ws);
    assert_eq!(report.status, NewtonStatus::Converged, "{report:?}");
}

#[test]
fn a_free_vibration_is_damped_and_slowed_as_theory_says() {
    let mesh = bar();
    let (model, _, mut ws) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let modes = Modes::new(&model);
    for k in [0, 5] {
        let omega = modes.omega[k];
        for product in [0.05, 0.5, 2.0] {
            let h = product / omega;
            // A strain of 1e-7 keeps the law linear to that share.
            let (mut state, amplitude) = modes.deflected(&model, k, 1e-9);
            let steps = 6;
            for _ in 0..steps {
                step(&model, h, &mut state, &mut ws);
            }
            let [x, v] = modes.of(&model, &state, k).map(|y| y / amplitude);
            // x + i v/ω is multiplied by 1 / (1 + i ω h) in every step.
            let shrink = x.hypot(v / omega);
            let theory = (1.0 + product * product).powf(-0.5 * f64::from(steps));
            let turned = (-v / omega).atan2(x);
            let expected = (f64::from(steps) * product.atan()).sin_cos();
            let phase = (turned.sin() - expected.0).hypot(turned.cos() - expected.1);
            println!("mode {k}, ωh = {product}: factor {shrink:.8} of {theory:.8}, phase {phase:.1e}");
            // Rounding: positions of 0.08 m are known to 1e-17 m beside a motion of 1e-9 m.
            assert!((shrink / theory - 1.0).abs() < 2e-5 && phase < 2e-5, "{shrink} {theory} {phase}");
        }
    }
}

#[test]
fn newtons_steps_converge_with_first_order() {
    let mesh = bar();
    let (model, _, mut ws) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let end = 0.02;
    let mut run = |steps: u32| {
        let mut state = model.rest_state();
        // A swing of a few centimetres: far from linear.
        for (v, x) in state.v.iter_mut().zip(model.q_rest()) {
            *v = Vector3::new(0.0, 0.0, 60.0 * x.x * x.x);
        }
        for _ in 0..steps {
            step(&model, end / f64::from(steps), &mut state, &mut ws);
        }
        state
    };
    let states = [400, 800, 1600].map(&mut run);
    let swing = states[2].q.iter().zip(model.q_rest()).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max);
    let differences = [distance(&states[0], &states[1]), distance(&states[1], &states[2])];
    let order = (differences[0] / differences[1]).log2();
    println!("differences {differences:?} m of {swing:.3} m, order {order:.3}");
    assert!(swing > 0.005, "{swing}");
    // The next term of the error is smaller by h ω = 0.02 or so, hence the tenth.
    assert!((order - 1.0).abs() < 0.1, "{order}");
}

/// Laws whose energy is so far from convex in ordinary motion that a step may gain from it: tissue that gives way while it
/// is squeezed speeds up by more than backward Euler damps.
const NOT_CONVEX: [&str; 1] = ["st_venant_kirchhoff"];

#[test]
fn the_energy_of_newtons_steps_never_grows_up_to_a_second() {
    let mesh = bar();
    for law in Material::NAMES {
        let (mut gain, mut unconverged) = (0.0_f64, 0);
        for (free, h) in [1e-3, 1e-2, 1.0 / 30.0, 0.1, 1.0].into_iter().flat_map(|h| [(false, h), (true, h)]) {
            let mut config = clamped(&mesh, law);
            if free {
                config.fixed.clear();
            }
            let (model, _, mut ws) = body(&mesh, &config);
            let mut state = model.rest_state();
            // Stretched by 40 %, sheared, and thrown.
            for &node in model.node_of_free() {
                let (q, x) = (&mut state.q[node as usize], model.q_rest()[node as usize]);
                *q += Vector3::new(0.4 * x.x, 0.1 * x.x, 0.0);
                state.v[node as usize] = Vector3::new(0.0, 0.3, 2.0 * x.x);
            }
            let begin = energy(&model, &state);
            for k in 0..12 {
                let before = state.clone();
                let report = newton_step(&model, h, &[], &NewtonConfig::default(), &mut state, &mut ws);
                // Whatever the law and the step: U(q) + ½ ‖v - v0‖² <= U(q0) + ½ ‖v0‖², and by as much as Newton says.
                let jump: Vec<_> = state.v.iter().zip(&before.v).map(|(v, b)| v - b).collect();
                let bound = energy(&model, &FemState { v: jump, ..state.clone() }) - energy(&model, &before);
                assert!(bound <= 1e-12 * begin, "{law} h {h}, free {free}, step {k}: {bound} {report:?}");
                assert!((bound + report.decrease).abs() < 1e-9 * begin, "{bound} {report:?}");
                gain = gain.max((energy(&model, &state) - energy(&model, &before)) / begin);
                unconverged += u32::from(!report.is_converged());
            }
        }
        println!("{law}: largest gain of energy in a step {gain:.1e}, {unconverged} of 120 steps not converged");
        // The tolerance of Newton's method: 1e-9 of the forces over motions of the size of the body.
        assert!(gain < 1e-9 || NOT_CONVEX.contains(law), "{law}: {gain:e}");
        // The corotational law's forces jump on its ridge, and laws that soften when they are flattened have steps
        // between two answers; there the iterations may run out.
        assert!(unconverged <= 6, "{law}: {unconverged}");
    }
}

/// However few iterations a step has, and damped, loaded, from crushed and inverted states alike: what is accepted is never
/// above the begin, `U(q) + ½ ‖v - v0‖² <= U(q0) + ½ ‖v0‖²` (damping and the barrier only add to the left side), also for
/// the laws whose whole energy may grow.
#[test]
fn the_accepted_potential_never_exceeds_that_of_the_begin_whatever_the_iterations() {
    let mesh = bar();
    for law in Material::NAMES {
        for (iterations, h, squeeze) in [(1, 1.0 / 30.0, 0.3), (2, 0.1, 0.1), (3, 1.0, -0.3), (10, 1e-2, -0.3)] {
            let mut config = clamped(&mesh, law);
            (config.rayleigh_stiffness, config.rayleigh_mass) = (0.01, 2.0);
            config.gravity = Vector3::new(0.0, 0.0, -9.81);
            let (model, _, mut ws) = body(&mesh, &config);
            let mut state = model.rest_state();
            for &node in model.node_of_free() {
                // Squeezed along the bar, or turned inside out.
                state.q[node as usize].x *= squeeze;
                state.v[node as usize] = Vector3::new(1.0, -0.5, 0.2);
            }
            let config = NewtonConfig { iterations, tolerance: 1e-9 };
            for k in 0..8 {
                let before = state.clone();
                let report = newton_step(&model, h, &[], &config, &mut state, &mut ws);
                let jump: Vec<_> = state.v.iter().zip(&before.v).map(|(v, b)| v - b).collect();
                let (end, begin) = (energy(&model, &FemState { v: jump, ..state.clone() }), energy(&model, &before));
                // Rounding of the two energies.
                assert!(end <= begin + 1e-12 * begin.abs().max(end.abs()), "{law}, step {k}: {begin} {end} {report:?}");
                assert!(report.decrease >= -1e-12 * begin.abs(), "{law}, step {k}: {report:?}");
            }
        }
    }
}

#[test]
fn newtons_residual_falls_quadratically_and_one_linearisation_leaves_one() {
    let mesh = bar_of([6, 2, 2]);
    let config = FemConfig { gravity: Vector3::new(0.0, 0.0, -9.81), ..clamped(&mesh, "neo_hookean") };
    let (model, _, mut ws) = body(&mesh, &config);
    let residual = |iterations: u32, ws: &mut ImplicitWorkspace| {
        let mut state = model.rest_state();
        let newton = NewtonConfig { iterations, tolerance: 1e-15 };
        newton_step(&model, 1.0 / 30.0, &[], &newton, &mut state, ws).relative_residual
    };
    let residuals: Vec<f64> = (1..6).map(|n| residual(n, &mut ws)).collect();
    println!("relative residuals after 1.. iterations: {residuals:?}");
    assert!(residuals[0] > 1e-6, "one linearisation leaves {:e}", residuals[0]);
    // r_{k+1} = C r_k²: once small, the exponent doubles; until the residual is that of rounding.
    let fast = residuals.windows(2).filter(|r| r[0] < 1e-2 && r[1] > 1e-13);
    let orders: Vec<f64> = fast.map(|r| r[1].ln() / r[0].ln()).collect();
    assert!(!orders.is_empty() && orders.iter().all(|&p| p > 1.6), "{orders:?}");
}

#[test]
fn a_step_that_cannot_be_taken_leaves_the_state_and_says_so() {
    let mesh = bar();
    let (model, _, mut ws) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let mut state = model.rest_state();
    state.v[model.node_of_free()[3] as usize].x = f64::NAN;
    let q = state.q.clone();
    let report = newton_step(&model, 0.01, &[], &NewtonConfig::default(), &mut state, &mut ws);
    assert_eq!(report.status, NewtonStatus::NonFinite);
    assert_eq!(state.q, q);
}
