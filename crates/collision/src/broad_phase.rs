//! The surface of a deforming body: triangles, refitted boxes, outward normals of its vertices.

use nalgebra::Vector3;
use thiserror::Error;

use crate::tree::{Aabb, TriangleTree};
use crate::triangle::closest_on_triangle;

/// Triangles that cannot be a surface.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SurfaceError {
    /// No triangle at all.
    #[error("surface: it has no triangles; contacts need the boundary of the mesh")]
    Empty,
    /// A triangle names a node that the body does not have.
    #[error("surface: triangle {triangle} uses node {node}, but the body has {nodes} nodes")]
    NodeOutOfRange {
        /// Position of the triangle.
        triangle: usize,
        /// The node it names.
        node: u32,
        /// Nodes of the body.
        nodes: usize,
    },
    /// A triangle uses a node twice.
    #[error("surface: triangle {triangle} uses node {node} twice")]
    RepeatedNode {
        /// Position of the triangle.
        triangle: usize,
        /// The repeated node.
        node: u32,
    },
    /// A coordinate that is not a number.
    #[error("surface: node {node} has a coordinate that is not finite or beyond 1e6 m")]
    NotFinite {
        /// The node.
        node: u32,
    },
}

/// The nearest point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The triangle that holds it.
    pub triangle: u32,
    /// The point \[m\].
    pub point: Vector3<f64>,
    /// Outward normal there, interpolated between the vertices; zero where they cancel.
    pub normal: Vector3<f64>,
    /// Distance \[m\], negative where the query lies on the inner side of the normal.
    pub signed_distance: f64,
}

/// A triangulated surface over the nodes of a body, outward counter-clockwise.
///
/// The triangles, edges and the shape of the tree are fixed at set-up; boxes and normals follow the positions through
/// [`refit`](Self::refit), which allocates nothing.
#[derive(Clone, Debug)]
pub struct SurfaceGeometry {
    triangles: Vec<[u32; 3]>,
    triangle_edges: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    nodes: Vec<u32>,
    /// Outward unit normal of each node of the body (zero away from the surface).
    normals: Vec<Vector3<f64>>,
    tree: TriangleTree,
    non_finite: usize,
}

