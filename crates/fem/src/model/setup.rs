//! A body from its mesh and configuration.

use std::{ops::Range, sync::Arc};

use super::{Batch, FemConfig, FemError, FemModel, MAX_STIFFNESS_RATIO, Tissue, elements::Elements, packs_of_batch};
use crate::{
    assembly::{PackLists, UpperBlocks},
    averaging::{Averaging, Groups, cliques},
    element::{
        ElementKind, QuadraticTetrahedron, Tetrahedron,
        quadratic::{POINTS, is_straight},
    },
    material::{Bulk, Law, Material},
    mesh::TetMesh,
    pack::{PACK, Pack, QuadraticPack},
    sparse::{BlockPattern, FIXED},
};

impl FemModel {
    /// Sets up a body over a mesh.
    ///
    /// # Errors
    /// Every mistake of mesh or configuration that would otherwise surface during a run; see [`FemError`].
    pub fn new(mesh: &TetMesh, config: &FemConfig) -> Result<Self, FemError> {
        Self::on_pattern(mesh, config, None)
    }

    /// Over a pattern that holds all blocks of the body, where there is one; nodes without elements are then held.
    pub(super) fn on_pattern(
        mesh: &TetMesh,
        config: &FemConfig,
        pattern: Option<&Arc<BlockPattern>>,
    ) -> Result<Self, FemError> {
        check_topology(mesh)?;
        config.validate(mesh)?;
        let regions = config.regions(mesh);
        let region_of = |t: usize| mesh.regions.get(t).map_or(0, |&r| r as usize);

        // Elements of one material lie together, in mesh order within it.
        let (mut tissues, tissue_of_region) = distinct_tissues(&regions);
        let mut order: Vec<u32> = (0..mesh.tetrahedra.len() as u32).collect();
        // Of quadratic ones the straight before the curved.
        let of_tetrahedron = |t: u32| tissue_of_region[region_of(t as usize)];
        let curved: Vec<bool> = (0..mesh.tetrahedra.len()).map(|t| is_curved(mesh, t)).collect();
        let key = |&t: &u32| (of_tetrahedron(t), curved[t as usize]);
        order.sort_by_key(key);
        check_stiffness_ratio(order.iter().map(|&t| &regions[region_of(t as usize)].0.material))?;

        let densities: Vec<f64> = regions.iter().map(|r| r.1).collect();
        let Elements { tetrahedra: elements, quadratic, mut mass, loose } =
            Elements::new(mesh, &order, config.element, |t| densities[region_of(t as usize)])?;
        if let (Some(&node), None) = (loose.first(), pattern) {
            return Err(FemError::Unconnected { node });
        }
        if let Some(total) = config.total_mass {
            mass.fill(total / mesh.nodes.len() as f64);
        }

        let (number, node_of_free) = number_free_nodes(mesh.nodes.len(), &config.fixed);
        if node_of_free.is_empty() {
            return Err(FemError::AllFixed { nodes: mesh.nodes.len() });
        }
        let (free_of_node, held) = hold(&number, node_of_free.len(), config.held.iter().chain(&loose));
        if config.fixed.is_empty() && mass.iter().all(|&m| m == 0.0) {
            return Err(FemError::Unsupported);
        }
        let corners: Vec<[u32; 4]> = elements.iter().map(|e| e.nodes).collect();
        let free_tetrahedra: Vec<[u32; 4]> = corners.iter().map(|e| e.map(|i| free_of_node[i as usize])).collect();
        let free = node_of_free.len();
        let of_element: Vec<usize> = order.iter().map(|&t| of_tetrahedron(t)).collect();
        let runs = runs(&of_element);
        let (mut groups, mut bulk_of_run, mut coupled) = (None, Vec::new(), Vec::new());
        if config.element == ElementKind::Averaged {
            bulk_of_run = split_bulk(&mut tissues, &of_element, &runs)?;
            let made = Groups::new(config.grouping, &corners, &runs);
            coupled = cliques(&made, &corners, &number);
            groups = Some(made);
        }
        let size = packs_of_batch(config.element);
        let mut batches = batches(order.iter().map(key), &tissues, PACK * size);
        let (packs, quadratic_packs) = pack(config.element, &elements, &quadratic, &mut batches);
        let (pattern, upper_blocks, pack_lists) = if config.element == ElementKind::Quadratic {
            let nodes: Vec<_> = quadratic_packs.iter().map(|pack| (&pack.nodes, pack.len)).collect();
            let pattern = pattern.map_or_else(|| coupling(&nodes, &coupled, &number, free), Arc::clone);
            lists::<10, 45>(&nodes, &batches, &free_of_node, pattern)
        } else {
            let nodes: Vec<_> = packs.iter().map(|pack| (&pack.nodes, pack.len)).collect();
            let pattern = pattern.map_or_else(|| coupling(&nodes, &coupled, &number, free), Arc::clone);
            lists::<4, 6>(&nodes, &batches, &free_of_node, pattern)
        };
        let averaging = groups.map(|groups| {
            let run_of = |e: u32| runs.partition_point(|run| run.end <= e as usize);
            let bulk = groups.members.iter().map(|m| bulk_of_run[run_of(m[0])]).collect();
            Averaging::new(groups, bulk, &coupled, &packs, &free_of_node, &pattern, &upper_blocks)
        });
        let points = if config.element == ElementKind::Quadratic { POINTS } else { 1 };
        let mut memory = 0;
        for batch in &mut batches {
            let first = memory;
            memory += batch.elements.len() * points * batch.tissue.viscosity.len();
            batch.memory = first..memory;
        }
        let total: f64 = mass.iter().sum();
        Ok(Self {
            held_mass: if total > 0.0 { total / mass.len() as f64 } else { 1.0 },
            q_rest: mesh.nodes.clone(),
            kind: config.element,
            elements,
            quadratic,
            free_tetrahedra,
            mesh_tetrahedron: order,
            batches,
            packs,
            quadratic_packs,
            pack_lists,
            memory,
            mass,
            free_of_node,
            node_of_free,
            held,
            pattern,
            upper_blocks,
            averaging,
            gravity: config.gravity,
            rayleigh_mass: config.rayleigh_mass,
            rayleigh_stiffness: config.rayleigh_stiffness,
            filter: config.filter,
        })
    }
}

