//! Which part of a skin a patch takes: the triangles nearest to the tool, as many as fit.

use nalgebra::{Isometry3, Vector3};

use super::SkinPatch;
use crate::broad_phase::{SurfaceGeometry, is_usable};
use crate::shape::ToolShape;
use crate::tool::{PlacedPart, Tool, ToolPose};
use crate::tree::Aabb;
use crate::triangle::{closest_on_triangle, closest_to_segment};

/// What a patch is gathered for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchConfig {
    /// Gap up to which a feature is a contact \[m\].
    pub margin: f64,
    /// How far the tool may go while the patch is in use \[m\].
    pub travel: f64,
    /// What detection remembers of the side from which the tool came ([`ContactSet::side`](crate::ContactSet::side)).
    pub side: Option<Vector3<f64>>,
}

/// What a patch took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PatchReport {
    /// Its nodes.
    pub nodes: usize,
    /// Its triangles.
    pub triangles: usize,
    /// Triangles within `margin + travel` of the tool that found no room; no nearer than those that did.
    pub left_out: usize,
}

/// A triangle near the tool.
#[derive(Clone, Copy, Debug)]
struct Near {
    distance: f64,
    triangle: u32,
}

/// Memory for gathering patches from one surface.
#[derive(Clone, Debug)]
pub struct PatchGathering {
    near: Vec<Near>,
    /// Whether each node of the body is taken.
    taken: Vec<bool>,
    edges: Vec<(u32, [u32; 2])>,
}

impl PatchGathering {
    /// Memory for one surface.
    #[must_use]
    pub fn new(surface: &SurfaceGeometry) -> Self {
        Self {
            near: Vec::with_capacity(surface.triangles().len()),
            taken: vec![false; surface.body_nodes()],
            edges: Vec::with_capacity(3 * surface.triangles().len()),
        }
    }

    /// Refills `patch` with the triangles within `margin + travel` of the tool, the nearest first, as long as their nodes
    /// fit. `positions` are the body's nodes \[m\], no farther from those that the surface was refitted to than `travel`;
    /// `movable` says which nodes can move. Allocates nothing.
    pub fn gather(
        &mut self,
        surface: &SurfaceGeometry,
        positions: &[Vector3<f64>],
        (tool, pose): (&ToolShape, &Isometry3<f64>),
        config: &PatchConfig,
        movable: impl Fn(u32) -> bool,
        patch: &mut SkinPatch,
    ) -> PatchReport {
        let part = std::iter::once(PlacedPart::alone(tool, pose));
        self.gather_parts(surface, positions, (part, &ToolPose::from(pose)), config, movable, patch)
    }

    /// The same around a tool of several parts; [`SkinPatch::set_other_sides`] is to follow.
    pub fn gather_tool(
        &mut self,
        surface: &SurfaceGeometry,
        positions: &[Vector3<f64>],
        (tool, pose): (&Tool, &ToolPose),
        config: &PatchConfig,
        movable: impl Fn(u32) -> bool,
        patch: &mut SkinPatch,
    ) -> PatchReport {
        self.gather_parts(surface, positions, (tool.placed(*pose), pose), config, movable, patch)
    }

