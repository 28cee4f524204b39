//! Where a body is and how it moves.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::model::RigidModel;

/// State of a rigid body.
///
/// Angular momentum rather than angular velocity: a body that nothing touches keeps it to the bit, while its angular
/// velocity changes as it turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidState {
    /// Centre of mass (m) and orientation: from the body's frame to the world.
    pub pose: Isometry3<f64>,
    /// Velocity of the centre of mass (m/s).
    pub velocity: Vector3<f64>,
    /// Angular momentum about the centre of mass (kg m²/s), in the world's frame.
    pub angular_momentum: Vector3<f64>,
}

impl RigidState {
    /// A body at `pose` with a velocity (m/s) and an angular velocity (rad/s), both in the world's frame.
    pub fn new(
        model: &RigidModel,
        pose: Isometry3<f64>,
        velocity: Vector3<f64>,
        angular_velocity: Vector3<f64>,
    ) -> Self {
        let mut state = Self { pose, velocity, angular_momentum: Vector3::zeros() };
        state.angular_momentum = state.inertia(model) * angular_velocity;
        state
    }

    /// Inertia about the centre of mass along the world's axes (kg m²).
    pub fn inertia(&self, model: &RigidModel) -> Matrix3<f64> {
        self.in_world(model.inertia())
    }

    /// Its inverse.
    pub fn inverse_inertia(&self, model: &RigidModel) -> Matrix3<f64> {
        self.in_world(model.inverse_inertia())
    }

    fn in_world(&self, tensor: &Matrix3<f64>) -> Matrix3<f64> {
        let r = self.pose.rotation.to_rotation_matrix().into_inner();
        r * tensor * r.transpose()
    }

    /// Angular velocity (rad/s) in the world's frame.
    pub fn angular_velocity(&self, model: &RigidModel) -> Vector3<f64> {
        let local = self.pose.rotation.inverse_transform_vector(&self.angular_momentum);
        self.pose.rotation * (model.inverse_inertia() * local)
    }

    /// Kinetic energy (J).
    pub fn kinetic_energy(&self, model: &RigidModel) -> f64 {
        0.5 * (model.mass() * self.velocity.norm_squared() + self.angular_momentum.dot(&self.angular_velocity(model)))
    }

    /// True where every number is finite.
    pub fn is_finite(&self) -> bool {
        let place = self.pose.translation.vector.iter().chain(self.pose.rotation.coords.iter());
        place.chain(self.velocity.iter()).chain(self.angular_momentum.iter()).all(|x| x.is_finite())
    }

    /// The same place, at rest.
    #[must_use]
    pub fn at_rest(&self) -> Self {
        Self { velocity: Vector3::zeros(), angular_momentum: Vector3::zeros(), ..*self }
    }
}
