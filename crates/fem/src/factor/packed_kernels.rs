//! Triangular solves with one packed front: numbers in 16 bits, sums in single precision.
//!
//! A front is walked through from unit to unit. Where it is worth two threads it is taken in panels: their triangle by
//! one, the rows (forward) or the units (backward) beyond it by both. Partial sums are eight whatever the width of the
//! machine's vectors.

use std::ops::Range;

use pulp::{Arch, Scalar, Simd, WithSimd};

use super::packed::{EIGHT, Shape, TILE};
use super::packed_copy::PackedFront;
use super::workers::{are_many, join};

/// Units of a panel: 256 columns.
const PANEL: usize = 32;

/// Numbers of a front above which it is taken in panels.
const LARGE: usize = 300_000;

/// Numbers of `L` in a product above which it is cut in two: some 30 µs.
const TASK_NUMBERS: usize = 100_000;

/// Eight rows.
type Eight = [f32; EIGHT];

/// One front; its rows come in pieces of eight, of which the first are those of its units.
#[derive(Clone, Copy)]
pub(super) struct Front<'a> {
    pub(super) shape: Shape,
    pub(super) packed: PackedFront<'a>,
    pub(super) arch: Arch,
}

/// Eight columns of a front.
struct Unit<'a> {
    /// What the multiples of each column are to be taken by.
    scales: &'a Eight,
    /// Columns of the inverse of the block on the diagonal, and its rows.
    inverse: &'a [Eight],
    inverse_rows: &'a [Eight],
    /// Strips of four columns.
    strips: std::slice::ChunksExact<'a, [i16; TILE]>,
}

