//! What can be wrong with the description of a soft body.

use thiserror::Error;

use super::MAX_STIFFNESS_RATIO;
use crate::{
    element::{ElementKind, quadratic::MidNodeError},
    material::MaterialError,
};

/// Why a body cannot be set up.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FemError {
    /// The mesh has no tetrahedron.
    #[error("the mesh has no tetrahedra: a soft body needs a volume mesh, not a surface")]
    Empty,
    /// The mesh is larger than the index types hold.
    #[error("the mesh has {nodes} nodes and {tetrahedra} tetrahedra: at most {limit} tetrahedra fit the index lists")]
    TooLarge {
        /// Nodes of the mesh.
        nodes: usize,
        /// Tetrahedra of the mesh.
        tetrahedra: usize,
        /// Largest number of tetrahedra.
        limit: usize,
    },
    /// A tetrahedron names a node that does not exist.
    #[error("tetrahedron {tetrahedron} has node {node}, but the mesh has {nodes} nodes (counted from 0)")]
    NodeOutOfRange {
        /// The tetrahedron.
        tetrahedron: usize,
        /// The node it names.
        node: u32,
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// A tetrahedron has no positive volume.
    #[error("tetrahedron {tetrahedron} has volume {volume:e} m³: inverted, flat or not finite; repair or remesh it")]
    Volume {
        /// The tetrahedron.
        tetrahedron: usize,
        /// Its volume (m³).
        volume: f64,
    },
    /// Averaged elements of a law that has no bulk term to average.
    #[error(
        "averaged elements need a law with a bulk term U(J), which {law} does not have: use `neo_hookean` or another \
         hyperelastic law with one, or quadratic elements"
    )]
    NoBulk {
        /// Name of the law.
        law: &'static str,
    },
    /// The mesh and the elements have different nodes.
    #[error(
        "elements are {}, but the mesh has mid-nodes on {mid_nodes} tetrahedra: {}", kind.name(),
        if *mid_nodes == 0 { "add them with `TetMesh::promoted`" } else { "remove them with `TetMesh::linear`" }
    )]
    Order {
        /// The kind of elements.
        kind: ElementKind,
        /// Tetrahedra with mid-nodes.
        mid_nodes: usize,
    },
    /// The mesh does not name six mid-nodes per tetrahedron.
    #[error("the mesh has {tetrahedra} tetrahedra but mid-nodes for {mid_nodes}: six per tetrahedron, or none at all")]
    MidNodeCount {
        /// Tetrahedra of the mesh.
        tetrahedra: usize,
        /// Tetrahedra with mid-nodes.
        mid_nodes: usize,
    },
    /// A mid-node spoils its element.
    #[error("tetrahedron {tetrahedron}: {error}")]
    MidNode {
        /// The tetrahedron.
        tetrahedron: usize,
        /// What is wrong.
        error: MidNodeError,
    },
    /// The mesh does not name one region per tetrahedron.
    #[error("the mesh has {tetrahedra} tetrahedra but {regions} region labels: one per tetrahedron, or none at all")]
    RegionCount {
        /// Tetrahedra of the mesh.
        tetrahedra: usize,
        /// Region labels.
        regions: usize,
    },
    /// A tetrahedron's region has no name.
    #[error("tetrahedron {tetrahedron} is in region {region}, but the mesh names {names} regions (counted from 0)")]
    RegionOutOfRange {
        /// The tetrahedron.
        tetrahedron: usize,
        /// Its region.
        region: u16,
        /// Named regions.
        names: usize,
    },
    /// A material or density is given for a region that the mesh does not have.
    #[error("no region is called `{name}`{}; the mesh has: {}", suggestion(.name, .known), list(.known))]
    UnknownRegion {
        /// The name given.
        name: String,
        /// The names of the mesh.
        known: Vec<String>,
    },
    /// A material's parameters are outside their range.
    #[error("material of {place}: {error}")]
    Material {
        /// `the body` or a region.
        place: String,
        /// What is wrong.
        error: MaterialError,
    },
    /// Regions differ too much in stiffness.
    #[error(
        "Young's moduli range from {softest:e} to {stiffest:e} Pa within one body: a ratio above {MAX_STIFFNESS_RATIO:e}; \
         soften the stiff region, or fix its nodes"
    )]
    StiffnessRatio {
        /// Smallest Young's modulus (Pa).
        softest: f64,
        /// Largest Young's modulus (Pa).
        stiffest: f64,
    },
    /// A number of the configuration is outside its range.
    #[error("{name} = {value}: must be {range}")]
    OutOfRange {
        /// The field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be, with its unit.
        range: &'static str,
    },
    /// A fixed node does not exist.
    #[error("fixed node {node} does not exist: the mesh has {nodes} nodes (counted from 0)")]
    FixedOutOfRange {
        /// The node.
        node: u32,
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// What a changed body may not differ in from the one that it comes from.
    #[error("a body that changes in a run keeps its nodes, its fixed nodes and its kind of elements: {what} differ")]
    Changed {
        /// What differs.
        what: &'static str,
    },
    /// Elements whose coupling is made anew by every change.
    #[error("averaged elements cannot be cut, held or released in a run: use linear or quadratic elements")]
    ChangedAverages,
    /// Every node is fixed.
    #[error("all {nodes} nodes are fixed: nothing can move; use a fixed body, or fix fewer nodes")]
    AllFixed {
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// Neither mass nor fixed nodes hold the body.
    #[error("the body has neither mass nor fixed nodes: its system is singular; give a density or fix some nodes")]
    Unsupported,
    /// A node belongs to no tetrahedron.
    #[error("node {node} belongs to no tetrahedron: remove unconnected nodes from the mesh")]
    Unconnected {
        /// The node.
        node: u32,
    },
}

/// The nearest known name, as a question.
fn suggestion(name: &str, known: &[String]) -> String {
    let nearest = known.iter().map(|k| (strsim::osa_distance(name, k), k)).min();
    match nearest {
        Some((distance, k)) if distance <= 1 + name.chars().count() / 3 => format!(" (did you mean `{k}`?)"),
        _ => String::new(),
    }
}

fn list(known: &[String]) -> String {
    if known.is_empty() { "no named regions".into() } else { known.join(", ") }
}
