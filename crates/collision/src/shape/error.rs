//! What keeps a shape from being one.

use thiserror::Error;

/// A shape that cannot be a tool.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ShapeError {
    /// A length that is not positive and finite.
    #[error("tool shape: {what} = {value} m must be {bound} and finite")]
    Length {
        /// Which length.
        what: &'static str,
        /// The length given \[m\].
        value: f64,
        /// What it must be.
        bound: &'static str,
    },
    /// A coordinate that is not a number.
    #[error("tool shape: {what}[{index}] is not finite")]
    NotFinite {
        /// Which list.
        what: &'static str,
        /// Position in it.
        index: usize,
    },
    /// Points that have no convex hull with a volume.
    #[error(
        "tool shape: no convex hull of {points} vertices: {reason}; give at least 4 points that do not lie in a plane"
    )]
    Hull {
        /// Number of points given.
        points: usize,
        /// What failed.
        reason: String,
    },
}
