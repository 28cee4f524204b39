//! Triangular solves with one packed front: numbers in single precision, sums in double.
//!
//! A front is walked through from unit to unit. Where it is worth two threads it is taken in panels: their triangle by
//! one, the rows (forward) or the units (backward) beyond it by both. Partial sums are eight whatever the width of the
//! machine's vectors.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::packed::{EIGHT, HEAD, Shape, TILE};
use super::workers::join;

/// Units of a panel: 256 columns.
const PANEL: usize = 32;

/// Numbers of a front above which it is taken in panels.
const LARGE: usize = 300_000;

/// Numbers of `L` in a product above which it is cut in two: some 30 µs.
const TASK_NUMBERS: usize = 100_000;

/// Eight rows.
type Eight = [f64; EIGHT];

/// One front; its rows come in pieces of eight, of which the first are those of its units.
#[derive(Clone, Copy)]
pub(super) struct Front<'a> {
    pub(super) shape: Shape,
    pub(super) packed: &'a [f32],
    pub(super) arch: Arch,
}

impl<'a> Front<'a> {
    /// Numbers before the strips of a unit, and its strips.
    #[inline(always)]
    fn unit(&self, unit: usize) -> (&'a [f32], std::slice::ChunksExact<'a, [f32; TILE]>) {
        let (head, strips) = self.packed[self.shape.at(unit)..self.shape.at(unit + 1)].split_at(HEAD);
        (head, strips.as_chunks::<TILE>().0.chunks_exact(self.shape.tiles(unit).max(1)))
    }

    /// Units of a panel; all of them where the front is for one thread.
    fn panel(&self) -> usize {
        let large = self.shape.own * self.shape.rows > LARGE;
        if large { PANEL } else { self.shape.units().max(1) }
    }

    /// `[x; u] <- [L11⁻¹ x; u - L21 L11⁻¹ x]`.
    pub(super) fn solve(self, rows: &mut [Eight]) {
        let units = self.shape.units();
        for begin in (0..units).step_by(self.panel()) {
            let end = (begin + self.panel()).min(units);
            // where there is one panel, it takes all rows along
            let taken = if self.panel() >= units { rows.len() } else { end };
            let (known, beyond) = rows.split_at_mut(taken);
            self.arch.dispatch(Triangle { front: self, units: begin..end, rows: known });
            self.subtract(begin..end, known, taken, beyond);
        }
    }

    /// Subtracts what the units do to the pieces of rows from `first` on.
    fn subtract(&self, units: Range<usize>, known: &[Eight], first: usize, y: &mut [Eight]) {
        if units.len() * y.len() * EIGHT * EIGHT > TASK_NUMBERS && y.len() > 1 {
            let half = y.len() / 2;
            let (upper, lower) = y.split_at_mut(half);
            join(
                || self.subtract(units.clone(), known, first, upper),
                || self.subtract(units.clone(), known, first + half, lower),
            );
        } else if !y.is_empty() {
            self.arch.dispatch(Product { front: *self, units, known, first, y });
        }
    }

    /// `x <- L11⁻ᵀ (x - L21ᵀ below)` with `rows = [x; below]`.
    pub(super) fn solve_transposed(self, rows: &mut [Eight]) {
        let units = self.shape.units();
        for begin in (0..units).step_by(self.panel()).rev() {
            let end = (begin + self.panel()).min(units);
            let taken = if self.panel() >= units { rows.len() } else { end };
            let (known, beyond) = rows.split_at_mut(taken);
            self.subtract_transposed(begin, &mut known[begin..end], taken, beyond);
            self.arch.dispatch(TriangleTransposed { front: self, units: begin..end, rows: known });
        }
    }

    /// Subtracts from the units from `begin` on what the pieces of rows from `first` on do to them.
    fn subtract_transposed(&self, begin: usize, wanted: &mut [Eight], first: usize, y: &[Eight]) {
        if wanted.len() * y.len() * EIGHT * EIGHT > TASK_NUMBERS && wanted.len() > 1 {
            let half = wanted.len() / 2;
            let (left, right) = wanted.split_at_mut(half);
            join(
                || self.subtract_transposed(begin, left, first, y),
                || self.subtract_transposed(begin + half, right, first, y),
            );
        } else if !y.is_empty() {
            self.arch.dispatch(ProductTransposed { front: *self, begin, wanted, first, y });
        }
    }
}

/// Units and the rows of their panel, or all rows.
struct Triangle<'a> {
    front: Front<'a>,
    units: Range<usize>,
    rows: &'a mut [Eight],
}

impl WithSimd for Triangle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for unit in self.units {
            let (head, strips) = self.front.unit(unit);
            let (known, rest) = self.rows[unit..].split_at_mut(1);
            solve_corner(head, &mut known[0]);
            for (strip, x) in strips.zip(known[0].as_chunks::<4>().0) {
                subtract_strip(simd, &strip[..rest.len()], *x, rest);
            }
        }
    }
}

