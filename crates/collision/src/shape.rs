//! Tool shapes: sphere, capsule, convex hull. Lengths in m, in the tool's own frame.
//!
//! A tool has no mass and no degrees of freedom: its pose comes from the device. Every query takes the pose that maps
//! the tool's frame to the world.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::hull::ConvexHull;

mod error;
mod written;

pub use error::ShapeError;
pub(crate) use written::ShapeConfig;

/// The nearest point of a tool's surface to a point of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPoint {
    /// Signed distance \[m\], negative inside the tool.
    pub distance: f64,
    /// The nearest point of the tool's surface \[m\].
    pub point: Vector3<f64>,
    /// The tool's outward unit normal there; zero where no direction is nearest (centre of a sphere, axis of a
    /// capsule), and then `point` is the query itself.
    pub normal: Vector3<f64>,
}

/// Where a point lies relative to the outline of a tool, seen along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Signed distance \[m\]: negative where the line through the point along the direction meets the tool. For a hull
    /// outside its outline, the distance to the line through the nearest edge.
    pub distance: f64,
    /// Outward unit normal of the outline, across the direction; zero in the middle of a round outline.
    pub normal: Vector3<f64>,
}

/// A ball inside a tool; balls of [`ToolShape::probes`] tell where a tool lies relative to the skin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Centre \[m\].
    pub centre: Vector3<f64>,
    /// Radius \[m\]; 0 for a corner of a hull.
    pub radius: f64,
}

/// The shape of a tool. Description; valid by construction, also when read from a file.
///
/// Serialised as `{ kind = "sphere", radius = 0.005 }`, `{ kind = "capsule", half_length = 0.02, radius = 0.003 }`,
/// `{ kind = "box", size = [x, y, z] }` (about the origin) or `{ kind = "convex", vertices = [[x, y, z], ...] }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ShapeConfig", into = "ShapeConfig")]
pub struct ToolShape {
    geometry: Geometry,
}

#[derive(Clone, Debug, PartialEq)]
enum Geometry {
    Sphere { radius: f64 },
    Capsule { half_length: f64, radius: f64 },
    Convex(Box<ConvexHull>),
}

fn positive(what: &'static str, value: f64) -> Result<f64, ShapeError> {
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(ShapeError::Length { what, value, bound: "positive" })
    }
}

impl ToolShape {
    /// A ball about the origin of the tool's frame.
    ///
    /// # Errors
    /// [`ShapeError::Length`] where `radius` \[m\] is not positive.
    pub fn sphere(radius: f64) -> Result<Self, ShapeError> {
        Ok(Self { geometry: Geometry::Sphere { radius: positive("radius", radius)? } })
    }

    /// All points within `radius` of the segment from `-half_length` to `half_length` on the z axis.
    ///
    /// # Errors
    /// [`ShapeError::Length`] where `radius` is not positive or `half_length` is negative \[m\].
    pub fn capsule(half_length: f64, radius: f64) -> Result<Self, ShapeError> {
        if !(half_length >= 0.0 && half_length.is_finite()) {
            return Err(ShapeError::Length { what: "half_length", value: half_length, bound: "at least zero" });
        }
        Ok(Self { geometry: Geometry::Capsule { half_length, radius: positive("radius", radius)? } })
    }

    /// The convex hull of `vertices` \[m\].
    ///
    /// # Errors
    /// [`ShapeError::Hull`] where they span no volume; [`ShapeError::NotFinite`].
    pub fn convex(vertices: &[Vector3<f64>]) -> Result<Self, ShapeError> {
        Ok(Self { geometry: Geometry::Convex(Box::new(ConvexHull::new(vertices)?)) })
    }

    /// A box about the origin with these sides \[m\]: the hull of its corners.
    ///
    /// # Errors
    /// [`ShapeError::Length`] where a side is not positive.
    pub fn cuboid(size: Vector3<f64>) -> Result<Self, ShapeError> {
        for (what, side) in ["size along x", "size along y", "size along z"].into_iter().zip(&size) {
            positive(what, *side)?;
        }
        let corner = |k: u32| Vector3::from_fn(|c, _| if k >> c & 1 == 0 { -0.5 } else { 0.5 } * size[c]);
        Self::convex(&(0..8).map(corner).collect::<Vec<_>>())
    }

