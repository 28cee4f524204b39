//! Measures of a stuffed mesh: volumes, boundary area, dihedral angles.

use nalgebra::Vector3;

use super::body::{FACES, boundary};

/// Size and shape of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StuffingQuality {
    /// Sum of the tetrahedra (m³).
    pub volume: f64,
    /// Smallest volume of a tetrahedron (m³); negative if one is inverted.
    pub smallest_volume: f64,
    /// Area of the boundary (m²).
    pub boundary_area: f64,
    /// Smallest dihedral angle (rad).
    pub smallest_dihedral: f64,
    /// Largest dihedral angle (rad).
    pub largest_dihedral: f64,
    /// Shortest edge (m).
    pub shortest_edge: f64,
    /// Longest edge (m).
    pub longest_edge: f64,
}

impl StuffingQuality {
    /// Measures a mesh of tetrahedra over nodes (m).
    pub fn of(nodes: &[Vector3<f64>], tetrahedra: &[[u32; 4]]) -> Self {
        let mut quality = Self {
            volume: 0.0,
            smallest_volume: f64::INFINITY,
            boundary_area: 0.0,
            smallest_dihedral: std::f64::consts::PI,
            largest_dihedral: 0.0,
            shortest_edge: f64::INFINITY,
            longest_edge: 0.0,
        };
        for tetrahedron in tetrahedra {
            let corners = tetrahedron.map(|n| nodes[n as usize]);
            let volume = volume(&corners);
            quality.volume += volume;
            quality.smallest_volume = quality.smallest_volume.min(volume);
            for angle in dihedrals(&corners) {
                quality.smallest_dihedral = quality.smallest_dihedral.min(angle);
                quality.largest_dihedral = quality.largest_dihedral.max(angle);
            }
            for (i, j) in PAIRS {
                let length = (corners[i] - corners[j]).norm();
                quality.shortest_edge = quality.shortest_edge.min(length);
                quality.longest_edge = quality.longest_edge.max(length);
            }
        }
        for triangle in boundary(tetrahedra) {
            let [p, q, r] = triangle.map(|n| nodes[n as usize]);
            quality.boundary_area += 0.5 * (q - p).cross(&(r - p)).norm();
        }
        quality
    }
}

const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// Signed volume (m³).
pub(super) fn volume([p, q, r, s]: &[Vector3<f64>; 4]) -> f64 {
    (q - p).cross(&(r - p)).dot(&(s - p)) / 6.0
}

/// Inner angles between the faces at the six edges (rad).
fn dihedrals(corners: &[Vector3<f64>; 4]) -> [f64; 6] {
    let normals = FACES.map(|f| {
        let [p, q, r] = f.map(|c| corners[c]);
        (q - p).cross(&(r - p))
    });
    // Faces i and j (opposite corners i and j) meet at the edge of the other two corners.
    PAIRS.map(|(i, j)| {
        let sine = normals[i].cross(&normals[j]).norm();
        std::f64::consts::PI - sine.atan2(normals[i].dot(&normals[j]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lattice_tetrahedron_has_dihedral_angles_of_60_and_90_degrees() {
        let nodes = [[0., 0., 0.], [2., 0., 0.], [1., -1., -1.], [1., 1., -1.]].map(Vector3::from);
        let quality = StuffingQuality::of(&nodes, &[[0, 1, 2, 3]]);
        assert!((quality.smallest_dihedral.to_degrees() - 60.0).abs() < 1e-12);
        assert!((quality.largest_dihedral.to_degrees() - 90.0).abs() < 1e-12);
        assert!((quality.volume.abs() - 8.0 / 12.0).abs() < 1e-15);
        // Two faces on each long edge, all congruent: base 2, height √2.
        assert!((quality.boundary_area - 4.0 * 2.0f64.sqrt()).abs() < 1e-14);
    }
}
