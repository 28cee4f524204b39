//! Description and state of a soft body.

mod config;
mod elements;

use std::{ops::Range, sync::Arc};

use nalgebra::{Vector3, Vector6};

pub(crate) use self::config::Tissue;
pub use self::config::{FemConfig, FemError, MAX_STIFFNESS_RATIO};
use self::elements::Elements;
use crate::{
    assembly::{PackLists, ScatterLists},
    averaging::{Averaging, Groups, cliques},
    element::{ElementKind, QuadraticTetrahedron, Tetrahedron, quadratic::POINTS},
    material::{BATCH, Bulk, Law, Material},
    mesh::TetMesh,
    pack::{PACK, Pack},
    sparse::{BlockPattern, FIXED},
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
    /// Empty unless the elements are linear.
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
    pack_lists: PackLists,
    memory: usize,
    mass: Vec<f64>,
    free_of_node: Vec<u32>,
    node_of_free: Vec<u32>,
    pattern: Arc<BlockPattern>,
    scatter: ScatterLists,
    averaging: Option<Averaging>,
    gravity: Vector3<f64>,
    rayleigh_mass: f64,
    rayleigh_stiffness: f64,
    filter: bool,
}

impl FemModel {
    /// Sets up a body over a mesh.
    ///
    /// # Errors
    /// Every mistake of mesh or configuration that would otherwise surface during a run; see [`FemError`].
    pub fn new(mesh: &TetMesh, config: &FemConfig) -> Result<Self, FemError> {
        check_topology(mesh)?;
        config.validate(mesh)?;
        let regions = config.regions(mesh);
        let region_of = |t: usize| mesh.regions.get(t).map_or(0, |&r| r as usize);

        // Elements of one material lie together, in mesh order within it.
        let (mut tissues, tissue_of_region) = distinct_tissues(&regions);
        let mut order: Vec<u32> = (0..mesh.tetrahedra.len() as u32).collect();
        order.sort_by_key(|&t| tissue_of_region[region_of(t as usize)]);
        check_stiffness_ratio(order.iter().map(|&t| &regions[region_of(t as usize)].0.material))?;

        let densities: Vec<f64> = regions.iter().map(|r| r.1).collect();
        let Elements { tetrahedra: elements, quadratic, mut mass } =
            Elements::new(mesh, &order, config.element, |t| densities[region_of(t as usize)])?;
        if let Some(total) = config.total_mass {
            mass.fill(total / mesh.nodes.len() as f64);
        }

        let (free_of_node, node_of_free) = number_free_nodes(mesh.nodes.len(), &config.fixed);
        if node_of_free.is_empty() {
            return Err(FemError::AllFixed { nodes: mesh.nodes.len() });
        }
        if config.fixed.is_empty() && mass.iter().all(|&m| m == 0.0) {
            return Err(FemError::Unsupported);
        }
        let corners: Vec<[u32; 4]> = elements.iter().map(|e| e.nodes).collect();
        let free_tetrahedra: Vec<[u32; 4]> = corners.iter().map(|e| e.map(|i| free_of_node[i as usize])).collect();
        let ten_nodes: Vec<[u32; 10]> = quadratic.iter().map(|e| e.nodes).collect();
        let free = node_of_free.len();
        let mut averaging = None;
        let (pattern, scatter) = match config.element {
            // Packs have lists of their own: here only the pattern, and the numbers of its upper blocks.
            ElementKind::Linear => {
                let pattern = BlockPattern::from_cliques(free, free_tetrahedra.iter().map(<[u32; 4]>::as_slice));
                let scatter = ScatterLists::new::<4>(&pattern, &[], &free_of_node);
                (Arc::new(pattern), scatter)
            }
            ElementKind::Quadratic => lists(&ten_nodes, &[], &free_of_node, free),
            ElementKind::Averaged => {
                let of_element: Vec<usize> = order.iter().map(|&t| tissue_of_region[region_of(t as usize)]).collect();
                let runs = runs(&of_element);
                let bulk_of_run = split_bulk(&mut tissues, &of_element, &runs)?;
                let groups = Groups::new(config.grouping, &corners, &runs);
                let run_of = |e: u32| runs.partition_point(|run| run.end <= e as usize);
                let bulk = groups.members.iter().map(|m| bulk_of_run[run_of(m[0])]).collect();
                let cliques = cliques(&groups, &corners, &free_of_node);
                let (pattern, scatter) = lists(&corners, &cliques, &free_of_node, free);
                let lists = Averaging::new(groups, bulk, &cliques, &elements, &free_of_node, &pattern, &scatter);
                averaging = Some(lists);
                (pattern, scatter)
            }
        };
        let size = batch_size(config.element);
        let mut batches = batches(order.iter().map(|&t| tissue_of_region[region_of(t as usize)]), &tissues, size);
        let (mut packs, mut pack_lists) = (Vec::new(), PackLists::default());
        if config.element == ElementKind::Linear {
            packs = pack(&mut batches, &elements);
            pack_lists = PackLists::new(&packs, &batches, &free_of_node, &pattern, &scatter);
        }
        let points = if config.element == ElementKind::Quadratic { POINTS } else { 1 };
        let mut memory = 0;
        for batch in &mut batches {
            let first = memory;
            memory += batch.elements.len() * points * batch.tissue.viscosity.len();
            batch.memory = first..memory;
        }
        Ok(Self {
            q_rest: mesh.nodes.clone(),
            kind: config.element,
            elements,
            quadratic,
            free_tetrahedra,
            mesh_tetrahedron: order,
            batches,
            packs,
            pack_lists,
            memory,
            mass,
            free_of_node,
            node_of_free,
            pattern,
            scatter,
            averaging,
            gravity: config.gravity,
            rayleigh_mass: config.rayleigh_mass,
            rayleigh_stiffness: config.rayleigh_stiffness,
            filter: config.filter,
        })
    }

