//! Ogden law of first order, isochoric, in the principal stretches [Ogden 1972].
//!
//! ```text
//! Ψ = 2 μ / α² (J^(-α/3) Σ_a g(c_a) - 3) + k/2 ln²J,    g(c) = c^(α/2),  c_a = σ_a²        J/m³
//! P = U diag(Ψ_a) Vᵀ,                                    Ψ_a = ∂Ψ/∂σ_a                     Pa
//! ```
//! with the signed singular values `σ` of `F` (`J = σ_1 σ_2 σ_3`). `μ` is the shear modulus at small strain (the usual
//! convention; that of the multiplicative-Jacobian paper is half of it), `k` the bulk modulus; `α > 0` stiffens in tension,
//! `α < 0` in compression, `α = 2` is neo-Hookean. With `h = g'` and the divided difference `D = (h_b - h_c) / (c_b - c_c)`,
//! which is computed without cancellation and is `h'` at repeated stretches, the tangent in the principal frame has
//! ```text
//! flip  = m ((h_b + h_c) + (σ_b + σ_c)² D) - s1 σ_a          m = 2 μ / α² J^(-α/3),   s1 = ∂Ψ/∂J at fixed C
//! twist = m ((h_b + h_c) + (σ_b - σ_c)² D) + s1 σ_a
//! ```
//! Departures: below a stretch of [`STRETCH_FLOOR`] `g` goes on as its quadratic Taylor polynomial in `c`, since powers of a
//! vanishing stretch have no derivative; the power and the logarithm of `J` are continued below `J0 =`
//! 0.2. All stay twice continuously differentiable; inverted elements are driven back by the
//! bulk term.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};
use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::{
    Bulk, Lame, Law, MaterialError,
    hyperelastic::VolumeFactor,
    kernel::{PrincipalLaw, principal::PrincipalResponse, principal_forces, principal_pack},
    lame::{validate_positive, validate_young_poisson},
    principal::PrincipalTangent,
    volume::{guarded, logarithmic, power_of},
};
use crate::{
    element::{ElementMatrices, Tetrahedron},
    lanes::{Real, Vec3},
    pack::{DeformedPack, PackMatrices},
    rotation::{SignedSvd, signed_svd},
};

/// Principal stretch below which the power is continued; the length of a fibre that is crushed to a fifth is beyond any
/// measured law.
pub const STRETCH_FLOOR: f64 = 0.2;

const FLOOR: f64 = STRETCH_FLOOR * STRETCH_FLOOR;

/// Exponent `alpha` where none is given, a choice of ours: at a simple shear of 0.5 the stress is 1.72 times the linear one.
pub const DEFAULT_ALPHA: f64 = 8.0;

/// Ogden material of first order. In files either `mu`, `alpha` and `bulk`, or `young`, `poisson` and, if wished, `alpha`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parameters")]
pub struct Ogden {
    /// Shear modulus at small strain (Pa), positive.
    pub mu: f64,
    /// Exponent, a number in `[-20, 20]` but not zero. Default: 8.
    pub alpha: f64,
    /// Bulk modulus (Pa), positive.
    pub bulk: f64,
}

/// The two ways to write the parameters.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    young: Option<f64>,
    poisson: Option<f64>,
    mu: Option<f64>,
    alpha: Option<f64>,
    bulk: Option<f64>,
}

impl TryFrom<Parameters> for Ogden {
    type Error = MaterialError;

    fn try_from(p: Parameters) -> Result<Self, MaterialError> {
        let law = match (p.young, p.poisson, p.mu, p.alpha, p.bulk) {
            (Some(young), Some(poisson), None, alpha, None) => {
                validate_young_poisson(young, poisson)?;
                Self { alpha: alpha.unwrap_or(DEFAULT_ALPHA), ..Self::from_young_poisson(young, poisson) }
            }
            (None, None, Some(mu), Some(alpha), Some(bulk)) => Self { mu, alpha, bulk },
            _ => {
                let sets = "`mu`, `alpha` and `bulk`, or `young`, `poisson` and, if wished, `alpha`";
                return Err(MaterialError::ParameterSet { law: "ogden", sets });
            }
        };
        law.validate()?;
        Ok(law)
    }
}

