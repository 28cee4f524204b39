//! Quadratic tetrahedra: ten nodes, straight or curved edges, isoparametric.
//!
//! With barycentric coordinates `l_0..l_3` the shape functions are `N_a = l_a (2 l_a - 1)` at the corners and
//! `N_ab = 4 l_a l_b` at the mid-nodes, numbered by [`EDGES`] (VTK's order). At a point of quadrature with gradients
//! `g_i = ∇N_i` (1/m, of the rest shape) and weight `w` (m³)
//! ```text
//! F = Σ q_i ⊗ g_i,    f_i = -Σ w P g_i,    K_ij = Σ w g_i · ∂P/∂F · g_j.
//! ```
//! Four points suffice: the rule is exact for polynomials of degree two, which at small strain is what
//! `g_i · ∂P/∂F · g_j` is in an element with straight edges, so the order of convergence is kept [Ciarlet 1978, 4.1];
//! and its 4 x 6 strains determine all 30 - 6 modes of deformation, so no element has a mode without energy. With
//! curved edges or large strain the rule leaves an error of the order of the interpolation's. Uniform stress stays
//! exact with curved edges: the gradients of a node are shifted by one vector and the weights scaled, so that
//! `Σ w g_i = ∫ ∇N_i` (variationally consistent integration of first order [Chen, Hillman, Rüter 2013]).
//!
//! The lumped mass is that of Hinton, Rock and Zienkiewicz 1976: the diagonal of the consistent mass scaled to the
//! element's mass, 1/36 at a corner and 4/27 at a mid-node (row sums would be negative at the corners). Departure: these
//! shares of a straight element serve curved ones too, times their volume.

#![allow(non_snake_case)]

mod matrices;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

pub use self::matrices::QuadraticMatrices;
pub(crate) use self::matrices::upper_index;
use crate::rotation::cofactor;

/// Corners that each mid-node lies between, in the order of the mid-nodes.
pub const EDGES: [(usize, usize); 6] = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)];

/// Share of an element's mass at each corner.
pub const CORNER_MASS: f64 = 1.0 / 36.0;

/// Share of an element's mass at each mid-node.
pub const MID_NODE_MASS: f64 = 4.0 / 27.0;

/// Points of quadrature.
pub const POINTS: usize = 4;

/// Barycentric coordinate of a point of quadrature at the corner it is near to, `(5 + 3√5) / 20`; the others share the
/// rest. All weights are a quarter.
const NEAR: f64 = 0.585_410_196_624_968_5;

/// A mid-node further from the middle of its straight edge than this share of the edge belongs elsewhere: mid-nodes in
/// another order lie at least about half an edge away.
const MOST_OFFSET: f64 = 0.45;

/// A mid-node that spoils its element.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MidNodeError {
    /// A mid-node is far from its edge.
    #[error(
        "mid-node {node} lies {offset:.2} edge lengths from the middle of the edge between nodes {ends:?}; give \
         mid-nodes in VTK's order (edges 01 12 02 03 13 23), near their edges"
    )]
    Offset {
        /// The mid-node.
        node: u32,
        /// The nodes at the ends of its edge.
        ends: [u32; 2],
        /// Distance from the middle of the straight edge, in lengths of that edge.
        offset: f64,
    },
    /// The map from the straight to the curved element folds.
    #[error(
        "the curved element folds at barycentric coordinates ({:.2}, {:.2}, {:.2}, {:.2}): its Jacobian there is \
         {ratio:.3} of the straight element's; straighten its edges (mid-nodes at their middles) or refine it",
        at[0], at[1], at[2], at[3]
    )]
    Folded {
        /// Barycentric coordinates of the place.
        at: [f64; 4],
        /// Jacobian determinant there over that of the straight element; not positive.
        ratio: f64,
    },
}

/// Rest shape of one quadratic tetrahedron.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticTetrahedron {
    /// Mesh nodes: four corners, then six mid-nodes.
    pub nodes: [u32; 10],
    /// Weight of each point (m³), positive; their sum is the volume.
    pub weights: [f64; POINTS],
    /// Gradients `g_1..g_9` at each point (1/m); `g_0` is minus their sum.
    gradients: [[Vector3<f64>; 9]; POINTS],
    straight: bool,
}

