//! Test bodies: Kuhn blocks of linear elastic tetrahedra, bottom fixed, and rows that touch their surface.
#![allow(dead_code, unreachable_pub)] // shared by test binaries that each use a part of it

use std::sync::Arc;

use nalgebra::{DMatrix, Matrix3, Vector3};
use palpate_fem::factor::{Factor, FactorStatus, SymbolicFactor};
use palpate_fem::nodal_rows::NodalRows;
use palpate_fem::sparse::{BlockPattern, FIXED, SystemMatrix};

/// Deterministic numbers in `[0, 1)` (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    pub fn vector(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.signed()).collect()
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }
}

/// A block of `cells` cubes of 10 mm, six tetrahedra each, inner nodes jittered, nodes with z = 0 fixed.
pub struct Body {
    /// All nodes (m).
    pub nodes: Vec<Vector3<f64>>,
    pub tetrahedra: Vec<[u32; 4]>,
    /// Free node of each node, or [`FIXED`].
    pub free: Vec<u32>,
    /// Positions of the free nodes (m).
    pub positions: Vec<Vector3<f64>>,
    /// Free nodes with the largest z.
    pub top: Vec<u32>,
    pub pattern: Arc<BlockPattern>,
}

impl Body {
    pub fn block(cells: [usize; 3], seed: u64) -> Self {
        let [nx, ny, nz] = cells;
        let mut random = Random(seed);
        let index = |i: usize, j: usize, k: usize| ((k * (ny + 1) + j) * (nx + 1) + i) as u32;
        let mut nodes = Vec::new();
        for k in 0..=nz {
            for j in 0..=ny {
                for i in 0..=nx {
                    let inner = (1..nx).contains(&i) && (1..ny).contains(&j) && (1..nz).contains(&k);
                    let jitter = Vector3::from_fn(|_, _| if inner { 0.15 * random.signed() } else { 0.0 });
                    nodes.push(0.01 * (Vector3::new(i as f64, j as f64, k as f64) + jitter));
                }
            }
        }
        // six tetrahedra around the main diagonal of each cube, one per order of the three axes
        let mut tetrahedra = Vec::new();
        for (k, j, i) in (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| (k, j, i)))) {
            for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                let mut corner = [i, j, k];
                let mut tetrahedron = [index(i, j, k); 4];
                for (step, &axis) in order.iter().enumerate() {
                    corner[axis] += 1;
                    tetrahedron[step + 1] = index(corner[0], corner[1], corner[2]);
                }
                tetrahedra.push(tetrahedron);
            }
        }
        let plane = (nx + 1) * (ny + 1);
        let free: Vec<u32> = (0..nodes.len()).map(|i| if i < plane { FIXED } else { (i - plane) as u32 }).collect();
        let positions = nodes[plane..].to_vec();
        let top = (((nz - 1) * plane) as u32..(nz * plane) as u32).collect();
        let elements: Vec<[u32; 4]> = tetrahedra.iter().map(|t| t.map(|i| free[i as usize])).collect();
        let pattern = Arc::new(BlockPattern::from_elements(positions.len(), &elements));
        Self { nodes, tetrahedra, free, positions, top, pattern }
    }

    pub fn free_nodes(&self) -> usize {
        self.positions.len()
    }

    /// `A = M + h² K` of linear elasticity, Young's modulus 3 kPa times a factor of 1 to 10 per element, Poisson's
    /// ratio 0.45, 1,000 kg/m³, h = 1/30 s.
    pub fn system(&self, seed: u64) -> SystemMatrix {
        self.system_turned(seed, |_| Matrix3::identity())
    }

    /// The same with the stiffness of each element turned by `rotation(centroid)`, as in a corotational body.
    pub fn system_turned(&self, seed: u64, rotation: impl Fn(Vector3<f64>) -> Matrix3<f64>) -> SystemMatrix {
        let mut random = Random(seed);
        let mut a = SystemMatrix::zeros(self.pattern.clone());
        let h = 1.0 / 30.0;
        for tetrahedron in &self.tetrahedra {
            let x = tetrahedron.map(|i| self.nodes[i as usize]);
            let edges = Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]);
            let rotation = rotation(x.iter().sum::<Vector3<f64>>() / 4.0);
            let volume = edges.determinant().abs() / 6.0;
            let inverse = edges.try_inverse().expect("a test element is degenerate");
            let row = |i: usize| inverse.row(i).transpose();
            let gradient = [-(row(0) + row(1) + row(2)), row(0), row(1), row(2)];
            let (young, poisson) = (3e3 * 10f64.powf(random.unit()), 0.45);
            let mu = young / (2.0 * (1.0 + poisson));
            let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
            for (i, &node_i) in tetrahedron.iter().enumerate() {
                for (j, &node_j) in tetrahedron.iter().enumerate() {
                    let (gi, gj) = (gradient[i], gradient[j]);
                    let stiffness = (gi * gj.transpose() * lambda
                        + gj * gi.transpose() * mu
                        + Matrix3::identity() * (mu * gi.dot(&gj)))
                        * volume;
                    let mass = if i == j { 1e3 * volume / 4.0 } else { 0.0 };
                    let block = rotation * stiffness * rotation.transpose() * (h * h) + Matrix3::identity() * mass;
                    let (fi, fj) = (self.free[node_i as usize], self.free[node_j as usize]);
                    if fi == FIXED || fj == FIXED {
                        continue;
                    }
                    let p = self.pattern.find(fi, fj).expect("the pattern lacks a block of its own elements");
                    a.blocks[p] += block;
                }
            }
        }
        a
    }

    /// Three rows (a frame) for each of `contacts` points on triangles of neighbouring top nodes, within a patch
    /// around a random place.
    pub fn contact_rows(&self, contacts: usize, seed: u64) -> NodalRows {
        let mut random = Random(seed);
        let mut near = self.top.clone();
        let centre = self.positions[near[random.below(near.len())] as usize];
        near.sort_by(|&a, &b| {
            let distance = |k: u32| (self.positions[k as usize] - centre).norm();
            distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
        });
        self.rows_at(&near, contacts, &mut random)
    }

    /// The same with the contacts all over the top.
    pub fn scattered_contact_rows(&self, contacts: usize, seed: u64) -> NodalRows {
        let mut random = Random(seed);
        let mut places = self.top.clone();
        for i in (1..places.len()).rev() {
            places.swap(i, random.below(i + 1));
        }
        self.rows_at(&places, contacts, &mut random)
    }

    fn rows_at(&self, places: &[u32], contacts: usize, random: &mut Random) -> NodalRows {
        let mut rows = NodalRows::default();
        for contact in 0..contacts {
            let node = places[contact % places.len()];
            let neighbours = &self.pattern.columns()[self.pattern.row(node as usize)];
            let others: Vec<u32> =
                neighbours.iter().copied().filter(|k| *k != node && self.top.binary_search(k).is_ok()).collect();
            let picked = [node, others[0], others[others.len() - 1]];
            let weights = [0.2 + random.unit(), random.unit(), random.unit()];
            let sum: f64 = weights.iter().sum();
            let normal = Vector3::new(0.3 * random.signed(), 0.3 * random.signed(), 1.0).normalize();
            let tangent = normal.cross(&Vector3::x()).normalize();
            for axis in [normal, tangent, normal.cross(&tangent)] {
                let mut entries: Vec<(u32, Vector3<f64>)> = Vec::new();
                for (&k, &w) in picked.iter().zip(&weights) {
                    if entries.iter().all(|(other, _)| *other != k) {
                        entries.push((k, axis * (w / sum)));
                    }
                }
                rows.push_row(entries);
            }
        }
        rows
    }
}