struct Product<'a> {
    front: Front<'a>,
    units: Range<usize>,
    known: &'a [Eight],
    first: usize,
    y: &'a mut [Eight],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for unit in self.units {
            let from = self.first - unit - 1;
            for (strip, x) in self.front.unit(unit).1.zip(self.known[unit].as_chunks::<4>().0) {
                subtract_strip(simd, &strip[from..from + self.y.len()], *x, self.y);
            }
        }
    }
}

struct TriangleTransposed<'a> {
    front: Front<'a>,
    units: Range<usize>,
    rows: &'a mut [Eight],
}

impl WithSimd for TriangleTransposed<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for unit in self.units.rev() {
            let (head, strips) = self.front.unit(unit);
            let (wanted, rest) = self.rows[unit..].split_at_mut(1);
            for (strip, x) in strips.zip(wanted[0].as_chunks_mut::<4>().0).rev() {
                subtract_dots(simd, &strip[..rest.len()], rest, x);
            }
            solve_corner_transposed(head, &mut wanted[0]);
        }
    }
}

struct ProductTransposed<'a> {
    front: Front<'a>,
    begin: usize,
    wanted: &'a mut [Eight],
    first: usize,
    y: &'a [Eight],
}

impl WithSimd for ProductTransposed<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (k, wanted) in self.wanted.iter_mut().enumerate().rev() {
            let from = self.first - (self.begin + k) - 1;
            for (strip, x) in self.front.unit(self.begin + k).1.zip(wanted.as_chunks_mut::<4>().0).rev() {
                subtract_dots(simd, &strip[from..from + self.y.len()], self.y, x);
            }
        }
    }
}

/// `y <- y - L x` for a strip of four columns and the eight rows of each of its tiles.
#[inline(always)]
fn subtract_strip<S: Simd>(simd: S, tiles: &[[f32; TILE]], x: [f64; 4], y: &mut [Eight]) {
    let factor = x.map(|x| simd.splat_f64s(-x));
    for (tile, y) in tiles.iter().zip(y) {
        let l = in_double(tile);
        let [a, b, c, d] = l.each_ref().map(|l| S::as_simd_f64s(l).0);
        for (k, y) in S::as_mut_simd_f64s(y).0.iter_mut().enumerate() {
            let first = simd.mul_add_e_f64s(a[k], factor[0], simd.mul_add_e_f64s(b[k], factor[1], *y));
            let second = simd.mul_add_e_f64s(c[k], factor[2], simd.mul_f64s(d[k], factor[3]));
            *y = simd.add_f64s(first, second);
        }
    }
}

/// `x <- x - Lᵀ y` for a strip of four columns, from its end: the first rows are those that were found last, and the sums
/// need not wait for them.
#[inline(always)]
fn subtract_dots<S: Simd>(simd: S, tiles: &[[f32; TILE]], y: &[Eight], x: &mut [f64; 4]) {
    // as many of the eight places as eight numbers fill vectors
    let mut sums = [[simd.splat_f64s(0.0); EIGHT]; 4];
    for (tile, y) in tiles.iter().zip(y).rev() {
        let l = in_double(tile);
        let l = l.each_ref().map(|l| S::as_simd_f64s(l).0);
        for (k, y) in S::as_simd_f64s(y).0.iter().enumerate() {
            for (sums, l) in sums.iter_mut().zip(l) {
                sums[k] = simd.mul_add_e_f64s(l[k], *y, sums[k]);
            }
        }
    }
    for (x, sums) in x.iter_mut().zip(sums) {
        let mut total = [0.0; EIGHT];
        S::as_mut_simd_f64s(&mut total).0.iter_mut().zip(sums).for_each(|(total, sum)| *total = sum);
        *x -= sum(total);
    }
}

/// `x <- L⁻¹ x` for the columns of a unit.
#[inline(always)]
fn solve_corner(head: &[f32], x: &mut Eight) {
    let (reciprocals, corner) = head.split_at(EIGHT);
    for (k, (reciprocal, column)) in reciprocals.iter().zip(corner.as_chunks::<EIGHT>().0).enumerate() {
        let pivot = x[k] * f64::from(*reciprocal);
        x.iter_mut().zip(column).for_each(|(x, l)| *x -= f64::from(*l) * pivot);
        x[k] = pivot;
    }
}

/// `x <- L⁻ᵀ x` for the columns of a unit.
#[inline(always)]
fn solve_corner_transposed(head: &[f32], x: &mut Eight) {
    let (reciprocals, corner) = head.split_at(EIGHT);
    for (k, (reciprocal, column)) in reciprocals.iter().zip(corner.as_chunks::<EIGHT>().0).enumerate().rev() {
        let mut products = [0.0; EIGHT];
        products.iter_mut().zip(column).zip(&*x).for_each(|((p, l), x)| *p = f64::from(*l) * x);
        x[k] = (x[k] - sum(products)) * f64::from(*reciprocal);
    }
}

#[inline(always)]
fn in_double(tile: &[f32; TILE]) -> [Eight; 4] {
    std::array::from_fn(|k| std::array::from_fn(|i| f64::from(tile[k * EIGHT + i])))
}

#[inline(always)]
fn sum([s0, s1, s2, s3, s4, s5, s6, s7]: Eight) -> f64 {
    ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7))
}
