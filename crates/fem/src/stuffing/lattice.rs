//! The body-centred cubic lattice and its tetrahedra.
//!
//! Vertices have integer coordinates in units of half the lattice constant `a`: the corners of the cubes are all
//! even, their centres all odd. Long edges (length a) join like vertices, short ones (√3/2 a) join a corner and a
//! centre. Each tetrahedron has two opposite long edges, at right angles to each other, and four short ones, and the
//! volume a³/12; a cube holds two vertices and twelve tetrahedra.

use nalgebra::Vector3;

/// Fourteen neighbours: six along long edges, then eight along short ones.
pub(super) const NEIGHBOURS: [[i32; 3]; 14] = [
    [-2, 0, 0],
    [2, 0, 0],
    [0, -2, 0],
    [0, 2, 0],
    [0, 0, -2],
    [0, 0, 2],
    [-1, -1, -1],
    [1, -1, -1],
    [-1, 1, -1],
    [1, 1, -1],
    [-1, -1, 1],
    [1, -1, 1],
    [-1, 1, 1],
    [1, 1, 1],
];

/// A block of lattice cubes around a body.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// Cubes along each axis.
    cubes: [i32; 3],
    corner_count: u32,
    constant: f64,
    origin: Vector3<f64>,
}

impl Lattice {
    /// Number of vertices of the lattice that `around` would make, as a float that cannot overflow.
    pub(super) fn vertex_estimate([low, high]: [Vector3<f64>; 2], constant: f64) -> f64 {
        (high - low).iter().map(|s| (s / constant).ceil() + 4.0).product::<f64>() * 2.0
    }

    /// Lattice of constant `a` around a box, with one and a half cubes to spare on each side.
    pub(super) fn around([low, high]: [Vector3<f64>; 2], constant: f64) -> Self {
        let cubes = [0, 1, 2].map(|i| ((high[i] - low[i]) / constant).ceil() as i32 + 3);
        let middle = 0.5 * (low + high);
        let origin = Vector3::from_fn(|i, _| middle[i] - 0.5 * f64::from(cubes[i]) * constant);
        let corner_count = cubes.iter().map(|&n| n as u32 + 1).product();
        Self { cubes, corner_count, constant, origin }
    }

    pub(super) fn vertex_count(&self) -> u32 {
        self.corner_count + self.cubes.iter().map(|&n| n as u32).product::<u32>()
    }

    pub(super) fn constant(&self) -> f64 {
        self.constant
    }

    /// Integer coordinates of a vertex.
    pub(super) fn coordinates(&self, vertex: u32) -> [i32; 3] {
        let (index, sizes, odd) = if vertex < self.corner_count {
            (vertex as i32, self.cubes.map(|n| n + 1), 0)
        } else {
            ((vertex - self.corner_count) as i32, self.cubes, 1)
        };
        let [i, j, k] = [index % sizes[0], index / sizes[0] % sizes[1], index / (sizes[0] * sizes[1])];
        [2 * i + odd, 2 * j + odd, 2 * k + odd]
    }

    /// The vertex at integer coordinates (all even or all odd), if it lies in the block.
    pub(super) fn vertex_at(&self, c: [i32; 3]) -> Option<u32> {
        let odd = c[0] & 1;
        let sizes = self.cubes.map(|n| n + 1 - odd);
        let [i, j, k] = c.map(|x| (x - odd) / 2);
        let inside = (0..3).all(|a| c[a] >= odd && (c[a] - odd) / 2 < sizes[a]);
        let index = i + sizes[0] * (j + sizes[1] * k);
        inside.then(|| index as u32 + if odd == 1 { self.corner_count } else { 0 })
    }

    pub(super) fn position(&self, vertex: u32) -> Vector3<f64> {
        let c = self.coordinates(vertex);
        self.origin + Vector3::from_fn(|a, _| 0.5 * self.constant * f64::from(c[a]))
    }

    /// Whether an edge between two neighbours is long: both corners or both centres.
    pub(super) fn is_long(&self, u: u32, v: u32) -> bool {
        (u < self.corner_count) == (v < self.corner_count)
    }

    /// Calls `visit` with the four vertices of every tetrahedron, positively oriented.
    pub(super) fn for_each_tetrahedron(&self, mut visit: impl FnMut([u32; 4])) {
        for vertex in self.corner_count..self.vertex_count() {
            let centre = self.coordinates(vertex);
            for axis in 0..3 {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut next = centre;
                next[axis] += 2;
                let Some(next) = self.vertex_at(next) else { continue };
                // The corners of the face between the two cubes, counter-clockwise seen from `next`.
                let ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)].map(|(du, dv)| {
                    let mut corner = centre;
                    corner[axis] += 1;
                    corner[u] += du;
                    corner[v] += dv;
                    self.vertex_at(corner)
                });
                for m in 0..4 {
                    if let (Some(p), Some(q)) = (ring[m], ring[(m + 1) % 4]) {
                        visit([vertex, next, p, q]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block() -> Lattice {
        Lattice::around([Vector3::zeros(), Vector3::new(2.0, 3.0, 1.5)], 1.0)
    }

    #[test]
    fn coordinates_and_vertices_are_inverse() {
        let lattice = block();
        for v in 0..lattice.vertex_count() {
            assert_eq!(lattice.vertex_at(lattice.coordinates(v)), Some(v));
        }
        assert_eq!(lattice.vertex_at([-1, 1, 1]), None);
        assert_eq!(lattice.vertex_at([0, 0, 2 * lattice.cubes[2] + 2]), None);
    }

    #[test]
    fn every_tetrahedron_has_the_volume_of_a_twelfth_of_a_cube() {
        let lattice = block();
        let mut count = 0;
        lattice.for_each_tetrahedron(|t| {
            let [p, q, r, s] = t.map(|v| lattice.position(v));
            let volume = (q - p).cross(&(r - p)).dot(&(s - p)) / 6.0;
            assert!((volume - 1.0 / 12.0).abs() < 1e-12, "volume {volume}");
            assert!(lattice.is_long(t[0], t[1]) && lattice.is_long(t[2], t[3]) && !lattice.is_long(t[0], t[2]));
            count += 1;
        });
        let [x, y, z] = lattice.cubes;
        // Four around each pair of neighbouring centres.
        assert_eq!(count, 4 * ((x - 1) * y * z + x * (y - 1) * z + x * y * (z - 1)));
    }
}
