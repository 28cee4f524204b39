//! Free vibration by the steps of the program, against theory: order in time, numerical damping, period, energy, and the
//! critical step of central differences on both sides.

#![allow(clippy::print_stdout)] // measured numbers

use std::path::Path;

use crate::integrator_setup::{Modes, distance};
use nalgebra::{Isometry3, Vector3};
use palpate::fem::assembly::{FemWorkspace, internal_forces};
use palpate::fem::integrator::critical_step::critical_step;
use palpate::fem::material::Material;
use palpate::fem::model::FemState;
use palpate::prelude::*;
use palpate::step::StepStatus;

/// A bar along x of 8 x 2 x 2 cm and 5 kPa, clamped at `x = 0`, with these keys of the body, in steps of `dt` (s).
fn bar(cells: [usize; 3], law: &str, keys: &str, dt: f64) -> World {
    let rate = 1.0 / dt;
    let text = format!(
        r#"
        name = "bar"
        [rates]
        step = {rate:?}
        tick = {:?}
        [[body]]
        name = "bar"
        block = {{ min = [0, 0, 0], max = [0.08, 0.02, 0.02], cells = {cells:?} }}
        density = 1000
        material = {{ law = "{law}", young = 5e3, poisson = 0.4 }}
        fixed = [{{ node_set = "x_min" }}]
        settle = false
        {keys}
        [[tool]]
        name = "far away"
        shape = {{ kind = "sphere", radius = 0.005 }}
        [hand]
        path = [{{ time = 0, position = [1, 1, 1] }}]
        "#,
        rate.max(1000.0),
    );
    Scene::from_toml(&text, Path::new("")).unwrap().build().unwrap()
}

const SMALL: [usize; 3] = [4, 1, 1];

/// One linearisation, each solve with the factor of its own matrix.
const LINEARISED: &str = "compliance = \"exact\"\ntolerance = 1e-13";

/// Central differences in so many substeps; what is unstable is not refused.
fn explicit(substeps: u32, keys: &str) -> String {
    format!("integrator = \"explicit\"\nexplicit = {{ substeps = {substeps}, allow_unstable = true }}\n{keys}")
}

/// The state after `steps` steps from `begin`, and all between for `visit`; `None` where the body failed.
fn run(world: &World, begin: &FemState, steps: u32, mut visit: impl FnMut(u32, &FemState)) -> Option<FemState> {
    let mut simulation = Simulation::new(world).unwrap();
    simulation.state_mut().fem = begin.clone();
    for k in 1..=steps {
        let report = simulation.step(&Isometry3::translation(1.0, 1.0, 1.0));
        if report.status != StepStatus::Advanced {
            return None;
        }
        assert_eq!(report.cuts, 0, "no motion here is one that the guard shortens");
        visit(k, &simulation.state().fem);
    }
    Some(simulation.state().fem.clone())
}

/// At rest in place, swinging upwards: by centimetres, far from linear.
fn thrown(world: &World) -> FemState {
    let model = world.model();
    let mut state = model.rest_state();
    for (v, x) in state.v.iter_mut().zip(model.q_rest()) {
        *v = Vector3::new(0.0, 0.0, 60.0 * x.x * x.x);
    }
    state
}

/// Takes the velocity from the time of `q` to half a step `dt` (s) before it, where central differences have it.
fn stagger(world: &World, dt: f64, state: &mut FemState) {
    let (model, half) = (world.model(), 0.5 * dt * world.model().rayleigh_mass());
    let mut ws = FemWorkspace::new(model);
    internal_forces(model, state, &mut ws);
    for &node in model.node_of_free() {
        let node = node as usize;
        let kick = ws.f_int[node] / model.mass()[node] * (0.5 * dt);
        state.v[node] = state.v[node] * (1.0 + half) - kick;
    }
}

