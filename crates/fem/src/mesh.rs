//! Tetrahedral meshes with named regions and node sets.

use std::collections::BTreeMap;

use nalgebra::Vector3;

/// A tetrahedral mesh in metres. Positive volume: `det(x1-x0, x2-x0, x3-x0) > 0` for every tetrahedron.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    /// Positions of the nodes [m].
    pub nodes: Vec<Vector3<f64>>,
    /// Four nodes per tetrahedron, counted from zero.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Region of each tetrahedron: an index into `region_names`.
    pub regions: Vec<u16>,
    /// Names of the regions, for materials.
    pub region_names: Vec<String>,
    /// Named sets of nodes.
    pub node_sets: BTreeMap<String, Vec<u32>>,
}
