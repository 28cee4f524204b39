//! The part of a skin around a tool, small and of fixed size: what a fast loop detects on while the whole surface is
//! out of its reach.
//!
//! A patch holds triangles and nodes with numbers of its own and the names that they have on the whole surface, so that a
//! contact has the same feature on either. Its normals are the whole surface's: a patch lacks triangles at its rim.

mod detection;
mod gathering;
pub mod renumbering;

use nalgebra::Vector3;

use crate::features::Skin;
use crate::tool::MAX_PARTS;
use crate::triangle::closest_on_triangle;

pub use detection::PatchDetection;
pub use gathering::{PatchConfig, PatchGathering, PatchReport};

/// Triangles and nodes around a tool. Filled in place by [`PatchGathering::gather`]; allocates in [`SkinPatch::new`] only.
#[derive(Debug, Default, PartialEq)]
pub struct SkinPatch {
    /// Names of the nodes; those that can move come first, both parts ascending.
    names: Vec<u32>,
    /// How many of them can move.
    movable: usize,
    normals: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    triangle_names: Vec<u32>,
    edge_names_of: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    edge_names: Vec<u32>,
    max_nodes: usize,
    side: Option<Vector3<f64>>,
    /// Of the tool's further parts.
    other_sides: Vec<Option<Vector3<f64>>>,
    clearance: f64,
}

/// A copy with the same room.
impl Clone for SkinPatch {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.max_nodes);
        copy.copy_from(self);
        copy
    }
}

impl SkinPatch {
    /// An empty patch with room for `max_nodes` nodes and as many triangles and edges as a planar mesh of them has.
    #[must_use]
    pub fn new(max_nodes: usize) -> Self {
        let (triangles, edges) = (2 * max_nodes, 3 * max_nodes);
        Self {
            names: Vec::with_capacity(max_nodes),
            movable: 0,
            normals: Vec::with_capacity(max_nodes),
            triangles: Vec::with_capacity(triangles),
            triangle_names: Vec::with_capacity(triangles),
            edge_names_of: Vec::with_capacity(triangles),
            edges: Vec::with_capacity(edges),
            edge_names: Vec::with_capacity(edges),
            max_nodes,
            side: None,
            other_sides: Vec::with_capacity(MAX_PARTS),
            clearance: 0.0,
        }
    }

    /// Nodes there is room for.
    #[must_use]
    pub fn max_nodes(&self) -> usize {
        self.max_nodes
    }

    /// Names of its nodes on the whole surface: those that can move first, both parts ascending.
    #[must_use]
    pub fn nodes(&self) -> &[u32] {
        &self.names
    }

    /// How many of its nodes, from the first, can move.
    #[must_use]
    pub fn movable(&self) -> usize {
        self.movable
    }

    /// Its triangles by the numbers of their nodes within the patch, outward counter-clockwise.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number within the patch of the node of this name.
    #[must_use]
    pub fn number_of(&self, name: u32) -> Option<usize> {
        let (movable, fixed) = self.names.split_at(self.movable.min(self.names.len()));
        movable.binary_search(&name).ok().or_else(|| fixed.binary_search(&name).ok().map(|k| k + movable.len()))
    }

    /// How far \[m\] the tool may go in any direction from the pose that the patch was gathered for before skin that the
    /// patch lacks could come within the margin of contact.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// Takes everything out and keeps the memory.
    pub fn clear(&mut self) {
        self.names.clear();
        self.movable = 0;
        self.normals.clear();
        self.triangles.clear();
        self.triangle_names.clear();
        self.edge_names_of.clear();
        self.edges.clear();
        self.edge_names.clear();
        self.side = None;
        self.other_sides.clear();
        self.clearance = 0.0;
    }

    /// Notes the sides from which the tool's further parts came ([`ContactSet::other_sides`](crate::ContactSet)).
    pub fn set_other_sides(&mut self, sides: &[Option<Vector3<f64>>]) {
        self.other_sides.clear();
        self.other_sides.extend_from_slice(sides.get(..MAX_PARTS).unwrap_or(sides));
    }

    /// Makes this a copy of `other` without allocating. Returns false, and is left cleared, if `other` does not fit.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        self.clear();
        if other.names.len() > self.max_nodes || other.max_nodes > self.max_nodes {
            return false;
        }
        self.names.extend_from_slice(&other.names);
        self.movable = other.movable;
        self.normals.extend_from_slice(&other.normals);
        self.triangles.extend_from_slice(&other.triangles);
        self.triangle_names.extend_from_slice(&other.triangle_names);
        self.edge_names_of.extend_from_slice(&other.edge_names_of);
        self.edges.extend_from_slice(&other.edges);
        self.edge_names.extend_from_slice(&other.edge_names);
        self.other_sides.extend_from_slice(&other.other_sides);
        (self.side, self.clearance) = (other.side, other.clearance);
        true
    }

    /// Whether a point \[m\] lies on the inner side of the triangle nearest to it.
    fn is_below(&self, point: &Vector3<f64>, positions: &[Vector3<f64>]) -> bool {
        let at = |n: u32| positions.get(n as usize).copied();
        let mut nearest = (f64::INFINITY, false);
        for nodes in &self.triangles {
            let [Some(a), Some(b), Some(c)] = nodes.map(at) else { continue };
            let corners = [a, b, c];
            let closest = closest_on_triangle(point, &corners);
            let away = point - closest.position(&corners);
            let distance = away.norm_squared();
            if distance < nearest.0 {
                nearest = (distance, away.dot(&self.normal_at(nodes, &closest.weights)) < 0.0);
            }
        }
        nearest.1
    }
}

impl Skin for SkinPatch {
    fn triangle(&self, t: u32) -> Option<[u32; 3]> {
        self.triangles.get(t as usize).copied()
    }

    fn edge_names(&self, t: u32) -> [u32; 3] {
        self.edge_names_of.get(t as usize).copied().unwrap_or_default()
    }

    fn edge(&self, edge: u32) -> Option<[u32; 2]> {
        self.edges.get(edge as usize).copied()
    }

    fn node_normal(&self, node: u32) -> Vector3<f64> {
        self.normals.get(node as usize).copied().unwrap_or_else(Vector3::zeros)
    }

    fn node_name(&self, node: u32) -> u32 {
        self.names.get(node as usize).copied().unwrap_or(u32::MAX)
    }

    fn triangle_name(&self, t: u32) -> u32 {
        self.triangle_names.get(t as usize).copied().unwrap_or(u32::MAX)
    }

    fn edge_name(&self, edge: u32) -> u32 {
        self.edge_names.get(edge as usize).copied().unwrap_or(u32::MAX)
    }
}
