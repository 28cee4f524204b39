//! How a tool moved during a step: as one, or with jaws that turned on it.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use palpate_collision::tool::{Jaw, Tool, ToolPose, jaw_of};

/// How a rigid part moved.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Path {
    /// Displacement of the point of the part that ends at the reference point \[m\].
    translation: Vector3<f64>,
    /// `1 - Rᵀ` for the rotation `R` of the step: a lever at the end of the step times this is its displacement.
    turn: Matrix3<f64>,
}

impl Path {
    fn between(previous: &Isometry3<f64>, current: &Isometry3<f64>) -> Self {
        let step = current.rotation * previous.rotation.inverse();
        Self {
            translation: current.translation.vector - previous.translation.vector,
            turn: Matrix3::identity() - step.inverse().to_rotation_matrix().into_inner(),
        }
    }

    /// The same with levers from a point that is not the origin of the part.
    fn about(reference: &Vector3<f64>, previous: &Isometry3<f64>, current: &Isometry3<f64>) -> Self {
        let began = previous * current.inverse_transform_point(&Point3::from(*reference));
        Self { translation: reference - began.coords, ..Self::between(previous, current) }
    }
}

/// How a tool moved during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolMotion {
    frame: Path,
    /// The first and the second jaw; as the frame for a tool without.
    jaws: [Path; 2],
}

impl ToolMotion {
    /// A tool at rest.
    pub fn none() -> Self {
        let rest = Path { translation: Vector3::zeros(), turn: Matrix3::zeros() };
        Self { frame: rest, jaws: [rest; 2] }
    }

    /// The motion of a tool without jaws from one pose to another.
    pub fn between(previous: &Isometry3<f64>, current: &Isometry3<f64>) -> Self {
        let frame = Path::between(previous, current);
        Self { frame, jaws: [frame; 2] }
    }

    /// The motion of a tool from one pose to another.
    pub fn of_tool(tool: &Tool, previous: &ToolPose, current: &ToolPose) -> Self {
        let motion = Self::between(&previous.frame, &current.frame);
        if tool.hinge().is_none() {
            return motion;
        }
        let reference = current.frame.translation.vector;
        let of_jaw =
            |jaw| Path::about(&reference, &tool.jaw_pose(Some(jaw), previous), &tool.jaw_pose(Some(jaw), current));
        Self { jaws: [of_jaw(Jaw::First), of_jaw(Jaw::Second)], ..motion }
    }

    /// That of one jaw alone, or for none of the frame, as a motion of the whole.
    #[must_use]
    pub fn of(&self, jaw: Option<Jaw>) -> Self {
        let path = self.path(jaw);
        Self { frame: path, jaws: [path; 2] }
    }

    /// Displacement \[m\] during the step of the tool's point that ends it at `lever` \[m\] from the reference point.
    pub fn displacement(&self, lever: &Vector3<f64>) -> Vector3<f64> {
        self.frame.translation + self.frame.turn * lever
    }

    /// The same of the point of the jaw that the identifier of a contact of the skin names.
    pub fn displacement_at(&self, feature: u64, lever: &Vector3<f64>) -> Vector3<f64> {
        let path = self.path(jaw_of(feature));
        path.translation + path.turn * lever
    }

    fn path(&self, jaw: Option<Jaw>) -> Path {
        match jaw {
            None => self.frame,
            Some(Jaw::First) => self.jaws[0],
            Some(Jaw::Second) => self.jaws[1],
        }
    }
}
