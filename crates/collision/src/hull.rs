//! Convex hulls: faces, edges and exact distance queries in the hull's own frame.
//!
//! The hull itself comes from parry. The queries are ours, because parry answers a point inside a hull by EPA, which
//! allocates and stops at a tolerance, while a hull of a tool has so few faces that looking at all of them is exact,
//! allocates nothing, and costs about a microsecond.

use nalgebra::Vector3;

use crate::contact::MAX_TOOL_FEATURES;
use crate::convert;
use crate::shape::{Outline, ShapeError, ToolPoint};
use crate::triangle::closest_on_triangle;

/// Edges between faces whose normals differ by less than this angle \[rad\] lie in one face of the solid.
const COPLANAR: f64 = 0.02;

/// An edge of a hull between two faces that meet at an angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HullEdge {
    /// Its two vertices.
    pub vertices: [u32; 2],
    /// The two faces that meet in it.
    pub faces: [u32; 2],
}

/// A convex solid with triangulated faces. A description: it never changes.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexHull {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Outward unit normal of each triangle.
    normals: Vec<Vector3<f64>>,
    /// `normal · x` on each triangle.
    offsets: Vec<f64>,
    /// Outward unit normals of the flat faces, each once.
    face_normals: Vec<Vector3<f64>>,
    edges: Vec<HullEdge>,
    neighbour_start: Vec<u32>,
    neighbours: Vec<u32>,
    centre: Vector3<f64>,
    inner_radius: f64,
    outer_radius: f64,
    extremes: [u32; 6],
}

impl ConvexHull {
    /// The hull of `points` \[m\].
    ///
    /// # Errors
    /// [`ShapeError::Hull`] where the points span no volume, and [`ShapeError::NotFinite`].
    pub fn new(points: &[Vector3<f64>]) -> Result<Self, ShapeError> {
        if let Some(index) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(ShapeError::NotFinite { what: "vertices", index });
        }
        let fail = |reason: String| ShapeError::Hull { points: points.len(), reason };
        let (vertices, triangles) = convert::convex_hull(points).map_err(fail)?;
        if triangles.len() > MAX_TOOL_FEATURES / 3 {
            return Err(fail("too many faces".into()));
        }
        let centre = vertices.iter().sum::<Vector3<f64>>() / vertices.len().max(1) as f64;
        let mut normals = Vec::with_capacity(triangles.len());
        let mut offsets = Vec::with_capacity(triangles.len());
        for t in &triangles {
            let [a, b, c] = t.map(|k| vertices[k as usize]);
            let normal = (b - a)
                .cross(&(c - a))
                .try_normalize(f64::MIN_POSITIVE)
                .ok_or_else(|| fail("a face without area".into()))?;
            offsets.push(normal.dot(&a));
            normals.push(normal);
        }
        let outer_radius = vertices.iter().map(|v| (v - centre).norm()).fold(0.0, f64::max);
        let inner_radius = normals.iter().zip(&offsets).map(|(n, d)| d - n.dot(&centre)).fold(f64::INFINITY, f64::min);
        if inner_radius.is_nan() || inner_radius <= 1e-6 * outer_radius {
            return Err(fail("the points lie in a plane".into()));
        }
        // Quickhull works to a tolerance: no input point may stand out of the solid that the distances describe.
        let outside = |p: &Vector3<f64>| normals.iter().zip(&offsets).any(|(n, d)| n.dot(p) - d > 1e-6 * outer_radius);
        if points.iter().any(outside) {
            return Err(fail("the hull does not enclose its points".into()));
        }
        let edges = edges(&triangles, &normals).ok_or_else(|| fail("the hull is not closed".into()))?;
        let mut face_normals: Vec<Vector3<f64>> = Vec::new();
        for normal in &normals {
            if face_normals.iter().all(|n| n.cross(normal).norm() > COPLANAR || n.dot(normal) < 0.0) {
                face_normals.push(*normal);
            }
        }
        let (neighbour_start, neighbours) = neighbours(vertices.len(), &triangles);
        let extremes = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()]
            .map(|direction| support_index(&vertices, &direction) as u32);
        Ok(Self {
            vertices,
            triangles,
            normals,
            offsets,
            face_normals,
            edges,
            neighbour_start,
            neighbours,
            centre,
            inner_radius,
            outer_radius,
            extremes,
        })
    }

    /// Corners \[m\].
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Triangles of the faces, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Outward unit normal of each triangle.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Outward unit normals of the flat faces, each once.
    pub fn face_normals(&self) -> &[Vector3<f64>] {
        &self.face_normals
    }

    /// Edges between faces that meet at an angle.
    pub fn edges(&self) -> &[HullEdge] {
        &self.edges
    }

    /// Vertices that share an edge with vertex `v`.
    pub fn neighbours(&self, v: usize) -> &[u32] {
        &self.neighbours[self.neighbour_start[v] as usize..self.neighbour_start[v + 1] as usize]
    }

    /// Mean of the vertices: a point inside \[m\].
    pub fn centre(&self) -> Vector3<f64> {
        self.centre
    }

    /// Radius of a ball about the centre that fits into the hull \[m\].
    pub fn inner_radius(&self) -> f64 {
        self.inner_radius
    }

    /// Radius of a ball about the centre that holds the hull \[m\].
    pub fn outer_radius(&self) -> f64 {
        self.outer_radius
    }

    /// The vertices that lie farthest along `±x`, `±y` and `±z`.
    pub fn extremes(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        self.extremes.iter().map(|&v| self.vertices[v as usize])
    }

    /// The vertex that lies farthest along `direction`; the first of several.
    pub fn support(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.vertices[support_index(&self.vertices, direction)]
    }

    /// Signed distance of `x`, negative inside: the nearest face plane inside, the nearest point of a face outside.
    pub fn signed_distance(&self, x: &Vector3<f64>) -> ToolPoint {
        let mut depth = f64::NEG_INFINITY;
        let mut face = 0;
        for (k, (normal, offset)) in self.normals.iter().zip(&self.offsets).enumerate() {
            let height = normal.dot(x) - offset;
            if height > depth {
                depth = height;
                face = k;
            }
        }
        let normal = self.normals[face];
        if depth.is_nan() || depth <= 0.0 {
            return ToolPoint { distance: depth, point: x - normal * depth, normal };
        }
        let mut point = *x;
        let mut distance = f64::INFINITY;
        for (k, triangle) in self.triangles.iter().enumerate() {
            // Faces turned away from the point, or farther than the best so far, cannot hold the closest point.
            let height = self.normals[k].dot(x) - self.offsets[k];
            if height <= 0.0 || height >= distance {
                continue;
            }
            let corners = triangle.map(|v| self.vertices[v as usize]);
            let closest = closest_on_triangle(x, &corners).position(&corners);
            let away = (x - closest).norm();
            if away < distance {
                distance = away;
                point = closest;
            }
        }
        // At rounding distance the difference of two points has no direction: the face has one.
        if distance <= 1e-9 * self.outer_radius {
            return ToolPoint { distance: depth, point: x - normal * depth, normal };
        }
        ToolPoint { distance, point, normal: (x - point) / distance }
    }

    /// The hull's outline seen along the unit `direction`, from `x`: distance (negative within it) and outward normal.
    pub fn outline(&self, x: &Vector3<f64>, direction: &Vector3<f64>) -> Outline {
        let mut nearest = Outline { distance: f64::NEG_INFINITY, normal: Vector3::zeros() };
        for edge in &self.edges {
            let [a, b] = edge.faces.map(|f| self.normals[f as usize].dot(direction));
            if a * b > 0.0 {
                continue;
            }
            let [p, q] = edge.vertices.map(|v| self.vertices[v as usize]);
            // An edge along the direction is seen as a point, which other edges of the outline hold.
            let Some(mut normal) = (q - p).cross(direction).try_normalize(1e-6 * (q - p).norm()) else { continue };
            if (self.centre - p).dot(&normal) > 0.0 {
                normal = -normal;
            }
            let distance = (x - p).dot(&normal);
            if distance > nearest.distance {
                nearest = Outline { distance, normal };
            }
        }
        nearest
    }
}

