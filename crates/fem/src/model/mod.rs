//! Description and state of a soft body.

mod change;
mod config;
mod elements;
mod error;
mod setup;

use std::{ops::Range, sync::Arc};

use nalgebra::{Vector3, Vector6};

pub(crate) use self::config::Tissue;
pub use self::{
    change::CarriedMemory,
    config::{FemConfig, MAX_STIFFNESS_RATIO},
    error::FemError,
};
use crate::{
    assembly::{PackLists, UpperBlocks},
    averaging::Averaging,
    element::{ElementKind, QuadraticTetrahedron, Tetrahedron, quadratic::POINTS},
    material::BATCH,
    pack::{PACK, Pack, QuadraticPack},
    sparse::BlockPattern,
};

/// The state of a soft body: what is saved, and all that a step changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FemState {
    /// Position of every mesh node (m), fixed ones included.
    pub q: Vec<Vector3<f64>>,
    /// Velocity of every mesh node (m/s); that of fixed nodes is ignored.
    pub v: Vec<Vector3<f64>>,
    /// Stresses of the Maxwell branches (Pa, second Piola, `xx yy zz yz xz xy`), by viscous element, point of quadrature
    /// and term: the memory of [viscous](crate::material::viscosity) tissue. Empty where all tissue is elastic.
    pub memory: Vec<Vector6<f64>>,
}

/// Consecutive elements of one material that are computed together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Batch {
    pub(crate) elements: Range<usize>,
    pub(crate) packs: Range<usize>,
    pub(crate) tissue: Tissue,
    /// The batch's part of [`FemState::memory`].
    pub(crate) memory: Range<usize>,
}

impl Batch {
    /// The batch's part of a list over all elements; nothing where the list is shorter.
    pub(crate) fn of<'a, T>(&self, list: &'a [T]) -> &'a [T] {
        list.get(self.elements.clone()).unwrap_or_default()
    }
}

/// The description of a soft body: never changes after set-up.
#[derive(Clone, Debug)]
pub struct FemModel {
    q_rest: Vec<Vector3<f64>>,
    kind: ElementKind,
    elements: Vec<Tetrahedron>,
    quadratic: Vec<QuadraticTetrahedron>,
    free_tetrahedra: Vec<[u32; 4]>,
    mesh_tetrahedron: Vec<u32>,
    batches: Vec<Batch>,
    packs: Vec<Pack>,
    quadratic_packs: Vec<QuadraticPack>,
    pack_lists: PackLists,
    memory: usize,
    mass: Vec<f64>,
    free_of_node: Vec<u32>,
    node_of_free: Vec<u32>,
    /// Whether each free node is held.
    held: Vec<bool>,
    held_mass: f64,
    pattern: Arc<BlockPattern>,
    upper_blocks: UpperBlocks,
    averaging: Option<Averaging>,
    gravity: Vector3<f64>,
    rayleigh_mass: f64,
    rayleigh_stiffness: f64,
    filter: bool,
}

impl FemModel {
    /// The state at rest: `q = q_rest`, `v = 0`, nothing remembered.
    pub fn rest_state(&self) -> FemState {
        FemState {
            q: self.q_rest.clone(),
            v: vec![Vector3::zeros(); self.q_rest.len()],
            memory: vec![Vector6::zeros(); self.memory],
        }
    }

    /// Entries of [`FemState::memory`].
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// Number of mesh nodes.
    pub fn nodes(&self) -> usize {
        self.q_rest.len()
    }

    /// Number of free nodes `n`; the system has `3 n` unknowns.
    pub fn free_nodes(&self) -> usize {
        self.node_of_free.len()
    }

    /// Rest positions (m).
    pub fn q_rest(&self) -> &[Vector3<f64>] {
        &self.q_rest
    }

    /// The kind of all elements.
    pub fn element_kind(&self) -> ElementKind {
        self.kind
    }

    /// Elements, grouped by material; of a quadratic body the straight tetrahedra over their corners.
    /// [`FemModel::mesh_tetrahedron`] gives their place in the mesh.
    pub fn elements(&self) -> &[Tetrahedron] {
        &self.elements
    }

