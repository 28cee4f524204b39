//! The inside of a closed surface that keeps its shape.
//!
//! The sign of the distance comes from the pseudo-normal of the feature that holds the nearest point: of a face its
//! normal, of an edge the sum of those of its two faces, of a vertex the sum of those around it weighted by the angle
//! there. With these the sign is right for every closed mesh (Baerentzen, Aanaes, Signed Distance Computation Using the
//! Angle Weighted Pseudonormal, IEEE TVCG 11(3), 2005); the area-weighted normals of a deforming skin do not have that
//! property at sharp corners.

use nalgebra::Vector3;

use crate::broad_phase::{SurfaceError, SurfaceGeometry};
use crate::contact::FeatureKind;
use crate::shape::ToolPoint;
use crate::tree::Aabb;
use crate::triangle::{TrianglePoint, closest_on_triangle};

/// A closed surface in the frame of its body \[m\]. Description.
#[derive(Clone, Debug)]
pub struct SolidMesh {
    vertices: Vec<Vector3<f64>>,
    surface: SurfaceGeometry,
    face_normals: Vec<Vector3<f64>>,
    edge_normals: Vec<Vector3<f64>>,
    vertex_normals: Vec<Vector3<f64>>,
    bounds: Aabb,
}

impl SolidMesh {
    /// From the outward counter-clockwise triangles of a closed surface.
    ///
    /// # Errors
    /// [`SurfaceError`] where they name vertices that are not there, repeat one, or a coordinate is not finite.
    pub fn new(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, SurfaceError> {
        let surface = SurfaceGeometry::new(triangles, &vertices)?;
        let mut bounds = Aabb::empty();
        vertices.iter().for_each(|v| bounds.include(v));
        let mut mesh = Self {
            face_normals: Vec::with_capacity(surface.triangles().len()),
            edge_normals: vec![Vector3::zeros(); surface.edges().len()],
            vertex_normals: vec![Vector3::zeros(); vertices.len()],
            vertices,
            surface,
            bounds,
        };
        for (t, edges) in mesh.surface.triangles().iter().zip(mesh.surface.triangle_edges()) {
            let corners = t.map(|v| mesh.vertices[v as usize]);
            let cross = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let normal = cross.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::zeros);
            mesh.face_normals.push(normal);
            for k in 0..3 {
                mesh.edge_normals[edges[k] as usize] += normal;
                let [ahead, back] = [(k + 1) % 3, (k + 2) % 3].map(|c| corners[c] - corners[k]);
                mesh.vertex_normals[t[k] as usize] += normal * ahead.angle(&back);
            }
        }
        let unit = |n: &mut Vector3<f64>| *n = n.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        mesh.edge_normals.iter_mut().chain(&mut mesh.vertex_normals).for_each(unit);
        Ok(mesh)
    }

    /// Vertices \[m\].
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Triangles, outward counter-clockwise.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.surface.triangles()
    }

    /// The box that holds it.
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// The nearest point of the surface to `x`, in the mesh's own frame. Its normal is the direction from it to `x`
    /// outside and the opposite inside, and the pseudo-normal on the surface itself.
    pub fn signed_distance(&self, x: &Vector3<f64>) -> ToolPoint {
        let corners = |t: u32| self.surface.triangles().get(t as usize).map(|t| t.map(|v| self.vertices[v as usize]));
        let square = |t: u32| {
            let near =
                corners(t).map(|corners| (closest_on_triangle(x, &corners).position(&corners) - x).norm_squared());
            near.unwrap_or(f64::INFINITY)
        };
        let nowhere = ToolPoint { distance: f64::INFINITY, point: *x, normal: Vector3::zeros() };
        let Some((t, _)) = self.surface.nearest_triangle(x, square) else { return nowhere };
        let Some(corners) = corners(t) else { return nowhere };
        let near = closest_on_triangle(x, &corners);
        let pseudo = self.pseudo_normal(t, &near);
        let point = near.position(&corners);
        let away = x - point;
        let sign = if away.dot(&pseudo) < 0.0 { -1.0 } else { 1.0 };
        // At rounding distance the difference of two points has no direction.
        let far = 1e-12 * (self.bounds.high - self.bounds.low).norm();
        let normal = away.try_normalize(far).map_or(pseudo, |n| n * sign);
        ToolPoint { distance: sign * away.norm(), point, normal }
    }

    fn pseudo_normal(&self, triangle: u32, near: &TrianglePoint) -> Vector3<f64> {
        let t = triangle as usize;
        match near.kind {
            FeatureKind::Triangle => self.face_normals[t],
            FeatureKind::Edge => self.edge_normals[self.surface.triangle_edges()[t][near.local] as usize],
            FeatureKind::Vertex => self.vertex_normals[self.surface.triangles()[t][near.local] as usize],
        }
    }
}