/// The matrix with all its entries.
pub fn dense(a: &SystemMatrix) -> DMatrix<f64> {
    let n = a.pattern.rows();
    let mut dense = DMatrix::zeros(3 * n, 3 * n);
    for i in 0..n {
        for p in a.pattern.row(i) {
            let j = a.pattern.columns()[p] as usize;
            dense.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&a.blocks[p]);
        }
    }
    dense
}

/// `H` with all its entries.
pub fn dense_rows(rows: &NodalRows, free_nodes: usize) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(rows.len(), 3 * free_nodes);
    for r in 0..rows.len() {
        for (k, v) in rows.row(r) {
            for c in 0..3 {
                dense[(r, 3 * k as usize + c)] += v[c];
            }
        }
    }
    dense
}

/// The factor of a body's matrix.
pub fn factored(body: &Body, a: &SystemMatrix) -> Factor {
    let mut factor = Factor::new(Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap()));
    assert_eq!(factor.refactor(a).status, FactorStatus::Ok);
    factor
}

/// `‖x − y‖ / ‖y‖`.
pub fn relative_difference(x: &[f64], y: &[f64]) -> f64 {
    let difference: f64 = x.iter().zip(y).map(|(x, y)| (x - y) * (x - y)).sum();
    (difference / y.iter().map(|y| y * y).sum::<f64>()).sqrt()
}
