//! A copy of `L` in 16 bits, for preconditioners.
//!
//! A column of a front below the block on its diagonal is kept in multiples of `max / 32767`, where `max` is its largest
//! number: the kernels fold the scale into the unknown that the column belongs to, so that it costs nothing. The blocks on
//! the diagonal are kept as their inverses in single precision.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::packed::{EIGHT, HEAD, PackedLayout, Shape, TILE};
use super::supernodal_tree::SupernodeTree;
use super::workers::join;

/// Numbers that are copied in one piece.
const COPY_AT_ONCE: usize = 1 << 18;

/// Largest multiple of a column's scale.
const MOST: f64 = i16::MAX as f64;

/// Added to a number of small magnitude, leaves it rounded to the nearest integer in the lowest bits: vectors of every
/// machine can add.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// The numbers, front by front.
#[derive(Clone)]
pub(super) struct PackedCopy {
    heads: Vec<f32>,
    tiles: Vec<[i16; TILE]>,
}

/// The part of a copy that belongs to one front.
#[derive(Clone, Copy)]
pub(super) struct PackedFront<'a> {
    pub(super) heads: &'a [[f32; HEAD]],
    pub(super) tiles: &'a [[i16; TILE]],
}

impl PackedCopy {
    /// Memory for the copy of a factor of this topology.
    pub(super) fn new(layout: &PackedLayout) -> Self {
        Self { heads: vec![0.0; layout.unit_count() * HEAD], tiles: vec![[0; TILE]; layout.tile_count()] }
    }

    /// The numbers of the front `s`.
    pub(super) fn front(&self, layout: &PackedLayout, s: usize) -> PackedFront<'_> {
        let heads = &self.heads.as_chunks::<HEAD>().0[layout.first_unit(s)..layout.first_unit(s + 1)];
        PackedFront { heads, tiles: &self.tiles[layout.first_tile(s)..layout.first_tile(s + 1)] }
    }

    /// Takes over `values`, as the factorisation stores them. The same bits for any number of threads.
    pub(super) fn take(&mut self, layout: &PackedLayout, tree: &SupernodeTree, values: &[f64]) {
        let packing = Packing { layout, tree, values, arch: Arch::new() };
        packing.fronts(0..tree.len(), self.heads.as_chunks_mut().0, &mut self.tiles);
    }
}

struct Packing<'a> {
    layout: &'a PackedLayout,
    tree: &'a SupernodeTree,
    values: &'a [f64],
    arch: Arch,
}

impl Packing<'_> {
    fn fronts(&self, fronts: Range<usize>, heads: &mut [[f32; HEAD]], tiles: &mut [[i16; TILE]]) {
        let (tile, unit) = (self.layout.first_tile(fronts.start), self.layout.first_unit(fronts.start));
        if fronts.len() > 1 && tiles.len() * TILE > COPY_AT_ONCE {
            let half = tile + tiles.len() / 2;
            let middle = fronts.start
                + 1
                + (fronts.start + 1..fronts.end - 1).take_while(|&s| self.layout.first_tile(s) < half).count();
            let (low, high) = tiles.split_at_mut(self.layout.first_tile(middle) - tile);
            let (low_heads, high_heads) = heads.split_at_mut(self.layout.first_unit(middle) - unit);
            join(
                || self.fronts(fronts.start..middle, low_heads, low),
                || self.fronts(middle..fronts.end, high_heads, high),
            );
            return;
        }
        for s in fronts {
            self.arch.dispatch(PackFront {
                shape: self.layout.shape(self.tree, s),
                below: self.tree.below(s),
                values: &self.values[self.tree.value_start(s)..self.tree.value_start(s + 1)],
                heads: &mut heads[self.layout.first_unit(s) - unit..self.layout.first_unit(s + 1) - unit],
                tiles: &mut tiles[self.layout.first_tile(s) - tile..self.layout.first_tile(s + 1) - tile],
            });
        }
    }
}

/// One front, `below` of whose rows lie under its own.
struct PackFront<'a> {
    shape: Shape,
    below: usize,
    values: &'a [f64],
    heads: &'a mut [[f32; HEAD]],
    tiles: &'a mut [[i16; TILE]],
}

