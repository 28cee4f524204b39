//! The number that laws and kernels compute with: `f64`, or one `f64` per lane.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

use super::elementary;

/// A real number, or one in each lane. Comparisons with NaN are false.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Answer of a comparison in each lane.
    type Mask: Copy;

    /// `value` in every lane of a number like `self`.
    fn constant(self, value: f64) -> Self;

    /// Square root.
    fn sqrt(self) -> Self;

    /// Absolute value.
    fn abs(self) -> Self;

    /// `f` of each lane.
    fn map(self, f: impl Fn(f64) -> f64) -> Self;

    /// Whether `self > other`.
    fn above(self, other: Self) -> Self::Mask;

    /// `self` where `mask` holds, elsewhere `other`.
    fn or_where_not(self, mask: Self::Mask, other: Self) -> Self;

    /// Whether `mask` holds in any lane.
    fn any(self, mask: Self::Mask) -> bool;

    /// `1 / self`.
    #[inline(always)]
    fn recip(self) -> Self {
        self.constant(1.0) / self
    }

    /// The larger of two numbers; `other` where either is NaN.
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.or_where_not(self.above(other), other)
    }

    /// Natural logarithm of a positive normal number ([`elementary::ln`]).
    #[inline(always)]
    fn ln(self) -> Self {
        elementary::ln(self)
    }

    /// Exponential function ([`elementary::exp`]).
    #[inline(always)]
    fn exp(self) -> Self {
        elementary::exp(self)
    }

    /// Power of a positive normal number with a constant exponent; the error is `|exponent ln self|` units in the last
    /// place.
    #[inline(always)]
    fn powf(self, exponent: f64) -> Self {
        (self.ln() * exponent).exp()
    }
}

impl Real for f64 {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        f(self)
    }

    #[inline(always)]
    fn above(self, other: Self) -> bool {
        self > other
    }

    #[inline(always)]
    fn or_where_not(self, mask: bool, other: Self) -> Self {
        if mask { self } else { other }
    }

    #[inline(always)]
    fn any(self, mask: bool) -> bool {
        mask
    }
}

/// One number for each lane of `N` vectors of the instruction set `S`.
///
/// With `N = 2` two chains of dependent operations overlap, which a chain of roots and quotients gains from.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd, const N: usize = 1> {
    simd: S,
    value: [S::f64s; N],
}

impl<S: Simd, const N: usize> Lanes<S, N> {
    /// Number of lanes; a power of two of at most eight.
    pub const COUNT: usize = N * S::F64_LANES;

    /// The lanes from `COUNT part` on of a row of eight elements.
    ///
    /// # Panics
    /// Where `part >= 8 / COUNT`.
    #[inline(always)]
    pub fn load(simd: S, row: &[f64; 8], part: usize) -> Self {
        let row = S::as_simd_f64s(row).0;
        let mut value = [row[N * part]; N];
        for k in 1..N {
            value[k] = row[N * part + k];
        }
        Self { simd, value }
    }

    /// Writes the lanes to their place in a row of eight elements; the inverse of [`Lanes::load`].
    ///
    /// # Panics
    /// Where `part >= 8 / COUNT`.
    #[inline(always)]
    pub fn store(self, row: &mut [f64; 8], part: usize) {
        let row = S::as_mut_simd_f64s(row).0;
        for k in 0..N {
            row[N * part + k] = self.value[k];
        }
    }
}

/// Implements an operator between two vectors of lanes, and between one and a constant.
macro_rules! operator {
    ($Trait:ident, $method:ident, $simd:ident) => {
        impl<S: Simd, const N: usize> $Trait for Lanes<S, N> {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for k in 0..N {
                    self.value[k] = self.simd.$simd(self.value[k], other.value[k]);
                }
                self
            }
        }

        impl<S: Simd, const N: usize> $Trait<f64> for Lanes<S, N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.$method(self.constant(other))
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd, const N: usize> Neg for Lanes<S, N> {
    type Output = Self;

    #[inline(always)]
    fn neg(mut self) -> Self {
        for k in 0..N {
            self.value[k] = self.simd.neg_f64s(self.value[k]);
        }
        self
    }
}

impl<S: Simd, const N: usize> Real for Lanes<S, N> {
    type Mask = [S::m64s; N];

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self { value: [self.simd.splat_f64s(value); N], ..self }
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for k in 0..N {
            self.value[k] = self.simd.sqrt_f64s(self.value[k]);
        }
        self
    }

    #[inline(always)]
    fn abs(mut self) -> Self {
        for k in 0..N {
            self.value[k] = self.simd.abs_f64s(self.value[k]);
        }
        self
    }

    #[inline(always)]
    fn map(mut self, f: impl Fn(f64) -> f64) -> Self {
        for x in pulp::bytemuck::cast_slice_mut::<_, f64>(&mut self.value) {
            *x = f(*x);
        }
        self
    }

    #[inline(always)]
    fn above(self, other: Self) -> [S::m64s; N] {
        let mut mask = [self.simd.greater_than_f64s(self.value[0], other.value[0]); N];
        for k in 1..N {
            mask[k] = self.simd.greater_than_f64s(self.value[k], other.value[k]);
        }
        mask
    }

    #[inline(always)]
    fn or_where_not(mut self, mask: [S::m64s; N], other: Self) -> Self {
        for k in 0..N {
            self.value[k] = self.simd.select_f64s(mask[k], self.value[k], other.value[k]);
        }
        self
    }

    #[inline(always)]
    fn any(self, mask: [S::m64s; N]) -> bool {
        let mut any = false;
        for k in 0..N {
            any |= self.simd.first_true_m64s(mask[k]) < S::F64_LANES;
        }
        any
    }
}
