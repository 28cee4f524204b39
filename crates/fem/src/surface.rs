//! The boundary surface of a tetrahedral mesh.

use nalgebra::Vector3;

use crate::{
    element::quadratic::EDGES,
    mesh::{FACES, TetMesh, sorted_faces},
};

/// Boundary triangles with outward orientation (counter-clockwise seen from outside).
///
/// A quadratic face becomes four flat facets over its six nodes. They leave the curved face by at most a quarter of the
/// distance by which the face leaves its corner triangle, and a point between the nodes moves with its facet instead
/// of with the shape functions: an error of second order in the facet's size, as on a linear mesh of twice the
/// resolution. At the nodes there is none, and forces put on facets keep their sum and their moments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Three mesh nodes per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The tetrahedron behind each triangle; four in a row for each quadratic face.
    pub tetrahedra: Vec<u32>,
    /// All mesh nodes that lie on the surface, ascending.
    pub nodes: Vec<u32>,
}

/// How the triangles of a surface hang together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SurfaceTopology {
    /// Edges.
    pub edges: usize,
    /// Edges that are not passed as often one way as the other: the rim of an open surface.
    pub rim_edges: usize,
    /// Edges of more than two triangles: parts that touch along a line.
    pub pinched_edges: usize,
    /// Nodes - edges + triangles: 2 for each closed part without handles.
    pub euler_characteristic: i64,
    /// No rim: the surface encloses a volume.
    pub closed: bool,
}

impl Surface {
    /// The faces that belong to exactly one tetrahedron, in the order of the tetrahedra.
    ///
    /// Outward orientation needs tetrahedra of positive volume. Indices are not used to look up positions.
    pub fn of(mesh: &TetMesh) -> Surface {
        let faces = sorted_faces(&mesh.tetrahedra);
        let single = faces.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() == 1);
        let mut boundary: Vec<(u32, u8)> = single.map(|group| (group[0].2, group[0].3)).collect();
        boundary.sort_unstable();

        let triangle = |&(t, k): &(u32, u8)| FACES[k as usize].map(|i| mesh.tetrahedra[t as usize][i]);
        let triangles: Vec<[u32; 3]> = match mesh.is_quadratic() {
            false => boundary.iter().map(triangle).collect(),
            true => {
                boundary = boundary.iter().flat_map(|&face| [face; 4]).collect();
                boundary.iter().step_by(4).flat_map(|&(t, k)| facets(mesh, t as usize, FACES[k as usize])).collect()
            }
        };
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        Surface { triangles, tetrahedra: boundary.iter().map(|&(t, _)| t).collect(), nodes }
    }

    /// Twice the area of triangle `k` times its outward unit normal (m²), with the given positions of the mesh's nodes.
    ///
    /// # Panics
    /// If `k` or a node of the triangle is out of range.
    pub fn area_vector(&self, k: usize, positions: &[Vector3<f64>]) -> Vector3<f64> {
        let [a, b, c] = self.triangles[k].map(|node| positions[node as usize]);
        (b - a).cross(&(c - a))
    }

    /// Total area (m²) with the given positions of the mesh's nodes.
    pub fn area(&self, positions: &[Vector3<f64>]) -> f64 {
        (0..self.triangles.len()).map(|k| 0.5 * self.area_vector(k, positions).norm()).sum()
    }

    /// Volume enclosed by a closed surface (m³), by the divergence theorem: Σ x·n A / 3 over the triangles.
    ///
    /// Positions are taken relative to a node of the surface, which loses no digits far from the origin.
    pub fn enclosed_volume(&self, positions: &[Vector3<f64>]) -> f64 {
        let Some(&first) = self.nodes.first() else { return 0.0 };
        let origin = positions[first as usize];
        let cone = |k: usize| {
            let corner = positions[self.triangles[k][0] as usize];
            (corner - origin).dot(&self.area_vector(k, positions)) / 6.0
        };
        (0..self.triangles.len()).map(cone).sum()
    }

    /// Edges, rim, pinches and Euler characteristic.
    pub fn topology(&self) -> SurfaceTopology {
        // Each triangle passes each of its edges once; true marks the pass from the lower to the higher node.
        let mut passes: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * self.triangles.len());
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                passes.push((from.min(to), from.max(to), from < to));
            }
        }
        passes.sort_unstable();

        let mut topology = SurfaceTopology::default();
        for edge in passes.chunk_by(|p, q| (p.0, p.1) == (q.0, q.1)) {
            let forward = edge.iter().filter(|pass| pass.2).count();
            topology.edges += 1;
            topology.rim_edges += usize::from(2 * forward != edge.len());
            topology.pinched_edges += usize::from(edge.len() > 2);
        }
        topology.euler_characteristic = self.nodes.len() as i64 - topology.edges as i64 + self.triangles.len() as i64;
        topology.closed = topology.rim_edges == 0 && !self.triangles.is_empty();
        topology
    }
}

/// The facets of a quadratic face given by its local corners: one at each corner, then the middle one. All turn as the
/// face does.
fn facets(mesh: &TetMesh, t: usize, [a, b, c]: [usize; 3]) -> [[u32; 3]; 4] {
    let corner = |i: usize| mesh.tetrahedra[t][i];
    // Mid-nodes of a face's edge: every pair of corners is in the list.
    let mid = |i: usize, j: usize| {
        let edge = EDGES.iter().position(|&(a, b)| (a, b) == (i, j) || (a, b) == (j, i)).unwrap_or_default();
        mesh.mid_nodes[t][edge]
    };
    let (ab, bc, ca) = (mid(a, b), mid(b, c), mid(c, a));
    [[corner(a), ab, ca], [ab, corner(b), bc], [ca, bc, corner(c)], [ab, bc, ca]]
}
