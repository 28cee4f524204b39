//! What a mesh must satisfy before it is simulated.

use std::path::PathBuf;

use nalgebra::Vector3;

use super::{At, MeshError, TetMesh, corners, signed_volume};
use crate::element::{QuadraticTetrahedron, quadratic::EDGES};

/// A tetrahedron is flat if |V| is below this fraction of the cube of its longest edge. The gradients of the shape
/// functions are then so large that a strain keeps fewer than four of its sixteen digits.
const FLAT: f64 = 1e-12;

/// How many inverted tetrahedra an error lists.
const LISTED: usize = 8;

/// Where the nodes and tetrahedra of a mesh stand in its file or files. Lines are empty where they are unknown.
#[derive(Clone, Debug, Default)]
pub(crate) struct Provenance {
    pub(crate) node_file: Option<PathBuf>,
    pub(crate) tetrahedron_file: Option<PathBuf>,
    pub(crate) node_lines: Vec<u32>,
    pub(crate) tetrahedron_lines: Vec<u32>,
}

impl Provenance {
    pub(crate) fn node(&self, node: usize) -> At {
        At { file: self.node_file.clone(), line: self.node_lines.get(node).map(|&line| line as usize) }
    }

    pub(crate) fn tetrahedron(&self, t: usize) -> At {
        At { file: self.tetrahedron_file.clone(), line: self.tetrahedron_lines.get(t).map(|&line| line as usize) }
    }

    pub(crate) fn file(&self) -> At {
        At { file: self.tetrahedron_file.clone(), line: None }
    }
}

/// Refuses the first thing that is wrong with a mesh.
pub(crate) fn check(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    check_lists(mesh, from)?;
    check_nodes(&mesh.nodes, from)?;
    check_indices(mesh, from)?;
    check_duplicates(mesh, from)?;
    check_volumes(mesh, from)?;
    check_faces(mesh, from)?;
    check_mid_nodes(mesh, from)?;
    check_unused(mesh, from)
}

fn check_lists(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let inconsistent = |what| Err(MeshError::Inconsistent { at: from.file(), what });
    if mesh.tetrahedra.is_empty() {
        return Err(MeshError::NoTetrahedra { at: from.file(), found: format!("{} nodes", mesh.nodes.len()) });
    }
    if mesh.nodes.len() > u32::MAX as usize || mesh.tetrahedra.len() > u32::MAX as usize {
        return inconsistent("nodes and tetrahedra are counted in 32 bits, and there are more".into());
    }
    let (tetrahedra, regions) = (mesh.tetrahedra.len(), mesh.regions.len());
    if regions != tetrahedra {
        return inconsistent(format!("{tetrahedra} tetrahedra, but regions for {regions}"));
    }
    if mesh.is_quadratic() && mesh.mid_nodes.len() != tetrahedra {
        return inconsistent(format!("{tetrahedra} tetrahedra, but mid-nodes for {}", mesh.mid_nodes.len()));
    }
    let names = mesh.region_names.len();
    if let Some(t) = mesh.regions.iter().position(|&region| region as usize >= names) {
        return inconsistent(format!("tetrahedron {t} is in region {}, but {names} have names", mesh.regions[t]));
    }
    let mut sorted: Vec<&String> = mesh.region_names.iter().collect();
    sorted.sort_unstable();
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        return inconsistent(format!("two regions are called {:?}", pair[0]));
    }
    Ok(())
}

/// Refuses coordinates that are infinite or not numbers.
pub(crate) fn check_nodes(nodes: &[Vector3<f64>], from: &Provenance) -> Result<(), MeshError> {
    for (node, x) in nodes.iter().enumerate() {
        if let Some(&value) = x.iter().find(|value| !value.is_finite()) {
            return Err(MeshError::NonFinite { at: from.node(node), node, value });
        }
    }
    Ok(())
}

