//! What keeps parts from being a tool.

use thiserror::Error;

use super::MAX_PARTS;

/// A tool that cannot be one.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ToolError {
    /// No parts.
    #[error("compound: `parts` is empty; give at least one part with a shape")]
    NoParts,
    /// More parts than a contact can name.
    #[error("compound: {0} parts, but {MAX_PARTS} is the most; let hulls stand for several of them")]
    TooManyParts(usize),
    /// A place that is not finite.
    #[error("compound: parts[{part}].position = {value:?} m must be finite")]
    Position {
        /// The part.
        part: usize,
        /// What was given.
        value: [f64; 3],
    },
    /// A rotation without a direction.
    #[error("compound: {key} has no direction; give a quaternion [w, x, y, z] or an axis that is not zero")]
    Rotation {
        /// The key.
        key: String,
    },
    /// A part of a jaw in a tool without a gripper.
    #[error(
        "compound: parts[{part}].jaw is given, but there is no `gripper` to turn it; add gripper = {{ pivot, axis, closed_degrees, open_degrees }} or leave `jaw` out"
    )]
    NoGripper {
        /// The part.
        part: usize,
    },
    /// A number of a jaw that does not exist.
    #[error("compound: parts[{part}].jaw = {value} must be 1 or 2; leave it out for parts that do not turn")]
    Jaw {
        /// The part.
        part: usize,
        /// What was given.
        value: u8,
    },
    /// A gripper with a jaw that has no part.
    #[error("compound: `gripper` is given, but no part has jaw = {0}; name the parts of both jaws")]
    EmptyJaw(u8),
    /// An angle or place of the gripper out of its range.
    #[error("compound: gripper.{key} = {value} must be {bound}")]
    Gripper {
        /// The key.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
}