    /// The hull, if the shape is one.
    pub fn hull(&self) -> Option<&ConvexHull> {
        match &self.geometry {
            Geometry::Convex(hull) => Some(hull),
            _ => None,
        }
    }

    /// Ends of the axis of a sphere (the centre, twice) or capsule in the world frame \[m\]; none for a hull.
    pub fn axis(&self, pose: &Isometry3<f64>) -> Option<[Vector3<f64>; 2]> {
        match &self.geometry {
            Geometry::Sphere { .. } => Some([pose.translation.vector; 2]),
            Geometry::Capsule { half_length, .. } => {
                let half = pose.rotation * Vector3::z() * *half_length;
                Some([pose.translation.vector - half, pose.translation.vector + half])
            }
            Geometry::Convex(_) => None,
        }
    }

    /// Nearest point of the tool to `point`, all in the world frame \[m\].
    #[inline]
    pub fn signed_distance(&self, pose: &Isometry3<f64>, point: &Vector3<f64>) -> ToolPoint {
        match &self.geometry {
            // A ball is the same however it is turned.
            Geometry::Sphere { radius } => from_core(point, pose.translation.vector, *radius),
            Geometry::Capsule { .. } | Geometry::Convex(_) => self.distance_when_turned(pose, point),
        }
    }

    fn distance_when_turned(&self, pose: &Isometry3<f64>, point: &Vector3<f64>) -> ToolPoint {
        let local = pose.inverse_transform_point(&Point3::from(*point)).coords;
        let near = match &self.geometry {
            Geometry::Sphere { radius } => from_core(&local, Vector3::zeros(), *radius),
            Geometry::Capsule { half_length, radius } => {
                from_core(&local, Vector3::new(0.0, 0.0, local.z.clamp(-half_length, *half_length)), *radius)
            }
            Geometry::Convex(hull) => hull.signed_distance(&local),
        };
        ToolPoint {
            distance: near.distance,
            point: pose.transform_point(&Point3::from(near.point)).coords,
            normal: pose.rotation * near.normal,
        }
    }

    /// The tool's point that lies farthest along `direction` (unit vector, world frame) \[m\].
    pub fn support(&self, pose: &Isometry3<f64>, direction: &Vector3<f64>) -> Vector3<f64> {
        let local = pose.rotation.inverse_transform_vector(direction);
        let point = match &self.geometry {
            Geometry::Sphere { radius } => local * *radius,
            Geometry::Capsule { half_length, radius } => {
                Vector3::new(0.0, 0.0, half_length.copysign(local.z)) + local * *radius
            }
            Geometry::Convex(hull) => hull.support(&local),
        };
        pose.transform_point(&Point3::from(point)).coords
    }

    /// The point of the tool's core that belongs to `point` (world frame, m): the nearest of the axis of a sphere or
    /// capsule, the centre of a hull.
    pub fn core(&self, pose: &Isometry3<f64>, point: &Vector3<f64>) -> Vector3<f64> {
        let core = match &self.geometry {
            Geometry::Sphere { .. } => Vector3::zeros(),
            Geometry::Capsule { half_length, .. } => {
                let z = pose.inverse_transform_point(&Point3::from(*point)).z;
                Vector3::new(0.0, 0.0, z.clamp(-half_length, *half_length))
            }
            Geometry::Convex(hull) => hull.centre(),
        };
        pose.transform_point(&Point3::from(core)).coords
    }

    /// The tool's outline seen along the unit `direction`, from `point` (world frame, m).
    pub fn outline(&self, pose: &Isometry3<f64>, point: &Vector3<f64>, direction: &Vector3<f64>) -> Outline {
        let local = pose.inverse_transform_point(&Point3::from(*point)).coords;
        let along = pose.rotation.inverse_transform_vector(direction);
        let flat = |v: Vector3<f64>| v - along * along.dot(&v);
        let about = |away: Vector3<f64>, radius: f64| Outline {
            distance: away.norm() - radius,
            normal: away.try_normalize(1e-9 * radius).unwrap_or_else(Vector3::zeros),
        };
        let outline = match &self.geometry {
            Geometry::Sphere { radius } => about(flat(local), *radius),
            Geometry::Capsule { half_length, radius } => {
                let (x, axis) = (flat(local), flat(Vector3::z()));
                let length = axis.norm_squared();
                let t = if length > 0.0 { (x.dot(&axis) / length).clamp(-half_length, *half_length) } else { 0.0 };
                about(x - axis * t, *radius)
            }
            Geometry::Convex(hull) => hull.outline(&local, &along),
        };
        Outline { distance: outline.distance, normal: pose.rotation * outline.normal }
    }

