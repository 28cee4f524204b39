//! Functions of the volume ratio `J` that laws share, continued through flat and inverted elements.
//!
//! `ln J` and negative powers of `J` end at `J = 0`, which a step of simulation may pass. Above `J0 =`
//! [`EXTENSION_BELOW`] every function here is exact. Below,
//! * `k0/2 ln²J - μ ln J` goes on as its quadratic Taylor polynomial at `J0`: convex, so that inverted elements are
//!   driven back, the harder the further they are inverted;
//! * powers are taken of a guarded ratio `j(J)` that equals `J` above `J0`, levels off smoothly and is `J0/2` at and below
//!   `J = 0`. With `t = 1 - J/J0` in `[0, 1]`:
//!   `j = J0 (1 - t + t³ - t⁴/2)`, `j' = 1 - 3 t² + 2 t³`, `j'' = 6 t (1 - t) / J0`.
//!
//! Both are twice continuously differentiable, so energy, force and tangent stay derivatives of one function.

#![allow(non_snake_case)]

use super::hyperelastic::VolumeFactor;

/// Volume ratio below which functions of `ln J` and powers of `J` are continued. Tissue that is crushed to a fifth of
/// its volume is beyond any measured law; above, the laws are exact.
pub const EXTENSION_BELOW: f64 = 0.2;

/// `f = k0/2 ln²J - mu ln J` (Pa), with its quadratic extension. `mu = 0` gives the bulk energy of the isochoric laws.
///
/// `f''` turns negative above `J = e` (for `k0 >> mu`): the logarithmic bulk energy softens in extreme expansion.
#[inline]
pub(super) fn logarithmic(mu: f64, k0: f64, J: f64) -> VolumeFactor {
    let at = if J > EXTENSION_BELOW { J } else { EXTENSION_BELOW };
    let ln = at.ln();
    let inverse = at.recip();
    let factor = VolumeFactor {
        value: (0.5 * k0 * ln - mu) * ln,
        first: (k0 * ln - mu) * inverse,
        second: (k0 * (1.0 - ln) + mu) * inverse * inverse,
    };
    if J > EXTENSION_BELOW {
        return factor;
    }
    // Also reached by NaN, which then spreads and is reported.
    let d = J - EXTENSION_BELOW;
    VolumeFactor {
        value: factor.value + d * (factor.first + 0.5 * d * factor.second),
        first: factor.first + d * factor.second,
        second: factor.second,
    }
}

/// The guarded volume ratio `j(J)`: at least `EXTENSION_BELOW / 2`, or NaN where `J` is.
#[inline]
pub(super) fn guarded(J: f64) -> VolumeFactor {
    if J > EXTENSION_BELOW {
        return VolumeFactor { value: J, first: 1.0, second: 0.0 };
    }
    let t = 1.0 - J / EXTENSION_BELOW;
    // NaN is kept by `f64::clamp`.
    let t = t.clamp(0.0, 1.0);
    let t2 = t * t;
    VolumeFactor {
        value: EXTENSION_BELOW * (1.0 - t + t * t2 - 0.5 * t2 * t2),
        first: 1.0 - 3.0 * t2 + 2.0 * t2 * t,
        second: 6.0 * (t - t2) / EXTENSION_BELOW,
    }
}

/// `j^k` of a guarded ratio `j`, where `power` is that value.
#[inline]
pub(super) fn power_of(j: &VolumeFactor, k: f64, power: f64) -> VolumeFactor {
    let slope = k * power / j.value;
    let curvature = (k - 1.0) * slope / j.value;
    VolumeFactor { value: power, first: slope * j.first, second: curvature * j.first * j.first + slope * j.second }
}