    /// The state at rest: `q = q_rest`, `v = 0`, nothing remembered.
    pub fn rest_state(&self) -> FemState {
        FemState {
            q: self.q_rest.clone(),
            v: vec![Vector3::zeros(); self.q_rest.len()],
            memory: vec![Vector6::zeros(); self.memory],
        }
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

    /// Free nodes at the corners of each element, [`FIXED`] where a node is fixed.
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

    /// Free number of every node, [`FIXED`] for fixed ones.
    pub fn free_of_node(&self) -> &[u32] {
        &self.free_of_node
    }

    /// Mesh node of every free node, ascending.
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

    pub(crate) fn batches(&self) -> &[Batch] {
        &self.batches
    }

    /// Most elements of a batch.
    pub(crate) fn batch_size(&self) -> usize {
        batch_size(self.kind)
    }

    pub(crate) fn averaging(&self) -> Option<&Averaging> {
        self.averaging.as_ref()
    }

    /// The elements of a linear body in packs of one material each, in the order of [`FemModel::elements`]; empty for other
    /// kinds.
    pub fn packs(&self) -> &[Pack] {
        &self.packs
    }

    pub(crate) fn pack_lists(&self) -> &PackLists {
        &self.pack_lists
    }

    pub(crate) fn scatter(&self) -> &ScatterLists {
        &self.scatter
    }
}

/// Checks counts and indices of the mesh.
fn check_topology(mesh: &TetMesh) -> Result<(), FemError> {
    let (nodes, tetrahedra) = (mesh.nodes.len(), mesh.tetrahedra.len());
    if tetrahedra == 0 {
        return Err(FemError::Empty);
    }
    if tetrahedra > ScatterLists::MAX_ELEMENTS || nodes >= FIXED as usize {
        return Err(FemError::TooLarge { nodes, tetrahedra, limit: ScatterLists::MAX_ELEMENTS });
    }
    for (tetrahedron, element) in mesh.tetrahedra.iter().enumerate() {
        let mids = mesh.mid_nodes.get(tetrahedron);
        if let Some(&node) = element.iter().chain(mids.into_iter().flatten()).find(|&&i| i as usize >= nodes) {
            return Err(FemError::NodeOutOfRange { tetrahedron, node, nodes });
        }
    }
    if !mesh.regions.is_empty() {
        if mesh.regions.len() != tetrahedra {
            return Err(FemError::RegionCount { tetrahedra, regions: mesh.regions.len() });
        }
        let names = mesh.region_names.len();
        if let Some(tetrahedron) = mesh.regions.iter().position(|&r| r as usize >= names) {
            return Err(FemError::RegionOutOfRange { tetrahedron, region: mesh.regions[tetrahedron], names });
        }
    }
    Ok(())
}

/// Most elements of a batch: as many points of quadrature whatever the kind.
fn batch_size(kind: ElementKind) -> usize {
    if kind == ElementKind::Quadratic { BATCH / POINTS } else { BATCH }
}

/// Pattern over the free nodes, and the lists that fill it from elements over the given nodes; `cliques` of free nodes are
/// coupled as well.
fn lists<const N: usize>(
    elements: &[[u32; N]],
    cliques: &[Vec<u32>],
    free_of_node: &[u32],
    free_nodes: usize,
) -> (Arc<BlockPattern>, ScatterLists) {
    let free: Vec<[u32; N]> = elements.iter().map(|e| e.map(|i| free_of_node[i as usize])).collect();
    let coupled = free.iter().map(<[u32; N]>::as_slice).chain(cliques.iter().map(Vec::as_slice));
    let pattern = BlockPattern::from_cliques(free_nodes, coupled);
    let scatter = ScatterLists::new(&pattern, elements, free_of_node);
    (Arc::new(pattern), scatter)
}

/// The tissues that differ, and the tissue of each region.
fn distinct_tissues(regions: &[(Tissue, f64)]) -> (Vec<Tissue>, Vec<usize>) {
    let mut tissues: Vec<Tissue> = Vec::new();
    let of_region = regions
        .iter()
        .map(|(tissue, _)| {
            tissues.iter().position(|t| t == tissue).unwrap_or_else(|| {
                tissues.push(tissue.clone());
                tissues.len() - 1
            })
        })
        .collect();
    (tissues, of_region)
}

/// Runs of elements of one material.
fn runs(material_of_element: &[usize]) -> Vec<Range<usize>> {
    let mut start = 0;
    let run = |run: &[usize]| {
        start += run.len();
        start - run.len()..start
    };
    material_of_element.chunk_by(|a, b| a == b).map(run).collect()
}

/// Takes the bulk terms out of the materials that elements have; returns them by run.
fn split_bulk(tissues: &mut [Tissue], of_element: &[usize], runs: &[Range<usize>]) -> Result<Vec<Bulk>, FemError> {
    let split = |run: &Range<usize>| {
        let material = &mut tissues[of_element[run.start]].material;
        let (rest, bulk) = material.without_bulk().ok_or(FemError::NoBulk { law: material.name() })?;
        *material = rest;
        Ok(bulk)
    };
    runs.iter().map(split).collect()
}

fn check_stiffness_ratio<'a>(materials: impl Iterator<Item = &'a Material>) -> Result<(), FemError> {
    let (softest, stiffest) = materials
        .map(|m| m.small_strain().young())
        .fold((f64::INFINITY, 0.0_f64), |(low, high), young| (low.min(young), high.max(young)));
    // The slack is for moduli that are converted from others.
    if stiffest > softest * MAX_STIFFNESS_RATIO * (1.0 + 1e-9) {
        return Err(FemError::StiffnessRatio { softest, stiffest });
    }
    Ok(())
}

