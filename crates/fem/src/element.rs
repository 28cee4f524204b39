//! Linear tetrahedra: shape vectors, deformed edges, and what an element adds to forces and stiffness. Quadratic ones are
//! in [`quadratic`].
//!
//! With rest edges `E = [X1-X0, X2-X0, X3-X0]` and deformed edges `e`, the shape vectors `D_i = ∇N_i` are the rows of
//! `E⁻¹` (`D_0 = -D_1-D_2-D_3`), and `F = e E⁻¹ = Σ q_i ⊗ D_i`. Since `Σ D_i = 0`, forces and stiffness of node 0 are
//! minus the sums over the other three: elements keep three forces and six blocks, and a translation is free of force to
//! the last bit of that sum.

#![allow(non_snake_case)]

mod kind;
pub mod quadratic;

use nalgebra::{Matrix3, Vector3};

pub use self::{kind::ElementKind, quadratic::QuadraticTetrahedron};

/// Rest shape of one linear tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tetrahedron {
    /// Mesh nodes.
    pub nodes: [u32; 4],
    /// `E⁻¹` (1/m); its rows are `D_1, D_2, D_3`.
    pub inverse_rest_edges: Matrix3<f64>,
    /// Rest volume `V0` (m³), positive.
    pub volume: f64,
}

impl Tetrahedron {
    /// The element over rest positions `q_rest` (m); `None` where its volume is not positive (or not finite).
    pub fn new(nodes: [u32; 4], q_rest: &[Vector3<f64>]) -> Option<Self> {
        let mut element = Self { nodes, inverse_rest_edges: Matrix3::zeros(), volume: 0.0 };
        let E = element.edges(q_rest);
        element.volume = E.determinant() / 6.0;
        element.inverse_rest_edges = E.try_inverse()?;
        (element.volume > 0.0 && element.inverse_rest_edges.iter().all(|x| x.is_finite())).then_some(element)
    }

    /// Shape vectors `D_0` to `D_3` (1/m): gradients of the shape functions of the four nodes.
    pub fn shape_vectors(&self) -> [Vector3<f64>; 4] {
        let [a, b, c] = [0, 1, 2].map(|i| self.inverse_rest_edges.row(i).transpose());
        [-(a + b + c), a, b, c]
    }

    /// Edges `[q1-q0, q2-q0, q3-q0]` as columns (m).
    #[inline]
    pub fn edges(&self, q: &[Vector3<f64>]) -> Matrix3<f64> {
        let [a, b, c, d] = self.nodes.map(|i| q[i as usize]);
        Matrix3::from_columns(&[b - a, c - a, d - a])
    }

    /// Deformation gradient `F = e E⁻¹`.
    #[inline]
    pub fn deformation_gradient(&self, q: &[Vector3<f64>]) -> Matrix3<f64> {
        self.edges(q) * self.inverse_rest_edges
    }

    /// Forces of nodes 1, 2, 3 as columns (N): `f_i = -V0 P D_i` for the first Piola stress `P` (Pa).
    #[inline]
    pub fn forces(&self, P: &Matrix3<f64>) -> Matrix3<f64> {
        P * self.inverse_rest_edges.transpose() * -self.volume
    }
}

/// Forces and stiffness blocks of the nodes 1, 2, 3 of an element; those of node 0 follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementMatrices {
    /// Internal forces of nodes 1, 2, 3 as columns (N).
    pub forces: Matrix3<f64>,
    /// Blocks `K_11, K_12, K_13, K_22, K_23, K_33` of `K = -∂f/∂q` (N/m).
    pub blocks: [Matrix3<f64>; 6],
}

impl ElementMatrices {
    /// All zero.
    pub const ZERO: Self = Self {
        forces: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        blocks: [Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 6],
    };

    /// Force of local node `a` (0 to 3) (N).
    #[inline]
    pub fn force(&self, a: usize) -> Vector3<f64> {
        match a {
            0 => -(self.forces.column(0) + self.forces.column(1) + self.forces.column(2)),
            _ => self.forces.column(a - 1).into_owned(),
        }
    }

    /// Upper block number `k` in the order of [`UPPER`] (N/m).
    #[inline]
    pub fn upper(&self, k: usize) -> Matrix3<f64> {
        let [k11, k12, k13, k22, k23, k33] = &self.blocks;
        match k {
            0 => -(self.upper(1) + self.upper(2) + self.upper(3)),
            1 => -(k11 + k12.transpose() + k13.transpose()),
            2 => -(k12 + k22 + k23.transpose()),
            3 => -(k13 + k23 + k33),
            _ => self.blocks[k - 4],
        }
    }

    /// Whether every force and the diagonal of the stiffness are finite; other blocks are sums of the same terms.
    #[inline]
    pub(crate) fn is_finite(&self) -> bool {
        let trace = self.blocks[0].trace() + self.blocks[3].trace() + self.blocks[5].trace();
        (self.forces.sum() + trace).is_finite()
    }
}

/// Local nodes of the ten blocks on and above the diagonal, in storage order.
pub const UPPER: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

/// The tetrahedron with rest edges `I` and volume 1/6. What a law answers for it with edges `F` is its
/// stress and tangent at a point: forces `-P / 6`, and block `(k, l)` is `∂P_.k / ∂F_.l / 6` (Pa).
///
/// It belongs to no mesh: its nodes are not meant to be looked up.
pub const UNIT: Tetrahedron = Tetrahedron {
    nodes: [0, 1, 2, 3],
    inverse_rest_edges: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    volume: 1.0 / 6.0,
};
