//! From triangles near a tool to features: tissue points with a gap, a normal and the skin's direction.

use nalgebra::{Isometry3, Vector3};

use crate::broad_phase::{SurfaceGeometry, is_usable};
use crate::contact::{Contact, FeatureKind, feature_id};
use crate::held::HeldPoint;
use crate::hull::ConvexHull;
use crate::narrow_phase::{HullInWorld, Touch, point_feature, samples, touch};
use crate::shape::ToolShape;

/// A feature within the query box, with what is needed to accept or reject it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Feature {
    pub(crate) contact: Contact,
    /// Outward normal of the skin.
    pub(crate) skin: Vector3<f64>,
    /// [`Touch::side`].
    pub(crate) side: f64,
    /// [`Touch::submerged`].
    pub(crate) submerged: bool,
    /// It carried a force in the step before.
    pub(crate) held: bool,
}

/// Deepest first; ties by feature, so that the order never depends on how features were found.
pub(crate) fn by_depth(a: &Feature, b: &Feature) -> std::cmp::Ordering {
    a.contact.gap.total_cmp(&b.contact.gap).then(a.contact.feature.cmp(&b.contact.feature))
}

/// What features are made of: a whole surface, or a patch of one. Nodes, triangles and edges are numbered within it; their
/// names are those of the whole surface.
pub(crate) trait Skin {
    fn triangle(&self, t: u32) -> Option<[u32; 3]>;
    /// Names of the edges of a triangle.
    fn edge_names(&self, t: u32) -> [u32; 3];
    /// Ends of an edge.
    fn edge(&self, edge: u32) -> Option<[u32; 2]>;
    /// Outward unit normal of a node; zero where it has none.
    fn node_normal(&self, node: u32) -> Vector3<f64>;
    fn node_name(&self, node: u32) -> u32;
    fn triangle_name(&self, t: u32) -> u32;
    fn edge_name(&self, edge: u32) -> u32;

    /// Outward unit normal between the nodes of a triangle; zero where they cancel.
    fn normal_at(&self, nodes: &[u32; 3], weights: &[f64; 3]) -> Vector3<f64> {
        let sum = (0..3).map(|k| self.node_normal(nodes[k]) * weights[k]).sum::<Vector3<f64>>();
        sum.try_normalize(1e-9).unwrap_or_else(Vector3::zeros)
    }
}

impl Skin for SurfaceGeometry {
    fn triangle(&self, t: u32) -> Option<[u32; 3]> {
        self.triangles().get(t as usize).copied()
    }

    fn edge_names(&self, t: u32) -> [u32; 3] {
        self.triangle_edges().get(t as usize).copied().unwrap_or_default()
    }

    fn edge(&self, edge: u32) -> Option<[u32; 2]> {
        self.edges().get(edge as usize).copied()
    }

    fn node_normal(&self, node: u32) -> Vector3<f64> {
        self.vertex_normal(node)
    }

    fn node_name(&self, node: u32) -> u32 {
        node
    }

    fn triangle_name(&self, t: u32) -> u32 {
        t
    }

    fn edge_name(&self, edge: u32) -> u32 {
        edge
    }
}

/// A skin, where it is, and the tool that meets it.
pub(crate) struct Meeting<'a, S> {
    pub(crate) surface: &'a S,
    pub(crate) positions: &'a [Vector3<f64>],
    pub(crate) tool: &'a ToolShape,
    pub(crate) pose: &'a Isometry3<f64>,
}

/// Where features are collected; when memory is full the shallower half gives way, and is counted.
pub(crate) struct Collector<'a> {
    pub(crate) features: &'a mut Vec<Feature>,
    pub(crate) margin: f64,
    pub(crate) candidates: usize,
    pub(crate) dropped: usize,
    /// What is offered now are held points.
    pub(crate) holding: bool,
    /// Features before this one are of other parts of the tool.
    pub(crate) start: usize,
    /// Bits of the part in the identifiers of its contacts.
    pub(crate) tag: u64,
}

impl<'a> Collector<'a> {
    /// For the features of one part.
    pub(crate) fn new(features: &'a mut Vec<Feature>, margin: f64, tag: u64) -> Self {
        let start = features.len();
        Self { features, margin, candidates: 0, dropped: 0, holding: false, start, tag }
    }

    /// Keeps a feature whose gap is within the margin. `contact` needs no `tool_point`, `normal` or `gap` yet.
    fn offer(&mut self, mut contact: Contact, skin: Vector3<f64>, touch: Touch) {
        self.candidates += 1;
        if touch.gap.is_nan() || touch.gap > self.margin {
            return;
        }
        if self.features.len() == self.features.capacity() {
            let own = self.features.len() - self.start;
            if own < 2 {
                self.dropped += 1;
                return;
            }
            self.features[self.start..].select_nth_unstable_by(own / 2, by_depth);
            self.dropped += own - own / 2;
            self.features.truncate(self.start + own / 2);
        }
        contact.feature |= self.tag;
        contact.normal = touch.normal;
        contact.gap = touch.gap;
        contact.tool_point = contact.tissue_point - touch.normal * touch.gap;
        self.features.push(Feature { contact, skin, side: touch.side, submerged: touch.submerged, held: self.holding });
    }
}

