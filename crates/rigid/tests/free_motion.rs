//! A body that nothing touches: what it keeps, and to which order.

#![allow(clippy::print_stdout)] // tables of what was measured

use nalgebra::{Isometry3, Matrix3, Vector3};
use palpate_rigid::{RigidError, RigidModel, RigidState, advance, free_motion};

fn model(moments: [f64; 3]) -> RigidModel {
    RigidModel::new(2.0, Matrix3::from_diagonal(&moments.into())).unwrap()
}

/// Steps without contact.
fn fly(
    model: &RigidModel,
    state: &mut RigidState,
    gravity: Vector3<f64>,
    dt: f64,
    steps: usize,
    mut visit: impl FnMut(&RigidState),
) {
    let none = Vector3::zeros();
    for _ in 0..steps {
        let free = free_motion(model, state, &gravity, dt);
        advance(model, state, &free, &none, &none, dt);
        visit(state);
    }
}

fn begin(model: &RigidModel, spin: Vector3<f64>) -> RigidState {
    RigidState::new(
        model,
        Isometry3::new(Vector3::zeros(), Vector3::new(0.3, -0.2, 0.5)),
        Vector3::new(1.0, 0.0, 2.0),
        spin,
    )
}

/// Angular momentum is kept to the bit, orientation converges with the square of the step, and the kinetic energy swings
/// about its first value by the square of the step: over ten thousand steps it does not grow.
#[test]
fn angular_momentum_is_kept_and_energy_does_not_grow() {
    let body = model([1.0, 2.0, 2.7]);
    let spin = Vector3::new(0.6, 1.1, -0.8);
    let at = |dt: f64| {
        let mut state = begin(&body, spin);
        fly(&body, &mut state, Vector3::zeros(), dt, (4.0 / dt).round() as usize, |_| {});
        state
    };
    let reference = at(1e-4);
    let (mut turns, mut swings) = (Vec::new(), Vec::new());
    for dt in [0.04, 0.02, 0.01] {
        let state = at(dt);
        turns.push(state.pose.rotation.angle_to(&reference.pose.rotation));
        let mut state = begin(&body, spin);
        let (momentum, energy) = (state.angular_momentum, state.kinetic_energy(&body));
        let mut worst = [0.0_f64; 2];
        let mut step = 0;
        fly(&body, &mut state, Vector3::zeros(), dt, 10_000, |s| {
            assert_eq!(s.angular_momentum, momentum, "to the bit");
            let half = usize::from(step >= 5000);
            worst[half] = worst[half].max((s.kinetic_energy(&body) / energy - 1.0).abs());
            step += 1;
        });
        println!(
            "h = {dt}: turned wrongly by {:.2e} rad after 4 s, energy swings by {worst:?} (halves of 10,000 steps)",
            turns.last().unwrap()
        );
        assert!(worst[1] <= 1.05 * worst[0], "it does not drift: {worst:?}");
        swings.push(worst[0].max(worst[1]));
    }
    for errors in [&turns, &swings] {
        let order = (errors[0] / errors[2]).log2() / 2.0;
        assert!((order - 2.0).abs() < 0.1, "order {order}: {errors:?}");
    }
}

/// Euler's equations of the symmetric top in closed form: the axis goes round the angular momentum with `|L| / I₁`.
#[test]
fn a_symmetric_top_precesses_as_euler_says() {
    let body = model([1.0, 1.0, 1.6]);
    let mut state = RigidState::new(&body, Isometry3::identity(), Vector3::zeros(), Vector3::new(0.5, 0.0, 3.0));
    let momentum = state.angular_momentum;
    let rate = momentum.norm() / 1.0;
    let axis = momentum.normalize();
    let first = Vector3::z();
    let (dt, steps) = (1e-3, 2000);
    fly(&body, &mut state, Vector3::zeros(), dt, steps, |_| {});
    let expected = nalgebra::UnitQuaternion::from_scaled_axis(axis * (rate * dt * steps as f64)) * first;
    let off = (state.pose.rotation * first).angle(&expected);
    println!("the axis is off by {off:.1e} rad after {:.1} rad", rate * dt * steps as f64);
    assert!(off < 1e-5, "{off}");
}

