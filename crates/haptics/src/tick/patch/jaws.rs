//! How the tool and its jaws move in a tick.

use nalgebra::{Isometry3, Point3, Vector3};
use palpate_collision::tool::{Jaw, Tool, ToolPose, jaw_of};

use super::ToolPoses;

/// How a part of the tool that is rigid moves in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    held: Isometry3<f64>,
    predicted: Isometry3<f64>,
    before: Isometry3<f64>,
    /// Where the snapshot has it, and where it was when the snapshot came.
    since: [Isometry3<f64>; 2],
    /// Pivot \[m\], and axis times the part's share in the opening.
    pivot: Vector3<f64>,
    axis: Vector3<f64>,
}

/// The tool's frame and its two jaws.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jaws {
    paths: [Path; 3],
    /// From the pose where contacts are found to the predicted one: translation, rotation vector, and opening \[rad\].
    translation: Vector3<f64>,
    rotation: Vector3<f64>,
    opening: f64,
}

impl Jaws {
    /// `before`: the tool at the end of the tick before; `since`: where the snapshot has it, and where it was when that came.
    pub(super) fn new(tool: &Tool, poses: &ToolPoses, before: Option<&ToolPose>, since: &[ToolPose; 2]) -> Self {
        let ToolPoses { held, predicted } = poses;
        let before = before.unwrap_or(held);
        let path = |jaw: Option<Jaw>| {
            let at = |pose| tool.jaw_pose(jaw, pose);
            let (pivot, axis) = match (tool.hinge(), jaw) {
                (Some(hinge), Some(jaw)) => {
                    let (pivot, axis) = hinge.in_world(held);
                    (pivot, axis * jaw.share())
                }
                _ => (held.frame.translation.vector, Vector3::zeros()),
            };
            Path {
                held: at(held),
                predicted: at(predicted),
                before: at(before),
                since: since.each_ref().map(at),
                pivot,
                axis,
            }
        };
        let frame = path(None);
        let jaws = [Jaw::First, Jaw::Second].map(|jaw| if tool.hinge().is_some() { path(Some(jaw)) } else { frame });
        Self {
            paths: [frame, jaws[0], jaws[1]],
            translation: predicted.frame.translation.vector - held.frame.translation.vector,
            rotation: (predicted.frame.rotation * held.frame.rotation.inverse()).scaled_axis(),
            opening: predicted.opening - held.opening,
        }
    }

    /// The tool's origin where contacts are found \[m\].
    pub(super) fn origin(&self) -> Vector3<f64> {
        self.paths[0].held.translation.vector
    }

    /// The path of what a contact's identifier names.
    pub(super) fn of(&self, feature: u64) -> &Path {
        let [frame, first, second] = &self.paths;
        match jaw_of(feature) {
            None => frame,
            Some(Jaw::First) => first,
            Some(Jaw::Second) => second,
        }
    }

    /// Change of the gap along a normal at this lever \[m\], from the pose where contacts are found to the predicted one.
    /// `opens` is that of the contact ([`Path::opens`]).
    pub(super) fn closing(&self, normal: &Vector3<f64>, lever: &Vector3<f64>, opens: &Vector3<f64>) -> f64 {
        let turned = lever.cross(normal).dot(&self.rotation);
        let moved = -normal.dot(&self.translation) - turned;
        if *opens == Vector3::zeros() { moved } else { moved - normal.dot(opens) * self.opening }
    }
}

impl Path {
    /// Velocity \[m\] of the point of the part at `x`, per rad that the jaws open.
    pub(super) fn opens(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.axis.cross(&(x - self.pivot))
    }

    /// Path \[m\] of the part's point at `x`, from where the tick before left it to the predicted pose.
    pub(super) fn of_point(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let local = self.held.inverse_transform_point(&Point3::from(*x));
        self.predicted * local - self.before * local
    }

    /// The same from where the snapshot has the tool to where it was when the snapshot came.
    pub(super) fn until_hand_over(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let local = self.held.inverse_transform_point(&Point3::from(*x));
        self.since[1] * local - self.since[0] * local
    }
}
