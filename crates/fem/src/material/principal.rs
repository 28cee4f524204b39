//! The tangent of an isotropic law in the principal frame of `F`, and the definiteness filter.
//!
//! With the signed singular values `F = U diag(σ) Vᵀ`, the 9 x 9 tangent `∂P/∂F` of an isotropic law falls into one 3 x 3
//! block over the scalings `U (e_a e_aᵀ) Vᵀ` and six numbers: for each pair `(b, c)` of axes the eigenvalue of the flip
//! `U (e_b e_cᵀ + e_c e_bᵀ) Vᵀ / √2` and of the twist `U (e_b e_cᵀ - e_c e_bᵀ) Vᵀ / √2`
//! [Smith, De Goes, Kim 2019]. The nearest positive semidefinite tangent needs only the eigenvalues of the 3 x 3 block.
//! Since `K = V0 Bᵀ (∂P/∂F) B` with `B` of full rank, the 12 x 12 stiffness is semidefinite exactly where `∂P/∂F` is.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::kernel::principal::PrincipalResponse;
use crate::{
    element::Tetrahedron,
    rotation::{SignedSvd, signed_svd},
};

/// Eigenvalues above `-ROUNDING` times the largest count as zero: rotations have eigenvalue zero at rest.
pub(crate) const ROUNDING: f64 = 1e-12;

/// `∂P/∂F` (Pa) of an isotropic law in the frame of the singular vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalTangent {
    svd: SignedSvd,
    /// Over the three scalings (Pa): `∂²Ψ/∂σ_a∂σ_b`, symmetric.
    pub scaling: Matrix3<f64>,
    /// Eigenvalue of the flip of the two axes other than `a` (Pa): `(Ψ_b - Ψ_c) / (σ_b - σ_c)`.
    pub flip: Vector3<f64>,
    /// Eigenvalue of the twist of the two axes other than `a` (Pa): `(Ψ_b + Ψ_c) / (σ_b + σ_c)`.
    pub twist: Vector3<f64>,
}

impl PrincipalTangent {
    /// The derivatives of a law in the given frame.
    pub fn new(svd: SignedSvd, response: &PrincipalResponse<f64>) -> Self {
        let [a, b, c, d, e, f] = response.scaling;
        Self {
            svd,
            scaling: Matrix3::new(a, b, c, b, d, e, c, e, f),
            flip: response.flip.into(),
            twist: response.twist.into(),
        }
    }

    /// Replaces negative eigenvalues by zero. Returns whether one was negative beyond rounding; data that are not finite
    /// are left alone.
    pub fn filter(&mut self) -> bool {
        let scale = self.scaling.amax().max(self.flip.amax()).max(self.twist.amax());
        if !scale.is_finite() {
            return false;
        }
        let floor = -ROUNDING * scale;
        let mut acted = self.flip.min() < floor || self.twist.min() < floor;
        self.flip = self.flip.sup(&Vector3::zeros());
        self.twist = self.twist.sup(&Vector3::zeros());
        if !is_positive(&self.scaling) {
            // Nearest semidefinite matrix (A + |A|) / 2 with |A| = V |Σ| Vᵀ [Higham 1988].
            let svd = signed_svd(&self.scaling);
            let absolute = svd.V * Matrix3::from_diagonal(&svd.sigma.abs()) * svd.V.transpose();
            let nearest = (self.scaling + absolute) * 0.5;
            acted |= (nearest - self.scaling).amax() > -floor;
            self.scaling = (nearest + nearest.transpose()) * 0.5;
        }
        acted
    }

    /// Stiffness blocks `K_ij` of the nodes 1, 2, 3 (N/m), in the order of
    /// [`ElementMatrices`](crate::element::ElementMatrices).
    pub fn blocks(&self, element: &Tetrahedron, blocks: &mut [Matrix3<f64>; 6]) {
        // Rows are D_1, D_2, D_3 in the rest frame of the singular vectors.
        let D = element.inverse_rest_edges * self.svd.V;
        let V0 = element.volume;
        let shear = (self.flip + self.twist) * (0.5 * V0);
        let coupling = (self.flip - self.twist) * (0.5 * V0);
        let A = self.scaling * V0;
        let U = self.svd.U;
        let mut k = 0;
        for i in 0..3 {
            for j in i..3 {
                let mut block = Matrix3::zeros();
                for a in 0..3 {
                    let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                    block[(a, a)] = A[(a, a)] * D[(i, a)] * D[(j, a)]
                        + shear[c] * D[(i, b)] * D[(j, b)]
                        + shear[b] * D[(i, c)] * D[(j, c)];
                    block[(a, b)] = A[(a, b)] * D[(i, a)] * D[(j, b)] + coupling[c] * D[(i, b)] * D[(j, a)];
                    block[(a, c)] = A[(a, c)] * D[(i, a)] * D[(j, c)] + coupling[b] * D[(i, c)] * D[(j, a)];
                }
                blocks[k] = U * block * U.transpose();
                k += 1;
            }
        }
    }
}

/// Whether a symmetric matrix is positive definite, by its leading minors.
#[inline]
fn is_positive(A: &Matrix3<f64>) -> bool {
    A[(0, 0)] > 0.0 && A[(0, 0)] * A[(1, 1)] > A[(0, 1)] * A[(0, 1)] && A.determinant() > 0.0
}