fn number_free_nodes(nodes: usize, fixed: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut free_of_node = vec![0; nodes];
    for &i in fixed {
        free_of_node[i as usize] = FIXED;
    }
    let mut node_of_free = Vec::with_capacity(nodes);
    for (i, free) in free_of_node.iter_mut().enumerate().filter(|(_, free)| **free != FIXED) {
        *free = node_of_free.len() as u32;
        node_of_free.push(i as u32);
    }
    (free_of_node, node_of_free)
}

/// Runs of one tissue, cut into batches of at most `size`. `tissue_of_element` is grouped.
fn batches(tissue_of_element: impl Iterator<Item = usize>, tissues: &[Tissue], size: usize) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    let mut last = usize::MAX;
    for (e, m) in tissue_of_element.enumerate() {
        match batches.last_mut() {
            Some(batch) if m == last && batch.elements.len() < size => batch.elements.end = e + 1,
            _ => batches.push(Batch { elements: e..e + 1, tissue: tissues[m].clone(), packs: 0..0, memory: 0..0 }),
        }
        last = m;
    }
    batches
}

/// Cuts each batch into packs and tells it which are its own.
fn pack(batches: &mut [Batch], elements: &[Tetrahedron]) -> Vec<Pack> {
    let mut packs = Vec::with_capacity(batches.len() * BATCH.div_ceil(PACK));
    for batch in batches {
        let first = packs.len();
        packs.extend(batch.of(elements).chunks(PACK).filter_map(Pack::new));
        batch.packs = first..packs.len();
    }
    packs
}
