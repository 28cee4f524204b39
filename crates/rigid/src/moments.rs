//! Volume, centroid and inertia of evenly filled shapes.

use nalgebra::{Matrix3, Vector3};

/// Moments of a solid of unit density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Volume (m³).
    pub volume: f64,
    /// Centroid in the frame of the shape (m).
    pub centroid: Vector3<f64>,
    /// Inertia about the centroid along the axes of the shape, for a density of 1 kg/m³ (kg m²).
    pub inertia: Matrix3<f64>,
}

impl Moments {
    /// A ball about the origin.
    pub fn of_sphere(radius: f64) -> Self {
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let inertia = Matrix3::identity() * (0.4 * volume * radius * radius);
        Self { volume, centroid: Vector3::zeros(), inertia }
    }

    /// A cylinder of length `2 half_length` on the z axis with half balls on its ends, about the origin.
    pub fn of_capsule(half_length: f64, radius: f64) -> Self {
        let (r, l) = (radius, 2.0 * half_length);
        let cylinder = std::f64::consts::PI * r * r * l;
        let balls = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        let along = 0.5 * cylinder * r * r + 0.4 * balls * r * r;
        // The half balls' own centroids lie 3 r / 8 beyond the ends of the cylinder.
        let across = cylinder * (0.25 * r * r + l * l / 12.0) + balls * (0.4 * r * r + 0.25 * l * l + 0.375 * l * r);
        let inertia = Matrix3::from_diagonal(&Vector3::new(across, across, along));
        Self { volume: cylinder + balls, centroid: Vector3::zeros(), inertia }
    }

    /// The inside of a closed surface with outward counter-clockwise triangles: sums over the tetrahedra that they span
    /// with one point, positive and negative ones. `∫ x xᵀ dV = V/20 (s sᵀ + a aᵀ + b bᵀ + c cᵀ)` with `s = a + b + c`.
    ///
    /// Triangles that name no vertex count nothing.
    pub fn of_surface(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Self {
        // About a point of the surface, so that a solid far from its origin loses no digits.
        let origin = vertices.first().copied().unwrap_or_else(Vector3::zeros);
        let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for t in triangles {
            let [Some(a), Some(b), Some(c)] = t.map(|v| vertices.get(v as usize).map(|x| x - origin)) else { continue };
            let v = a.dot(&b.cross(&c)) / 6.0;
            let s = a + b + c;
            volume += v;
            first += s * (0.25 * v);
            second += (s * s.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (v / 20.0);
        }
        let centroid = if volume > 0.0 { first / volume } else { Vector3::zeros() };
        let about_centroid = second - centroid * centroid.transpose() * volume;
        let inertia = Matrix3::identity() * about_centroid.trace() - about_centroid;
        Self { volume, centroid: centroid + origin, inertia }
    }
}
