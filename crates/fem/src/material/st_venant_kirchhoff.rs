//! St Venant-Kirchhoff law: linear elasticity in the Green strain `E = (C - I) / 2`.
//!
//! ```text
//! Ψ = μ tr E² + λ/2 tr² E              J/m³,    one term with f = 1 in the multiplicative-Jacobian form
//! S = 2 μ E + λ tr(E) I                Pa,      dS = λ/2 tr(dC) I + μ dC
//! ```
//! A polynomial in `C`, so it exists for every `F`. It does not see the sign of `J`: an inverted element counts as its
//! mirror image and is not driven back, and the stress of a bar falls again below a stretch of `1/√3 = 0.58`. For moderate
//! strain under tension and for comparison with other codes; tissue that is pressed hard collapses.

#![allow(non_snake_case)]

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::{
    Lame, MaterialError,
    hyperelastic::{Hyperelastic, Response},
    lame::{ElasticParameters, validate_young_poisson},
};

/// St Venant-Kirchhoff material. In files either `young` and `poisson`, or `mu` and `lambda`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct StVenantKirchhoff {
    /// Young's modulus at small strain (Pa), positive.
    pub young: f64,
    /// Poisson's ratio at small strain, in `(-1, 0.5)`.
    pub poisson: f64,
}

impl TryFrom<ElasticParameters> for StVenantKirchhoff {
    type Error = MaterialError;

    fn try_from(p: ElasticParameters) -> Result<Self, MaterialError> {
        let (young, poisson) = p.young_poisson("st_venant_kirchhoff")?;
        Ok(Self { young, poisson })
    }
}

impl StVenantKirchhoff {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self { young, poisson }
    }
}

impl Hyperelastic for StVenantKirchhoff {
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

    #[inline]
    fn response(&self, C: &Matrix3<f64>, _J: f64) -> Response {
        let Lame { mu, lambda } = self.small_strain();
        let E = (C - Matrix3::identity()) * 0.5;
        let trace = E.trace();
        Response {
            energy: mu * E.norm_squared() + 0.5 * lambda * trace * trace,
            S: E * (2.0 * mu) + Matrix3::from_diagonal_element(lambda * trace),
            alpha: 0.5 * lambda,
            beta: mu,
            ..Response::default()
        }
    }
}
