//! A shape as scene files write it.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Geometry, ShapeError, ToolShape};

/// What a scene file says of a shape.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ShapeConfig {
    Sphere { radius: f64 },
    Capsule { half_length: f64, radius: f64 },
    Box { size: [f64; 3] },
    Convex { vertices: Vec<[f64; 3]> },
}

impl TryFrom<ShapeConfig> for ToolShape {
    type Error = ShapeError;

    fn try_from(config: ShapeConfig) -> Result<Self, ShapeError> {
        match config {
            ShapeConfig::Sphere { radius } => Self::sphere(radius),
            ShapeConfig::Capsule { half_length, radius } => Self::capsule(half_length, radius),
            ShapeConfig::Box { size } => Self::cuboid(size.into()),
            ShapeConfig::Convex { vertices } => {
                Self::convex(&vertices.into_iter().map(Vector3::from).collect::<Vec<_>>())
            }
        }
    }
}

impl From<ToolShape> for ShapeConfig {
    fn from(shape: ToolShape) -> Self {
        match shape.geometry {
            Geometry::Sphere { radius } => Self::Sphere { radius },
            Geometry::Capsule { half_length, radius } => Self::Capsule { half_length, radius },
            Geometry::Convex(hull) => Self::Convex { vertices: hull.vertices().iter().map(|v| (*v).into()).collect() },
        }
    }
}
