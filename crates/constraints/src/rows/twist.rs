//! What a row says of a body that moves as a whole: a tool or a rigid body.

use nalgebra::Vector3;

/// The part of a row on a body with a velocity and an angular velocity about its reference point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwistRow {
    /// Change of the row's gap per metre of the body's translation [-]; force on the body per newton of the row.
    pub force: Vector3<f64>,
    /// Change of the row's gap per radian of its rotation about the reference point \[m\]; torque on the body about that
    /// point per newton of the row.
    pub torque: Vector3<f64>,
}

/// The tool's part of a row.
pub type ToolRow = TwistRow;

impl TwistRow {
    /// The row of direction `d` (unit vector) at lever `r` \[m\] from the reference point, for the body that `d` points
    /// away from: `(-d, -(r x d))`.
    pub fn new(direction: &Vector3<f64>, lever: &Vector3<f64>) -> Self {
        Self { force: -direction, torque: -lever.cross(direction) }
    }

    /// The same for the body that `d` points to: `(d, r x d)`.
    pub fn towards(direction: &Vector3<f64>, lever: &Vector3<f64>) -> Self {
        Self { force: *direction, torque: lever.cross(direction) }
    }

    /// Velocity of the row's gap [m/s] from the body's velocity [m/s] and angular velocity [rad/s].
    pub fn dot(&self, velocity: &Vector3<f64>, angular_velocity: &Vector3<f64>) -> f64 {
        self.force.dot(velocity) + self.torque.dot(angular_velocity)
    }
}

/// Velocity and angular velocity of a body about its reference point, in the world frame; also changes of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Velocity of the reference point [m/s].
    pub linear: Vector3<f64>,
    /// Angular velocity [rad/s].
    pub angular: Vector3<f64>,
}

/// A wrench on a tool about its reference point, in the world frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolWrench {
    /// Force \[N\].
    pub force: Vector3<f64>,
    /// Torque about the reference point [N m].
    pub torque: Vector3<f64>,
}
