//! Forces and motions at a point: wrench and twist, in world axes.

use nalgebra::Vector3;

/// A force and a torque about the tool's origin, in world axes.
///
/// On the hand: what the device's motors are asked to render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force \[N\].
    pub force: Vector3<f64>,
    /// Torque about the tool's origin \[N m\].
    pub torque: Vector3<f64>,
}

impl Wrench {
    /// No force, no torque.
    #[must_use]
    pub fn zero() -> Self {
        Self::default()
    }

    /// A pure force \[N\].
    #[must_use]
    pub fn from_force(force: Vector3<f64>) -> Self {
        Self { force, torque: Vector3::zeros() }
    }

    /// Whether all six numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        all_finite(&self.force) && all_finite(&self.torque)
    }
}

/// Linear velocity of the tool's origin and angular velocity, in world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Velocity of the tool's origin \[m/s\].
    pub linear: Vector3<f64>,
    /// Angular velocity \[rad/s\].
    pub angular: Vector3<f64>,
}

/// Whether all three numbers are finite.
pub(crate) fn all_finite(v: &Vector3<f64>) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}
