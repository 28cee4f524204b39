//! Features of a patch after edges and triangles of its surface have been numbered anew, as a cut does it: known by their nodes,
//! which keep their names.

use super::SkinPatch;
use crate::contact::{FeatureKind, feature_kind};

/// Bits of an identifier that hold the number of the tissue's feature.
const TISSUE: u64 = u32::MAX as u64;

/// In place of a node where a feature has fewer than three.
pub const NO_NODE: u32 = u32::MAX;

impl SkinPatch {
    /// The identifier that a feature of the numbering before has in the numbering of this patch: the same kind, part of the tool
    /// and feature of that, on the edge or triangle with the same nodes. `None` where the patch has none, as where the
    /// tissue between them is gone.
    ///
    /// `nodes` are the names of the feature's nodes, ascending: one of a vertex, two of an edge, three of a triangle, and
    /// [`NO_NODE`] in the other places.
    #[must_use]
    pub fn renumbered(&self, feature: u64, nodes: &[u32; 3]) -> Option<u64> {
        let name = |node: u32| self.names.get(node as usize).copied();
        let number = match feature_kind(feature)? {
            FeatureKind::Vertex => self.number_of(nodes[0]).map(|_| nodes[0]),
            FeatureKind::Edge => {
                let is_it = |ends: &[u32; 2]| {
                    let [a, b] = ends.map(name);
                    a.min(b) == Some(nodes[0]) && a.max(b) == Some(nodes[1])
                };
                let edge = self.edges.iter().position(is_it)?;
                self.edge_names.get(edge).copied()
            }
            FeatureKind::Triangle => {
                let is_it = |corners: &[u32; 3]| {
                    let mut names = corners.map(|node| name(node).unwrap_or(NO_NODE));
                    names.sort_unstable();
                    names == *nodes
                };
                let triangle = self.triangles.iter().position(is_it)?;
                self.triangle_names.get(triangle).copied()
            }
        }?;
        Some(feature & !TISSUE | u64::from(number))
    }
}