impl Ogden {
    /// From Young's modulus (Pa) and Poisson's ratio at small strain, with [`DEFAULT_ALPHA`]; not validated.
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        let lame = Lame::from_young_poisson(young, poisson);
        Self { mu: lame.mu, alpha: DEFAULT_ALPHA, bulk: lame.bulk() }
    }

    #[inline(always)]
    fn state<T: Real>(&self, s: &Vec3<T>) -> Principal<T> {
        let Self { mu, alpha, bulk } = *self;
        let dJ = [s[1] * s[2], s[2] * s[0], s[0] * s[1]];
        let J = s[0] * dJ[0];
        let scale = 2.0 * mu / (alpha * alpha);
        let j = guarded(J);
        let f = power_of(&j, -alpha / 3.0, j.value.powf(-alpha / 3.0));
        let k = 0.5 * alpha;
        let g = [stretch_power(k, s[0] * s[0]), stretch_power(k, s[1] * s[1]), stretch_power(k, s[2] * s[2])];
        let sum = g[0].value + g[1].value + g[2].value;
        let volume = logarithmic(0.0, bulk, J);
        Principal {
            energy: (f.value * sum - 3.0) * scale + volume.value,
            s1: f.first * sum * scale + volume.first,
            s2: f.second * sum * scale + volume.second,
            m: f.value * scale,
            m_prime: f.first * scale,
            g,
            dJ,
        }
    }

    /// Forces and tangent at a state of the law; whether the filter acted.
    fn element_at(
        &self,
        element: &Tetrahedron,
        svd: SignedSvd,
        state: &Principal<f64>,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> bool {
        out.forces = element.forces(&state.stress(&svd));
        let mut tangent = PrincipalTangent::new(svd, &self.derivatives(svd.sigma.as_ref(), state));
        let acted = filter && tangent.filter();
        tangent.blocks(element, &mut out.blocks);
        acted
    }

    /// The derivatives by the singular values `s` at a state of the law.
    #[inline(always)]
    fn derivatives<T: Real>(&self, s: &Vec3<T>, p: &Principal<T>) -> PrincipalResponse<T> {
        let (mut stress, mut flip, mut twist) = (*s, *s, *s);
        let mut scaling = [p.m; 6];
        let mut k = 0;
        for a in 0..3 {
            let h = p.g[a].first;
            stress[a] = s[a] * h * p.m * 2.0 + p.dJ[a] * p.s1;
            for e in a..3 {
                let mixed = s[a] * h * p.dJ[e] + p.dJ[a] * s[e] * p.g[e].first;
                let same =
                    if a == e { (h + s[a] * s[a] * p.g[a].second * 2.0) * p.m * 2.0 } else { p.s1 * s[3 - a - e] };
                scaling[k] = p.s2 * p.dJ[a] * p.dJ[e] + p.m_prime * mixed * 2.0 + same;
                k += 1;
            }
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            let mean = p.g[b].first + p.g[c].first;
            let difference = divided_difference(0.5 * self.alpha, s[b] * s[b], s[c] * s[c]);
            let (sum, gap) = (s[b] + s[c], s[b] - s[c]);
            flip[a] = p.m * (mean + sum * sum * difference) - p.s1 * s[a];
            twist[a] = p.m * (mean + gap * gap * difference) + p.s1 * s[a];
        }
        PrincipalResponse { stress, scaling, flip, twist }
    }
}

impl PrincipalLaw for Ogden {
    #[inline(always)]
    fn principal<T: Real>(&self, sigma: &Vec3<T>) -> PrincipalResponse<T> {
        self.derivatives(sigma, &self.state(sigma))
    }
}

/// The law at given singular values; letters as in the module's documentation.
struct Principal<T> {
    energy: T,
    s1: T,
    s2: T,
    m: T,
    /// `∂m/∂J`.
    m_prime: T,
    /// `g, h, h'` of each stretch.
    g: [VolumeFactor<T>; 3],
    /// `∂J/∂σ`.
    dJ: Vec3<T>,
}

impl Principal<f64> {
    /// `P = U diag(Ψ_a) Vᵀ`.
    fn stress(&self, svd: &SignedSvd) -> Matrix3<f64> {
        let h = Vector3::new(self.g[0].first, self.g[1].first, self.g[2].first);
        let along = svd.sigma.component_mul(&h) * (2.0 * self.m) + Vector3::from(self.dJ) * self.s1;
        svd.U * Matrix3::from_diagonal(&along) * svd.V.transpose()
    }
}