/// Checks counts and indices of the mesh.
fn check_topology(mesh: &TetMesh) -> Result<(), FemError> {
    let (nodes, tetrahedra) = (mesh.nodes.len(), mesh.tetrahedra.len());
    if tetrahedra == 0 {
        return Err(FemError::Empty);
    }
    if tetrahedra > PackLists::MAX_ELEMENTS || nodes >= FIXED as usize {
        return Err(FemError::TooLarge { nodes, tetrahedra, limit: PackLists::MAX_ELEMENTS });
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

/// Whether a tetrahedron of the mesh has mid-nodes away from the middles of its edges. Nodes are in range.
fn is_curved(mesh: &TetMesh, tetrahedron: usize) -> bool {
    mesh.ten_nodes(tetrahedron).is_some_and(|nodes| !is_straight(&nodes.map(|i| mesh.nodes[i as usize])))
}

/// Cuts each batch into packs and tells it which are its own.
fn pack(
    kind: ElementKind,
    elements: &[Tetrahedron],
    quadratic: &[QuadraticTetrahedron],
    batches: &mut [Batch],
) -> (Vec<Pack>, Vec<QuadraticPack>) {
    let (mut packs, mut quadratic_packs) = (Vec::new(), Vec::new());
    for batch in batches {
        let first = packs.len() + quadratic_packs.len();
        if kind == ElementKind::Quadratic {
            let elements = batch.of(quadratic).chunks(PACK).zip(batch.of(elements).chunks(PACK));
            quadratic_packs.extend(elements.filter_map(|(elements, corners)| QuadraticPack::new(elements, corners)));
        } else {
            packs.extend(batch.of(elements).chunks(PACK).filter_map(Pack::new));
        }
        batch.packs = first..packs.len() + quadratic_packs.len();
    }
    (packs, quadratic_packs)
}

/// Pattern over the free nodes of packs, given by the nodes of their elements and their number; `cliques` of free nodes are
/// coupled as well.
fn coupling<const N: usize>(
    packs: &[(&[[u32; N]; PACK], usize)],
    cliques: &[Vec<u32>],
    free_of_node: &[u32],
    free_nodes: usize,
) -> Arc<BlockPattern> {
    let elements = packs.iter().flat_map(|(nodes, len)| &nodes[..*len]);
    let free: Vec<[u32; N]> = elements.map(|e| e.map(|i| free_of_node[i as usize])).collect();
    let coupled = free.iter().map(<[u32; N]>::as_slice).chain(cliques.iter().map(Vec::as_slice));
    Arc::new(BlockPattern::from_cliques(free_nodes, coupled))
}

/// The upper blocks of a pattern, and the lists that fill them from packs.
fn lists<const N: usize, const B: usize>(
    packs: &[(&[[u32; N]; PACK], usize)],
    batches: &[Batch],
    free_of_node: &[u32],
    pattern: Arc<BlockPattern>,
) -> (Arc<BlockPattern>, UpperBlocks, PackLists) {
    let upper = UpperBlocks::new(&pattern);
    let lists = PackLists::new::<N, B>(packs, batches, free_of_node, &pattern, &upper);
    (pattern, upper, lists)
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

pub(super) fn number_free_nodes(nodes: usize, fixed: &[u32]) -> (Vec<u32>, Vec<u32>) {
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

/// Free numbers without those of held nodes, and which free nodes are held.
fn hold<'a>(number: &[u32], free: usize, nodes: impl Iterator<Item = &'a u32>) -> (Vec<u32>, Vec<bool>) {
    let (mut free_of_node, mut held) = (number.to_vec(), vec![false; free]);
    for &node in nodes {
        if number[node as usize] != FIXED {
            held[number[node as usize] as usize] = true;
            free_of_node[node as usize] = FIXED;
        }
    }
    (free_of_node, held)
}

/// Runs of one key, tissue and whether the elements are curved, cut into batches of at most `size`. The keys are grouped.
fn batches(key_of_element: impl Iterator<Item = (usize, bool)>, tissues: &[Tissue], size: usize) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    let mut last = None;
    for (e, key) in key_of_element.enumerate() {
        match batches.last_mut() {
            Some(batch) if last == Some(key) && batch.elements.len() < size => batch.elements.end = e + 1,
            _ => batches.push(Batch { elements: e..e + 1, tissue: tissues[key.0].clone(), packs: 0..0, memory: 0..0 }),
        }
        last = Some(key);
    }
    batches
}
