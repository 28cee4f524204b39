//! Choices of nodes.

use serde::{Deserialize, Serialize};

/// A choice of nodes of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum NodeSelection {
    /// A named node set of the mesh.
    NodeSet(String),
    /// All nodes of a named region of the mesh.
    Region(String),
    /// Nodes with a coordinate at or below a value.
    Below(Plane),
    /// Nodes with a coordinate at or above a value.
    Above(Plane),
    /// Nodes inside an axis-aligned box.
    Box {
        /// Lower corner (m).
        min: [f64; 3],
        /// Upper corner (m).
        max: [f64; 3],
    },
    /// Nodes inside a ball.
    Ball {
        /// Centre (m).
        center: [f64; 3],
        /// Radius (m).
        radius: f64,
    },
}

/// An axis-aligned plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// Axis normal to the plane.
    pub axis: Axis,
    /// Coordinate on that axis (m).
    pub at: f64,
}

/// A coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// First axis.
    X,
    /// Second axis.
    Y,
    /// Third axis.
    Z,
}

impl Axis {
    /// Index of the axis in a vector.
    pub fn index(self) -> usize {
        self as usize
    }
}
