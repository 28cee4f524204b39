//! Shapes of bodies that are not soft: half-spaces, convex shapes and closed triangle meshes. Lengths in m.
//!
//! A solid is a signed distance and, where it is bounded, a skeleton: points and segments that, thickened by a radius,
//! touch other shapes first. Two solids meet where the skeleton of one comes near the other
//! ([`solid_contact`](crate::solid_contact)); tissue meets a solid at its nodes
//! ([`solid_detection`](crate::solid_detection)).

use nalgebra::{Isometry3, Vector3};
use thiserror::Error;

use crate::broad_phase::SurfaceError;
use crate::shape::{ShapeError, ToolPoint, ToolShape};
use crate::solid_mesh::SolidMesh;
use crate::tree::Aabb;

/// A shape that cannot be a solid.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SolidError {
    /// A normal without a direction.
    #[error(
        "plane: the normal {0:?} has no direction; give the vector that points out of the solid, such as [0, 0, 1]"
    )]
    Normal([f64; 3]),
    /// A side that is not positive and finite.
    #[error("box: the size {0:?} m must be positive along each axis")]
    Size([f64; 3]),
    /// A convex shape with a bad number.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// Triangles that are no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

/// The shape of a fixed or rigid body in the body's own frame. Description.
#[derive(Clone, Debug)]
pub enum Solid {
    /// Everything on the inner side of the plane through the origin with this outward unit normal.
    HalfSpace(Vector3<f64>),
    /// Sphere, capsule, box or another convex hull.
    Convex(ToolShape),
    /// The inside of a closed surface.
    Mesh(Box<SolidMesh>),
}

impl From<ToolShape> for Solid {
    fn from(shape: ToolShape) -> Self {
        Self::Convex(shape)
    }
}

impl Solid {
    /// The half-space below the plane through the origin with this outward normal (of any length).
    ///
    /// # Errors
    /// [`SolidError::Normal`]
    pub fn half_space(normal: Vector3<f64>) -> Result<Self, SolidError> {
        match normal.try_normalize(f64::MIN_POSITIVE).filter(|n| n.iter().all(|x| x.is_finite())) {
            Some(unit) => Ok(Self::HalfSpace(unit)),
            None => Err(SolidError::Normal(normal.into())),
        }
    }

    /// A box about the origin with these sides \[m\].
    ///
    /// # Errors
    /// [`SolidError::Size`]
    pub fn cuboid(size: Vector3<f64>) -> Result<Self, SolidError> {
        if !size.iter().all(|s| *s > 0.0 && s.is_finite()) {
            return Err(SolidError::Size(size.into()));
        }
        Ok(Self::Convex(ToolShape::cuboid(size)?))
    }

    /// The inside of a closed surface with outward counter-clockwise triangles.
    ///
    /// # Errors
    /// [`SolidError::Surface`]
    pub fn mesh(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, SolidError> {
        Ok(Self::Mesh(Box::new(SolidMesh::new(vertices, triangles)?)))
    }

    /// Nearest point of the solid's surface to `point`, all in the world frame \[m\]; distance negative inside.
    pub fn signed_distance(&self, pose: &Isometry3<f64>, point: &Vector3<f64>) -> ToolPoint {
        match self {
            Self::HalfSpace(normal) => {
                let normal = pose.rotation * normal;
                let distance = (point - pose.translation.vector).dot(&normal);
                ToolPoint { distance, point: point - normal * distance, normal }
            }
            Self::Convex(shape) => shape.signed_distance(pose, point),
            Self::Mesh(mesh) => {
                let local = pose.inverse_transform_point(&(*point).into()).coords;
                let near = mesh.signed_distance(&local);
                let surface = pose.transform_point(&near.point.into()).coords;
                ToolPoint { distance: near.distance, point: surface, normal: pose.rotation * near.normal }
            }
        }
    }

    /// The box along the world's axes that holds the solid \[m\]; none for a half-space.
    pub fn bounding_box(&self, pose: &Isometry3<f64>) -> Option<Aabb> {
        match self {
            Self::HalfSpace(_) => None,
            Self::Convex(shape) => {
                let (low, high) = shape.bounding_box(pose);
                Some(Aabb { low, high })
            }
            Self::Mesh(mesh) => {
                let mut bounds = Aabb::empty();
                for k in 0..8 {
                    let corner =
                        Vector3::from_fn(
                            |c, _| if k >> c & 1 == 0 { mesh.bounds().low[c] } else { mesh.bounds().high[c] },
                        );
                    bounds.include(&pose.transform_point(&corner.into()).coords);
                }
                Some(bounds)
            }
        }
    }

    /// Length of the body: the radius of a ball that holds it \[m\]; infinite for a half-space.
    pub fn outer_radius(&self) -> f64 {
        match self {
            Self::HalfSpace(_) => f64::INFINITY,
            Self::Convex(shape) => shape.bounding_sphere(&Isometry3::identity()).1,
            Self::Mesh(mesh) => 0.5 * (mesh.bounds().high - mesh.bounds().low).norm(),
        }
    }
}
