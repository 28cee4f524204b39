//! Stable neo-Hookean law [Smith, De Goes, Kim 2018, equations 14 to 16].
//!
//! ```text
//! Ψ = μ/2 (I1 - 3) - μ/2 ln((I1 + 1) / 4) - 3/4 μ (J - 1) + λ/2 (J - 1)²        J/m³
//! P = μ (1 - 1/(I1 + 1)) F + (λ (J - 1) - 3/4 μ) cof F                          Pa
//! ```
//! the paper's energy less its value at rest, with its re-parameterisation: for linear elasticity with Lamé's `(μ_L, λ_L)`
//! at small strain, `μ = 4/3 μ_L` and `λ = λ_L + 5/6 μ_L`.
//!
//! There is no `ln J`: energy, force and tangent are smooth for every `F`, inverted or flat, without any continuation, and
//! the force of an inverted element leads back. The logarithm of `I1 + 1 >= 1` keeps a body that is crushed to a point from
//! being stable there. The price is realism under strong compression: the energy of a flat element is finite.

#![allow(non_snake_case)]

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame, MaterialError,
    hyperelastic::{Hyperelastic, Response, VolumeFactor},
    lame::{ElasticParameters, validate_young_poisson},
};

/// Stable neo-Hookean material. In files either `young` and `poisson`, or Lamé's `mu` and `lambda` at small strain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct StableNeoHookean {
    /// Young's modulus at small strain (Pa), positive.
    pub young: f64,
    /// Poisson's ratio at small strain, in `(-1, 0.5)`.
    pub poisson: f64,
}

impl TryFrom<ElasticParameters> for StableNeoHookean {
    type Error = MaterialError;

    fn try_from(p: ElasticParameters) -> Result<Self, MaterialError> {
        let (young, poisson) = p.young_poisson("stable_neo_hookean")?;
        Ok(Self { young, poisson })
    }
}

impl StableNeoHookean {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self { young, poisson }
    }
}

impl Hyperelastic for StableNeoHookean {
    const MIXED: bool = false;
    const CURVED: bool = true;

    fn validate(&self) -> Result<(), MaterialError> {
        validate_young_poisson(self.young, self.poisson)
    }

    #[inline]
    fn small_strain(&self) -> Lame {
        Lame::from_young_poisson(self.young, self.poisson)
    }

    fn relaxed(&self, share: f64) -> Self {
        let lame = Hyperelastic::small_strain(self).relaxed(share);
        Self { young: lame.young(), poisson: lame.poisson() }
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        let Lame { mu, lambda } = Hyperelastic::small_strain(self);
        Some((Self { young: 2.0 * mu, poisson: 0.0 }, Bulk::Quadratic { modulus: lambda }))
    }

    #[inline]
    fn response(&self, C: &Matrix3<f64>, J: f64) -> Response {
        let Lame { mu, lambda } = self.small_strain();
        let (mu, lambda) = (mu * 4.0 / 3.0, lambda + mu * 5.0 / 6.0);
        let I1 = C.trace();
        let inverse = (I1 + 1.0).recip();
        let mut response = Response {
            energy: 0.5 * mu * ((I1 - 3.0) - (0.25 * (I1 + 1.0)).ln()),
            S: Matrix3::from_diagonal_element(mu * (1.0 - inverse)),
            alpha: mu * inverse * inverse,
            ..Response::default()
        };
        let d = J - 1.0;
        response.add_volume(&VolumeFactor {
            value: (0.5 * lambda * d - 0.75 * mu) * d,
            first: lambda * d - 0.75 * mu,
            second: lambda,
        });
        response
    }
}
