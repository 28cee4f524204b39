//! From four to ten nodes per tetrahedron and back.

use super::TetMesh;
use crate::element::quadratic::EDGES;

impl TetMesh {
    /// Whether tetrahedra have mid-nodes.
    pub fn is_quadratic(&self) -> bool {
        !self.mid_nodes.is_empty()
    }

    /// The ten nodes of tetrahedron `t`, corners first; `None` where it has no mid-nodes.
    pub fn ten_nodes(&self, t: usize) -> Option<[u32; 10]> {
        let (corners, mids) = (self.tetrahedra.get(t)?, self.mid_nodes.get(t)?);
        Some(std::array::from_fn(|i| if i < 4 { corners[i] } else { mids[i - 4] }))
    }

    /// The same mesh with a node at the middle of every edge, shared by all tetrahedra around it; a mesh that has
    /// mid-nodes already is returned as it is.
    ///
    /// Nodes keep their numbers and new ones follow, ordered by their edges. A node set gains the mid-nodes of the edges
    /// whose two ends it holds.
    ///
    /// # Panics
    /// If a tetrahedron names a node that does not exist.
    pub fn promoted(&self) -> TetMesh {
        let mut mesh = self.clone();
        if self.is_quadratic() {
            return mesh;
        }
        let edge = |t: &[u32; 4], (a, b): (usize, usize)| (t[a].min(t[b]), t[a].max(t[b]));
        let mut edges: Vec<(u32, u32)> = self.tetrahedra.iter().flat_map(|t| EDGES.map(|e| edge(t, e))).collect();
        edges.sort_unstable();
        edges.dedup();
        let first = self.nodes.len();
        let number = |e: (u32, u32)| (first + edges.partition_point(|&other| other < e)) as u32;
        mesh.nodes.extend(edges.iter().map(|&(a, b)| (self.nodes[a as usize] + self.nodes[b as usize]) * 0.5));
        mesh.mid_nodes = self.tetrahedra.iter().map(|t| EDGES.map(|e| number(edge(t, e)))).collect();
        for set in mesh.node_sets.values_mut() {
            let mut held = vec![false; first];
            for &node in set.iter() {
                if let Some(held) = held.get_mut(node as usize) {
                    *held = true;
                }
            }
            let both = (first as u32..).zip(&edges).filter(|(_, (a, b))| held[*a as usize] && held[*b as usize]);
            set.extend(both.map(|(node, _)| node));
        }
        mesh
    }

    /// The straight tetrahedra over the corners; nodes that are no corner of any are left out.
    pub fn linear(&self) -> TetMesh {
        let mut mesh = TetMesh { mid_nodes: Vec::new(), ..self.clone() };
        if self.is_quadratic() {
            mesh.drop_unused_nodes();
        }
        mesh
    }
}

/// The mid-nodes of a tetrahedron whose corners 2 and 3 are exchanged.
pub(crate) fn swap_last_corners(mids: &mut [u32; 6]) {
    // Edge 12 becomes 13, and 02 becomes 03.
    mids.swap(1, 4);
    mids.swap(2, 3);
}
