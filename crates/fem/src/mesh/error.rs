//! What can be wrong with a mesh or its file: where, which number, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::element::quadratic::MidNodeError;

/// A place in a mesh file. Lines count from one and are known for text formats only.
///
/// A mesh that was built in memory has neither file nor line, and is called "mesh" in messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct At {
    /// The file, where the mesh came from one.
    pub file: Option<PathBuf>,
    /// The line, counted from one, where the format is text.
    pub line: Option<usize>,
}

impl At {
    /// The file as a whole.
    pub fn file(path: &Path) -> At {
        At { file: Some(path.to_path_buf()), line: None }
    }

    /// A line of a file, counted from one.
    pub fn line(path: &Path, line: usize) -> At {
        At { file: Some(path.to_path_buf()), line: Some(line) }
    }
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.file {
            Some(file) => write!(f, "{}", file.display())?,
            None => f.write_str("mesh")?,
        }
        match self.line {
            Some(line) => write!(f, ":{line}"),
            None => Ok(()),
        }
    }
}

/// Why a mesh is refused. Nodes and tetrahedra are counted from zero, lines of files from one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file cannot be opened, read or written.
    #[error("{}: {source}; check the path and its permissions", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Neither the extension nor the content is of a format that is read here.
    #[error(
        "{at}: not a mesh format that is read here; convert it to Gmsh .msh, VTK .vtk or .vtu, MEDIT .mesh or TetGen .node/.ele"
    )]
    UnknownFormat {
        /// The file.
        at: At,
    },
    /// A known format in a variant that is not read.
    #[error("{at}: {what} cannot be read here; {remedy}")]
    Unsupported {
        /// The place.
        at: At,
        /// The variant.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The file breaks the rules of its format.
    #[error("{at}: {what}; the file is damaged or was cut off, write it again")]
    Syntax {
        /// The place.
        at: At,
        /// What was expected and what was found.
        what: String,
    },
    /// A closed or open surface, an image of labels: something that tetrahedra can be made from.
    #[error(
        "{at}: {what} without tetrahedra; make tetrahedra from a closed surface or a label image with `palpate mesh make`"
    )]
    NotVolumetric {
        /// The file.
        at: At,
        /// What the file holds.
        what: String,
    },
    /// Solid cells that are not tetrahedra of first or second order.
    #[error(
        "{at}: {cells} cannot be simulated, only linear tetrahedra and quadratic tetrahedra are; split or re-mesh them"
    )]
    UnsupportedCells {
        /// The first such cell.
        at: At,
        /// How many of which cell, as "12 hexahedra (8 nodes), 3 ...".
        cells: String,
    },
    /// A mesh with no tetrahedron.
    #[error("{at}: no tetrahedra; the file holds {found}, export the volume mesh as well")]
    NoTetrahedra {
        /// The file.
        at: At,
        /// What it holds instead.
        found: String,
    },
    /// A coordinate that is infinite or not a number.
    #[error("{at}: node {node} has the coordinate {value}; every coordinate must be a finite number")]
    NonFinite {
        /// The place.
        at: At,
        /// The node.
        node: usize,
        /// The coordinate.
        value: f64,
    },
    /// A cell or a node set names a node that does not exist.
    #[error(
        "{at}: {what} uses node {node}, but the mesh has {nodes} nodes and not that one; correct the number or add the node"
    )]
    NodeOutOfRange {
        /// The place.
        at: At,
        /// The tetrahedron or node set.
        what: String,
        /// The number of the node as the file has it.
        node: i64,
        /// The number of nodes.
        nodes: usize,
    },
    /// Two nodes of a file carry one number.
    #[error("{at}: node number {number} is given twice; renumber the nodes")]
    RepeatedNodeNumber {
        /// The place.
        at: At,
        /// The number as the file has it.
        number: i64,
    },
    /// Tetrahedra that are numbered against the convention while others follow it: the mesh is folded or mixed.
    #[error(
        "{at}: tetrahedron {tetrahedron} has volume {volume:.3e} m³, and so are {inverted} of {total} inverted (first: {first:?}); \
         rebuild the mesh if it is folded, or reorder their nodes (`TetMesh::reorient`)"
    )]
    Inverted {
        /// The place of the first.
        at: At,
        /// The first.
        tetrahedron: usize,
        /// Its volume (m³), negative.
        volume: f64,
        /// How many are inverted.
        inverted: usize,
        /// How many tetrahedra there are.
        total: usize,
        /// The first few.
        first: Vec<u32>,
    },
    /// A tetrahedron without volume to working precision.
    #[error(
        "{at}: tetrahedron {tetrahedron} has volume {volume:.3e} m³ with edges up to {edge:.3e} m, that is none ({flat} of {total} are flat); \
         remove it or rebuild the mesh"
    )]
    ZeroVolume {
        /// The place of the first.
        at: At,
        /// The first.
        tetrahedron: usize,
        /// Its volume (m³).
        volume: f64,
        /// Its longest edge (m).
        edge: f64,
        /// How many are flat.
        flat: usize,
        /// How many tetrahedra there are.
        total: usize,
    },
    /// Two tetrahedra with the same four nodes.
    #[error(
        "{at}: tetrahedron {tetrahedron} has the same four nodes as tetrahedron {earlier} ({duplicates} repeated in all); remove the repeated ones"
    )]
    Duplicate {
        /// The place of the later one.
        at: At,
        /// The later one.
        tetrahedron: usize,
        /// The earlier one.
        earlier: usize,
        /// How many are repeated.
        duplicates: usize,
    },
    /// A mid-node that lies wrong within its quadratic tetrahedron.
    #[error("{at}: tetrahedron {tetrahedron}: {fault}")]
    MidNode {
        /// The place.
        at: At,
        /// The tetrahedron.
        tetrahedron: usize,
        /// What is wrong.
        fault: MidNodeError,
    },
    /// Quadratic tetrahedra whose mid-nodes do not fit together.
    #[error("{at}: tetrahedron {tetrahedron}: {what}; every edge needs one mid-node of its own, write the mesh again")]
    MidNodeShared {
        /// The place.
        at: At,
        /// The tetrahedron.
        tetrahedron: usize,
        /// Which nodes.
        what: String,
    },
    /// Tetrahedra that lie on the same side of a common face: they overlap.
    #[error(
        "{at}: tetrahedra {tetrahedron} and {other} overlap, they lie on the same side of the face {face:?}; remove one or rebuild the mesh"
    )]
    Overlap {
        /// The place of `tetrahedron`.
        at: At,
        /// The later one.
        tetrahedron: usize,
        /// The earlier one.
        other: usize,
        /// The nodes of the face.
        face: [u32; 3],
    },
    /// Nodes that carry no tissue and so would have no mass and no stiffness.
    #[error(
        "{at}: node {node} belongs to no tetrahedron, {unused} of {total} nodes do not; \
         check that the file is whole, or remove them with `TetMesh::drop_unused_nodes`"
    )]
    UnusedNodes {
        /// The place of the first.
        at: At,
        /// The first.
        node: usize,
        /// How many.
        unused: usize,
        /// How many nodes there are.
        total: usize,
    },
    /// The parts of the description of a mesh do not fit together.
    #[error("{at}: {what}; correct the description of the mesh")]
    Inconsistent {
        /// The place.
        at: At,
        /// What does not fit.
        what: String,
    },
}
