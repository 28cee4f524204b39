//! The kinds of elements that a body can be made of.

use serde::{Deserialize, Serialize};

/// How displacement and pressure are interpolated within a tetrahedron.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// Four nodes, uniform strain. The cheapest; too stiff in bending, and locks near incompressibility.
    #[default]
    Linear,
    /// Ten nodes, linear strain: the mesh needs mid-nodes ([`TetMesh::promoted`](crate::mesh::TetMesh::promoted)). Bends
    /// well, and locks only mildly near incompressibility.
    Quadratic,
    /// Four nodes; the bulk energy sees volume changes averaged over patches of elements, which removes volumetric
    /// locking ([`averaging`](crate::averaging)). For laws with a bulk term of their own.
    Averaged,
}

impl ElementKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Quadratic, Self::Averaged];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Quadratic => "quadratic",
            Self::Averaged => "averaged",
        }
    }

    /// Largest Poisson's ratio at which the element is still of use; above, it locks or its system is too badly
    /// conditioned. A body beyond it is warned of, with another kind as the remedy.
    pub fn highest_poisson(self) -> f64 {
        match self {
            Self::Linear => 0.48,
            Self::Quadratic => 0.495,
            Self::Averaged => 0.4999,
        }
    }
}
