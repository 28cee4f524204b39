//! The free motion of one step.
//!
//! Velocity: `v_free = v + h g` (semi-implicit Euler, as positions follow from the new velocity). Rotation: nothing turns
//! the angular momentum `L`, and the body turns by the exponential of its mean angular velocity, which the implicit
//! midpoint rule on the group of rotations gives in the body's frame,
//! ```text
//! Π = Rᵀ L,   w = I⁻¹ exp(-h w / 2) Π,   R⁺ = R exp(h w)
//! ```
//! `L` is kept to the bit, so that the gyroscopic term can never blow the motion up: the angular velocity is at most
//! `|L|` over the least moment. The rule is symmetric in time and of second order: energy swings by `O(h²)` and does not
//! drift. A body whose inertia is that of a ball turns exactly. Where `h |Π| / I_min` is large the step is divided, so
//! that the fixed-point iteration for `w` contracts; a body that turns faster than the divisions allow turns wrongly, but
//! with the right momentum.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::model::RigidModel;
use crate::state::RigidState;

/// Turn (rad) of a part of a step, measured with the least moment.
const TURN: f64 = 0.4;

/// Most parts of a step: 13 rad a step is a body that a screen shows as a blur.
const MOST_PARTS: usize = 32;

/// Most iterations for one mean angular velocity: the error falls at least fivefold in each.
const ITERATIONS: usize = 24;

/// The motion if nothing touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeMotion {
    /// Velocity of the centre of mass at the end of the step (m/s).
    pub velocity: Vector3<f64>,
    /// Mean angular velocity of the step (rad/s), in the world's frame.
    pub angular_velocity: Vector3<f64>,
    /// Rotation of the step, in the world's frame.
    pub turn: UnitQuaternion<f64>,
}

/// The free motion of a step `dt` (s) under an acceleration (m/s²).
pub fn free_motion(model: &RigidModel, state: &RigidState, acceleration: &Vector3<f64>, dt: f64) -> FreeMotion {
    let fastest = dt * state.angular_momentum.norm() / model.least_moment();
    let parts = if fastest.is_finite() { ((fastest / TURN).ceil() as usize).clamp(1, MOST_PARTS) } else { 1 };
    let h = dt / parts as f64;
    let begin = state.pose.rotation;
    let (mut rotation, mut mean) = (begin, Vector3::zeros());
    for _ in 0..parts {
        let momentum = rotation.inverse_transform_vector(&state.angular_momentum);
        let w = midpoint(model, &momentum, h);
        mean += rotation * w / parts as f64;
        rotation *= UnitQuaternion::from_scaled_axis(w * h);
    }
    FreeMotion { velocity: state.velocity + acceleration * dt, angular_velocity: mean, turn: rotation / begin }
}

/// `w = I⁻¹ exp(-h w / 2) Π` by fixed-point iteration.
fn midpoint(model: &RigidModel, momentum: &Vector3<f64>, h: f64) -> Vector3<f64> {
    let mut w = model.inverse_inertia() * momentum;
    for _ in 0..ITERATIONS {
        let next = model.inverse_inertia() * (UnitQuaternion::from_scaled_axis(w * (-0.5 * h)) * momentum);
        let change = (next - w).norm();
        w = next;
        if change <= 1e-15 * w.norm() {
            break;
        }
    }
    w
}

/// The end of the step: the free motion with what contact adds to the velocity (m/s) and to the angular velocity (rad/s,
/// by the inertia of the step's begin).
pub fn advance(
    model: &RigidModel,
    state: &mut RigidState,
    free: &FreeMotion,
    added_velocity: &Vector3<f64>,
    added_angular_velocity: &Vector3<f64>,
    dt: f64,
) {
    state.angular_momentum += state.inertia(model) * added_angular_velocity;
    state.velocity = free.velocity + added_velocity;
    let rotation = UnitQuaternion::from_scaled_axis(added_angular_velocity * dt) * free.turn * state.pose.rotation;
    let translation = Translation3::from(state.pose.translation.vector + state.velocity * dt);
    // Products of unit quaternions leave the sphere by rounding only, and slowly.
    state.pose = Isometry3::from_parts(translation, UnitQuaternion::new_normalize(rotation.into_inner()));
}
