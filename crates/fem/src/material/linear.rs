//! Linear elasticity at small strain `ε = sym(F - I)`.
//!
//! ```text
//! Ψ = μ tr ε² + λ/2 tr² ε         J/m³
//! P = 2 μ ε + λ tr(ε) I           Pa,     K_ij = V0 (μ (D_i·D_j I + D_j D_iᵀ) + λ D_i D_jᵀ)
//! ```
//! The stiffness is constant: one factor serves a whole run. The law exists for every `F` and always restores, but a
//! rotation counts as strain: it stiffens and swells tissue that turns. For strain and rotation below about 5 %, for
//! comparison with theory, and as the cheapest law there is.

#![allow(non_snake_case)]

use nalgebra::Matrix3;
use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::{
    Lame, Law,
    kernel::{small_strain_forces, small_strain_pack},
    lame::{ElasticParameters, elastic_moduli, elastic_parameters},
};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    pack::{DeformedPack, PackMatrices},
};

/// Linear material. In files either `young` and `poisson`, or `mu` and `lambda`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct Linear {
    /// Young's modulus (Pa), positive.
    pub young: f64,
    /// Poisson's ratio, in `(-1, 0.5)`.
    pub poisson: f64,
}

elastic_parameters!(Linear, "linear");

impl Law for Linear {
    elastic_moduli!();

    fn is_frame_indifferent(&self) -> bool {
        false
    }

    fn is_continued(&self) -> bool {
        false
    }

    fn energy_density(&self, F: &Matrix3<f64>) -> f64 {
        let Lame { mu, lambda } = self.small_strain();
        let strain = small_strain(F);
        let trace = strain.trace();
        mu * strain.norm_squared() + 0.5 * lambda * trace * trace
    }

    #[inline]
    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
        let Lame { mu, lambda } = self.small_strain();
        let strain = small_strain(F);
        strain * (2.0 * mu) + Matrix3::from_diagonal_element(lambda * strain.trace())
    }

    #[inline]
    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, _filter: bool, out: &mut ElementMatrices) -> bool {
        let Lame { mu, lambda } = self.small_strain();
        out.forces = element.forces(&self.first_piola(&(edges * element.inverse_rest_edges)));
        // Columns are D_1, D_2, D_3.
        let D = element.inverse_rest_edges.transpose();
        let (mu, lambda) = (mu * element.volume, lambda * element.volume);
        let mut k = 0;
        for i in 0..3 {
            for j in i..3 {
                let (D_i, D_j) = (D.column(i), D.column(j));
                let mut block = D_j * (D_i * mu).transpose() + D_i * (D_j * lambda).transpose();
                let dot = mu * D_i.dot(&D_j);
                for c in 0..3 {
                    block[(c, c)] += dot;
                }
                out.blocks[k] = block;
                k += 1;
            }
        }
        // Positive semidefinite by its parameters' range.
        false
    }

    fn pack(&self, at: &DeformedPack<'_>, _filter: bool, out: &mut PackMatrices) {
        small_strain_pack(Arch::new(), self.small_strain(), at, out);
    }

    fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices) {
        small_strain_forces(Arch::new(), self.small_strain(), at, out);
    }
}

/// `ε = sym(F - I)`.
#[inline]
fn small_strain(F: &Matrix3<f64>) -> Matrix3<f64> {
    let gradient = F - Matrix3::identity();
    (gradient + gradient.transpose()) * 0.5
}
