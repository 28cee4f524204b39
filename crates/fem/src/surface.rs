//! The boundary surface of a tetrahedral mesh.

/// Boundary triangles with outward orientation (counter-clockwise seen from outside).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Three mesh nodes per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The tetrahedron behind each triangle.
    pub tetrahedra: Vec<u32>,
    /// All mesh nodes that lie on the surface, ascending.
    pub nodes: Vec<u32>,
}
