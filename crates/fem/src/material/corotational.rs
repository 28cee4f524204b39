//! Corotational linear elasticity: `F = R S` with the proper rotation `R` nearest to `F`.
//!
//! ```text
//! Ψ = μ ‖F - R‖² + λ/2 tr²(S - I)                J/m³
//! P = 2 μ (F - R) + λ tr(S - I) R                Pa
//! ```
//! The force is the classical `f_e = -R K_e (Rᵀ x - X)` [Müller, Gross 2004; Etzmuss 2003]: `K_e` applied to `Rᵀ x - X`
//! sees the strain `sym(Rᵀ F - I) = S - I`, whose stress rotated by `R` is `P`, since `Rᵀ F = S` is symmetric for the
//! polar rotation. The tangent is not the classical `R K_e Rᵀ` but exact, with `∂R/∂F` [Chao 2010; McAdams 2011]: in the
//! signed singular values `Ψ = μ Σ (σ_a - 1)² + λ/2 (Σ σ_a - 3)²`, so that with `Ψ_a = ∂Ψ/∂σ_a`
//! ```text
//! scalings 2 μ I + λ 1 1ᵀ,   flips 2 μ,   twists 2 μ + (2 λ tr(S - I) - 4 μ) / (σ_b + σ_c).
//! ```
//! Inversion: the smallest singular value turns negative and `R` stays proper [Irving 2004]. Where two singular values
//! cancel (`σ_2 = -σ_3`) the energy has a ridge and `R` jumps; there the denominator is held at [`RIDGE`] or above, and
//! the tangent is exact everywhere else. Small strain only: the law collapses volume under strong compression.

#![allow(non_snake_case)]

use nalgebra::Matrix3;
use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::{
    Lame, Law,
    kernel::{PrincipalLaw, principal::PrincipalResponse, principal_forces, principal_pack},
    lame::{ElasticParameters, elastic_moduli, elastic_parameters},
    principal::PrincipalTangent,
};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    lanes::{Real, Vec3},
    pack::{DeformedPack, PackMatrices},
    rotation::{polar_rotation, signed_svd},
};

/// Smallest sum of two singular values in the derivative of the rotation.
pub const RIDGE: f64 = 1e-6;

/// Corotational linear material. In files either `young` and `poisson`, or `mu` and `lambda`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct Corotational {
    /// Young's modulus (Pa), positive.
    pub young: f64,
    /// Poisson's ratio, in `(-1, 0.5)`.
    pub poisson: f64,
}

elastic_parameters!(Corotational, "corotational");

impl Corotational {
    #[inline]
    fn stress(&self, F: &Matrix3<f64>, R: &Matrix3<f64>) -> Matrix3<f64> {
        let Lame { mu, lambda } = self.small_strain();
        // tr(S - I) = R : (F - R), without the cancellation of tr(S) - 3.
        let difference = F - R;
        difference * (2.0 * mu) + R * (lambda * R.dot(&difference))
    }
}

impl PrincipalLaw for Corotational {
    #[inline(always)]
    fn principal<T: Real>(&self, s: &Vec3<T>) -> PrincipalResponse<T> {
        let Lame { mu, lambda } = self.small_strain();
        let stretch = [s[0] - 1.0, s[1] - 1.0, s[2] - 1.0];
        let trace = stretch[0] + stretch[1] + stretch[2];
        let (mut stress, mut twist) = (*s, *s);
        for a in 0..3 {
            stress[a] = stretch[a] * (2.0 * mu) + trace * lambda;
            let sum = s[(a + 1) % 3] + s[(a + 2) % 3];
            twist[a] = (trace * (2.0 * lambda) - 4.0 * mu) / sum.larger(sum.constant(RIDGE)) + 2.0 * mu;
        }
        let at = |value: f64| s[0].constant(value);
        let (diagonal, other) = (at(2.0 * mu + lambda), at(lambda));
        let scaling = [diagonal, other, other, diagonal, other, diagonal];
        PrincipalResponse { stress, scaling, flip: [at(2.0 * mu); 3], twist }
    }
}

impl Law for Corotational {
    elastic_moduli!();

    fn is_continued(&self) -> bool {
        false
    }

    fn energy_density(&self, F: &Matrix3<f64>) -> f64 {
        let Lame { mu, lambda } = self.small_strain();
        let R = polar_rotation(F);
        let difference = F - R;
        let trace = R.dot(&difference);
        mu * difference.norm_squared() + 0.5 * lambda * trace * trace
    }

    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
        self.stress(F, &polar_rotation(F))
    }

    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, filter: bool, out: &mut ElementMatrices) -> bool {
        let F = edges * element.inverse_rest_edges;
        let svd = signed_svd(&F);
        // NaN in F passes through the difference F - R into the forces and is reported.
        out.forces = element.forces(&self.stress(&F, &(svd.U * svd.V.transpose())));
        let mut tangent = PrincipalTangent::new(svd, &self.principal(svd.sigma.as_ref()));
        let acted = filter && tangent.filter();
        tangent.blocks(element, &mut out.blocks);
        acted
    }

    fn pack(&self, at: &DeformedPack<'_>, filter: bool, out: &mut PackMatrices) {
        principal_pack(Arch::new(), self, at, filter, out);
    }

    fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices) {
        principal_forces(Arch::new(), self, at, out);
    }
}
