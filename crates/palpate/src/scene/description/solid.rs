//! Bodies that are not soft: fixed ones and rigid ones.

use palpate_collision::shape::ToolShape;
use palpate_collision::solid::{Solid, SolidError};
use serde::{Deserialize, Serialize};

/// The shape of a fixed or rigid body, in the body's own frame (m).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SolidShape {
    /// Everything below the plane through the body's position: a fixed body only.
    Plane {
        /// Outward normal, of any length.
        normal: [f64; 3],
    },
    /// A box about the position.
    Box {
        /// Its sides (m).
        size: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Its radius (m).
        radius: f64,
    },
    /// All points within `radius` of the segment from `-half_length` to `half_length` on the z axis.
    Capsule {
        /// Half the length of the segment (m).
        half_length: f64,
        /// Radius (m).
        radius: f64,
    },
    /// The convex hull of points.
    Convex {
        /// The points (m).
        vertices: Vec<[f64; 3]>,
    },
    /// The inside of a closed triangle surface from an STL, OBJ or PLY file, relative to the scene file.
    Mesh {
        /// The file.
        file: String,
        /// Factor from the unit of the file to metres.
        #[serde(default = "one")]
        scale: f64,
    },
}

fn one() -> f64 {
    1.0
}

impl SolidShape {
    /// The shape as contacts see it; `None` for a mesh, which must be read first.
    pub(crate) fn solid(&self) -> Option<Result<Solid, SolidError>> {
        let convex = |shape: Result<ToolShape, _>| shape.map(Solid::from).map_err(SolidError::from);
        Some(match self {
            Self::Plane { normal } => Solid::half_space((*normal).into()),
            Self::Box { size } => Solid::cuboid((*size).into()),
            Self::Sphere { radius } => convex(ToolShape::sphere(*radius)),
            Self::Capsule { half_length, radius } => convex(ToolShape::capsule(*half_length, *radius)),
            Self::Convex { vertices } => {
                convex(ToolShape::convex(&vertices.iter().map(|v| (*v).into()).collect::<Vec<_>>()))
            }
            Self::Mesh { .. } => return None,
        })
    }
}

/// A body that never moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedBodyDescription {
    /// Name in reports.
    pub name: String,
    /// Its shape.
    pub shape: SolidShape,
    /// Where the shape's origin lies (m).
    #[serde(default)]
    pub position: [f64; 3],
    /// Its rotation: unit axis times angle (rad).
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Coefficient of friction, in place of that of `[contact]`; for laws of friction by a coefficient only. With the tool
    /// the geometric mean of the two holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Largest number of contacts with each other body, in place of that of `[contact]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_contacts: Option<usize>,
}

/// A body with six degrees of freedom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigidBodyDescription {
    /// Name in reports.
    pub name: String,
    /// Its shape; not a plane.
    pub shape: SolidShape,
    /// Mass (kg).
    pub mass: f64,
    /// Moments of inertia about the centre of mass along the axes of the shape (kg m²); by default those of the shape
    /// filled evenly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia: Option<[f64; 3]>,
    /// Where the shape's origin begins (m).
    #[serde(default)]
    pub position: [f64; 3],
    /// How it begins: unit axis times angle (rad).
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Velocity of its centre of mass at the begin (m/s).
    #[serde(default)]
    pub velocity: [f64; 3],
    /// Angular velocity at the begin (rad/s), in the world's frame.
    #[serde(default)]
    pub angular_velocity: [f64; 3],
    /// Coefficient of friction, in place of that of `[contact]`; for laws of friction by a coefficient only. Where two of
    /// these bodies touch, or one and the tool, the geometric mean of both holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Largest number of contacts with each other body, in place of that of `[contact]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_contacts: Option<usize>,
}
