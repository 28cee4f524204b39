//! Where a tool is and how far it is open.

use nalgebra::Isometry3;

/// Pose of a tool: its frame, and the angle between its jaws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPose {
    /// From the tool's frame to the world.
    pub frame: Isometry3<f64>,
    /// Angle between the jaws \[rad\]; means nothing for a tool without.
    pub opening: f64,
}

impl ToolPose {
    /// The pose at the share `t` of the way to `other`; this rotation where the two are opposite.
    #[must_use]
    pub fn towards(&self, other: &Self, t: f64) -> Self {
        let (a, b) = (&self.frame, &other.frame);
        let rotation = a.rotation.try_slerp(&b.rotation, t, 1e-9).unwrap_or(a.rotation);
        let frame = Isometry3::from_parts(a.translation.vector.lerp(&b.translation.vector, t).into(), rotation);
        Self { frame, opening: self.opening + (other.opening - self.opening) * t }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let Isometry3 { rotation, translation } = &self.frame;
        let numbers = translation.vector.iter().chain(rotation.coords.iter()).chain([&self.opening]);
        numbers.into_iter().all(|x| x.is_finite())
    }
}

/// A tool without jaws, or with closed ones.
impl From<Isometry3<f64>> for ToolPose {
    fn from(frame: Isometry3<f64>) -> Self {
        Self { frame, opening: 0.0 }
    }
}

impl From<&Isometry3<f64>> for ToolPose {
    fn from(frame: &Isometry3<f64>) -> Self {
        Self::from(*frame)
    }
}

impl From<&ToolPose> for ToolPose {
    fn from(pose: &ToolPose) -> Self {
        *pose
    }
}
