//! What a user chooses for a soft body, and what can be wrong with it.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::Vector3;
use thiserror::Error;

use crate::{
    averaging::Grouping,
    element::{ElementKind, quadratic::MidNodeError},
    material::{Law, Material, MaterialError, NeoHookean, PronyTerm, viscosity::validate_prony},
    mesh::TetMesh,
};

/// Largest ratio of Young's moduli within one body. Beyond it single-step integration and the preconditioner lose more
/// digits than a real-time tolerance leaves.
pub const MAX_STIFFNESS_RATIO: f64 = 1e4;

/// Choices for one soft body.
#[derive(Clone, Debug, PartialEq)]
pub struct FemConfig {
    /// The kind of all elements; quadratic ones need a mesh with mid-nodes. Default: linear.
    pub element: ElementKind,
    /// How averaged elements are grouped. Default: patches, which the convergence study favours.
    pub grouping: Grouping,
    /// Material of the regions that `region_materials` does not name. Default: neo-Hookean, 5 kPa, 0.45 (soft liver).
    pub material: Material,
    /// Material by region name. Default: none.
    pub region_materials: BTreeMap<String, Material>,
    /// Prony viscosity of the regions that `region_viscosities` does not name; no terms is elastic. Default: none.
    pub viscosity: Vec<PronyTerm>,
    /// Prony viscosity by region name. Default: none.
    pub region_viscosities: BTreeMap<String, Vec<PronyTerm>>,
    /// Density of the regions that `region_densities` does not name (kg/m³), >= 0. Default: 1060.
    pub density: f64,
    /// Density by region name (kg/m³), >= 0. Default: none.
    pub region_densities: BTreeMap<String, f64>,
    /// If set, this mass (kg) is shared equally by all nodes, fixed ones included, and densities are not used: the
    /// uniform mass of other engines' scenes. Default: none.
    pub total_mass: Option<f64>,
    /// Rayleigh damping by mass `α` (1/s), >= 0: `C = α M + β K`. Default: 0.
    pub rayleigh_mass: f64,
    /// Rayleigh damping by stiffness `β` (s), >= 0. Default: 0.
    pub rayleigh_stiffness: f64,
    /// Acceleration of gravity (m/s²). Default: (0, 0, -9.81).
    pub gravity: Vector3<f64>,
    /// Mesh nodes that do not move: they keep the position that the state holds. Default: none.
    pub fixed: Vec<u32>,
    /// Mesh nodes that do not move for now but may be released by [`FemModel::changed`](super::FemModel::changed): they keep
    /// their rows in the system, which are those of a mass alone. Backward Euler serves such bodies. Default: none.
    pub held: Vec<u32>,
    /// Definiteness filter: each element's tangent is replaced by the nearest positive semidefinite one. On for real
    /// time; off for reference runs, where Newton's method converges quadratically. Default: true.
    pub filter: bool,
}

impl Default for FemConfig {
    fn default() -> Self {
        Self {
            element: ElementKind::Linear,
            grouping: Grouping::Patches,
            material: NeoHookean { young: 5e3, poisson: 0.45 }.into(),
            region_materials: BTreeMap::new(),
            viscosity: Vec::new(),
            region_viscosities: BTreeMap::new(),
            density: 1060.0,
            region_densities: BTreeMap::new(),
            total_mass: None,
            rayleigh_mass: 0.0,
            rayleigh_stiffness: 0.0,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            fixed: Vec::new(),
            held: Vec::new(),
            filter: true,
        }
    }
}

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

/// Checks a number of the configuration: finite and not negative.
fn not_negative(name: &'static str, value: f64, range: &'static str) -> Result<(), FemError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(FemError::OutOfRange { name, value, range }) }
}

impl FemConfig {
    /// Checks everything that does not depend on the mesh's geometry.
    pub(super) fn validate(&self, mesh: &TetMesh) -> Result<(), FemError> {
        let named = self.region_materials.keys().chain(self.region_densities.keys());
        for name in named.chain(self.region_viscosities.keys()) {
            if !mesh.region_names.contains(name) {
                return Err(FemError::UnknownRegion { name: name.clone(), known: mesh.region_names.clone() });
            }
        }
        let in_place = |place: String, material: &Material, viscosity: &[PronyTerm]| {
            let turns = viscosity.is_empty() || material.is_frame_indifferent();
            (material.validate())
                .and_then(|()| validate_prony(viscosity))
                .and_then(|()| if turns { Ok(()) } else { Err(MaterialError::NoViscosity(material.name())) })
                .map_err(|error| FemError::Material { place, error })
        };
        in_place("the body".into(), &self.material, &self.viscosity)?;
        for name in self.region_materials.keys().chain(self.region_viscosities.keys()) {
            let tissue = self.region(name);
            in_place(format!("region `{name}`"), &tissue.material, &tissue.viscosity)?;
        }
        not_negative("density", self.density, ">= 0 kg/m³ and finite (soft tissue: about 1060)")?;
        for &density in self.region_densities.values() {
            not_negative("region_densities", density, ">= 0 kg/m³ and finite (soft tissue: about 1060)")?;
        }
        if let Some(mass) = self.total_mass {
            not_negative("total_mass", mass, ">= 0 kg and finite")?;
        }
        not_negative("rayleigh_mass", self.rayleigh_mass, ">= 0 1/s and finite")?;
        not_negative("rayleigh_stiffness", self.rayleigh_stiffness, ">= 0 s and finite")?;
        if let Some(&value) = self.gravity.iter().find(|g| !g.is_finite()) {
            return Err(FemError::OutOfRange { name: "gravity", value, range: "finite, in m/s²" });
        }
        let nodes = mesh.nodes.len();
        if let Some(&node) = self.fixed.iter().chain(&self.held).find(|&&i| i as usize >= nodes) {
            return Err(FemError::FixedOutOfRange { node, nodes });
        }
        Ok(())
    }

    /// What each region consists of; the whole body where the mesh has no regions.
    pub(super) fn regions(&self, mesh: &TetMesh) -> Vec<(Tissue, f64)> {
        if mesh.regions.is_empty() {
            let tissue = Tissue { material: self.material, viscosity: self.viscosity.as_slice().into() };
            return vec![(tissue, self.density)];
        }
        let density = |name| *self.region_densities.get(name).unwrap_or(&self.density);
        mesh.region_names.iter().map(|name| (self.region(name), density(name))).collect()
    }

    fn region(&self, name: &str) -> Tissue {
        Tissue {
            material: *self.region_materials.get(name).unwrap_or(&self.material),
            viscosity: self.region_viscosities.get(name).unwrap_or(&self.viscosity).as_slice().into(),
        }
    }
}

/// A law with its viscosity.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tissue {
    /// The law; its shear modulus is the instantaneous one.
    pub(crate) material: Material,
    /// Terms of the Prony series; none is elastic.
    pub(crate) viscosity: Arc<[PronyTerm]>,
}