impl<'a> Front<'a> {
    #[inline(always)]
    fn unit(&self, unit: usize) -> Unit<'a> {
        let tiles = &self.packed.tiles[self.shape.at(unit)..self.shape.at(unit + 1)];
        let head = self.packed.heads[unit].as_chunks::<EIGHT>().0;
        let (inverse, inverse_rows) = head[1..].split_at(EIGHT);
        Unit { scales: &head[0], inverse, inverse_rows, strips: tiles.chunks_exact(self.shape.tiles(unit).max(1)) }
    }

    /// Units of a panel; all of them where the front is for one thread.
    fn panel(&self) -> usize {
        let large = self.shape.own * self.shape.rows > LARGE;
        if large { PANEL } else { self.shape.units().max(1) }
    }

    /// `[x; u] <- [L11⁻¹ x; u - L21 L11⁻¹ x]`.
    pub(super) fn solve(self, rows: &mut [Eight]) {
        let units = self.shape.units();
        // Rows are sums over the units in turn, in panels or not; one thread reads without a gap.
        let panel = if are_many() { self.panel() } else { units.max(1) };
        for begin in (0..units).step_by(panel) {
            let end = (begin + panel).min(units);
            // where there is one panel, it takes all rows along
            let taken = if panel >= units { rows.len() } else { end };
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
        for k in self.units {
            let unit = self.front.unit(k);
            let (known, rest) = self.rows[k..].split_at_mut(1);
            known[0] = combination(simd, unit.inverse, &known[0]);
            let x = scaled(unit.scales, &known[0]);
            for (strip, x) in unit.strips.zip(x.as_chunks::<4>().0) {
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
        for k in self.units {
            let from = self.first - k - 1;
            let unit = self.front.unit(k);
            let x = scaled(unit.scales, &self.known[k]);
            for (strip, x) in unit.strips.zip(x.as_chunks::<4>().0) {
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
        for k in self.units.rev() {
            let unit = self.front.unit(k);
            let (wanted, rest) = self.rows[k..].split_at_mut(1);
            subtract_dots(simd, unit.strips, 0, rest, unit.scales, &mut wanted[0]);
            wanted[0] = combination(simd, unit.inverse_rows, &wanted[0]);
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
            let unit = self.front.unit(self.begin + k);
            subtract_dots(simd, unit.strips, from, self.y, unit.scales, wanted);
        }
    }
}

#[inline(always)]
fn scaled(scales: &Eight, x: &Eight) -> Eight {
    std::array::from_fn(|k| scales[k] * x[k])
}

/// `y <- y - L x` for a strip of four columns and the eight rows of each of its tiles.
#[inline(always)]
fn subtract_strip<S: Simd>(simd: S, tiles: &[[i16; TILE]], x: [f32; 4], y: &mut [Eight]) {
    if S::F32_LANES > EIGHT {
        return subtract_strip(Scalar::new(), tiles, x, y);
    }
    let factor = x.map(|x| simd.splat_f32s(-x));
    for (tile, y) in tiles.iter().zip(y) {
        let l = in_single(tile);
        let [a, b, c, d] = l.each_ref().map(|l| S::as_simd_f32s(l).0);
        for (k, y) in S::as_mut_simd_f32s(y).0.iter_mut().enumerate() {
            let first = simd.mul_add_e_f32s(a[k], factor[0], simd.mul_add_e_f32s(b[k], factor[1], *y));
            let second = simd.mul_add_e_f32s(c[k], factor[2], simd.mul_f32s(d[k], factor[3]));
            *y = simd.add_f32s(first, second);
        }
    }
}

/// `x <- x - Lᵀ y` for the strips of a unit, from their tile `from` on and from their end: the first rows are those that
/// were found last, and the sums need not wait for them.
#[inline(always)]
fn subtract_dots<S: Simd>(
    simd: S,
    strips: std::slice::ChunksExact<'_, [i16; TILE]>,
    from: usize,
    y: &[Eight],
    scales: &Eight,
    x: &mut Eight,
) {
    if S::F32_LANES > EIGHT {
        return subtract_dots(Scalar::new(), strips, from, y, scales, x);
    }
    let columns = scales.as_chunks::<4>().0.iter().zip(x.as_chunks_mut::<4>().0);
    for (strip, (scales, x)) in strips.zip(columns).rev() {
        // as many of the eight places as eight numbers fill vectors
        let mut sums = [[simd.splat_f32s(0.0); EIGHT]; 4];
        for (tile, y) in strip[from..from + y.len()].iter().zip(y).rev() {
            let l = in_single(tile);
            let l = l.each_ref().map(|l| S::as_simd_f32s(l).0);
            for (k, y) in S::as_simd_f32s(y).0.iter().enumerate() {
                for (sums, l) in sums.iter_mut().zip(l) {
                    sums[k] = simd.mul_add_e_f32s(l[k], *y, sums[k]);
                }
            }
        }
        for ((x, scale), sums) in x.iter_mut().zip(scales).zip(sums) {
            let mut total = [0.0; EIGHT];
            S::as_mut_simd_f32s(&mut total).0.iter_mut().zip(sums).for_each(|(total, sum)| *total = sum);
            *x -= scale * sum(total);
        }
    }
}

/// The combination of eight columns.
#[inline(always)]
fn combination<S: Simd>(simd: S, columns: &[Eight], x: &Eight) -> Eight {
    if S::F32_LANES > EIGHT {
        return combination(Scalar::new(), columns, x);
    }
    let mut total = [0.0; EIGHT];
    for (k, total) in S::as_mut_simd_f32s(&mut total).0.iter_mut().enumerate() {
        let mut sums = [simd.splat_f32s(0.0); 2];
        for (j, (column, x)) in columns.iter().zip(x).enumerate() {
            let column = S::as_simd_f32s(column).0;
            sums[j % 2] = simd.mul_add_e_f32s(column[k], simd.splat_f32s(*x), sums[j % 2]);
        }
        *total = simd.add_f32s(sums[0], sums[1]);
    }
    total
}

#[inline(always)]
fn in_single(tile: &[i16; TILE]) -> [Eight; 4] {
    std::array::from_fn(|k| std::array::from_fn(|i| f32::from(tile[k * EIGHT + i])))
}

#[inline(always)]
fn sum([s0, s1, s2, s3, s4, s5, s6, s7]: Eight) -> f32 {
    ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7))
}