fn check_indices(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let nodes = mesh.nodes.len();
    let out = |node: &u32| *node as usize >= nodes;
    for (t, tetrahedron) in mesh.tetrahedra.iter().enumerate() {
        let mids = mesh.mid_nodes.get(t).into_iter().flatten();
        if let Some(&node) = tetrahedron.iter().chain(mids).find(|node| out(node)) {
            let what = format!("tetrahedron {t}");
            return Err(MeshError::NodeOutOfRange { at: from.tetrahedron(t), what, node: node.into(), nodes });
        }
    }
    for (name, set) in &mesh.node_sets {
        if let Some(&node) = set.iter().find(|node| out(node)) {
            let what = format!("node set {name:?}");
            return Err(MeshError::NodeOutOfRange { at: from.file(), what, node: node.into(), nodes });
        }
    }
    Ok(())
}

/// Tetrahedra whose four nodes occurred before, as (later, earlier), ascending in the later one.
pub(crate) fn repeated(tetrahedra: &[[u32; 4]]) -> Vec<(u32, u32)> {
    let mut keyed: Vec<([u32; 4], u32)> = tetrahedra.iter().zip(0..).map(|(&t, i)| (sorted(t), i)).collect();
    keyed.sort_unstable();
    let same = keyed.chunk_by(|a, b| a.0 == b.0);
    let mut pairs: Vec<(u32, u32)> =
        same.flat_map(|group| group[1..].iter().map(|later| (later.1, group[0].1))).collect();
    pairs.sort_unstable();
    pairs
}

fn sorted<const N: usize>(mut nodes: [u32; N]) -> [u32; N] {
    nodes.sort_unstable();
    nodes
}

fn check_duplicates(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let pairs = repeated(&mesh.tetrahedra);
    let Some(&(later, earlier)) = pairs.first() else { return Ok(()) };
    let (tetrahedron, earlier) = (later as usize, earlier as usize);
    Err(MeshError::Duplicate { at: from.tetrahedron(tetrahedron), tetrahedron, earlier, duplicates: pairs.len() })
}

/// Whether a tetrahedron has volume at all, and its longest edge (m).
pub(crate) fn is_flat(x: &[Vector3<f64>; 4], volume: f64) -> (bool, f64) {
    let edge = longest_edge(x);
    // Not `<=`: a volume that overflowed to NaN or infinity is of no use either.
    (!(volume.abs() > FLAT * edge.powi(3) && volume.is_finite()), edge)
}

fn longest_edge(x: &[Vector3<f64>; 4]) -> f64 {
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    pairs.iter().map(|&(i, j)| (x[i] - x[j]).norm()).fold(0.0, f64::max)
}

fn check_volumes(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let (mut inverted, mut flat) = (Vec::new(), Vec::new());
    for (t, &tetrahedron) in mesh.tetrahedra.iter().enumerate() {
        let x = corners(&mesh.nodes, tetrahedron);
        let volume = signed_volume(&x);
        let (is_flat, edge) = is_flat(&x, volume);
        if is_flat {
            flat.push((t, volume, edge));
        } else if volume < 0.0 {
            inverted.push((t, volume));
        }
    }
    let total = mesh.tetrahedra.len();
    if let Some(&(tetrahedron, volume, edge)) = flat.first() {
        let at = from.tetrahedron(tetrahedron);
        return Err(MeshError::ZeroVolume { at, tetrahedron, volume, edge, flat: flat.len(), total });
    }
    if let Some(&(tetrahedron, volume)) = inverted.first() {
        let first = inverted.iter().take(LISTED).map(|&(t, _)| t as u32).collect();
        let at = from.tetrahedron(tetrahedron);
        return Err(MeshError::Inverted { at, tetrahedron, volume, inverted: inverted.len(), total, first });
    }
    Ok(())
}

/// The faces of a tetrahedron of positive volume, counter-clockwise seen from outside.
pub(crate) const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// A face by its sorted nodes, whether sorting reversed its sense, its tetrahedron, and its place in `FACES`.
pub(crate) type Face = ([u32; 3], bool, u32, u8);

