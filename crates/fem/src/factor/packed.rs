//! A copy of `L` in single precision, in the order in which a solve reads it.
//!
//! A solve reads every number of `L` twice, once up the tree and once down, and does two operations with each: it waits
//! for memory. As stored by the factorisation, in columns, four columns are read side by side, and the processor loses
//! track of the four streams at the end of each of many short columns. Here a front is
//! ```text
//! units of 8 columns:  8 reciprocals of the diagonal,  8 x 8 numbers below the diagonal,  strip of 4 columns,  strip of 4
//! strip:               tiles of 8 rows x 4 columns, each column of a tile in one piece, down to the end of the front
//! ```
//! read from one end to the other. Own rows of a front and rows below are each filled up with zeros to multiples of eight,
//! so that no loop has a tail; the zeros above the diagonal that the factorisation stores are left out, which is more.

#![allow(non_snake_case)]

use super::supernodal_tree::SupernodeTree;
use super::workers::join;

/// Rows of a tile and columns of a unit.
pub(super) const EIGHT: usize = 8;

/// Numbers of a tile: four columns.
pub(super) const TILE: usize = 4 * EIGHT;

/// Numbers before the strips of a unit.
pub(super) const HEAD: usize = EIGHT + EIGHT * EIGHT;

/// Numbers that are copied in one piece.
const COPY_AT_ONCE: usize = 1 << 18;

/// Where the fronts of a topology lie in the copy, and in the memory for their rows.
#[derive(Debug)]
pub(super) struct PackedLayout {
    /// First number of each front, and the end.
    start: Vec<usize>,
    /// First row of each front where all are listed one after another, and the end.
    row_start: Vec<usize>,
}

/// Shape of one front in units of eight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Own columns.
    pub(super) width: usize,
    /// Own columns, filled up.
    pub(super) own: usize,
    /// Rows: own and below, each filled up.
    pub(super) rows: usize,
}

impl Shape {
    fn of(tree: &SupernodeTree, s: usize) -> Self {
        let width = tree.columns(s).len();
        let own = width.next_multiple_of(EIGHT);
        Self { width, own, rows: own + tree.below(s).next_multiple_of(EIGHT) }
    }

    pub(super) fn units(self) -> usize {
        self.own / EIGHT
    }

    /// Tiles of each strip of a unit.
    pub(super) fn tiles(self, unit: usize) -> usize {
        self.rows / EIGHT - unit - 1
    }

    /// Strips of a unit: one where four columns or fewer are left.
    pub(super) fn strips(self, unit: usize) -> usize {
        if self.width - unit * EIGHT > 4 { 2 } else { 1 }
    }

    /// First number of a unit in the front; for [`Self::units`], the end of the front.
    pub(super) fn at(self, unit: usize) -> usize {
        let whole = |units: usize| units * HEAD + 2 * TILE * (units * (self.rows / EIGHT) - units * (units + 1) / 2);
        match unit.checked_sub(1) {
            Some(last) if unit == self.units() => whole(last) + HEAD + self.strips(last) * TILE * self.tiles(last),
            _ => whole(unit),
        }
    }
}

impl PackedLayout {
    pub(super) fn new(tree: &SupernodeTree) -> Self {
        let (mut start, mut row_start) = (vec![0], vec![0]);
        for s in 0..tree.len() {
            let shape = Shape::of(tree, s);
            start.push(start[s] + shape.at(shape.units()));
            row_start.push(row_start[s] + shape.rows);
        }
        Self { start, row_start }
    }

    /// Numbers of the copy.
    pub(super) fn len(&self) -> usize {
        self.start[self.start.len() - 1]
    }

    /// Rows of all fronts together.
    pub(super) fn rows(&self) -> usize {
        self.row_start[self.row_start.len() - 1]
    }

    /// First row of the front `s`.
    pub(super) fn row_start(&self, s: usize) -> usize {
        self.row_start[s]
    }

    pub(super) fn shape(&self, tree: &SupernodeTree, s: usize) -> Shape {
        Shape::of(tree, s)
    }

    /// The numbers of the front `s`.
    pub(super) fn front<'v>(&self, s: usize, packed: &'v [f32]) -> &'v [f32] {
        &packed[self.start[s]..self.start[s + 1]]
    }

    /// Copies `values`, as the factorisation stores them. The same bits for any number of threads.
    pub(super) fn pack(&self, tree: &SupernodeTree, values: &[f64], packed: &mut [f32]) {
        self.pack_fronts(tree, 0..tree.len(), values, packed);
    }

    fn pack_fronts(&self, tree: &SupernodeTree, fronts: std::ops::Range<usize>, values: &[f64], packed: &mut [f32]) {
        let first = self.start[fronts.start];
        if fronts.len() > 1 && packed.len() > COPY_AT_ONCE {
            let half = self.start.partition_point(|&start| start < first + packed.len() / 2);
            let middle = half.clamp(fronts.start + 1, fronts.end - 1);
            let (low, high) = packed.split_at_mut(self.start[middle] - first);
            join(
                || self.pack_fronts(tree, fronts.start..middle, values, low),
                || self.pack_fronts(tree, middle..fronts.end, values, high),
            );
            return;
        }
        for s in fronts {
            let front = &values[tree.value_start(s)..tree.value_start(s + 1)];
            pack_front(
                Shape::of(tree, s),
                tree.below(s),
                front,
                &mut packed[self.start[s] - first..][..self.start[s + 1] - self.start[s]],
            );
        }
    }
}

/// Copies one front, `below` of whose rows lie under its own.
fn pack_front(shape: Shape, below: usize, values: &[f64], packed: &mut [f32]) {
    let width = shape.width;
    for unit in 0..shape.units() {
        let first = unit * EIGHT;
        let columns = EIGHT.min(width - first);
        let (head, strips) = packed[shape.at(unit)..shape.at(unit + 1)].split_at_mut(HEAD);
        head.fill(0.0);
        let (reciprocals, corner) = head.split_at_mut(EIGHT);
        let column = |k: usize| &values[(first + k) * (width + below)..(first + k + 1) * (width + below)];
        for k in 0..columns {
            reciprocals[k] = (1.0 / column(k)[first + k]) as f32;
            for i in k + 1..columns {
                corner[k * EIGHT + i] = column(k)[first + i] as f32;
            }
        }
        if shape.tiles(unit) == 0 {
            continue;
        }
        for (strip, packed) in strips.chunks_exact_mut(TILE * shape.tiles(unit)).enumerate() {
            let tiles = packed.as_chunks_mut::<TILE>().0;
            let (own_tiles, below_tiles) = tiles.split_at_mut((shape.own - first) / EIGHT - 1);
            for k in 0..4 {
                // columns that are not there, and rows that fill up, are zero
                let column = if 4 * strip + k < columns { column(4 * strip + k) } else { &[][..] };
                let (own, below) = column.split_at(width.min(column.len()));
                round_into(own_tiles, k, own.get(first + EIGHT..).unwrap_or(&[]));
                round_into(below_tiles, k, below);
            }
        }
    }
}

/// Column `k` of some tiles; zeros where the column ends.
fn round_into(tiles: &mut [[f32; TILE]], k: usize, column: &[f64]) {
    let mut pieces = column.chunks(EIGHT);
    for tile in tiles {
        let to = &mut tile[k * EIGHT..(k + 1) * EIGHT];
        let from = pieces.next().unwrap_or(&[]);
        to[from.len()..].fill(0.0);
        to.iter_mut().zip(from).for_each(|(to, from)| *to = *from as f32);
    }
}