    /// Calls `visit` with the directions (unit vectors, world frame) in which a point deep inside the tool may leave it
    /// besides the nearest: across the axis of a capsule towards `-skin`; through each face of a hull.
    pub fn exits(&self, pose: &Isometry3<f64>, skin: &Vector3<f64>, mut visit: impl FnMut(Vector3<f64>)) {
        match &self.geometry {
            Geometry::Sphere { .. } => {}
            Geometry::Capsule { .. } => {
                let axis = pose.rotation * Vector3::z();
                if let Some(across) = (axis * axis.dot(skin) - skin).try_normalize(1e-9) {
                    visit(across);
                }
            }
            Geometry::Convex(hull) => hull.face_normals().iter().for_each(|n| visit(pose.rotation * n)),
        }
    }

    /// Radius of a ball inside the tool \[m\]: the depth up to which the nearest way out can be trusted.
    pub fn inner_radius(&self) -> f64 {
        match &self.geometry {
            Geometry::Sphere { radius } | Geometry::Capsule { radius, .. } => *radius,
            Geometry::Convex(hull) => hull.inner_radius(),
        }
    }

    /// Centre and radius of a ball that holds the tool, in the world frame \[m\].
    pub fn bounding_sphere(&self, pose: &Isometry3<f64>) -> (Vector3<f64>, f64) {
        match &self.geometry {
            Geometry::Sphere { radius } => (pose.translation.vector, *radius),
            Geometry::Capsule { half_length, radius } => (pose.translation.vector, half_length + radius),
            Geometry::Convex(hull) => (pose.transform_point(&Point3::from(hull.centre())).coords, hull.outer_radius()),
        }
    }

    /// Lower and upper corner of the box along the world's axes that holds the tool \[m\].
    pub fn bounding_box(&self, pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for k in 0..3 {
            let direction = Vector3::ith(k, 1.0);
            high[k] = self.support(pose, &direction)[k];
            low[k] = self.support(pose, &-direction)[k];
        }
        (low, high)
    }

    /// Balls inside the tool whose places tell on which side of the skin the tool lies, in the world frame:
    /// the centre of a sphere; centre and ends of a capsule; centre and extreme corners of a hull.
    pub fn probes<'a>(&'a self, pose: &'a Isometry3<f64>) -> impl Iterator<Item = Probe> + 'a {
        let world = |v: Vector3<f64>| pose.transform_point(&Point3::from(v)).coords;
        let (first, ends, corners) = match &self.geometry {
            Geometry::Sphere { radius } => (Probe { centre: Vector3::zeros(), radius: *radius }, None, None),
            Geometry::Capsule { half_length, radius } => {
                let end = |z| Probe { centre: Vector3::new(0.0, 0.0, z), radius: *radius };
                (end(0.0), Some([end(-half_length), end(*half_length)]), None)
            }
            Geometry::Convex(hull) => {
                (Probe { centre: hull.centre(), radius: hull.inner_radius() }, None, Some(hull.extremes()))
            }
        };
        std::iter::once(first)
            .chain(ends.into_iter().flatten())
            .chain(corners.into_iter().flatten().map(|centre| Probe { centre, radius: 0.0 }))
            .map(move |probe| Probe { centre: world(probe.centre), ..probe })
    }
}

/// Distance to a ball of `radius` about the nearest point `core` of an axis.
#[inline]
fn from_core(x: &Vector3<f64>, core: Vector3<f64>, radius: f64) -> ToolPoint {
    let away = x - core;
    let distance = away.norm();
    // Closer to the axis than rounding lets a direction be known.
    if distance <= 1e-12 * radius {
        return ToolPoint { distance: -radius, point: *x, normal: Vector3::zeros() };
    }
    let normal = away / distance;
    ToolPoint { distance: distance - radius, point: core + normal * radius, normal }
}