#[test]
fn a_linearised_step_damps_and_slows_a_free_mode_as_theory_says() {
    let modes = Modes::new(bar(SMALL, "neo_hookean", LINEARISED, 0.01).model());
    for k in [0, 5] {
        let omega = modes.omega[k];
        for product in [0.05, 0.5, 2.0] {
            let world = bar(SMALL, "neo_hookean", LINEARISED, product / omega);
            // A strain of 1e-7 keeps the law linear to that share.
            let (state, amplitude) = modes.deflected(world.model(), k, 1e-9);
            let steps = 6;
            let state = run(&world, &state, steps, |_, _| {}).unwrap();
            let [x, v] = modes.of(world.model(), &state, k).map(|y| y / amplitude);
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

/// The order from the ends of three runs, each of twice the steps of the one before.
fn order(ends: &[FemState; 3]) -> f64 {
    let differences = [distance(&ends[0], &ends[1]), distance(&ends[1], &ends[2])];
    println!("differences {differences:?} m");
    (differences[0] / differences[1]).log2()
}

#[test]
fn linearised_steps_converge_with_first_order() {
    let end = 0.02;
    let ends = [100, 200, 400].map(|steps| {
        let world = bar(SMALL, "neo_hookean", LINEARISED, end / f64::from(steps));
        run(&world, &thrown(&world), steps, |_, _| {}).unwrap()
    });
    let world = bar(SMALL, "neo_hookean", LINEARISED, 0.01);
    assert!(distance(&ends[2], &world.model().rest_state()) > 0.005, "it swings");
    let order = order(&ends);
    println!("order {order:.3}");
    // The next term of the error is smaller by h ω = 0.05 or so, hence the tenth.
    assert!((order - 1.0).abs() < 0.1, "{order}");
}

#[test]
fn the_energy_of_linearised_steps_of_linear_tissue_never_grows() {
    // The linear law, at any size; another one at a strain of 1e-7, where it is linear.
    let cases = [("linear", 1e-2), ("neo_hookean", 1e-9)];
    for (law, size) in cases.into_iter().filter(|(law, _)| Material::NAMES.contains(law)) {
        let modes = Modes::new(bar(SMALL, law, LINEARISED, 0.01).model());
        for h in [1e-3, 1e-2, 1.0 / 30.0, 0.1, 1.0] {
            let world = bar(SMALL, law, LINEARISED, h);
            let model = world.model();
            let mut state = model.rest_state();
            for k in [0, 3, 7, 20] {
                let (other, _) = modes.deflected(model, k, size);
                state.q.iter_mut().zip(other.q.iter().zip(model.q_rest())).for_each(|(q, (o, x))| *q += o - x);
            }
            // Modal energy: that of the law itself drowns in rounding at such a strain.
            let energy = |state: &FemState| -> f64 {
                (0..modes.omega.len())
                    .map(|k| {
                        let [x, v] = modes.of(model, state, k);
                        0.5 * (modes.omega[k] * x).powi(2) + 0.5 * v * v
                    })
                    .sum()
            };
            let begin = energy(&state);
            let mut before = begin;
            let end = run(&world, &state, 20, |k, state| {
                let after = energy(state);
                // Rounding of positions, 1e-17 m of 1e-9 m, squared away into the energy that is left.
                assert!(after <= before * (1.0 + 1e-6) + 1e-14 * begin, "{law}, h {h}, step {k}: {before} {after}");
                before = after;
            });
            assert!(end.is_some());
        }
    }
}

#[test]
fn the_first_newton_iteration_is_the_linearised_step() {
    // With stiffness damping at rest, where the filter has nothing to do; without it at any deformation.
    for (beta, steps) in [(0.01, 1), (0.0, 4)] {
        let damping = format!("rayleigh_mass = 3.0\nrayleigh_stiffness = {beta:?}");
        let of = |keys: &str| {
            let world = bar([4, 2, 2], "neo_hookean", &format!("{keys}\n{damping}"), 0.01);
            let mut state = world.model().rest_state();
            for (v, x) in state.v.iter_mut().zip(world.model().q_rest()) {
                *v = Vector3::new(0.1 * x.x, 0.0, 2.0 * x.x);
            }
            run(&world, &state, steps, |_, _| {}).unwrap()
        };
        let linearised = of(&format!("{LINEARISED}\ndefiniteness_filter = false"));
        let newton = of("integrator = \"newton\"\nnewton = { iterations = 1, tolerance = 1e-12 }");
        // Two ways to the same linear system: rounding, and what the conjugate gradients leave.
        let difference = distance(&newton, &linearised);
        println!("β = {beta}: {difference:.1e} m apart");
        assert!(difference < 1e-12, "{difference:e}");
        let rest = bar([4, 2, 2], "neo_hookean", LINEARISED, 0.01).model().rest_state();
        assert!(distance(&newton, &rest) > 1e-4, "it moved");
    }
}

/// Largest displacement (m) after `steps` substeps `dt` (s) from a small deflection that holds every mode; infinite where
/// the body failed.
fn largest_after(keys: &str, dt: f64, steps: u32) -> f64 {
    const SUBSTEPS: u32 = 50;
    let world = bar(SMALL, "neo_hookean", &explicit(SUBSTEPS, keys), f64::from(SUBSTEPS) * dt);
    let model = world.model();
    let mut state = model.rest_state();
    let mut sign = 1.0;
    for &node in model.node_of_free() {
        state.q[node as usize] += Vector3::new(1.0, 0.6, -0.8) * (sign * 1e-8);
        sign = -sign;
    }
    run(&world, &state, steps / SUBSTEPS, |_, _| {})
        .map_or(f64::INFINITY, |state| distance(&state, &model.rest_state()))
}

#[test]
fn explicit_steps_blow_up_just_above_the_critical_step_and_not_below() {
    for (alpha, beta) in [(0.0, 0.0), (20.0, 0.0), (0.0, 5e-4), (20.0, 5e-3)] {
        let keys = format!("rayleigh_mass = {alpha:?}\nrayleigh_stiffness = {beta:?}");
        let world = bar(SMALL, "neo_hookean", &keys, 0.01);
        let h = critical_step(world.model(), &world.model().rest_state(), world.symbolic()).step;
        // Growth by 1 % above: exp(√(8 · 0.01) n), about a hundred decades in a thousand steps; with strong damping the
        // growth is (1 + 0.02 or so) a step.
        let (below, above) = (largest_after(&keys, 0.99 * h, 3000), largest_after(&keys, 1.01 * h, 3000));
        println!("α = {alpha}, β = {beta}: h = {h:.4e} s: {below:.2e} m below, {above:.2e} m above");
        assert!(below < 1e-6, "stable: {below} m at 0.99 h");
        assert!(above > 1e-4, "unstable: {above} m at 1.01 h");
    }
}

#[test]
fn the_period_of_a_free_mode_is_that_of_central_differences() {
    let modes = Modes::new(bar(SMALL, "neo_hookean", "", 0.01).model());
    for (k, product) in [(0, 0.02), (modes.omega.len() - 11, 0.5), (modes.omega.len() - 1, 1.0)] {
        let h = product / modes.omega[k];
        let world = bar(SMALL, "neo_hookean", &explicit(1, ""), h);
        let phase = 2.0 * (0.5 * product).asin();
        let (mut state, amplitude) = modes.deflected(world.model(), k, 1e-8);
        stagger(&world, h, &mut state);
        let end = run(&world, &state, 60, |n, state| {
            let x = modes.of(world.model(), state, k)[0] / amplitude;
            // No damping at all; a strain of 1e-6 keeps the law linear to that share.
            assert!((x - (phase * f64::from(n)).cos()).abs() < 1e-5, "mode {k}, step {n}: {x}");
        });
        assert!(end.is_some());
        let period = product / phase;
        println!("mode {k}, ωh = {product}: period {period:.6} of the true one");
        // The next term of the series is 3/640 (ωh)⁴ or so.
        assert!((period - (1.0 - product * product / 24.0)).abs() < 0.01 * product * product);
    }
}

#[test]
fn central_differences_converge_with_second_order_and_with_first_where_stiffness_damps() {
    for (beta, expected) in [(0.0, 2.0), (1e-3, 1.0)] {
        let keys = format!("rayleigh_mass = 2.0\nrayleigh_stiffness = {beta:?}");
        let ends = [200, 400, 800].map(|steps| {
            let h = 0.08 / f64::from(steps);
            let world = bar(SMALL, "neo_hookean", &explicit(1, &keys), h);
            let mut state = thrown(&world);
            stagger(&world, h, &mut state);
            run(&world, &state, steps, |_, _| {}).unwrap()
        });
        let order = order(&ends);
        println!("β = {beta}: order {order:.3}");
        assert!((order - expected).abs() < 0.15, "{order}");
    }
}
