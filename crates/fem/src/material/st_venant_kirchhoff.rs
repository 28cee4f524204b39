//! St Venant-Kirchhoff law: linear elasticity in the Green strain `E = (C - I) / 2`.
//!
//! ```text
//! Ψ = μ tr E² + λ/2 tr² E              J/m³,    one term with f = 1 in the multiplicative-Jacobian form
//! S = 2 μ E + λ tr(E) I                Pa,      dS = λ/2 tr(dC) I + μ dC
//! ```
//! A polynomial in `C`, so it exists for every `F`. It does not see the sign of `J`: an inverted element counts as its
//! mirror image and is not driven back, and the stress of a bar falls again below a stretch of `1/√3 = 0.58`. For moderate
//! strain under tension and for comparison with other codes; tissue that is pressed hard collapses.
//!
//! Its energy is so far from convex that a step may gain from it: tissue that gives way while it is squeezed speeds up by
//! more than backward Euler damps. The incremental potential of Newton's method falls nevertheless
//! ([`NewtonReport::decrease`](crate::integrator::newton::NewtonReport::decrease)).

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

use super::{
    Lame,
    hyperelastic::{Hyperelastic, Isotropic, Response},
    lame::{ElasticParameters, elastic_moduli, elastic_parameters},
};
use crate::lanes::Real;

/// St Venant-Kirchhoff material. In files either `young` and `poisson`, or `mu` and `lambda`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElasticParameters")]
pub struct StVenantKirchhoff {
    /// Young's modulus at small strain (Pa), positive.
    pub young: f64,
    /// Poisson's ratio at small strain, in `(-1, 0.5)`.
    pub poisson: f64,
}

elastic_parameters!(StVenantKirchhoff, "st_venant_kirchhoff");

impl Hyperelastic for StVenantKirchhoff {
    const MIXED: bool = false;
    const CURVED: bool = true;
    const CONTINUED: bool = false;

    elastic_moduli!();

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, I2: T, J: T) -> Response<T> {
        let Lame { mu, lambda } = self.small_strain();
        // tr E and tr E² of E = (C - I) / 2, with tr C² = I1² - 2 I2.
        let trace = (I1 - 3.0) * 0.5;
        let square = (I1 * I1 - I2 * 2.0 - I1 * 2.0 + 3.0) * 0.25;
        let zero = J.constant(0.0);
        Response {
            energy: square * mu + trace * trace * (0.5 * lambda),
            S: Isotropic { identity: trace * lambda - mu, strain: J.constant(mu) },
            S_prime: Isotropic { identity: zero, strain: zero },
            s1: zero,
            s2: zero,
            alpha: J.constant(0.5 * lambda),
            beta: J.constant(mu),
        }
    }
}