    fn gather_parts<'a>(
        &mut self,
        surface: &SurfaceGeometry,
        positions: &[Vector3<f64>],
        (parts, pose): (impl Iterator<Item = PlacedPart<'a>> + Clone, &ToolPose),
        config: &PatchConfig,
        movable: impl Fn(u32) -> bool,
        patch: &mut SkinPatch,
    ) -> PatchReport {
        patch.clear();
        let within = config.margin + config.travel;
        let usable = is_usable(&pose.frame.translation.vector) && pose.is_finite();
        if !usable || !within.is_finite() {
            return PatchReport::default();
        }
        patch.side = config.side;
        self.near.clear();
        let none = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let boxes = parts.clone().map(|part| part.shape.bounding_box(&part.pose));
        let (low, high) = boxes.fold(none, |all, own| (all.0.inf(&own.0), all.1.sup(&own.1)));
        let range = Vector3::repeat(within + config.travel);
        let near = &mut self.near;
        surface.query(&Aabb { low: low - range, high: high + range }, |t| {
            let Some(corners) = surface.corners(t, positions) else { return };
            let distances = parts.clone().map(|part| distance(part.shape, &part.pose, &corners));
            let distance = distances.fold(f64::INFINITY, f64::min);
            if distance <= within && near.len() < near.capacity() {
                near.push(Near { distance, triangle: t });
            }
        });
        near.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.triangle.cmp(&b.triangle)));
        let left_out = self.take_nearest(surface, patch);
        // Nearest skin that the patch lacks, less the gap from which it would count.
        patch.clearance =
            left_out.map_or(config.travel, |distance| (distance - config.margin).clamp(0.0, config.travel));
        self.number(surface, &movable, patch);
        let (nodes, triangles) = (patch.names.len(), patch.triangles.len());
        PatchReport { nodes, triangles, left_out: self.near.len() - triangles }
    }

    /// Triangles in order of distance while their nodes fit, by their names; the distance of the first that did not.
    fn take_nearest(&mut self, surface: &SurfaceGeometry, patch: &mut SkinPatch) -> Option<f64> {
        let mut nearest_left_out = None;
        for near in &self.near {
            let Some(nodes) = surface.triangles().get(near.triangle as usize) else { continue };
            let new = nodes.iter().filter(|&&n| !self.taken[n as usize]).count();
            let full = patch.triangles.len() == 2 * patch.max_nodes;
            if full || patch.names.len() + new > patch.max_nodes {
                nearest_left_out.get_or_insert(near.distance);
                continue;
            }
            for &n in nodes.iter() {
                if !std::mem::replace(&mut self.taken[n as usize], true) {
                    patch.names.push(n);
                }
            }
            patch.triangles.push(*nodes);
            patch.triangle_names.push(near.triangle);
        }
        patch.names.iter().for_each(|&n| self.taken[n as usize] = false);
        nearest_left_out
    }

    /// From names to numbers within the patch: nodes, their normals, triangles, edges.
    fn number(&mut self, surface: &SurfaceGeometry, movable: impl Fn(u32) -> bool, patch: &mut SkinPatch) {
        patch.names.sort_unstable_by_key(|&n| (!movable(n), n));
        patch.movable = patch.names.iter().filter(|&&n| movable(n)).count();
        patch.normals.extend(patch.names.iter().map(|&n| surface.vertex_normal(n)));
        self.edges.clear();
        for k in 0..patch.triangles.len() {
            let named = patch.triangles[k];
            let numbered = named.map(|n| patch.number_of(n).unwrap_or(0) as u32);
            let names = surface.triangle_edges()[patch.triangle_names[k] as usize];
            patch.triangles[k] = numbered;
            patch.edge_names_of.push(names);
            for name in names {
                // Ends in the order of the whole surface, so that weights mean the same.
                let ends = surface.edges()[name as usize].map(|n| patch.number_of(n).unwrap_or(0) as u32);
                self.edges.push((name, ends));
            }
        }
        self.edges.sort_unstable();
        self.edges.dedup();
        for &(name, ends) in self.edges.iter().take(3 * patch.max_nodes) {
            patch.edges.push(ends);
            patch.edge_names.push(name);
        }
    }
}

/// Distance \[m\] of a triangle to the tool, negative inside it: that of the point of the triangle nearest to the tool's
/// axis or centre, or of a corner.
fn distance(tool: &ToolShape, pose: &Isometry3<f64>, corners: &[Vector3<f64>; 3]) -> f64 {
    let nearest = match tool.axis(pose) {
        Some([p, q]) if p != q => closest_to_segment(&p, &q, corners),
        _ => closest_on_triangle(&tool.bounding_sphere(pose).0, corners),
    };
    let points = corners.iter().copied().chain([nearest.position(corners)]);
    points.map(|x| tool.signed_distance(pose, &x).distance).fold(f64::INFINITY, f64::min)
}
