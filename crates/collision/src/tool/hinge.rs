//! The hinge of a grasper: two jaws that turn about one axis by half the opening each.
//!
//! With θ the opening, the first jaw is turned by θ/2 about the axis through the pivot by the right-hand rule, the second
//! by −θ/2; the parts of both are placed as they lie at θ = 0. A point x of a jaw moves by
//! ```text
//! ẋ = ± ½ θ̇  a × (x − p)          a: axis, p: pivot, in the tool's frame or the world's
//! ```
//! so by virtual power a force f at x acts on θ with the torque ± ½ a · ((x − p) × f), N m.

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

use super::ToolPose;

/// One of the two jaws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jaw {
    /// Turned by half the opening.
    First,
    /// Turned by half the opening the other way.
    Second,
}

impl Jaw {
    /// Angle about the axis over the opening.
    #[must_use]
    pub fn share(self) -> f64 {
        match self {
            Self::First => 0.5,
            Self::Second => -0.5,
        }
    }
}

/// Axis and range of the jaws, in the tool's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// A point of the axis \[m\].
    pub pivot: Vector3<f64>,
    /// Its direction.
    pub axis: Unit<Vector3<f64>>,
    /// Opening with the gripper closed \[rad\].
    pub closed: f64,
    /// Opening with the gripper open \[rad\].
    pub open: f64,
}

impl Hinge {
    /// Opening \[rad\] for a gripper between 0, closed, and 1, open; beyond them at the ends.
    #[must_use]
    pub fn opening(&self, gripper: f64) -> f64 {
        self.closed + (self.open - self.closed) * gripper.clamp(0.0, 1.0)
    }

    /// How a jaw lies at an opening \[rad\], against where it lies at 0, in the tool's frame.
    #[must_use]
    pub fn turn(&self, jaw: Jaw, opening: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&self.axis, jaw.share() * opening);
        let shift = self.pivot - rotation * self.pivot;
        Isometry3::from_parts(Translation3::from(shift), rotation)
    }

    /// Pivot \[m\] and axis in the world.
    #[must_use]
    pub fn in_world(&self, pose: &ToolPose) -> (Vector3<f64>, Vector3<f64>) {
        let frame = &pose.frame;
        (frame.rotation * self.pivot + frame.translation.vector, frame.rotation * self.axis.into_inner())
    }

    /// Torque on the opening \[N m\] of a wrench that acts on one of the jaws: `force` \[N\] and `torque` \[N m\] about the
    /// world's point `reference` \[m\].
    #[must_use]
    pub fn torque(
        &self,
        pose: &ToolPose,
        jaw: Option<Jaw>,
        reference: &Vector3<f64>,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
    ) -> f64 {
        let Some(jaw) = jaw else { return 0.0 };
        let (pivot, axis) = self.in_world(pose);
        jaw.share() * axis.dot(&(torque + (reference - pivot).cross(force)))
    }
}