/// All faces of all tetrahedra, equal ones side by side.
pub(crate) fn sorted_faces(tetrahedra: &[[u32; 4]]) -> Vec<Face> {
    let mut faces = Vec::with_capacity(4 * tetrahedra.len());
    for (t, tetrahedron) in (0..).zip(tetrahedra) {
        for (k, face) in (0..).zip(FACES) {
            let nodes = face.map(|i| tetrahedron[i]);
            faces.push((sorted(nodes), is_odd(nodes), t, k));
        }
    }
    faces.sort_unstable();
    faces
}

/// Whether sorting three numbers takes an odd permutation.
fn is_odd([a, b, c]: [u32; 3]) -> bool {
    (a > b) ^ (a > c) ^ (b > c)
}

/// Neighbours of positive volume see their common face in opposite senses; a third one never fits.
fn check_faces(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let faces = sorted_faces(&mesh.tetrahedra);
    // Equal faces of one sense are adjacent after sorting, since the sense is the second key.
    let overlaps = faces.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 == pair[1].1);
    let first = overlaps.map(|pair| (pair[1].2.max(pair[0].2), pair[0].2.min(pair[1].2), pair[0].0)).min();
    let Some((later, earlier, face)) = first else { return Ok(()) };
    let (tetrahedron, other) = (later as usize, earlier as usize);
    Err(MeshError::Overlap { at: from.tetrahedron(tetrahedron), tetrahedron, other, face })
}

/// Every edge has one mid-node, which is no corner and belongs to no other edge, and no element is folded by its own.
fn check_mid_nodes(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    // Edge and mid-node of every element, equal ones side by side.
    let mut edges: Vec<((u32, u32), u32, u32)> = Vec::with_capacity(6 * mesh.mid_nodes.len());
    for (t, (corners, mids)) in (0..).zip(mesh.tetrahedra.iter().zip(&mesh.mid_nodes)) {
        for ((a, b), &mid) in EDGES.iter().map(|&(a, b)| (corners[a], corners[b])).zip(mids) {
            edges.push(((a.min(b), a.max(b)), mid, t));
        }
    }
    edges.sort_unstable();
    let mut edge_of_node: Vec<Option<(u32, u32)>> = vec![None; mesh.nodes.len()];
    let shared = |tetrahedron: u32, what: String| {
        let tetrahedron = tetrahedron as usize;
        Err(MeshError::MidNodeShared { at: from.tetrahedron(tetrahedron), tetrahedron, what })
    };
    for group in edges.chunk_by(|x, y| x.0 == y.0) {
        let ((a, b), node, _) = group[0];
        if let Some(&(_, other, t)) = group.iter().find(|entry| entry.1 != node) {
            return shared(t, format!("the edge between nodes {a} and {b} has the mid-nodes {node} and {other}"));
        }
        if let Some((c, d)) = edge_of_node[node as usize].replace((a, b)) {
            return shared(group[0].2, format!("node {node} is mid-node of the edges {a}-{b} and {c}-{d}"));
        }
    }
    let corner = (0..).zip(&mesh.tetrahedra).find_map(|(t, corners)| {
        corners.iter().find(|&&node| edge_of_node[node as usize].is_some()).map(|&node| (t, node))
    });
    if let Some((t, node)) = corner {
        return shared(t, format!("node {node} is a corner here and a mid-node elsewhere"));
    }
    for tetrahedron in 0..mesh.mid_nodes.len() {
        let Some(nodes) = mesh.ten_nodes(tetrahedron) else { continue };
        if let Err(fault) = QuadraticTetrahedron::new(nodes, &mesh.nodes) {
            return Err(MeshError::MidNode { at: from.tetrahedron(tetrahedron), tetrahedron, fault });
        }
    }
    Ok(())
}

fn check_unused(mesh: &TetMesh, from: &Provenance) -> Result<(), MeshError> {
    let used = mesh.used_nodes();
    let Some(node) = used.iter().position(|used| !used) else { return Ok(()) };
    let unused = used.iter().filter(|used| !**used).count();
    Err(MeshError::UnusedNodes { at: from.node(node), node, unused, total: used.len() })
}