/// Whether the mid-nodes of an element with the given rest positions (m) lie at the middles of straight edges, to the
/// rounding of their coordinates.
pub fn is_straight(x: &[Vector3<f64>; 10]) -> bool {
    let largest = x.iter().map(Vector3::amax).fold(0.0, f64::max);
    EDGES.iter().zip(&x[4..]).all(|(&(a, b), mid)| (mid - (x[a] + x[b]) * 0.5).amax() <= 4.0 * f64::EPSILON * largest)
}

/// Derivatives of the shape functions by the barycentric coordinates `1, 2, 3` (with `l_0 = 1 - l_1 - l_2 - l_3`).
fn parametric_gradients(l: &[f64; 4]) -> [Vector3<f64>; 10] {
    let of = |a: usize| match a {
        0 => Vector3::repeat(-1.0),
        _ => Vector3::ith(a - 1, 1.0),
    };
    std::array::from_fn(|i| match i {
        0..4 => of(i) * (4.0 * l[i] - 1.0),
        _ => {
            let (a, b) = EDGES[i - 4];
            of(b) * (4.0 * l[a]) + of(a) * (4.0 * l[b])
        }
    })
}

/// Values of the ten shape functions at barycentric coordinates.
pub fn shape_functions(l: &[f64; 4]) -> [f64; 10] {
    std::array::from_fn(|i| match i {
        0..4 => l[i] * (2.0 * l[i] - 1.0),
        _ => 4.0 * l[EDGES[i - 4].0] * l[EDGES[i - 4].1],
    })
}

/// Barycentric coordinates of point of quadrature `k`.
fn point(k: usize) -> [f64; 4] {
    std::array::from_fn(|a| if a == k { NEAR } else { (1.0 - NEAR) / 3.0 })
}

/// Barycentric coordinates of node `i`.
fn node_coordinates(i: usize) -> [f64; 4] {
    std::array::from_fn(|a| match i {
        0..4 => f64::from(u8::from(a == i)),
        _ => 0.5 * f64::from(u8::from(a == EDGES[i - 4].0 || a == EDGES[i - 4].1)),
    })
}

impl QuadraticTetrahedron {
    /// The element over rest positions `q_rest` (m).
    ///
    /// # Errors
    /// A mid-node away from its edge; a Jacobian that is not positive at a point of quadrature or a node.
    pub fn new(nodes: [u32; 10], q_rest: &[Vector3<f64>]) -> Result<Self, MidNodeError> {
        let x = nodes.map(|i| q_rest[i as usize]);
        for (&(a, b), k) in EDGES.iter().zip(4..) {
            let offset = (x[k] - (x[a] + x[b]) * 0.5).norm() / (x[b] - x[a]).norm();
            // An edge without length has no middle.
            if offset > MOST_OFFSET || offset.is_nan() {
                return Err(MidNodeError::Offset { node: nodes[k], ends: [nodes[a], nodes[b]], offset });
            }
        }
        let straight = Matrix3::from_columns(&[x[1] - x[0], x[2] - x[0], x[3] - x[0]]).determinant();
        let jacobian = |l: &[f64; 4]| {
            let g = parametric_gradients(l);
            x.iter().zip(&g).map(|(x, g)| x * g.transpose()).sum::<Matrix3<f64>>()
        };
        let folded = |at: [f64; 4]| {
            let ratio = jacobian(&at).determinant() / straight;
            // Not `<=`: NaN is no Jacobian either.
            if ratio > 1e-6 { Ok(()) } else { Err(MidNodeError::Folded { at, ratio }) }
        };
        (0..POINTS).try_for_each(|k| folded(point(k)))?;
        (0..10).try_for_each(|i| folded(node_coordinates(i)))?;

        let mut element = Self {
            nodes,
            weights: [0.0; POINTS],
            gradients: [[Vector3::zeros(); 9]; POINTS],
            straight: is_straight(&x),
        };
        for k in 0..POINTS {
            let at = point(k);
            let dX = jacobian(&at);
            // Folds were refused above: the inverse exists.
            let inverse = dX.try_inverse().unwrap_or_else(Matrix3::zeros);
            element.weights[k] = dX.determinant() / 24.0;
            let g = parametric_gradients(&at);
            element.gradients[k] = std::array::from_fn(|i| inverse.tr_mul(&g[i + 1]));
        }
        element.integrate_gradients_exactly(|l| (jacobian(l), parametric_gradients(l)));
        Ok(element)
    }

