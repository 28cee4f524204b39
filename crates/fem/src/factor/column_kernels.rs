//! Triangular solves and products with one vector, four columns of `L` at a time.
//!
//! Partial sums are eight whatever the width of the machine's vectors.

#![allow(non_snake_case)]

use pulp::{Arch, Simd, WithSimd};

/// Numbers of a column that are taken at once: the widest vectors hold as many.
const EIGHT: usize = 8;

/// Rows `rows` of some columns, which are `stride` apart in `values`.
#[derive(Clone, Copy)]
pub(super) struct Columns<'a> {
    pub(super) values: &'a [f64],
    pub(super) stride: usize,
    pub(super) first_row: usize,
}

impl<'a> Columns<'a> {
    /// `len` numbers of a column, from row `from` of this view.
    #[inline(always)]
    fn column(&self, j: usize, from: usize, len: usize) -> &'a [f64] {
        let start = j * self.stride + self.first_row + from;
        &self.values[start..start + len]
    }

    /// The same columns from a later row on.
    pub(super) fn below(self, rows: usize) -> Self {
        Self { first_row: self.first_row + rows, ..self }
    }

    /// Later columns.
    pub(super) fn after(self, columns: usize) -> Self {
        Self { values: &self.values[columns * self.stride..], ..self }
    }
}

/// `x <- L⁻¹ x` for the lower triangle at the top of the columns.
pub(super) fn solve_lower(arch: Arch, L: Columns<'_>, x: &mut [f64]) {
    arch.dispatch(SolveLower { L, x });
}

/// `x <- L⁻ᵀ x`.
pub(super) fn solve_upper(arch: Arch, L: Columns<'_>, x: &mut [f64]) {
    arch.dispatch(SolveUpper { L, x });
}

/// `y <- y - L x` for as many rows as `y` and as many columns as `x` has.
pub(super) fn subtract_product(arch: Arch, L: Columns<'_>, x: &[f64], y: &mut [f64]) {
    arch.dispatch(SubtractProduct { L, x, y });
}

/// `x <- x - Lᵀ y`.
pub(super) fn subtract_transposed(arch: Arch, L: Columns<'_>, y: &[f64], x: &mut [f64]) {
    arch.dispatch(SubtractTransposed { L, x, y });
}

struct SolveLower<'a> {
    L: Columns<'a>,
    x: &'a mut [f64],
}

impl WithSimd for SolveLower<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { L, x } = self;
        let n = x.len();
        for j in (0..n).step_by(4) {
            let width = (n - j).min(4);
            for k in j..j + width {
                let column = L.column(k, k, j + width - k);
                let pivot = x[k] / column[0];
                x[k] = pivot;
                for (x, l) in x[k + 1..j + width].iter_mut().zip(&column[1..]) {
                    *x -= l * pivot;
                }
            }
            let (known, rest) = x.split_at_mut(j + width);
            subtract(simd, L.after(j).below(j + width), &known[j..], rest);
        }
    }
}

struct SolveUpper<'a> {
    L: Columns<'a>,
    x: &'a mut [f64],
}

impl WithSimd for SolveUpper<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { L, x } = self;
        let n = x.len();
        for j in (0..n).step_by(4).rev() {
            let width = (n - j).min(4);
            let (known, rest) = x.split_at_mut(j + width);
            subtract_dots(simd, L.after(j).below(j + width), rest, &mut known[j..]);
            for k in (j..j + width).rev() {
                let column = L.column(k, k, j + width - k);
                let sum: f64 = x[k + 1..j + width].iter().zip(&column[1..]).map(|(x, l)| x * l).sum();
                x[k] = (x[k] - sum) / column[0];
            }
        }
    }
}

struct SubtractProduct<'a> {
    L: Columns<'a>,
    x: &'a [f64],
    y: &'a mut [f64],
}

impl WithSimd for SubtractProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (k, x) in self.x.chunks(4).enumerate() {
            subtract(simd, self.L.after(4 * k), x, self.y);
        }
    }
}

struct SubtractTransposed<'a> {
    L: Columns<'a>,
    x: &'a mut [f64],
    y: &'a [f64],
}

