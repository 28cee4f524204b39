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

use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame,
    hyperelastic::{Hyperelastic, Isotropic, Response, StrainFactor, VolumeFactor},
    lame::{ElasticParameters, elastic_moduli, elastic_parameters},
};
use crate::lanes::Real;

/// Stable neo-Hookean material. In files either `young` and `poisson`, or Lamé's `mu` and `lambda` at small strain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct StableNeoHookean {
    /// Young's modulus at small strain (Pa), positive.
    pub young: f64,
    /// Poisson's ratio at small strain, in `(-1, 0.5)`.
    pub poisson: f64,
}

elastic_parameters!(StableNeoHookean, "stable_neo_hookean");

impl Hyperelastic for StableNeoHookean {
    const MIXED: bool = false;
    const CURVED: bool = true;
    const CONTINUED: bool = false;

    elastic_moduli!();

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        let Lame { mu, lambda } = Hyperelastic::small_strain(self);
        Some((Self { young: 2.0 * mu, poisson: 0.0 }, Bulk::Quadratic { modulus: lambda }))
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, _: T, J: T) -> Response<T> {
        let Lame { mu, lambda } = self.small_strain();
        let (mu, lambda) = (mu * 4.0 / 3.0, lambda + mu * 5.0 / 6.0);
        let zero = J.constant(0.0);
        let inverse = (I1 + 1.0).recip();
        let shear = StrainFactor {
            value: ((I1 - 3.0) - ((I1 + 1.0) * 0.25).ln()) * (0.5 * mu),
            S: Isotropic { identity: (-inverse + 1.0) * mu, strain: zero },
            alpha: inverse * inverse * mu,
            beta: zero,
        };
        let d = J - 1.0;
        let volume = VolumeFactor {
            value: (d * (0.5 * lambda) - 0.75 * mu) * d,
            first: d * lambda - 0.75 * mu,
            second: J.constant(lambda),
        };
        Response::volume(&volume).with_strain(&shear)
    }
}
