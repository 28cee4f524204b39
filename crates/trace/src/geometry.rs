//! What the trace is told once about bodies and tool.

use crate::error::TraceError;

/// A body whose nodes are traced.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyGeometry {
    /// Name of the body; the id of its entity in viewers.
    pub name: String,
    /// Rest position of each node (m).
    pub rest_positions: Vec<[f64; 3]>,
    /// Triangles of the surface, by node of this body, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Red, green, blue, opacity, each 0 to 1.
    pub color: [f64; 4],
}

impl BodyGeometry {
    /// Colour of soft tissue: a muted red.
    pub const TISSUE_COLOR: [f64; 4] = [0.72, 0.29, 0.26, 1.0];

    /// A body of tissue colour.
    pub fn new(name: impl Into<String>, rest_positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        Self { name: name.into(), rest_positions, triangles, color: Self::TISSUE_COLOR }
    }

    pub(crate) fn validate(&self) -> Result<(), TraceError> {
        let nodes = self.rest_positions.len();
        for (k, triangle) in self.triangles.iter().enumerate() {
            if let Some(node) = triangle.iter().find(|&&node| node as usize >= nodes) {
                return Err(TraceError::Config {
                    what: format!("a node of triangle {k} of body '{}'", self.name),
                    value: node.to_string(),
                    remedy: "it must be below the number of nodes of the body",
                });
            }
        }
        Ok(())
    }
}

/// A fixed or rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidGeometry {
    /// Name; the id of its entity in viewers, and of its frame where it moves.
    pub name: String,
    /// Its shape, in its own frame.
    pub shape: ToolShape,
    /// Origin of that frame (m), and its orientation `[x, y, z, w]`; of a body that moves: at the begin.
    pub pose: ([f64; 3], [f64; 4]),
    /// True for a rigid body.
    pub moves: bool,
}

/// One of the shapes of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolPart {
    /// The shape, in its own frame.
    pub shape: ToolShape,
    /// Origin of that frame in the tool's (m), and its orientation `[x, y, z, w]`; of a jaw at the opening 0.
    pub pose: ([f64; 3], [f64; 4]),
    /// The jaw that it turns with.
    pub jaw: Option<ToolJaw>,
}

/// One of the two jaws of a tool: its own frame in viewers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToolJaw {
    /// Turned about the hinge by half the opening.
    First,
    /// Turned by half the opening the other way.
    Second,
}

/// The axis about which the jaws of a tool turn, in its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolHinge {
    /// A point of the axis (m).
    pub pivot: [f64; 3],
    /// Its direction, of unit length.
    pub axis: [f64; 3],
}

/// Shape of a tool or of a body, in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum ToolShape {
    /// A sphere about the origin of the tool.
    Sphere {
        /// Radius (m).
        radius: f64,
    },
    /// All points within `radius` of the segment from `a` to `b`.
    Capsule {
        /// One end of the segment (m).
        a: [f64; 3],
        /// The other end (m).
        b: [f64; 3],
        /// Radius (m).
        radius: f64,
    },
    /// A triangle mesh.
    Mesh {
        /// Vertices (m).
        vertices: Vec<[f64; 3]>,
        /// Triangles by vertex, counter-clockwise from outside.
        triangles: Vec<[u32; 3]>,
    },
    /// Several shapes, two groups of which may be jaws. For tools alone: of a body they are drawn as one.
    Compound {
        /// The shapes.
        parts: Vec<ToolPart>,
        /// What the jaws turn about.
        hinge: Option<ToolHinge>,
    },
}

impl ToolShape {
    pub(crate) fn validate(&self) -> Result<(), TraceError> {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } if !(*radius > 0.0 && radius.is_finite()) => {
                Err(TraceError::Config {
                    what: "the radius of a tool or body".into(),
                    value: radius.to_string(),
                    remedy: "it must be positive and finite, in metres",
                })
            }
            Self::Mesh { vertices, triangles } => {
                BodyGeometry::new("tool", vertices.clone(), triangles.clone()).validate()
            }
            Self::Compound { parts, .. } => parts.iter().try_for_each(|part| part.shape.validate()),
            _ => Ok(()),
        }
    }
}