impl WithSimd for SubtractTransposed<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (k, x) in self.x.chunks_mut(4).enumerate() {
            subtract_dots(simd, self.L.after(4 * k), self.y, x);
        }
    }
}

/// `y <- y - L x` for up to four columns.
#[inline(always)]
fn subtract<S: Simd>(simd: S, L: Columns<'_>, x: &[f64], y: &mut [f64]) {
    let n = y.len();
    if n == 0 {
        return;
    }
    let &[x0, x1, x2, x3] = x else {
        for (j, x) in x.iter().enumerate() {
            y.iter_mut().zip(L.column(j, 0, n)).for_each(|(y, l)| *y -= l * x);
        }
        return;
    };
    let (a, b, c, d) = (L.column(0, 0, n), L.column(1, 0, n), L.column(2, 0, n), L.column(3, 0, n));
    let factor = [x0, x1, x2, x3].map(|x| simd.splat_f64s(-x));
    let tail = n - n % EIGHT;
    let eights = y.as_chunks_mut::<EIGHT>().0.iter_mut().zip(a.as_chunks::<EIGHT>().0).zip(b.as_chunks::<EIGHT>().0);
    for ((((y, a), b), c), d) in eights.zip(c.as_chunks::<EIGHT>().0).zip(d.as_chunks::<EIGHT>().0) {
        let [a, b, c, d] = [a, b, c, d].map(|l| S::as_simd_f64s(l).0);
        for (k, y) in S::as_mut_simd_f64s(y).0.iter_mut().enumerate() {
            let first = simd.mul_add_e_f64s(a[k], factor[0], simd.mul_add_e_f64s(b[k], factor[1], *y));
            let second = simd.mul_add_e_f64s(c[k], factor[2], simd.mul_f64s(d[k], factor[3]));
            *y = simd.add_f64s(first, second);
        }
    }
    for i in tail..n {
        y[i] -= (a[i] * x0 + b[i] * x1) + (c[i] * x2 + d[i] * x3);
    }
}

/// `x <- x - Lᵀ y` for up to four columns.
#[inline(always)]
fn subtract_dots<S: Simd>(simd: S, L: Columns<'_>, y: &[f64], x: &mut [f64]) {
    let n = y.len();
    if n == 0 {
        return;
    }
    let [x0, x1, x2, x3] = x else {
        for (j, x) in x.iter_mut().enumerate() {
            *x -= dot(L.column(j, 0, n), y);
        }
        return;
    };
    let (a, b, c, d) = (L.column(0, 0, n), L.column(1, 0, n), L.column(2, 0, n), L.column(3, 0, n));
    // as many of the eight places as eight numbers fill vectors
    let mut sums = [[simd.splat_f64s(0.0); EIGHT]; 4];
    let eights = y.as_chunks::<EIGHT>().0.iter().zip(a.as_chunks::<EIGHT>().0).zip(b.as_chunks::<EIGHT>().0);
    for ((((y, a), b), c), d) in eights.zip(c.as_chunks::<EIGHT>().0).zip(d.as_chunks::<EIGHT>().0) {
        let l = [a, b, c, d].map(|l| S::as_simd_f64s(l).0);
        for (k, y) in S::as_simd_f64s(y).0.iter().enumerate() {
            for (sums, l) in sums.iter_mut().zip(l) {
                sums[k] = simd.mul_add_e_f64s(l[k], *y, sums[k]);
            }
        }
    }
    let tail = n - n % EIGHT;
    for ((x, column), sums) in [x0, x1, x2, x3].into_iter().zip([a, b, c, d]).zip(sums) {
        let mut total = [0.0; EIGHT];
        let vectors = S::as_mut_simd_f64s(&mut total).0;
        vectors.iter_mut().zip(sums).for_each(|(total, sum)| *total = sum);
        let [s0, s1, s2, s3, s4, s5, s6, s7] = total;
        *x -= ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7)) + dot(&column[tail..], &y[tail..]);
    }
}

#[inline(always)]
fn dot(column: &[f64], y: &[f64]) -> f64 {
    column.iter().zip(y).map(|(l, y)| l * y).sum()
}