/// `g = c^k` with `h = g'` and `h'`, with its quadratic extension below the square of [`STRETCH_FLOOR`].
#[inline(always)]
fn stretch_power<T: Real>(k: f64, c: T) -> VolumeFactor<T> {
    let at = c.larger(c.constant(FLOOR));
    let inverse = at.recip();
    let value = at.powf(k);
    let first = value * inverse * k;
    let second = first * inverse * (k - 1.0);
    // Zero above the floor; NaN, which then spreads and is reported, where the stretch is.
    let d = c - at;
    VolumeFactor { value: value + d * (first + d * second * 0.5), first: first + d * second, second }
}

/// `(h(b) - h(c)) / (b - c)` for `h` of [`stretch_power`]; its limit `h'` where `b = c`.
///
/// Above the floor it is `k c^(k-2) (e^((k-1) t) - 1) / (e^t - 1)` with `t = ln(b / c)`, which cancels nothing; where one
/// or both lie below, the mean over the parts, since `h` is straight there.
#[inline(always)]
fn divided_difference<T: Real>(k: f64, b: T, c: T) -> T {
    let (zero, floor) = (b.constant(0.0), b.constant(FLOOR));
    let ordered = c.above(b);
    let (low, high) = (b.or_where_not(ordered, c), c.or_where_not(ordered, b));
    let from = low.larger(floor);
    let ratio = (high.larger(floor) - from) / from;
    let slope = ratio.map(|r| if r > 0.0 { ((k - 1.0) * r.ln_1p()).exp_m1() / r } else { k - 1.0 });
    let curved = from.powf(k - 2.0) * slope * k;
    let straight = b.constant(k * (k - 1.0) * FLOOR.powf(k - 2.0));
    let across =
        (curved * (high - floor) + straight * (floor - low)) / (high - low).larger(zero.constant(f64::MIN_POSITIVE));
    curved.or_where_not(low.above(floor), across.or_where_not(high.above(floor), straight))
}

impl Law for Ogden {
    fn validate(&self) -> Result<(), MaterialError> {
        validate_positive("mu", self.mu, "positive and finite in Pa (the shear modulus at small strain)")?;
        validate_positive("bulk", self.bulk, "positive and finite in Pa (soft tissue: 1e4 to 1e7)")?;
        if !(self.alpha.abs() <= 20.0 && self.alpha != 0.0) {
            let range = "in -20 <= alpha <= 20 and not zero (soft tissue: -10 to 15)";
            return Err(MaterialError::OutOfRange { name: "alpha", value: self.alpha, range });
        }
        Ok(())
    }

    fn small_strain(&self) -> Lame {
        Lame::from_shear_bulk(self.mu, self.bulk)
    }

    fn relaxed(&self, share: f64) -> Self {
        Self { mu: self.mu * (1.0 - share), ..*self }
    }

    fn without_bulk(&self) -> Option<(Self, Bulk)> {
        Some((Self { bulk: 0.0, ..*self }, Bulk::Logarithmic { modulus: self.bulk }))
    }

    fn is_continued(&self) -> bool {
        true
    }

    fn element_under_pressure(
        &self,
        element: &Tetrahedron,
        edges: &Matrix3<f64>,
        pressure: f64,
        filter: bool,
        out: &mut ElementMatrices,
    ) -> Option<bool> {
        let svd = signed_svd(&(edges * element.inverse_rest_edges));
        let mut state = self.state(svd.sigma.as_ref());
        state.s1 += pressure;
        Some(self.element_at(element, svd, &state, filter, out))
    }

    fn energy_density(&self, F: &Matrix3<f64>) -> f64 {
        self.state(signed_svd(F).sigma.as_ref()).energy
    }

    fn first_piola(&self, F: &Matrix3<f64>) -> Matrix3<f64> {
        let svd = signed_svd(F);
        self.state(svd.sigma.as_ref()).stress(&svd)
    }

    fn element(&self, element: &Tetrahedron, edges: &Matrix3<f64>, filter: bool, out: &mut ElementMatrices) -> bool {
        let svd = signed_svd(&(edges * element.inverse_rest_edges));
        self.element_at(element, svd, &self.state(svd.sigma.as_ref()), filter, out)
    }

    fn pack(&self, at: &DeformedPack<'_>, filter: bool, out: &mut PackMatrices) {
        principal_pack(Arch::new(), self, at, filter, out);
    }

    fn pack_forces(&self, at: &DeformedPack<'_>, out: &mut PackMatrices) {
        principal_forces(Arch::new(), self, at, out);
    }
}
