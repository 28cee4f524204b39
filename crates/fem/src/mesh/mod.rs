//! Tetrahedral meshes with named regions and node sets.

mod check;
mod error;
mod promotion;
pub mod quality;
mod warning;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Vector3};

pub(crate) use check::{FACES, Provenance, check, check_nodes, is_flat, repeated, sorted_faces};
pub use error::{At, MeshError};
pub use quality::MeshQuality;
pub use warning::MeshWarning;

use crate::format;
use crate::surface::Surface;

/// Widest mesh (m) that a scale may make: volumes and what is made of them stay within the range of f64.
const VASTEST: f64 = 1e12;

/// A tetrahedral mesh in metres. Positive volume: `det(x1-x0, x2-x0, x3-x0) > 0` for every tetrahedron.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    /// Positions of the nodes (m).
    pub nodes: Vec<Vector3<f64>>,
    /// Four nodes per tetrahedron, its corners, counted from zero.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Six mid-nodes per tetrahedron, between the corners 01, 12, 02, 03, 13, 23 (VTK's order), or none at all: then
    /// the mesh is of linear tetrahedra. Volumes, angles and faces are those of the straight tetrahedra over the corners.
    pub mid_nodes: Vec<[u32; 6]>,
    /// Region of each tetrahedron: an index into `region_names`.
    pub regions: Vec<u16>,
    /// Names of the regions, for materials.
    pub region_names: Vec<String>,
    /// Named sets of nodes.
    pub node_sets: BTreeMap<String, Vec<u32>>,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundingBox {
    /// Smallest coordinates (m).
    pub min: Vector3<f64>,
    /// Largest coordinates (m).
    pub max: Vector3<f64>,
}

impl BoundingBox {
    /// Distance between opposite corners (m).
    pub fn diagonal(&self) -> f64 {
        (self.max - self.min).norm()
    }

    /// The middle of the box (m).
    pub fn centre(&self) -> Vector3<f64> {
        (self.min + self.max) * 0.5
    }
}

impl TetMesh {
    /// Reads and validates a mesh file; the format is found from its content and extension.
    ///
    /// Coordinates are taken to be metres. Nodes without tetrahedra are left out and tetrahedra that are all
    /// numbered inside out are turned round; [`format::read`] tells of these and of other warnings.
    ///
    /// # Errors
    /// Whatever [`TetMesh::validate`] refuses, and files that are missing, damaged or of another kind.
    pub fn load(path: impl AsRef<Path>) -> Result<TetMesh, MeshError> {
        Ok(format::read(path.as_ref())?.mesh)
    }

    /// The mesh with every coordinate multiplied by `factor` (0.001 turns millimetres into metres).
    ///
    /// # Errors
    /// A factor that is not positive and finite.
    pub fn scaled(mut self, factor: f64) -> Result<TetMesh, MeshError> {
        if !(factor > 0.0 && factor.is_finite()) {
            let what = format!("scale {factor} is not a positive finite number");
            return Err(MeshError::Inconsistent { at: At::default(), what });
        }
        for x in &mut self.nodes {
            *x *= factor;
        }
        let diagonal = self.bounding_box().diagonal();
        if diagonal.is_nan() || diagonal > VASTEST {
            let what = format!("with scale {factor:e} the mesh is {diagonal:.1e} m across, more than {VASTEST:e}");
            return Err(MeshError::Inconsistent { at: At::default(), what });
        }
        Ok(self)
    }

    /// Signed volume of tetrahedron `t` (m³).
    ///
    /// # Panics
    /// If `t` is out of range.
    pub fn tetrahedron_volume(&self, t: usize) -> f64 {
        signed_volume(&corners(&self.nodes, self.tetrahedra[t]))
    }

    /// Sum of the volumes of all tetrahedra (m³).
    pub fn volume(&self) -> f64 {
        self.tetrahedra.iter().map(|&t| signed_volume(&corners(&self.nodes, t))).sum()
    }

