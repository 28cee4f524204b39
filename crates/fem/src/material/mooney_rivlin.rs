//! Mooney-Rivlin law, isochoric, in the multiplicative-Jacobian form [Marchesseau 2010].
//!
//! ```text
//! Ψ = c1 (J^(-2/3) I1 - 3) + c2 (J^(-4/3) I2 - 3) + k/2 ln²J          J/m³
//! ```
//! with `I1 = tr C`, `I2 = (tr²C - tr C²) / 2`. At small strain the shear modulus is `2 (c1 + c2)` and the bulk modulus `k`.
//!
//! Departure: the powers and the logarithm of `J` are continued below `J0 = 0.2`, twice continuously differentiably;
//! inverted elements are driven back by the bulk term. From Young and Poisson `c1 = c2 = μ/4`; who knows another ratio
//! gives the coefficients.

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame, MaterialError,
    hyperelastic::{Hyperelastic, Isotropic, Response, StrainFactor, VolumeFactor},
    lame::{validate_positive, validate_young_poisson},
    volume::{guarded, logarithmic, power_of},
};
use crate::lanes::Real;

/// Mooney-Rivlin material. In files either `c1`, `c2` and `bulk`, or `young` and `poisson`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parameters")]
pub struct MooneyRivlin {
    /// Coefficient of `I1` (Pa), >= 0.
    pub c1: f64,
    /// Coefficient of `I2` (Pa), >= 0; `c1 + c2` is positive.
    pub c2: f64,
    /// Bulk modulus (Pa), positive.
    pub bulk: f64,
}

/// The two ways to write the parameters.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    young: Option<f64>,
    poisson: Option<f64>,
    c1: Option<f64>,
    c2: Option<f64>,
    bulk: Option<f64>,
}

impl TryFrom<Parameters> for MooneyRivlin {
    type Error = MaterialError;

    fn try_from(p: Parameters) -> Result<Self, MaterialError> {
        let law = match (p.young, p.poisson, p.c1, p.c2, p.bulk) {
            (Some(young), Some(poisson), None, None, None) => {
                validate_young_poisson(young, poisson)?;
                Self::from_young_poisson(young, poisson)
            }
            (None, None, Some(c1), Some(c2), Some(bulk)) => Self { c1, c2, bulk },
            _ => {
                let sets = "`c1`, `c2` and `bulk`, or `young` and `poisson`";
                return Err(MaterialError::ParameterSet { law: "mooney_rivlin", sets });
            }
        };
        Hyperelastic::validate(&law)?;
        Ok(law)
    }
}

impl MooneyRivlin {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain, with `c1 = c2`; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        let lame = Lame::from_young_poisson(young, poisson);
        Self { c1: 0.25 * lame.mu, c2: 0.25 * lame.mu, bulk: lame.bulk() }
    }
}

impl Hyperelastic for MooneyRivlin {
    const MIXED: bool = true;
    const CURVED: bool = true;
    const CONTINUED: bool = true;

    fn validate(&self) -> Result<(), MaterialError> {
        for (name, value) in [("c1", self.c1), ("c2", self.c2)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(MaterialError::OutOfRange { name, value, range: ">= 0 Pa and finite" });
            }
        }
        validate_positive("c1 + c2", self.c1 + self.c2, "positive in Pa (half the shear modulus)")?;
        validate_positive("bulk", self.bulk, "positive and finite in Pa (soft tissue: 1e4 to 1e7)")
    }

    #[inline]
    fn small_strain(&self) -> Lame {
        Lame::from_shear_bulk(2.0 * (self.c1 + self.c2), self.bulk)
    }

    fn relaxed(&self, share: f64) -> Self {
        Self { c1: self.c1 * (1.0 - share), c2: self.c2 * (1.0 - share), bulk: self.bulk }
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        Some((Self { bulk: 0.0, ..*self }, Bulk::Logarithmic { modulus: self.bulk }))
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, I2: T, J: T) -> Response<T> {
        let zero = J.constant(0.0);
        let first = StrainFactor {
            value: I1 * self.c1,
            S: Isotropic { identity: J.constant(2.0 * self.c1), strain: zero },
            alpha: zero,
            beta: zero,
        };
        let j = guarded(J);
        let root = j.value.powf(-1.0 / 3.0);
        let root2 = root * root;
        let bulk = logarithmic(0.0, self.bulk, J);
        let rest = VolumeFactor { value: bulk.value - 3.0 * (self.c1 + self.c2), ..bulk };
        Response::volume(&rest)
            .with(&power_of(&j, -2.0 / 3.0, root2), &first)
            .with(&power_of(&j, -4.0 / 3.0, root2 * root2), &second_invariant(I1, I2, self.c2))
    }
}

/// `g = c I2` with its derivatives.
#[inline(always)]
pub(super) fn second_invariant<T: Real>(I1: T, I2: T, c: f64) -> StrainFactor<T> {
    StrainFactor {
        value: I2 * c,
        S: Isotropic { identity: I1 * (2.0 * c), strain: I1.constant(-2.0 * c) },
        alpha: I1.constant(2.0 * c),
        beta: I1.constant(-2.0 * c),
    }
}