/// The intermediate axis: a spin about it turns over, again and again, and stays finite at steps of any length.
#[test]
fn a_spin_about_the_intermediate_axis_turns_over_and_stays_finite() {
    let body = model([1.0, 2.0, 2.9]);
    for (dt, speed) in [(1.0 / 30.0, 5.0), (1.0 / 30.0, 50.0), (1.0 / 30.0, 5e3), (1.0, 1e6)] {
        let mut state =
            RigidState::new(&body, Isometry3::identity(), Vector3::zeros(), Vector3::new(1e-3, 1.0, 1e-3) * speed);
        let momentum = state.angular_momentum;
        let (mut up, mut turned) = (true, 0);
        fly(&body, &mut state, Vector3::zeros(), dt, 2000, |s| {
            let now = (s.pose.rotation * Vector3::y()).dot(&momentum) > 0.0;
            turned += u32::from(now != up);
            up = now;
            assert!(s.is_finite() && s.angular_momentum == momentum);
            assert!(s.kinetic_energy(&body) <= momentum.norm_squared() / (2.0 * body.least_moment()) * (1.0 + 1e-12));
        });
        println!("h = {dt:.3} s at {speed} rad/s: turned over {turned} times");
        // Beyond some hundred radians a step only momentum and bounds are right.
        assert!(turned >= 4 || dt * speed > 100.0, "{turned}");
    }
}

#[test]
fn a_ball_turns_exactly_and_falls_as_semi_implicit_euler_does() {
    let body = model([1.5, 1.5, 1.5]);
    let mut state = begin(&body, Vector3::new(0.0, 0.0, 20.0));
    let (first, dt, steps) = (state, 0.05, 100);
    fly(&body, &mut state, Vector3::new(0.0, 0.0, -10.0), dt, steps, |_| {});
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::z() * (20.0 * 5.0));
    assert!((turn * first.pose.rotation).angle_to(&state.pose.rotation) < 1e-12);
    assert!((state.velocity - Vector3::new(1.0, 0.0, 2.0 - 50.0)).norm() < 1e-12);
    // z = v t + g t (t + h) / 2
    let z = 2.0 * 5.0 - 10.0 * 5.0 * 5.05 / 2.0;
    assert!((state.pose.translation.z - z).abs() < 1e-11, "{}", state.pose.translation.z - z);
}

/// A torque impulse of contact changes the angular momentum by exactly itself.
#[test]
fn an_impulse_changes_the_momentum_by_itself() {
    let body = model([1.0, 2.0, 2.7]);
    let mut state = begin(&body, Vector3::new(3.0, 1.0, -2.0));
    let (before, impulse) = (state.angular_momentum, Vector3::new(0.4, -0.7, 0.2));
    let free = free_motion(&body, &state, &Vector3::zeros(), 0.01);
    let added = state.inverse_inertia(&body) * impulse;
    advance(&body, &mut state, &free, &Vector3::new(0.1, 0.0, 0.0), &added, 0.01);
    assert!((state.angular_momentum - before - impulse).norm() < 1e-14);
    assert!((state.velocity - free.velocity - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-15);
}

#[test]
fn masses_and_moments_that_no_body_has_are_refused() {
    for mass in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(RigidModel::new(mass, Matrix3::identity()), Err(RigidError::Mass(_))), "{mass}");
    }
    for moments in [[1.0, 1.0, 0.0], [1.0, 1.0, -1.0], [1.0, 1.0, 2.1], [f64::NAN, 1.0, 1.0], [0.0; 3]] {
        let inertia = Matrix3::from_diagonal(&moments.into());
        assert!(matches!(RigidModel::new(1.0, inertia), Err(RigidError::Inertia(_))), "{moments:?}");
    }
    assert!(RigidModel::new(1.0, Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 2.0))).is_ok(), "a thin disc");
}