    /// The smallest axis-aligned box around the nodes; zero at the origin for a mesh without nodes.
    pub fn bounding_box(&self) -> BoundingBox {
        let Some(&first) = self.nodes.first() else { return BoundingBox::default() };
        let (min, max) = self.nodes.iter().fold((first, first), |(min, max), x| (min.inf(x), max.sup(x)));
        BoundingBox { min, max }
    }

    /// The boundary: faces of exactly one tetrahedron, counter-clockwise seen from outside.
    pub fn surface(&self) -> Surface {
        Surface::of(self)
    }

    /// Checks everything that the simulation relies on, and measures the mesh.
    ///
    /// # Errors
    /// Names the first offender: lists whose lengths differ, non-finite coordinates, indices out of range,
    /// repeated, flat, inverted or overlapping tetrahedra, and nodes that no tetrahedron uses.
    pub fn validate(&self) -> Result<MeshQuality, MeshError> {
        check(self, &Provenance::default())?;
        Ok(MeshQuality::measure(self))
    }

    /// Removes nodes that no tetrahedron uses, keeps the order of the others, and returns how many were removed.
    /// Node sets lose the removed nodes.
    pub fn drop_unused_nodes(&mut self) -> usize {
        self.compact_nodes().iter().filter(|kept| kept.is_none()).count()
    }

    /// As [`TetMesh::drop_unused_nodes`]; returns the new number of every old node.
    pub(crate) fn compact_nodes(&mut self) -> Vec<Option<u32>> {
        let used = self.used_nodes();
        let mut next = 0;
        let renumbered: Vec<Option<u32>> = used
            .iter()
            .map(|&used| {
                used.then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect();
        let renumber = |node: u32| renumbered.get(node as usize).copied().flatten();
        let mut keep = used.iter();
        self.nodes.retain(|_| keep.next().copied().unwrap_or(false));
        for node in self.tetrahedra.iter_mut().flatten().chain(self.mid_nodes.iter_mut().flatten()) {
            *node = renumber(*node).unwrap_or(*node);
        }
        for set in self.node_sets.values_mut() {
            *set = set.iter().filter_map(|&node| renumber(node)).collect();
        }
        renumbered
    }

    /// Whether some tetrahedron uses each node.
    pub(crate) fn used_nodes(&self) -> Vec<bool> {
        let mut used = vec![false; self.nodes.len()];
        for &node in self.tetrahedra.iter().flatten().chain(self.mid_nodes.iter().flatten()) {
            if let Some(used) = used.get_mut(node as usize) {
                *used = true;
            }
        }
        used
    }

    /// Exchanges two nodes of every tetrahedron of negative volume, and returns how many were turned round.
    ///
    /// This mends files that mix two numbering conventions. It must not be used on a folded mesh, in which
    /// tetrahedra of negative volume lie inside others: turned round, they count that space twice.
    pub fn reorient(&mut self) -> usize {
        let mut turned = 0;
        for (k, t) in self.tetrahedra.iter_mut().enumerate() {
            if signed_volume(&corners(&self.nodes, *t)) < 0.0 {
                t.swap(2, 3);
                if let Some(mids) = self.mid_nodes.get_mut(k) {
                    promotion::swap_last_corners(mids);
                }
                turned += 1;
            }
        }
        turned
    }
}

/// Positions of the four nodes of a tetrahedron.
pub(crate) fn corners(nodes: &[Vector3<f64>], t: [u32; 4]) -> [Vector3<f64>; 4] {
    t.map(|node| nodes[node as usize])
}

/// Volume of a tetrahedron (m³), positive if its fourth node sees the first three counter-clockwise from behind:
/// det(x1-x0, x2-x0, x3-x0) / 6.
pub(crate) fn signed_volume(x: &[Vector3<f64>; 4]) -> f64 {
    Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]).determinant() / 6.0
}