impl WithSimd for PackFront<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { shape, below, values, heads, tiles } = self;
        let (width, rows) = (shape.width, shape.width + below);
        for (unit, head) in heads.iter_mut().enumerate() {
            let first = unit * EIGHT;
            let columns = EIGHT.min(width - first);
            let column = |k: usize| &values[(first + k) * rows + first..(first + k + 1) * rows];
            let mut corner = [[0.0; EIGHT]; EIGHT];
            for (k, corner) in corner.iter_mut().enumerate().take(columns) {
                corner[k..columns].copy_from_slice(&column(k)[k..columns]);
            }
            let (scales, inverses) = head.split_at_mut(EIGHT);
            scales.fill(0.0);
            write_inverse(&corner, columns, inverses);
            let (in_strip, own_tiles) = (shape.tiles(unit), (shape.own - first) / EIGHT - 1);
            if in_strip == 0 {
                continue;
            }
            let tiles = &mut tiles[shape.at(unit)..shape.at(unit + 1)];
            for (strip, tiles) in tiles.chunks_exact_mut(in_strip).enumerate() {
                let (own_tiles, below_tiles) = tiles.split_at_mut(own_tiles);
                for k in 0..4 {
                    // columns that are not there, and rows that fill up, are zero
                    let place = 4 * strip + k;
                    let column = if place < columns { column(place) } else { &[][..] };
                    let (own, below) = column.split_at((width - first).min(column.len()));
                    let own = own.get(EIGHT..).unwrap_or(&[]);
                    let largest = largest(own).max(largest(below));
                    let multiples = if largest > 0.0 { MOST / largest } else { 0.0 };
                    scales[place] = (largest / MOST) as f32;
                    round_into(own_tiles, k, own, multiples);
                    round_into(below_tiles, k, below, multiples);
                }
            }
        }
    }
}

/// Largest magnitude.
#[inline(always)]
fn largest(numbers: &[f64]) -> f64 {
    let mut most = [0.0f64; EIGHT];
    let (pieces, rest) = numbers.as_chunks::<EIGHT>();
    for numbers in pieces {
        most.iter_mut().zip(numbers).for_each(|(most, x)| *most = if x.abs() > *most { x.abs() } else { *most });
    }
    most.iter().chain(rest).fold(0.0, |most, x| if x.abs() > most { x.abs() } else { most })
}

/// Column `k` of some tiles, in multiples of its scale; zeros where the column ends.
#[inline(always)]
fn round_into(tiles: &mut [[i16; TILE]], k: usize, column: &[f64], multiples: f64) {
    // the low bits of the sum are the integer in two's complement
    let round = |x: f64| (x * multiples + ROUNDER).to_bits() as i16;
    let (pieces, rest) = column.as_chunks::<EIGHT>();
    let mut tiles = tiles.iter_mut().map(|tile| &mut tile[k * EIGHT..(k + 1) * EIGHT]);
    for (from, to) in pieces.iter().zip(&mut tiles) {
        to.copy_from_slice(&from.map(round));
    }
    for (at, to) in tiles.enumerate() {
        to.fill(0);
        if at == 0 {
            to.iter_mut().zip(rest).for_each(|(to, from)| *to = round(*from));
        }
    }
}

/// The inverse of a lower triangle of `size` columns, by columns and then by rows; zeros beyond it.
fn write_inverse(corner: &[[f64; EIGHT]; EIGHT], size: usize, inverses: &mut [f32]) {
    inverses.fill(0.0);
    let (by_columns, by_rows) = inverses.split_at_mut(EIGHT * EIGHT);
    for j in 0..size {
        let mut x = [0.0; EIGHT];
        x[j] = 1.0;
        for k in j..size {
            x[k] /= corner[k][k];
            for i in k + 1..size {
                x[i] -= corner[k][i] * x[k];
            }
            by_columns[j * EIGHT + k] = x[k] as f32;
            by_rows[k * EIGHT + j] = x[k] as f32;
        }
    }
}