    /// Scales the weights to the exact volume and shifts the gradients of each node by one vector, so that
    /// `Σ w g_i = ∫ ∇N_i`: no change where edges are straight. `map` gives the Jacobian and the parametric gradients.
    fn integrate_gradients_exactly(&mut self, map: impl Fn(&[f64; 4]) -> (Matrix3<f64>, [Vector3<f64>; 10])) {
        // Degree three, which is what det dX and cof(dX) ∇N are: Keast's five points.
        let near = |k: usize| std::array::from_fn(|a| if a == k { 0.5 } else { 1.0 / 6.0 });
        let rule = (0..4).map(|k| (near(k), 0.075)).chain([([0.25; 4], -2.0 / 15.0)]);
        let (mut volume, mut exact) = (0.0, [Vector3::zeros(); 9]);
        for (at, weight) in rule {
            let (dX, g) = map(&at);
            volume += weight * dX.determinant();
            let cof = cofactor(&dX);
            for (exact, g) in exact.iter_mut().zip(&g[1..]) {
                *exact += cof * g * weight;
            }
        }
        let scale = volume / self.weights.iter().sum::<f64>();
        self.weights = self.weights.map(|w| w * scale);
        for (i, exact) in exact.iter().enumerate() {
            let found: Vector3<f64> = self.gradients.iter().zip(self.weights).map(|(g, w)| g[i] * w).sum();
            let shift = (exact - found) / volume;
            self.gradients.iter_mut().for_each(|g| g[i] += shift);
        }
    }

    /// Volume of the curved element (m³).
    pub fn volume(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// `[∇N_0 .. ∇N_9]` at point `k` (1/m).
    ///
    /// # Panics
    /// If `k` is not below [`POINTS`].
    pub fn gradients(&self, k: usize) -> [Vector3<f64>; 10] {
        let g = &self.gradients[k];
        std::array::from_fn(|i| if i == 0 { -g.iter().sum::<Vector3<f64>>() } else { g[i - 1] })
    }

    /// Position of point `k` (m) with node positions `q`.
    ///
    /// # Panics
    /// If `k` is not below [`POINTS`] or a node is out of range.
    pub fn position(&self, k: usize, q: &[Vector3<f64>]) -> Vector3<f64> {
        let N = shape_functions(&point(k));
        self.nodes.iter().zip(N).map(|(&i, n)| q[i as usize] * n).sum()
    }

    /// Deformation gradients `F = Σ q_i ⊗ g_i` at the points.
    #[inline]
    pub fn deformation_gradients(&self, q: &[Vector3<f64>]) -> [Matrix3<f64>; POINTS] {
        let first = q[self.nodes[0] as usize];
        let edges: [Vector3<f64>; 9] = std::array::from_fn(|i| q[self.nodes[i + 1] as usize] - first);
        self.gradients.map(|g| {
            let mut F = Matrix3::zeros();
            for (edge, g) in edges.iter().zip(&g) {
                for c in 0..3 {
                    let mut column = F.column_mut(c);
                    column += edge * g[c];
                }
            }
            F
        })
    }

    /// Whether all mid-nodes lie at the middles of straight edges, to rounding.
    pub fn is_straight(&self) -> bool {
        self.straight
    }

    /// Deformation gradients at the ten nodes, extrapolated from those at the points: exact where edges are straight.
    pub(crate) fn nodal_gradients(&self, q: &[Vector3<f64>]) -> [Matrix3<f64>; 10] {
        let points = self.deformation_gradients(q);
        std::array::from_fn(|i| points.iter().zip(extrapolation(i)).map(|(F, share)| F * share).sum())
    }
}

/// Shares of the four points in a value at node `i`, of what varies linearly over the element.
fn extrapolation(i: usize) -> [f64; POINTS] {
    let far = (1.0 - NEAR) / 3.0;
    node_coordinates(i).map(|l| (l - far) / (NEAR - far))
}
