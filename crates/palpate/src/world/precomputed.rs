//! Whether the inverse of the first matrix between the nodes of the skin is precomputed, and what it takes.

use palpate_constraints::surface_inverse::SurfaceInverse;
use palpate_fem::model::FemModel;
use palpate_fem::sparse::FIXED;
use palpate_fem::surface::Surface;

/// Bytes in the megabyte that scenes count memory in.
const MEGABYTE: f64 = 1e6;

/// The plan for the precomputed inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precomputed {
    /// Nodes of the skin that can move.
    pub nodes: usize,
    /// Memory of the inverse between them (bytes).
    pub bytes: usize,
    /// What the scene grants (bytes).
    pub most: usize,
}

impl Precomputed {
    /// For so many nodes, within so many megabytes.
    pub(super) fn new(nodes: usize, megabytes: f64) -> Self {
        // Saturates where a scene grants more than there can be.
        Self { nodes, bytes: SurfaceInverse::bytes(nodes), most: (megabytes * MEGABYTE) as usize }
    }

    /// Whether there is something to precompute, and room for it.
    pub fn fits(&self) -> bool {
        self.nodes > 0 && self.bytes <= self.most
    }

    /// In words.
    pub(super) fn text(&self) -> String {
        let megabytes = |bytes: usize| bytes as f64 / MEGABYTE;
        let (nodes, taken, most) = (self.nodes, megabytes(self.bytes), megabytes(self.most));
        if self.fits() {
            format!("inverse between {nodes} nodes of the skin precomputed, {taken:.1} MB")
        } else {
            format!(
                "inverse between {nodes} nodes of the skin not precomputed: it takes {taken:.1} MB, `surface_memory` \
                 grants {most:.1}"
            )
        }
    }
}

/// Free nodes of the skin, ascending.
pub(super) fn skin_nodes(model: &FemModel, surface: &Surface) -> Vec<u32> {
    let free = model.free_of_node();
    let of_skin = surface.triangles.iter().flatten();
    let mut nodes: Vec<u32> = of_skin.map(|&node| free[node as usize]).filter(|&node| node != FIXED).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}
