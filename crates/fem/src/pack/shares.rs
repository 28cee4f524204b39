//! What packs of elements add to forces and stiffness.

use nalgebra::Matrix3;

use super::{PACK, Row};
use crate::{
    element::{ElementMatrices, UPPER},
    material::BatchReport,
};

/// Forces and stiffness of a pack of elements of `N` nodes, with `B = N (N - 1) / 2` blocks off the diagonal.
#[repr(align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct PackShares<const N: usize, const B: usize> {
    /// `forces[a][c]` is component `c` of the internal force on node `a` (N).
    pub forces: [[Row; 3]; N],
    /// Lower triangles `11, 21, 31, 22, 32, 33` of the blocks `K_aa` (N/m).
    pub diagonal: [[Row; 6]; N],
    /// Blocks `K_ab`, `a < b`, of `K = -∂f/∂q` by columns (N/m); the pairs by rows, `K_01, K_02, ..`.
    pub off_diagonal: [[Row; 9]; B],
    /// Volume ratio `J`; of a quadratic element the least at its points.
    pub jacobian: Row,
    /// 1 where the definiteness filter changed the tangent, elsewhere 0.
    pub filtered: Row,
    /// A sum that is not finite where a force or the diagonal of the stiffness is not.
    pub checksum: Row,
}

/// Results of four-node elements.
pub type PackMatrices = PackShares<4, 6>;

/// Results of ten-node elements.
pub type QuadraticPackMatrices = PackShares<10, 45>;

impl<const N: usize, const B: usize> PackShares<N, B> {
    /// All zero.
    pub const ZERO: Self = Self {
        forces: [[[0.0; PACK]; 3]; N],
        diagonal: [[[0.0; PACK]; 6]; N],
        off_diagonal: [[[0.0; PACK]; 9]; B],
        jacobian: [0.0; PACK],
        filtered: [0.0; PACK],
        checksum: [0.0; PACK],
    };

    /// Blocks on and above the diagonal.
    pub const BLOCKS: usize = N + B;

    /// Nodes `(a, b)` of block `k`: first the diagonal ones, then the others in storage order.
    pub(crate) fn nodes_of_block(k: usize) -> (usize, usize) {
        let pairs = || (0..N).flat_map(|a| (a + 1..N).map(move |b| (a, b)));
        if k < N { (k, k) } else { pairs().nth(k - N).unwrap_or_default() }
    }

    /// Tells a report of the first `len` elements, which are counted from `first` on.
    pub(crate) fn note(&self, first: u32, len: usize, report: &mut BatchReport) {
        for lane in 0..len.min(PACK) {
            let finite = self.checksum[lane].is_finite();
            report.note(first + lane as u32, self.jacobian[lane], self.filtered[lane] > 0.0, finite);
        }
    }
}

impl PackMatrices {
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
        self.checksum[lane] += forces.sum();
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
