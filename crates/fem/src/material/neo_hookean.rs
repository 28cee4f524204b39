//! Compressible neo-Hookean law in the multiplicative-Jacobian form [Marchesseau 2010].
//!
//! ```text
//! Ψ = μ/2 (I1 - 3)  +  f(J),    f(J) = k0/2 ln²J - μ ln J                    J/m³
//! P = μ F + f'(J) cof F,        f' = (k0 ln J - μ) / J                       Pa
//!                               f'' = (k0 (1 - ln J) + μ) / J²
//! ```
//! with `I1 = tr FᵀF`. `k0` is Lamé's `λ`: at small strain the law is linear elasticity with `(μ, k0)`.
//!
//! Departure: below `J0 =` [`EXTENSION_BELOW`] `f` goes on as its quadratic Taylor polynomial at `J0`, twice continuously
//! differentiable and convex in `J`, so inverted elements are driven back with a finite force. Above `J = e` (for
//! `k0 >> μ`) the law itself softens in volume: `f''` turns negative.

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

pub use super::volume::EXTENSION_BELOW;
use super::{
    Bulk, Lame, MaterialError,
    hyperelastic::{Hyperelastic, Isotropic, Response, StrainFactor},
    lame::{elastic_moduli, validate_young_poisson},
    volume::logarithmic,
};
use crate::lanes::Real;

/// Compressible neo-Hookean material. In files either `young` and `poisson`, or `mu` and `k0`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parameters")]
pub struct NeoHookean {
    /// Young's modulus at small strain (Pa), positive.
    pub young: f64,
    /// Poisson's ratio at small strain, in `(-1, 0.5)`.
    pub poisson: f64,
}

/// The two ways to write the parameters.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    young: Option<f64>,
    poisson: Option<f64>,
    mu: Option<f64>,
    k0: Option<f64>,
}

impl TryFrom<Parameters> for NeoHookean {
    type Error = MaterialError;

    fn try_from(p: Parameters) -> Result<Self, MaterialError> {
        match (p.young, p.poisson, p.mu, p.k0) {
            (Some(young), Some(poisson), None, None) => {
                validate_young_poisson(young, poisson)?;
                Ok(Self { young, poisson })
            }
            (None, None, Some(mu), Some(k0)) => Self::from_moduli(mu, k0),
            _ => {
                Err(MaterialError::ParameterSet { law: "neo_hookean", sets: "`young` and `poisson`, or `mu` and `k0`" })
            }
        }
    }
}

impl NeoHookean {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self { young, poisson }
    }

    /// From the parameters of the energy: shear modulus `mu` (Pa) and volumetric modulus `k0` (Pa).
    ///
    /// # Errors
    /// [`MaterialError::ShearModulus`], [`MaterialError::VolumeModulus`].
    pub fn from_moduli(mu: f64, k0: f64) -> Result<Self, MaterialError> {
        if !(mu > 0.0 && mu.is_finite()) {
            return Err(MaterialError::ShearModulus(mu));
        }
        let lame = Lame { mu, lambda: k0 };
        if !(lame.bulk() > 0.0 && k0.is_finite()) {
            return Err(MaterialError::VolumeModulus { k0, mu });
        }
        Ok(Self { young: lame.young(), poisson: lame.poisson() })
    }
}

impl Hyperelastic for NeoHookean {
    const MIXED: bool = false;
    const CURVED: bool = false;
    const CONTINUED: bool = true;

    elastic_moduli!();

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        let Lame { mu, lambda } = Hyperelastic::small_strain(self);
        Some((Self { young: 2.0 * mu, poisson: 0.0 }, Bulk::Logarithmic { modulus: lambda }))
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, _: T, J: T) -> Response<T> {
        let Lame { mu, lambda: k0 } = self.small_strain();
        let zero = J.constant(0.0);
        let shear = StrainFactor {
            value: (I1 - 3.0) * (0.5 * mu),
            S: Isotropic { identity: J.constant(mu), strain: zero },
            alpha: zero,
            beta: zero,
        };
        Response::volume(&logarithmic(mu, k0, J)).with_strain(&shear)
    }
}