fn support_index(vertices: &[Vector3<f64>], direction: &Vector3<f64>) -> usize {
    let mut best = 0;
    let mut reach = f64::NEG_INFINITY;
    for (k, v) in vertices.iter().enumerate() {
        let along = v.dot(direction);
        if along > reach {
            reach = along;
            best = k;
        }
    }
    best
}

/// Edges of a closed triangle mesh, without those inside a flat face; none if the mesh is not closed.
fn edges(triangles: &[[u32; 3]], normals: &[Vector3<f64>]) -> Option<Vec<HullEdge>> {
    let mut half: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
    for (f, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            half.push(([a.min(b), a.max(b)], f as u32));
        }
    }
    half.sort_unstable();
    let mut edges = Vec::new();
    for pair in half.chunks(2) {
        let [(vertices, f), (other, g)] = pair else { return None };
        if vertices != other {
            return None;
        }
        let [n, m] = [normals[*f as usize], normals[*g as usize]];
        if n.cross(&m).norm() > COPLANAR {
            edges.push(HullEdge { vertices: *vertices, faces: [*f, *g] });
        }
    }
    Some(edges)
}

fn neighbours(vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut pairs: Vec<(u32, u32)> =
        triangles.iter().flat_map(|t| (0..3).flat_map(|k| [(t[k], t[(k + 1) % 3]), (t[(k + 1) % 3], t[k])])).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let mut start = vec![0u32; vertices + 1];
    for (v, _) in &pairs {
        start[*v as usize + 1] += 1;
    }
    for v in 0..vertices {
        start[v + 1] += start[v];
    }
    (start, pairs.into_iter().map(|(_, w)| w).collect())
}
