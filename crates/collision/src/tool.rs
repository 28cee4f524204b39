//! Tools: one shape, or several that move as one, two groups of which may be the jaws of a gripper.
//!
//! The union of a tool's parts is what touches: each part meets the skin as a tool of its own would, with its own memory of
//! the side from which it came, so that two jaws can hold a fold between them. A contact's identifier names its part and
//! jaw ([`part_of`], [`jaw_of`]): forces are matched between steps part by part.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use crate::contact::feature_kind;
use crate::shape::ToolShape;

mod error;
mod hinge;
mod pose;
mod written;

pub use error::ToolError;
pub use hinge::{Hinge, Jaw};
pub use pose::ToolPose;
use written::ToolConfig;

/// Most parts of a tool.
pub const MAX_PARTS: usize = 32;

/// Place of part and jaw in a contact's identifier: the seven high bits of the tool's feature.
const PART_AT: u32 = 54;
const JAW_AT: u32 = 59;

/// One shape of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The shape, in the part's own frame.
    pub shape: ToolShape,
    /// From the part's frame to the tool's, of a jaw at the opening 0.
    pub place: Isometry3<f64>,
    /// The jaw that it belongs to; none for a part that does not turn.
    pub jaw: Option<Jaw>,
}

/// A tool. Description; valid by construction, also when read from a file.
///
/// Serialised as a [`ToolShape`], or as
/// `{ kind = "compound", parts = [{ shape = {...}, position = [x, y, z], rotation = ..., jaw = 1 }, ...], gripper = { pivot
/// = [x, y, z], axis = [x, y, z], closed_degrees = 0, open_degrees = 40 } }`. `position` (m) and `rotation` ([`Turn`]) of a
/// part default to none, `jaw` (1 or 2) to a part that does not turn, `gripper` to none.
///
/// [`Turn`]: crate::turn::Turn
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ToolConfig", into = "ToolConfig")]
pub struct Tool {
    parts: Vec<Part>,
    hinge: Option<Hinge>,
    /// One shape in the tool's own frame.
    simple: bool,
}

impl From<ToolShape> for Tool {
    fn from(shape: ToolShape) -> Self {
        let part = Part { shape, place: Isometry3::identity(), jaw: None };
        Self { parts: vec![part], hinge: None, simple: true }
    }
}

/// A part where it is in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedPart<'a> {
    pub(crate) shape: &'a ToolShape,
    pub(crate) pose: Isometry3<f64>,
    /// Bits of its contacts' identifiers.
    pub(crate) tag: u64,
}

impl<'a> PlacedPart<'a> {
    /// A shape alone.
    pub(crate) fn alone(shape: &'a ToolShape, pose: &Isometry3<f64>) -> Self {
        Self { shape, pose: *pose, tag: 0 }
    }
}

/// The bits of a contact's identifier that name part and jaw.
pub(crate) const PART_BITS: u64 = 0x7f << PART_AT;

/// Number of the tool's part that a contact of the skin names.
#[must_use]
pub fn part_of(feature: u64) -> usize {
    (feature >> PART_AT & 0x1f) as usize
}

/// The jaw that a contact of the skin names; none for a part that does not turn, and for other identifiers.
#[must_use]
pub fn jaw_of(feature: u64) -> Option<Jaw> {
    feature_kind(feature)?;
    match feature >> JAW_AT & 3 {
        1 => Some(Jaw::First),
        2 => Some(Jaw::Second),
        _ => None,
    }
}

impl Tool {
    /// Several shapes as one tool, with the hinge of its jaws.
    ///
    /// # Errors
    /// No parts or too many; a place that is not finite; jaws without a hinge, a hinge without one of the jaws.
    pub fn compound(parts: Vec<Part>, hinge: Option<Hinge>) -> Result<Self, ToolError> {
        if parts.is_empty() {
            return Err(ToolError::NoParts);
        }
        if parts.len() > MAX_PARTS {
            return Err(ToolError::TooManyParts(parts.len()));
        }
        for (k, part) in parts.iter().enumerate() {
            let value = part.place.translation.vector;
            if !value.iter().all(|x| x.is_finite()) {
                return Err(ToolError::Position { part: k, value: value.into() });
            }
            if part.jaw.is_some() && hinge.is_none() {
                return Err(ToolError::NoGripper { part: k });
            }
        }
        let lacks = |jaw| parts.iter().all(|part| part.jaw != Some(jaw));
        match hinge {
            Some(_) if lacks(Jaw::First) => Err(ToolError::EmptyJaw(1)),
            Some(_) if lacks(Jaw::Second) => Err(ToolError::EmptyJaw(2)),
            _ => Ok(Self { parts, hinge, simple: false }),
        }
    }

