//! Veronda-Westmann law, isochoric, exponential [Veronda, Westmann 1970; Marchesseau 2010].
//!
//! ```text
//! Ψ = c1 (e^X - 1) - c1 c2 / 2 (J^(-4/3) I2 - 3) + k/2 ln²J,    X = c2 (J^(-2/3) I1 - 3)      J/m³
//! ```
//! `c1` (Pa) scales, `c2` says how fast the tissue stiffens. At small strain the shear modulus is `c1 c2` and the bulk
//! modulus `k`. The exponential is grouped: `φ(X)` with the chain rule, as [`Response::with_composed`] says. The second term
//! is negative, so that the law loses convexity in moderate strain for small `c2`; the tangent filter is for that.
//!
//! Departures: above `X0 =` [`EXPONENT_LIMIT`] the curvature of the exponential fades to zero over one unit of `X` and it goes
//! on as a straight line, twice continuously differentiable and convex; no force overflows. The powers and the logarithm of
//! `J` are continued below `J0 =` 0.2; inverted elements are driven back by the bulk term.

#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame, MaterialError,
    hyperelastic::{Hyperelastic, Response, VolumeFactor},
    lame::{validate_positive, validate_young_poisson},
    mooney_rivlin::second_invariant,
    volume::{guarded, logarithmic, power_of},
};
use crate::lanes::Real;

/// Exponent above which the exponential goes on straight. There the tissue is `e^9.2 = 1e4` times stiffer than at rest: the
/// largest ratio of stiffness that a body may have ([`MAX_STIFFNESS_RATIO`](crate::model::MAX_STIFFNESS_RATIO)).
pub const EXPONENT_LIMIT: f64 = 9.2;

/// Stiffening `c2` where none is given, a choice of ours: at a simple shear of 0.5 the stress is 1.57 times the linear one.
pub const DEFAULT_STIFFENING: f64 = 1.0;

/// Veronda-Westmann material. In files either `c1`, `c2` and `bulk`, or `young`, `poisson` and, if wished, `c2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parameters")]
pub struct VerondaWestmann {
    /// Scale of the exponential (Pa), positive.
    pub c1: f64,
    /// Stiffening, a number in `(0, 100]`. Default: 1.
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

impl TryFrom<Parameters> for VerondaWestmann {
    type Error = MaterialError;

    fn try_from(p: Parameters) -> Result<Self, MaterialError> {
        let law = match (p.young, p.poisson, p.c1, p.c2, p.bulk) {
            (Some(young), Some(poisson), None, c2, None) => {
                validate_young_poisson(young, poisson)?;
                Self::with_stiffening(young, poisson, c2.unwrap_or(DEFAULT_STIFFENING))
            }
            (None, None, Some(c1), Some(c2), Some(bulk)) => Self { c1, c2, bulk },
            _ => {
                let sets = "`c1`, `c2` and `bulk`, or `young`, `poisson` and, if wished, `c2`";
                return Err(MaterialError::ParameterSet { law: "veronda_westmann", sets });
            }
        };
        Hyperelastic::validate(&law)?;
        Ok(law)
    }
}

impl VerondaWestmann {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain, with [`DEFAULT_STIFFENING`]; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self::with_stiffening(young, poisson, DEFAULT_STIFFENING)
    }

    /// From Young's modulus (Pa) and Poisson's ratio at small strain, and the stiffening; not validated.
    pub fn with_stiffening(young: f64, poisson: f64, c2: f64) -> Self {
        let lame = Lame::from_young_poisson(young, poisson);
        Self { c1: lame.mu / c2, c2, bulk: lame.bulk() }
    }
}

impl Hyperelastic for VerondaWestmann {
    const MIXED: bool = true;
    const CURVED: bool = true;
    const CONTINUED: bool = true;

    fn validate(&self) -> Result<(), MaterialError> {
        if !(self.c2 > 0.0 && self.c2 <= 100.0) {
            let range = "in 0 < c2 <= 100, a number (soft tissue: 0.1 to 20)";
            return Err(MaterialError::OutOfRange { name: "c2", value: self.c2, range });
        }
        validate_positive("c1", self.c1, "positive and finite in Pa (c1 c2 is the shear modulus)")?;
        validate_positive("bulk", self.bulk, "positive and finite in Pa (soft tissue: 1e4 to 1e7)")
    }

    #[inline]
    fn small_strain(&self) -> Lame {
        Lame::from_shear_bulk(self.c1 * self.c2, self.bulk)
    }

    fn relaxed(&self, share: f64) -> Self {
        Self { c1: self.c1 * (1.0 - share), ..*self }
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        Some((Self { bulk: 0.0, ..*self }, Bulk::Logarithmic { modulus: self.bulk }))
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, I2: T, J: T) -> Response<T> {
        let Self { c1, c2, bulk } = *self;
        let j = guarded(J);
        let root = j.value.powf(-1.0 / 3.0);
        let root2 = root * root;
        let f = power_of(&j, -2.0 / 3.0, root2);
        let scaled = VolumeFactor { value: f.value * c2, first: f.first * c2, second: f.second * c2 };
        let phi = exponential(c1, (f.value * I1 - 3.0) * c2);
        let bulk = logarithmic(0.0, bulk, J);
        let rest = VolumeFactor { value: bulk.value + 1.5 * c1 * c2, ..bulk };
        Response::volume(&rest)
            .with_composed(&phi, &scaled, I1)
            .with(&power_of(&j, -4.0 / 3.0, root2 * root2), &second_invariant(I1, I2, -0.5 * c1 * c2))
    }
}

/// `φ = c (e^X - 1)` with its derivatives, continued above [`EXPONENT_LIMIT`]: with `d = X - X0` and `t = min(d, 1)`
/// `φ'' = c e^X0 (1 - t)`, integrated twice.
#[inline(always)]
fn exponential<T: Real>(c: f64, X: T) -> VolumeFactor<T> {
    let (one, limit) = (X.constant(1.0), X.constant(EXPONENT_LIMIT));
    let at = X.or_where_not(limit.above(X), limit);
    // Zero where the exponential is exact; NaN, which then spreads and is reported, where X is.
    let d = X - at;
    let t = one.or_where_not(d.above(one), d);
    let straight = d - t;
    let e = at.exp();
    let grown = t + t * t * (t * (-1.0 / 6.0) + 0.5) + straight * 1.5;
    VolumeFactor {
        value: ((e - 1.0) + e * grown) * c,
        first: e * (one + t - t * t * 0.5) * c,
        second: e * (one - t) * c,
    }
}
