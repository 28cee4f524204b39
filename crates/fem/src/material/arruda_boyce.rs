//! Arruda-Boyce eight-chain law as a series of five terms, isochoric [Arruda, Boyce 1993; Marchesseau 2010].
//!
//! ```text
//! Ψ = m Σ_{p=1..5} w_p N^(1-p) (J^(-2p/3) I1^p - 3^p) + k/2 ln²J       J/m³
//! w = 1/2, 1/20, 11/1050, 19/7000, 519/673750
//! ```
//! with the chain density `m` (Pa) and `N` links in a chain: chains lock near a stretch of `√N`. At small strain the
//! shear modulus is `μ = 2 m Σ p w_p (3/N)^(p-1)`, 1.085 `m` for `N = 8`, and the bulk modulus `k`.
//!
//! Departure: the powers and the logarithm of `J` are continued below `J0 = 0.2`, twice continuously differentiably;
//! inverted elements are driven back by the bulk term.

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame, MaterialError,
    hyperelastic::{Hyperelastic, Isotropic, Response, StrainFactor},
    lame::{validate_positive, validate_young_poisson},
    volume::{guarded, logarithmic, power_of},
};
use crate::lanes::Real;

/// Links in a chain where none are given: the value of the liver model [Marchesseau 2010].
pub const DEFAULT_LINKS: f64 = 8.0;

/// Coefficients of the series of the inverse Langevin function, for one link.
const SERIES: [f64; 5] = [1.0 / 2.0, 1.0 / 20.0, 11.0 / 1050.0, 19.0 / 7000.0, 519.0 / 673_750.0];

/// Arruda-Boyce material. In files either `modulus` and `bulk`, or `young` and `poisson`; `links` with both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parameters")]
pub struct ArrudaBoyce {
    /// Modulus of the chain density `m` (Pa), positive.
    pub modulus: f64,
    /// Bulk modulus (Pa), positive.
    pub bulk: f64,
    /// Links in a chain `N`, >= 2. Default: 8.
    pub links: f64,
}

/// The two ways to write the parameters.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    young: Option<f64>,
    poisson: Option<f64>,
    modulus: Option<f64>,
    bulk: Option<f64>,
    links: Option<f64>,
}

impl TryFrom<Parameters> for ArrudaBoyce {
    type Error = MaterialError;

    fn try_from(p: Parameters) -> Result<Self, MaterialError> {
        let links = p.links.unwrap_or(DEFAULT_LINKS);
        let law = match (p.young, p.poisson, p.modulus, p.bulk) {
            (Some(young), Some(poisson), None, None) => {
                validate_young_poisson(young, poisson)?;
                Self::with_links(young, poisson, links)
            }
            (None, None, Some(modulus), Some(bulk)) => Self { modulus, bulk, links },
            _ => {
                let sets = "`modulus` and `bulk`, or `young` and `poisson`, and `links` with either";
                return Err(MaterialError::ParameterSet { law: "arruda_boyce", sets });
            }
        };
        Hyperelastic::validate(&law)?;
        Ok(law)
    }
}

impl ArrudaBoyce {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain, with [`DEFAULT_LINKS`]; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self::with_links(young, poisson, DEFAULT_LINKS)
    }

    /// From Young's modulus (Pa) and Poisson's ratio at small strain, and the links of a chain; not validated.
    pub fn with_links(young: f64, poisson: f64, links: f64) -> Self {
        let lame = Lame::from_young_poisson(young, poisson);
        Self { modulus: lame.mu / initial_shear(links), bulk: lame.bulk(), links }
    }
}

/// Shear modulus at small strain over the modulus of the chain density.
#[inline]
fn initial_shear(links: f64) -> f64 {
    let ratio = 3.0 / links;
    // Horner's scheme for 2 Σ p w_p ratio^(p-1).
    2.0 * (1..=5).rev().fold(0.0, |sum, p| sum * ratio + f64::from(p) * SERIES[p as usize - 1])
}

impl Hyperelastic for ArrudaBoyce {
    const MIXED: bool = true;
    const CURVED: bool = true;
    const CONTINUED: bool = true;

    fn validate(&self) -> Result<(), MaterialError> {
        validate_positive("modulus", self.modulus, "positive and finite in Pa (liver: 770)")?;
        validate_positive("bulk", self.bulk, "positive and finite in Pa (soft tissue: 1e4 to 1e7)")?;
        if !(self.links >= 2.0 && self.links.is_finite()) {
            let range = ">= 2 links and finite (8 for liver)";
            return Err(MaterialError::OutOfRange { name: "links", value: self.links, range });
        }
        Ok(())
    }

    #[inline]
    fn small_strain(&self) -> Lame {
        Lame::from_shear_bulk(self.modulus * initial_shear(self.links), self.bulk)
    }

    fn relaxed(&self, share: f64) -> Self {
        Self { modulus: self.modulus * (1.0 - share), ..*self }
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        Some((Self { bulk: 0.0, ..*self }, Bulk::Logarithmic { modulus: self.bulk }))
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, _: T, J: T) -> Response<T> {
        let (zero, one) = (J.constant(0.0), J.constant(1.0));
        let j = guarded(J);
        let root = j.value.powf(-1.0 / 3.0);
        let factor = root * root;
        let mut response = Response::volume(&logarithmic(0.0, self.bulk, J));
        // J^(-2p/3), c_p = m w_p N^(1-p), I1^(p-2) and 3^p, raised by one power in each turn; I1 >= 0 may vanish.
        let (mut power, mut c, mut rest) = (one, self.modulus, 1.0);
        let (mut lower, mut low) = (zero, one);
        for k in 0..SERIES.len() {
            let p = (k + 1) as f64;
            power = power * factor;
            rest *= 3.0;
            let c_p = c * SERIES[k];
            let g = StrainFactor {
                value: low * I1 * c_p,
                S: Isotropic { identity: low * (2.0 * c_p * p), strain: zero },
                alpha: lower * (2.0 * c_p * p * (p - 1.0)),
                beta: zero,
            };
            response = response.with(&power_of(&j, -2.0 / 3.0 * p, power), &g);
            response.energy = response.energy - c_p * rest;
            (lower, low) = (low, low * I1);
            c /= self.links;
        }
        response
    }
}