    /// Its parts.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The hinge of its jaws, if it has some.
    #[must_use]
    pub fn hinge(&self) -> Option<&Hinge> {
        self.hinge.as_ref()
    }

    /// The shape of a tool that is no compound.
    #[must_use]
    pub fn shape(&self) -> Option<&ToolShape> {
        self.parts.first().filter(|_| self.simple).map(|part| &part.shape)
    }

    /// Where a jaw is, or for none the frame of the tool.
    #[must_use]
    pub fn jaw_pose(&self, jaw: Option<Jaw>, pose: &ToolPose) -> Isometry3<f64> {
        match (&self.hinge, jaw) {
            (Some(hinge), Some(jaw)) => pose.frame * hinge.turn(jaw, pose.opening),
            _ => pose.frame,
        }
    }

    /// Where a part is in the world; the tool's frame for one that there is not.
    #[must_use]
    pub fn part_pose(&self, part: usize, pose: &ToolPose) -> Isometry3<f64> {
        match self.parts.get(part) {
            // Without a product that would cost the sign of a zero.
            Some(part) if part.jaw.is_none() && part.place == Isometry3::identity() => pose.frame,
            Some(part) => self.jaw_pose(part.jaw, pose) * part.place,
            None => pose.frame,
        }
    }

    /// Its parts in the world.
    pub(crate) fn placed(&self, pose: ToolPose) -> impl Iterator<Item = PlacedPart<'_>> + Clone {
        self.parts.iter().enumerate().map(move |(k, part)| {
            let jaw = part.jaw.map_or(0, |jaw| if jaw == Jaw::First { 1 } else { 2 });
            let tag = (k as u64) << PART_AT | jaw << JAW_AT;
            PlacedPart { shape: &part.shape, pose: self.part_pose(k, &pose), tag }
        })
    }

    /// Signed distance of a point of the world to the nearest part \[m\], negative inside.
    #[must_use]
    pub fn signed_distance(&self, pose: &(impl Into<ToolPose> + Clone), point: &Vector3<f64>) -> f64 {
        let distances =
            self.placed(pose.clone().into()).map(|part| part.shape.signed_distance(&part.pose, point).distance);
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Lower and upper corner of the box along the world's axes that holds the tool \[m\].
    #[must_use]
    pub fn bounding_box(&self, pose: &(impl Into<ToolPose> + Clone)) -> (Vector3<f64>, Vector3<f64>) {
        let boxes = self.placed(pose.clone().into()).map(|part| part.shape.bounding_box(&part.pose));
        let none = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        boxes.fold(none, |all, own| (all.0.inf(&own.0), all.1.sup(&own.1)))
    }

    /// How far \[m\] any point of the tool goes at most from one pose to another: with its parts' bounding balls, whose
    /// surfaces turn.
    #[must_use]
    pub fn path(&self, from: &ToolPose, to: &ToolPose) -> f64 {
        let parts = self.placed(*from).zip(self.placed(*to));
        let paths = parts.map(|(from, to)| {
            let (centre, radius) = to.shape.bounding_sphere(&to.pose);
            let moved = (centre - from.shape.bounding_sphere(&from.pose).0).norm();
            moved + radius * to.pose.rotation.angle_to(&from.pose.rotation)
        });
        paths.fold(0.0, f64::max)
    }

    /// Whether turning it about its own centre changes nothing.
    #[must_use]
    pub fn is_ball(&self) -> bool {
        self.shape().and_then(|shape| shape.axis(&Isometry3::identity())).is_some_and(|[a, b]| a == b)
    }
}