impl SurfaceGeometry {
    /// A surface from triangles over the body's nodes at `positions` \[m\], refitted to them.
    ///
    /// # Errors
    /// [`SurfaceError`] names the triangle or node that is wrong.
    pub fn new(triangles: Vec<[u32; 3]>, positions: &[Vector3<f64>]) -> Result<Self, SurfaceError> {
        if triangles.is_empty() {
            return Err(SurfaceError::Empty);
        }
        for (triangle, t) in triangles.iter().enumerate() {
            for k in 0..3 {
                let node = t[k];
                let p = positions.get(node as usize).ok_or(SurfaceError::NodeOutOfRange {
                    triangle,
                    node,
                    nodes: positions.len(),
                })?;
                if node == t[(k + 1) % 3] {
                    return Err(SurfaceError::RepeatedNode { triangle, node });
                }
                if !is_usable(p) {
                    return Err(SurfaceError::NotFinite { node });
                }
            }
        }
        let ends = |t: &[u32; 3], k: usize| [t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])];
        let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|t| (0..3).map(|k| ends(t, k))).collect();
        edges.sort_unstable();
        edges.dedup();
        let number = |edge: [u32; 2]| edges.binary_search(&edge).unwrap_or(0) as u32;
        let triangle_edges = triangles.iter().map(|t| [0, 1, 2].map(|k| number(ends(t, k)))).collect();
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let centroids: Vec<_> =
            triangles.iter().map(|t| t.iter().map(|&n| positions[n as usize]).sum::<Vector3<f64>>() / 3.0).collect();
        let mut surface = Self {
            tree: TriangleTree::new(&centroids),
            triangles,
            triangle_edges,
            edges,
            nodes,
            normals: vec![Vector3::zeros(); positions.len()],
            non_finite: 0,
        };
        surface.refit(positions);
        Ok(surface)
    }

    /// Refills boxes and vertex normals from the positions of the body's nodes \[m\].
    ///
    /// The normal of a vertex is the sum of its triangles' normals weighted by area. Triangles with a coordinate that
    /// is not finite or beyond 1e6 m are left out, and their number is returned.
    pub fn refit(&mut self, positions: &[Vector3<f64>]) -> usize {
        for &node in &self.nodes {
            self.normals[node as usize] = Vector3::zeros();
        }
        self.non_finite = 0;
        for t in &self.triangles {
            let Some([a, b, c]) = finite_corners(t, positions) else {
                self.non_finite += 1;
                continue;
            };
            let normal = (b - a).cross(&(c - a));
            for &node in t {
                self.normals[node as usize] += normal;
            }
        }
        for &node in &self.nodes {
            let normal = &mut self.normals[node as usize];
            *normal = normal.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::zeros);
        }
        let triangles = &self.triangles;
        self.tree.refit(|t| {
            let mut bounds = Aabb::empty();
            if let Some(corners) = finite_corners(&triangles[t as usize], positions) {
                corners.iter().for_each(|p| bounds.include(p));
            }
            bounds
        });
        self.non_finite
    }

    /// Triangles over the body's nodes.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Edges by their nodes, each once, ascending.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Positions in [`edges`](Self::edges) of the three edges of each triangle; edge `k` joins nodes `k` and `k + 1`.
    pub fn triangle_edges(&self) -> &[[u32; 3]] {
        &self.triangle_edges
    }

    /// Nodes of the body on the surface, ascending.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Number of nodes of the body.
    pub fn body_nodes(&self) -> usize {
        self.normals.len()
    }

    /// Outward unit normal of a node; zero away from the surface and where no triangle around it has an area.
    pub fn vertex_normal(&self, node: u32) -> Vector3<f64> {
        self.normals.get(node as usize).copied().unwrap_or_else(Vector3::zeros)
    }

    /// Outward unit normal between the vertices of a triangle, by barycentric weights; zero where they cancel.
    pub fn normal_at(&self, triangle: u32, weights: &[f64; 3]) -> Vector3<f64> {
        let t = &self.triangles[triangle as usize];
        let sum = (0..3).map(|k| self.vertex_normal(t[k]) * weights[k]).sum::<Vector3<f64>>();
        sum.try_normalize(1e-9).unwrap_or_else(Vector3::zeros)
    }

    /// Triangles that were left out of the latest refit because a coordinate was not finite.
    pub fn non_finite(&self) -> usize {
        self.non_finite
    }

    /// Corners of a triangle \[m\]; none where one is not finite.
    pub fn corners(&self, triangle: u32, positions: &[Vector3<f64>]) -> Option<[Vector3<f64>; 3]> {
        finite_corners(self.triangles.get(triangle as usize)?, positions)
    }

    /// Triangles whose boxes may meet the box, always in the same order.
    pub fn query(&self, bounds: &Aabb, visit: impl FnMut(u32)) {
        self.tree.query(bounds, visit);
    }

    /// The nearest point of the surface; none where no triangle is finite.
    ///
    /// The sign comes from the interpolated vertex normal: right near a surface whose triangles are small against its
    /// curvature. [`contains`](Self::contains) is right everywhere and dearer.
    pub fn nearest(&self, point: &Vector3<f64>, positions: &[Vector3<f64>]) -> Option<SurfacePoint> {
        let on = |t: u32| {
            let corners = self.corners(t, positions)?;
            let closest = closest_on_triangle(point, &corners);
            Some((closest.position(&corners), closest.weights))
        };
        let (triangle, square) =
            self.tree.nearest(point, |t| on(t).map_or(f64::INFINITY, |(x, _)| (x - point).norm_squared()))?;
        let (x, weights) = on(triangle)?;
        let normal = self.normal_at(triangle, &weights);
        let signed_distance = if (point - x).dot(&normal) < 0.0 { -square.sqrt() } else { square.sqrt() };
        Some(SurfacePoint { triangle, point: x, normal, signed_distance })
    }

    /// The triangle with the least `distance_squared` \[m²\] to `point`, among those whose boxes can hold it; none where
    /// no triangle is finite.
    pub fn nearest_triangle(
        &self,
        point: &Vector3<f64>,
        distance_squared: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        self.tree.nearest(point, distance_squared)
    }

    /// True where a point lies inside the surface: its winding number exceeds one half.
    ///
    /// Visits every triangle (solid angle after Van Oosterom and Strackee 1983), so it is for set-up and rare events;
    /// small holes in the surface do not change the answer.
    pub fn contains(&self, point: &Vector3<f64>, positions: &[Vector3<f64>]) -> bool {
        let mut angle = 0.0;
        for t in &self.triangles {
            let Some(corners) = finite_corners(t, positions) else { continue };
            let [a, b, c] = corners.map(|p| p - point);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            angle += 2.0 * a.dot(&b.cross(&c)).atan2(below);
        }
        angle > 2.0 * std::f64::consts::PI
    }
}

/// Coordinates beyond this \[m\] are taken for not finite: the body has diverged, and products of them may overflow.
const FARTHEST: f64 = 1e6;

fn finite_corners(t: &[u32; 3], positions: &[Vector3<f64>]) -> Option<[Vector3<f64>; 3]> {
    let at = |k: usize| positions.get(t[k] as usize).copied().filter(is_usable);
    Some([at(0)?, at(1)?, at(2)?])
}

/// Finite, and not so far that squares overflow.
pub(crate) fn is_usable(p: &Vector3<f64>) -> bool {
    p.iter().all(|x| x.abs() <= FARTHEST)
}