/// A contact at a tissue point that has no gap yet.
fn at(feature: u64, nodes: [u32; 3], weights: [f64; 3], tissue_point: Vector3<f64>) -> Contact {
    Contact {
        feature,
        nodes,
        weights,
        normal: Vector3::zeros(),
        tissue_point,
        tool_point: tissue_point,
        gap: f64::INFINITY,
    }
}

impl<S: Skin> Meeting<'_, S> {
    fn corners(&self, nodes: &[u32; 3]) -> Option<[Vector3<f64>; 3]> {
        let at = |k: usize| self.positions.get(nodes[k] as usize).copied().filter(is_usable);
        Some([at(0)?, at(1)?, at(2)?])
    }

    /// A surface node against the tool.
    pub(crate) fn node(&self, node: u32, found: &mut Collector) {
        let Some(x) = self.positions.get(node as usize).copied().filter(is_usable) else { return };
        let skin = self.surface.node_normal(node);
        if let Some(touch) = touch(self.tool, self.pose, &x, &skin) {
            let id = feature_id(FeatureKind::Vertex, self.surface.node_name(node), 0);
            found.offer(at(id, [node; 3], [1.0, 0.0, 0.0], x), skin, touch);
        }
    }

    /// A point that carried a force in the step before.
    pub(crate) fn held(&self, point: &HeldPoint, found: &mut Collector) {
        let (mut x, mut skin) = (Vector3::zeros(), Vector3::zeros());
        for (&node, &weight) in point.nodes.iter().zip(&point.weights) {
            let Some(q) = self.positions.get(node as usize).filter(|q| is_usable(q)) else { return };
            x += q * weight;
            skin += self.surface.node_normal(node) * weight;
        }
        let skin = skin.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        if let Some(touch) = touch(self.tool, self.pose, &x, &skin) {
            found.offer(at(point.feature, point.nodes, point.weights, x), skin, touch);
        }
    }

    /// The deepest points of a triangle in a sphere or capsule with this axis.
    pub(crate) fn face(&self, t: u32, axis: &[Vector3<f64>; 2], found: &mut Collector) {
        let Some(nodes) = self.surface.triangle(t) else { return };
        let Some(corners) = self.corners(&nodes) else { return };
        let edges = self.surface.edge_names(t);
        let names = nodes.map(|node| self.surface.node_name(node));
        samples(axis, &corners, |point, tool_feature| {
            let x = point.position(&corners);
            let skin = self.surface.normal_at(&nodes, &point.weights);
            if let Some(touch) = touch(self.tool, self.pose, &x, &skin) {
                let id = point_feature(self.surface.triangle_name(t), &names, &edges, &point, tool_feature);
                found.offer(at(id, nodes, point.weights, x), skin, touch);
            }
        });
    }

    /// Corners of a hull against a triangle. Tool features count from 1: 0 is the tissue's own closest point.
    pub(crate) fn hull_corners(&self, t: u32, hull: &ConvexHull, placed: &HullInWorld, found: &mut Collector) {
        let Some(nodes) = self.surface.triangle(t) else { return };
        let Some(corners) = self.corners(&nodes) else { return };
        let name = self.surface.triangle_name(t);
        placed.corners_on_triangle(hull, &corners, |corner, point, skin, touch| {
            let id = feature_id(FeatureKind::Triangle, name, corner + 1);
            found.offer(at(id, nodes, point.weights, point.position(&corners)), skin, touch);
        });
    }

    /// Edges of a hull against an edge of the surface, as far as they pass within `range` \[m\] of it.
    pub(crate) fn hull_edges(
        &self,
        edge: u32,
        hull: &ConvexHull,
        placed: &HullInWorld,
        range: f64,
        found: &mut Collector,
    ) {
        let Some([i, j]) = self.surface.edge(edge) else { return };
        let name = self.surface.edge_name(edge);
        let end = |node: u32| self.positions.get(node as usize).copied().filter(is_usable);
        let (Some(a), Some(b)) = (end(i), end(j)) else { return };
        let mean = self.surface.node_normal(i) + self.surface.node_normal(j);
        let Some(skin) = mean.try_normalize(1e-9) else { return };
        placed.edges_on_edge(hull, [a, b], &skin, range, |tool_edge, t, touch| {
            let id = feature_id(FeatureKind::Edge, name, tool_edge + 1);
            found.offer(at(id, [i, j, j], [1.0 - t, t, 0.0], a + (b - a) * t), skin, touch);
        });
    }
}

/// Keeps of the features from `start` on those for which `keep` holds, in their order.
pub(crate) fn retain_from(features: &mut Vec<Feature>, start: usize, mut keep: impl FnMut(&Feature) -> bool) {
    let mut kept = start;
    for k in start..features.len() {
        if keep(&features[k]) {
            if kept != k {
                features.swap(kept, k);
            }
            kept += 1;
        }
    }
    features.truncate(kept);
}
