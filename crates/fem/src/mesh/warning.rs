//! What is odd about a mesh that can still be used.

use std::fmt;

use super::quality::WIDEST_BODY;

/// What is odd about a mesh that can still be used.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub enum MeshWarning {
    /// The mesh is metres wide: plainly in other units.
    Units {
        /// Diagonal of the bounding box (m), if the file were in metres.
        diagonal: f64,
        /// The factor that is likely meant: 0.001 for millimetres, 0.01 for centimetres.
        scale: f64,
    },
    /// Every tetrahedron was numbered against the convention; all were turned round.
    Reoriented {
        /// How many.
        tetrahedra: usize,
    },
    /// Nodes without tetrahedra were left out.
    UnusedNodesDropped {
        /// How many.
        nodes: usize,
    },
    /// Elements on which the accuracy and the conditioning suffer.
    PoorElements {
        /// How many tetrahedra have a radius ratio below [`POOR_RADIUS_RATIO`](super::quality::POOR_RADIUS_RATIO).
        tetrahedra: usize,
        /// The worst one.
        worst: u32,
        /// Its radius ratio.
        radius_ratio: f64,
    },
    /// Parts that share no node: they will fall apart.
    Disconnected {
        /// How many parts.
        parts: usize,
    },
    /// An array in the file looks like regions but is not made of whole numbers, or could not be read.
    RegionsIgnored {
        /// Its name, or what stood in the way.
        array: String,
    },
}

impl MeshWarning {
    /// Of a mesh whose bounding box has this diagonal (m), where that is plainly in another unit.
    pub fn of_width(diagonal: f64) -> Option<Self> {
        // Millimetres, unless the body would then be smaller than a finger's breadth.
        let scale = if diagonal * 1e-3 >= 0.02 { 1e-3 } else { 1e-2 };
        (diagonal > WIDEST_BODY).then_some(Self::Units { diagonal, scale })
    }
}

impl fmt::Display for MeshWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MeshWarning::Units { diagonal, scale } => write!(
                f,
                "the mesh would be {diagonal:.3} m across, so it is probably not in metres; set `scale = {scale}` for {}",
                if *scale < 0.005 { "millimetres" } else { "centimetres" }
            ),
            MeshWarning::Reoriented { tetrahedra } => {
                write!(f, "all {tetrahedra} tetrahedra were numbered inside out; they were turned round")
            }
            MeshWarning::UnusedNodesDropped { nodes } => {
                write!(f, "{nodes} nodes belong to no tetrahedron; they were left out and later nodes renumbered")
            }
            MeshWarning::PoorElements { tetrahedra, worst, radius_ratio } => write!(
                f,
                "{tetrahedra} poor tetrahedra, the worst is {worst} with radius ratio {radius_ratio:.2e} (1 is regular); \
                 expect inaccurate strain and slow convergence there"
            ),
            MeshWarning::Disconnected { parts } => {
                write!(f, "the mesh is in {parts} parts that share no node; they are not held together")
            }
            MeshWarning::RegionsIgnored { array } => {
                write!(f, "regions were not taken from {array}: whole numbers per cell are needed")
            }
        }
    }
}
