//! Forces and stiffness of one quadratic tetrahedron: the plain version, of which packs
//! ([`QuadraticPack`](crate::pack::QuadraticPack)) are the fast one.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::{QuadraticTetrahedron, extrapolation};
use crate::{
    element::{ElementMatrices, UNIT},
    material::Law,
};

impl QuadraticTetrahedron {
    /// Adds the forces of a first Piola stress `P` (Pa) at point `k` to those of nodes 1 to 9 (N).
    #[inline]
    fn add_forces(&self, k: usize, P: &Matrix3<f64>, forces: &mut [Vector3<f64>; 10]) {
        add_forces(&(P * -self.weights[k]), &self.gradients[k], forces);
    }

    /// Adds point `k` to the blocks of nodes 1 to 9. `tangent` holds `∂P/∂F` over six times the unit of stress, as the
    /// blocks of the [unit tetrahedron](super::UNIT): block `(k, l)` is `∂P_.k / ∂F_.l / 6` (Pa).
    fn add_blocks(&self, k: usize, tangent: &[Matrix3<f64>; 6], blocks: &mut [Matrix3<f64>; 55]) {
        let w = 6.0 * self.weights[k];
        add_blocks(&tangent.map(|c| c * w), &self.gradients[k], blocks);
    }

    /// Adds what a stress and tangent at node `i` of weight `w` (m³) exert, as [`Self::answer`] does for the points.
    pub(crate) fn add_at_node(&self, i: usize, w: f64, answer: &ElementMatrices, out: &mut QuadraticMatrices) {
        let shares = extrapolation(i);
        let g: [Vector3<f64>; 9] =
            std::array::from_fn(|j| self.gradients.iter().zip(shares).map(|(g, share)| g[j] * share).sum());
        add_forces(&(answer.forces * (6.0 * w)), &g, &mut out.forces);
        add_blocks(&answer.blocks.map(|c| c * (6.0 * w)), &g, &mut out.blocks);
    }

    /// Forces and exact tangent of one element, as [`Law::element`]; for packs of elements see
    /// [`QuadraticPack`](crate::pack::QuadraticPack). Returns whether the filter changed the tangent at any point.
    pub fn answer(&self, law: &impl Law, q: &[Vector3<f64>], filter: bool, out: &mut QuadraticMatrices) -> bool {
        *out = QuadraticMatrices::ZERO;
        let mut point = ElementMatrices::ZERO;
        let mut filtered = false;
        for (k, F) in self.deformation_gradients(q).iter().enumerate() {
            filtered |= law.element(&UNIT, F, filter, &mut point);
            self.add_forces(k, &(point.forces * -6.0), &mut out.forces);
            self.add_blocks(k, &point.blocks, &mut out.blocks);
        }
        out.complete();
        filtered
    }
}

/// Adds `wP g` to the forces of nodes 1 to 9.
#[inline]
fn add_forces(wP: &Matrix3<f64>, g: &[Vector3<f64>; 9], forces: &mut [Vector3<f64>; 10]) {
    for (force, g) in forces[1..].iter_mut().zip(g) {
        *force += wP * g;
    }
}

/// Adds `g_i · tangent · g_j` to the blocks of nodes 1 to 9.
#[inline]
fn add_blocks(tangent: &[Matrix3<f64>; 6], g: &[Vector3<f64>; 9], blocks: &mut [Matrix3<f64>; 55]) {
    let [c00, c01, c02, c11, c12, c22] = tangent;
    let (c10, c20, c21) = (c01.transpose(), c02.transpose(), c12.transpose());
    for j in 0..9 {
        let (x, y, z) = (g[j].x, g[j].y, g[j].z);
        let t0 = c00 * x + c01 * y + c02 * z;
        let t1 = c10 * x + c11 * y + c12 * z;
        let t2 = c20 * x + c21 * y + c22 * z;
        for i in 0..=j {
            blocks[upper_index(i + 1, j + 1)] += t0 * g[i].x + t1 * g[i].y + t2 * g[i].z;
        }
    }
}

/// Place of the block of nodes `i <= j` among the 55 on and above the diagonal, which are listed by rows.
#[inline]
pub(crate) const fn upper_index(i: usize, j: usize) -> usize {
    i * (19 - i) / 2 + j
}

/// Forces and stiffness blocks of a quadratic tetrahedron.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticMatrices {
    /// Internal force of each node (N).
    pub forces: [Vector3<f64>; 10],
    /// Blocks `K_ij`, `i <= j`, of `K = -∂f/∂q` by rows (N/m).
    pub blocks: [Matrix3<f64>; 55],
}

impl QuadraticMatrices {
    /// All zero.
    pub const ZERO: Self = Self {
        forces: [Vector3::new(0.0, 0.0, 0.0); 10],
        blocks: [Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); 55],
    };

    /// Node 0 from the others: the shape functions add up to one, so a translation is free of force.
    pub(crate) fn complete(&mut self) {
        self.forces[0] = -self.forces[1..].iter().sum::<Vector3<f64>>();
        for j in 1..10 {
            let column = (1..10).map(|i| match i <= j {
                true => self.blocks[upper_index(i, j)],
                false => self.blocks[upper_index(j, i)].transpose(),
            });
            self.blocks[j] = -column.sum::<Matrix3<f64>>();
        }
        self.blocks[0] = -(1..10).map(|j| self.blocks[j].transpose()).sum::<Matrix3<f64>>();
    }
}
