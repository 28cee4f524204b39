//! Compressible neo-Hookean law in the multiplicative-Jacobian form [Marchesseau 2010].
//!
//! ```text
//! Ψ = μ/2 (I1 - 3)  +  f(J),    f(J) = k0/2 ln²J - μ ln J                    J/m³
//! P = μ F + f'(J) cof F,        f' = (k0 ln J - μ) / J                       Pa
//!                               f'' = (k0 (1 - ln J) + μ) / J²
//! ```
//! with `I1 = tr FᵀF`. `k0` is Lamé's `λ`: at small strain the law is linear elasticity with `(μ, k0)`.
//!
//! Departure: `ln J` ends at `J = 0`, which a step of simulation may pass. Below `J0 =` [`EXTENSION_BELOW`] `f` is
//! continued by its quadratic Taylor polynomial at `J0`. Energy, force and tangent stay derivatives of one function that
//! is twice continuously differentiable and convex in `J` there, so inverted elements are driven back with a finite
//! force. Above `J = e` (for `k0 >> μ`) the law itself softens in volume: `f''` turns negative.

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

use super::{
    Lame, MaterialError,
    hyperelastic::{Hyperelastic, Isotropic, Response, StrainFactor, VolumeFactor},
    lame::validate_young_poisson,
};
use crate::lanes::Real;

/// Volume ratio below which the volumetric energy is continued by a quadratic. Tissue that is crushed to a fifth of its
/// volume is beyond any measured law; above, the law is exact.
pub const EXTENSION_BELOW: f64 = 0.2;

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
            _ => Err(MaterialError::ParameterPair),
        }
    }
}

impl NeoHookean {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self { young, poisson }
    }

    /// From the parameters of the energy: shear modulus `mu` (Pa) and volumetric modulus `k0` (Pa).
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

    fn validate(&self) -> Result<(), MaterialError> {
        validate_young_poisson(self.young, self.poisson)
    }

    #[inline]
    fn small_strain(&self) -> Lame {
        Lame::from_young_poisson(self.young, self.poisson)
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
        Response::volume(&volume(mu, k0, J)).with_strain(&shear)
    }
}

/// `f, f', f''` of the volumetric term, with its extension.
#[inline(always)]
fn volume<T: Real>(mu: f64, k0: f64, J: T) -> VolumeFactor<T> {
    let end = J.constant(EXTENSION_BELOW);
    let at = J.larger(end);
    let ln = at.ln();
    let inverse = at.recip();
    let value = (ln * (0.5 * k0) - mu) * ln;
    let first = (ln * k0 - mu) * inverse;
    let second = (-(ln * k0) + (k0 + mu)) * inverse * inverse;
    // Zero above the end of the law; NaN there, and so everywhere, where J is NaN.
    let d = J - at;
    VolumeFactor { value: value + d * (first + d * second * 0.5), first: first + d * second, second }
}
