//! Conversion between nalgebra and parry's types. The only file of the project that names parry.

use nalgebra::Vector3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

/// A point for parry.
pub fn to_parry(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// A point from parry.
pub fn from_parry(v: &Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// Vertices and outward (counter-clockwise) triangles of the convex hull of `points` by parry's quickhull.
///
/// # Errors
/// Parry's message where the points are too few, not finite, or lie in a plane.
pub(crate) fn convex_hull(points: &[Vector3<f64>]) -> Result<HullMesh, String> {
    let points: Vec<Vector> = points.iter().map(to_parry).collect();
    let (vertices, triangles) = try_convex_hull(&points).map_err(|error| error.to_string())?;
    Ok((vertices.iter().map(from_parry).collect(), triangles))
}

/// Vertices and triangles.
pub(crate) type HullMesh = (Vec<Vector3<f64>>, Vec<[u32; 3]>);
