//! Tetrahedra in packs of eight: rest shapes and results as rows of eight numbers, one for each element.
//!
//! The nodes of a packed element ascend, whatever their order in the mesh, so that its blocks `(a, b)` with `a <= b` all
//! lie in the upper half of the system and none is transposed on its way there. Half of the orders turn the sign of
//! `det E`, which cancels in every formula that holds [`Pack::inverse_det`].

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use crate::element::{ElementMatrices, Tetrahedron, UPPER};

/// Elements in a pack: the widest vectors hold eight numbers.
pub const PACK: usize = 8;

/// One number for each element of a pack.
pub type Row = [f64; PACK];

/// Rest shapes of up to eight tetrahedra. Places without an element repeat the last one.
#[repr(align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct Pack {
    /// Mesh nodes of each element, ascending.
    pub nodes: [[u32; 4]; PACK],
    /// Number of elements, 1 to 8.
    pub len: usize,
    /// Components of the shape vectors: `shape[i][c]` is component `c` of `D_(i+1)` (1/m).
    pub shape: [[Row; 3]; 3],
    /// `D_i · D_j` (1/m²) for the pairs 11, 12, 13, 22, 23, 33.
    pub gram: [Row; 6],
    /// `1 / det E`, plus or minus `1 / 6 V0` (1/m³).
    pub inverse_det: Row,
    /// Rest volume `V0` (m³), positive.
    pub volume: Row,
}

impl Pack {
    /// Packs up to eight elements; `None` where there is none or more.
    pub fn new(elements: &[Tetrahedron]) -> Option<Self> {
        let last = elements.last()?;
        if elements.len() > PACK {
            return None;
        }
        let mut pack = Self {
            nodes: [[0; 4]; PACK],
            len: elements.len(),
            shape: [[[0.0; PACK]; 3]; 3],
            gram: [[0.0; PACK]; 6],
            inverse_det: [0.0; PACK],
            volume: [0.0; PACK],
        };
        for lane in 0..PACK {
            let element = elements.get(lane).unwrap_or(last);
            let mut order = [0, 1, 2, 3];
            order.sort_by_key(|&a| element.nodes[a]);
            pack.nodes[lane] = order.map(|a| element.nodes[a]);
            let D = element.shape_vectors();
            let D = [D[order[1]], D[order[2]], D[order[3]]];
            let mut k = 0;
            for i in 0..3 {
                for c in 0..3 {
                    pack.shape[i][c][lane] = D[i][c];
                }
                for j in i..3 {
                    pack.gram[k][lane] = D[i].dot(&D[j]);
                    k += 1;
                }
            }
            let even =
                (0..4).flat_map(|a| (0..a).map(move |b| (b, a))).filter(|&(b, a)| order[b] > order[a]).count() % 2;
            let sign = if even == 0 { 1.0 } else { -1.0 };
            pack.inverse_det[lane] = sign / (6.0 * element.volume);
            pack.volume[lane] = element.volume;
        }
        Some(pack)
    }

    /// An element with its nodes ascending. Where that turns the orientation, its edges have a negative determinant.
    ///
    /// # Panics
    /// If `lane` is not below [`PACK`].
    pub fn element(&self, lane: usize) -> Tetrahedron {
        Tetrahedron {
            nodes: self.nodes[lane],
            inverse_rest_edges: Matrix3::from_fn(|i, c| self.shape[i][c][lane]),
            volume: self.volume[lane],
        }
    }

    /// Deformed edges from the first node to the others (m): `edges[i][c]` is component `c` of `e_(i+1)`.
    #[inline]
    pub fn edges(&self, q: &[Vector3<f64>]) -> [[Row; 3]; 3] {
        let mut edges = [[[0.0; PACK]; 3]; 3];
        for (lane, nodes) in self.nodes.iter().enumerate() {
            let [a, b, c, d] = nodes.map(|i| q[i as usize]);
            for (i, edge) in [b - a, c - a, d - a].iter().enumerate() {
                for c in 0..3 {
                    edges[i][c][lane] = edge[c];
                }
            }
        }
        edges
    }
}

/// Forces and stiffness of a pack of elements, over all four nodes of each.
#[repr(align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct PackMatrices {
    /// `forces[a][c]` is component `c` of the internal force on node `a` (N).
    pub forces: [[Row; 3]; 4],
    /// Lower triangles `11, 21, 31, 22, 32, 33` of the blocks `K_aa` (N/m), `a` from 0 to 3.
    pub diagonal: [[Row; 6]; 4],
    /// Blocks `K_01, K_02, K_03, K_12, K_13, K_23` of `K = -∂f/∂q` by columns (N/m).
    pub off_diagonal: [[Row; 9]; 6],
    /// Volume ratio `J`.
    pub jacobian: Row,
    /// 1 where the definiteness filter changed the tangent, elsewhere 0.
    pub filtered: Row,
    /// A sum that is not finite where a force or the diagonal of the stiffness is not.
    pub checksum: Row,
}

impl PackMatrices {
    /// All zero.
    pub const ZERO: Self = Self {
        forces: [[[0.0; PACK]; 3]; 4],
        diagonal: [[[0.0; PACK]; 6]; 4],
        off_diagonal: [[[0.0; PACK]; 9]; 6],
        jacobian: [0.0; PACK],
        filtered: [0.0; PACK],
        checksum: [0.0; PACK],
    };

    /// The forces and blocks of an element, over its nodes in ascending order.
    ///
    /// # Panics
    /// If `lane` is not below [`PACK`].
    pub fn element(&self, lane: usize) -> ElementMatrices {
        let diagonal = |a: usize| {
            let [x, xy, xz, y, yz, z] = self.diagonal[a].map(|row| row[lane]);
            Matrix3::new(x, xy, xz, xy, y, yz, xz, yz, z)
        };
        let other = |k: usize| Matrix3::from_fn(|r, c| self.off_diagonal[k][3 * c + r][lane]);
        ElementMatrices {
            forces: Matrix3::from_fn(|c, i| self.forces[i + 1][c][lane]),
            blocks: [diagonal(1), other(3), other(4), diagonal(2), other(5), diagonal(3)],
        }
    }

    /// Adds forces of nodes 1, 2, 3 (columns, N) to those of an element, and minus their sum to node 0.
    pub(crate) fn add_forces(&mut self, lane: usize, forces: &Matrix3<f64>) {
        for (i, force) in forces.column_iter().enumerate() {
            for c in 0..3 {
                self.forces[i + 1][c][lane] += force[c];
                self.forces[0][c][lane] -= force[c];
            }
        }
    }

    /// Replaces the forces and blocks of an element; the inverse of [`PackMatrices::element`] up to rounding at node 0.
    ///
    /// # Panics
    /// If `lane` is not below [`PACK`].
    pub fn set_element(&mut self, lane: usize, matrices: &ElementMatrices) {
        for a in 0..4 {
            let force = matrices.force(a);
            for c in 0..3 {
                self.forces[a][c][lane] = force[c];
            }
        }
        let (mut others, mut diagonals) = (self.off_diagonal.iter_mut(), self.diagonal.iter_mut());
        for (k, &(a, b)) in UPPER.iter().enumerate() {
            let block = matrices.upper(k);
            if a == b {
                let triangle = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)];
                for (row, at) in diagonals.next().into_iter().flatten().zip(triangle) {
                    row[lane] = block[at];
                }
            } else {
                for (row, x) in others.next().into_iter().flatten().zip(&block) {
                    row[lane] = *x;
                }
            }
        }
    }
}

/// Nodes `(a, b)` of the off-diagonal blocks, in storage order.
pub const OFF_DIAGONAL: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
