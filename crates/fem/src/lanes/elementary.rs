//! Logarithm and exponential over [`Real`], without branches and tables.
//!
//! What the laws take logarithms and powers of is held above a positive bound, so arguments are positive and normal.
//! The same arithmetic on every machine, unlike the system's library: a run replays to the bit elsewhere. Polynomials
//! are those of fdlibm (Sun Microsystems 1993), which bound the error below one unit in the last place.

use std::f64::consts::{FRAC_1_SQRT_2, LOG2_E};

use super::Real;

/// High part of `ln 2`, exact when multiplied by a number of up to 20 bits.
const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;

/// `ln 2` less the high part.
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// Added to and taken from a number below 2^51, it rounds to the nearest integer: `1.5 * 2^52`.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// `ln x` for positive normal `x`; NaN for NaN.
///
/// `x = 2^k m` with `m` in `[√½, √2)`; with `f = m - 1` and `s = f / (2 + f)`: `ln m = f - f²/2 + s (f²/2 + R(s²))`.
#[inline(always)]
pub fn ln<T: Real>(x: T) -> T {
    let k = x.map(exponent);
    let f = x.map(mantissa) - 1.0;
    let s = f / (f + 2.0);
    let z = s * s;
    let w = z * z;
    let even = w * (w * (w * 1.531_383_769_920_937_3e-1 + 2.222_219_843_214_978_4e-1) + 3.999_999_999_940_942e-1);
    let odd = w * (w * (w * 1.479_819_860_511_658_6e-1 + 1.818_357_216_161_805e-1) + 2.857_142_874_366_239e-1);
    let r = even + z * (odd + 6.666_666_666_666_735e-1);
    let half = f * f * 0.5;
    // Zero, or NaN where `x` is: its bits have passed for a number.
    let nan = x * 0.0;
    k * LN2_HIGH - ((half - (s * (half + r) + k * LN2_LOW)) - f) + nan
}

/// `e^x` for `|x| <= 700`; larger arguments count as that; NaN for NaN.
///
/// `x = k ln 2 + r`; `e^r = 1 + r + r c / (2 - c)` with `c = r - r² P(r²)`.
#[inline(always)]
pub fn exp<T: Real>(x: T) -> T {
    let (low, high) = (x.constant(-700.0), x.constant(700.0));
    let x = high.or_where_not(x.above(high), x);
    let x = low.or_where_not(low.above(x), x);
    let rounded = x * LOG2_E + ROUND;
    let k = rounded - ROUND;
    // In [-0.35, 0.35], in two parts.
    let high = x - k * LN2_HIGH;
    let low = k * LN2_LOW;
    let r = high - low;
    let t = r * r;
    let p = t * (t * 4.138_136_797_057_238_5e-8 - 1.653_390_220_546_525_2e-6) + 6.613_756_321_437_934e-5;
    let p = t * (t * p - 2.777_777_777_701_559_3e-3) + 1.666_666_666_666_660_2e-1;
    let c = r - t * p;
    let two = x.constant(2.0);
    let y = (high - (low - (r * c) / (two - c))) + 1.0;
    y * rounded.map(power_of_two)
}

/// The bits of `x` counted from those of `√½`: the exponent of a cut there, above 52 bits.
#[inline(always)]
fn from_cut(x: f64) -> i64 {
    x.to_bits().wrapping_sub(FRAC_1_SQRT_2.to_bits()) as i64
}

/// `k` of `x = 2^k m`, by the bits of a number whose last place is one.
#[inline(always)]
fn exponent(x: f64) -> f64 {
    f64::from_bits(ROUND.to_bits().wrapping_add((from_cut(x) >> 52) as u64)) - ROUND
}

/// `m` of `x = 2^k m`, in `[√½, √2)`.
#[inline(always)]
fn mantissa(x: f64) -> f64 {
    const EXPONENT: u64 = 0xfff << 52;
    f64::from_bits(x.to_bits().wrapping_sub(from_cut(x) as u64 & EXPONENT))
}

/// `2^k` of `k + ROUND`, for `|k| <= 1022`.
#[inline(always)]
fn power_of_two(rounded: f64) -> f64 {
    f64::from_bits(1.0_f64.to_bits().wrapping_add(rounded.to_bits() << 52))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers over many scales.
    fn samples() -> impl Iterator<Item = f64> {
        (0..20_000).map(|i| ((i as f64 - 10_000.0) * 0.069).exp() * (1.0 + (i % 7) as f64 * 0.1))
    }

    #[test]
    fn logarithms_are_those_of_the_library_to_two_units_in_the_last_place() {
        for x in samples() {
            let (ours, library) = (ln(x), x.ln());
            assert!((ours - library).abs() <= 2.0 * f64::EPSILON * library.abs(), "ln {x}: {ours} {library}");
        }
        assert_eq!(ln(1.0), 0.0);
        assert!(ln(f64::NAN).is_nan());
    }

    #[test]
    fn exponentials_are_those_of_the_library_to_two_units_in_the_last_place() {
        for x in samples().map(|x| 0.5 * x.ln()).flat_map(|x| [x, -x, 1e-3 * x]) {
            let (ours, library) = (exp(x), x.exp());
            assert!((ours - library).abs() <= 2.0 * f64::EPSILON * library, "exp {x}: {ours} {library}");
        }
        assert_eq!(exp(0.0), 1.0);
        assert_eq!((exp(1e9), exp(-1e9)), (exp(700.0), exp(-700.0)));
        assert!(exp(f64::NAN).is_nan());
    }
}