    /// The elements of a quadratic body, in the order of [`FemModel::elements`]; empty for other kinds.
    pub fn quadratic_elements(&self) -> &[QuadraticTetrahedron] {
        &self.quadratic
    }

    /// Free nodes at the corners of each element, [`FIXED`](crate::sparse::FIXED) where a node is fixed.
    pub fn free_tetrahedra(&self) -> &[[u32; 4]] {
        &self.free_tetrahedra
    }

    /// Tetrahedron of the mesh for each element.
    pub fn mesh_tetrahedron(&self) -> &[u32] {
        &self.mesh_tetrahedron
    }

    /// Rest volume (m³).
    pub fn volume(&self) -> f64 {
        match self.kind {
            ElementKind::Quadratic => self.quadratic.iter().map(QuadraticTetrahedron::volume).sum(),
            _ => self.elements.iter().map(|e| e.volume).sum(),
        }
    }

    /// Lumped mass of every node (kg), positive. Weight acts as these masses times gravity, so that a free fall is free
    /// of strain; on quadratic elements that differs from the consistent load by forces within each element that add up to
    /// nothing, which leave a strain of the order of the weight of one layer of elements.
    pub fn mass(&self) -> &[f64] {
        &self.mass
    }

    /// Free number of every node, [`FIXED`](crate::sparse::FIXED) for fixed ones and for those that are held.
    pub fn free_of_node(&self) -> &[u32] {
        &self.free_of_node
    }

    /// For every free node whether it is held: it has rows in the system, but does not move.
    pub fn held(&self) -> &[bool] {
        &self.held
    }

    /// Mesh node of every free node, held ones included, ascending.
    pub fn node_of_free(&self) -> &[u32] {
        &self.node_of_free
    }

    /// Sparsity of every matrix of this body.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    /// Acceleration of gravity (m/s²).
    pub fn gravity(&self) -> &Vector3<f64> {
        &self.gravity
    }

    /// Rayleigh damping by mass (1/s).
    pub fn rayleigh_mass(&self) -> f64 {
        self.rayleigh_mass
    }

    /// Rayleigh damping by stiffness (s).
    pub fn rayleigh_stiffness(&self) -> f64 {
        self.rayleigh_stiffness
    }

    /// Whether the definiteness filter is on.
    pub fn filter(&self) -> bool {
        self.filter
    }

    /// Mass in the rows of held nodes (kg): that of the mean node before any change.
    pub(crate) fn held_mass(&self) -> f64 {
        self.held_mass
    }

    pub(crate) fn batches(&self) -> &[Batch] {
        &self.batches
    }

    /// Most packs of a batch.
    pub(crate) fn packs_of_batch(&self) -> usize {
        packs_of_batch(self.kind)
    }

    /// Parts whose elements assembly sums side by side: as many threads find work.
    pub fn parts(&self) -> usize {
        self.pack_lists.parts().len()
    }

    pub(crate) fn averaging(&self) -> Option<&Averaging> {
        self.averaging.as_ref()
    }

    /// The elements of a linear or averaged body in packs of one material each, in the order of [`FemModel::elements`]; empty
    /// for a quadratic one.
    pub fn packs(&self) -> &[Pack] {
        &self.packs
    }

    /// The elements of a quadratic body in packs, as [`FemModel::packs`]; empty for other kinds.
    pub fn quadratic_packs(&self) -> &[QuadraticPack] {
        &self.quadratic_packs
    }

    pub(crate) fn pack_lists(&self) -> &PackLists {
        &self.pack_lists
    }

    pub(crate) fn upper_blocks(&self) -> &UpperBlocks {
        &self.upper_blocks
    }
}

/// Most packs of a batch: as many points of quadrature whatever the kind.
fn packs_of_batch(kind: ElementKind) -> usize {
    BATCH / PACK / if kind == ElementKind::Quadratic { POINTS } else { 1 }
}
