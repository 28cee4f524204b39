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
use crate::lanes::Real;

/// Volume ratio below which functions of `ln J` and powers of `J` are continued. Tissue that is crushed to a fifth of
/// its volume is beyond any measured law; above, the laws are exact.
pub const EXTENSION_BELOW: f64 = 0.2;

/// `f = k0/2 ln²J - mu ln J` (Pa), with its quadratic extension. `mu = 0` gives the bulk energy of the isochoric laws.
///
/// `f''` turns negative above `J = e` (for `k0 >> mu`): the logarithmic bulk energy softens in extreme expansion.
#[inline(always)]
pub(super) fn logarithmic<T: Real>(mu: f64, k0: f64, J: T) -> VolumeFactor<T> {
    let at = J.larger(J.constant(EXTENSION_BELOW));
    let ln = at.ln();
    let inverse = at.recip();
    let value = (ln * (0.5 * k0) - mu) * ln;
    let first = (ln * k0 - mu) * inverse;
    let second = (-(ln * k0) + (k0 + mu)) * inverse * inverse;
    // Zero where the law is exact; NaN, which then spreads and is reported, where J is.
    let d = J - at;
    VolumeFactor { value: value + d * (first + d * second * 0.5), first: first + d * second, second }
}

/// The guarded volume ratio `j(J)`: at least `EXTENSION_BELOW / 2`, or NaN where `J` is.
#[inline(always)]
pub(super) fn guarded<T: Real>(J: T) -> VolumeFactor<T> {
    let (zero, one) = (J.constant(0.0), J.constant(1.0));
    let t = one - J * (1.0 / EXTENSION_BELOW);
    let t = zero.or_where_not(zero.above(t), t);
    let t = one.or_where_not(t.above(one), t);
    let t2 = t * t;
    let value = (one - t + t * t2 - t2 * t2 * 0.5) * EXTENSION_BELOW;
    VolumeFactor {
        value: J.or_where_not(J.above(J.constant(EXTENSION_BELOW)), value),
        first: one - t2 * 3.0 + t2 * t * 2.0,
        second: (t - t2) * (6.0 / EXTENSION_BELOW),
    }
}

/// `j^k` of a guarded ratio `j`, where `power` is that value.
#[inline(always)]
pub(super) fn power_of<T: Real>(j: &VolumeFactor<T>, k: f64, power: T) -> VolumeFactor<T> {
    let inverse = j.value.recip();
    let slope = power * inverse * k;
    let curvature = slope * inverse * (k - 1.0);
    VolumeFactor { value: power, first: slope * j.first, second: curvature * j.first * j.first + slope * j.second }
}
