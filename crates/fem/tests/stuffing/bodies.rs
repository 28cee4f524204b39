//! Bodies with known volume, and the topology of a boundary, for the stuffing tests.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;
use palpate_fem::mesh::TetMesh;
use palpate_fem::stuffing::LevelSet;

pub(crate) struct Sphere {
    pub(crate) centre: Vector3<f64>,
    pub(crate) radius: f64,
}

impl Sphere {
    pub(crate) fn volume(&self) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * self.radius.powi(3)
    }

    pub(crate) fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI * self.radius.powi(2)
    }
}

impl LevelSet for Sphere {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        self.radius - (point - self.centre).norm()
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        [self.centre.add_scalar(-self.radius), self.centre.add_scalar(self.radius)]
    }
}

/// A torus around an axis through its centre.
pub(crate) struct Torus {
    pub(crate) centre: Vector3<f64>,
    pub(crate) axis: Vector3<f64>,
    pub(crate) ring: f64,
    pub(crate) tube: f64,
}

impl Torus {
    pub(crate) fn volume(&self) -> f64 {
        2.0 * std::f64::consts::PI.powi(2) * self.ring * self.tube.powi(2)
    }
}

impl LevelSet for Torus {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        let d = point - self.centre;
        let axis = self.axis.normalize();
        let height = d.dot(&axis);
        let radius = (d - axis * height).norm();
        self.tube - ((radius - self.ring).powi(2) + height * height).sqrt()
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        let reach = self.ring + self.tube;
        [self.centre.add_scalar(-reach), self.centre.add_scalar(reach)]
    }
}

/// A union of balls: creases, contacts and parts thinner than a cell.
#[derive(Debug)]
pub(crate) struct Blobs(pub(crate) Vec<(Vector3<f64>, f64)>);

impl LevelSet for Blobs {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        self.0.iter().map(|(centre, radius)| radius - (point - centre).norm()).fold(f64::NEG_INFINITY, f64::max)
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = -low;
        for (centre, radius) in &self.0 {
            low = low.inf(&centre.add_scalar(-radius));
            high = high.sup(&centre.add_scalar(*radius));
        }
        [low, high]
    }
}

/// Faces of one tetrahedron only, oriented outward.
pub(crate) fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let mut faces: BTreeMap<[u32; 3], ([u32; 3], usize)> = BTreeMap::new();
    for &[a, b, c, d] in &mesh.tetrahedra {
        for face in [[b, c, d], [a, d, c], [a, b, d], [a, c, b]] {
            let mut key = face;
            key.sort_unstable();
            faces.entry(key).or_insert((face, 0)).1 += 1;
        }
    }
    assert!(faces.values().all(|f| f.1 <= 2), "a face belongs to more than two tetrahedra");
    faces.into_values().filter(|f| f.1 == 1).map(|f| f.0).collect()
}

/// Every edge twice, in opposite directions, and the triangles around every node a single fan.
pub(crate) fn is_closed_surface(triangles: &[[u32; 3]]) -> bool {
    let mut edges = BTreeSet::new();
    let mut links: BTreeMap<u32, BTreeMap<u32, u32>> = BTreeMap::new();
    for &[a, b, c] in triangles {
        for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
            if !edges.insert((p, q)) || links.entry(p).or_default().insert(q, r).is_some() {
                return false;
            }
        }
    }
    edges.iter().all(|&(p, q)| edges.contains(&(q, p)))
        && links.values().all(|link| {
            let start = *link.keys().next().unwrap();
            let mut at = start;
            let mut steps = 0;
            loop {
                let Some(&next) = link.get(&at) else { return false };
                at = next;
                steps += 1;
                if at == start || steps > link.len() {
                    return steps == link.len();
                }
            }
        })
}

/// Vertices - edges + triangles of a closed surface: 2 for a sphere, 0 for a torus.
pub(crate) fn euler_characteristic(triangles: &[[u32; 3]]) -> i64 {
    let nodes: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    nodes.len() as i64 - triangles.len() as i64 / 2
}

/// Volume that a boundary encloses by the divergence theorem (m³): positive if it is oriented outward.
pub(crate) fn enclosed_volume(mesh: &TetMesh, triangles: &[[u32; 3]]) -> f64 {
    triangles
        .iter()
        .map(|t| {
            let [p, q, r] = t.map(|n| mesh.nodes[n as usize]);
            p.cross(&q).dot(&r) / 6.0
        })
        .sum()
}
