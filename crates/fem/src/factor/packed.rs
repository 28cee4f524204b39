//! Where a copy of `L` in 16 bits keeps its numbers: in the order in which a solve reads them.
//!
//! A solve reads every number of `L` twice, once up the tree and once down, and does two operations with each: it waits
//! for memory. As stored by the factorisation, in columns, four columns are read side by side, and the processor loses
//! track of the four streams at the end of each of many short columns. Here a front is
//! ```text
//! units of 8 columns:  head (single precision),  strip of 4 columns,  strip of 4
//! head:                8 scales of the columns,  inverse of the 8 x 8 numbers on the diagonal by columns,  by rows
//! strip (16 bits):     tiles of 8 rows x 4 columns, each column of a tile in one piece, down to the end of the front
//! ```
//! heads in one piece of memory and strips in another, read from one end to the other. Own rows of a front and rows below
//! are each filled up with zeros to multiples of eight, so that no loop has a tail; the zeros above the diagonal that the
//! factorisation stores are left out, which is more.

use super::supernodal_tree::SupernodeTree;

/// Rows of a tile and columns of a unit.
pub(super) const EIGHT: usize = 8;

/// Numbers of a tile: four columns.
pub(super) const TILE: usize = 4 * EIGHT;

/// Numbers of the head of a unit.
pub(super) const HEAD: usize = EIGHT + 2 * EIGHT * EIGHT;

/// Where the fronts of a topology lie in the copy, and in the memory for their rows.
#[derive(Debug)]
pub(super) struct PackedLayout {
    /// First tile of each front, and the end.
    tiles: Vec<usize>,
    /// First unit of each front, and the end.
    units: Vec<usize>,
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

    /// First tile of a unit in the front; for [`Self::units`], the end of the front.
    pub(super) fn at(self, unit: usize) -> usize {
        let whole = |units: usize| 2 * (units * (self.rows / EIGHT) - units * (units + 1) / 2);
        match unit.checked_sub(1) {
            Some(last) if unit == self.units() => whole(last) + self.strips(last) * self.tiles(last),
            _ => whole(unit),
        }
    }
}

impl PackedLayout {
    pub(super) fn new(tree: &SupernodeTree) -> Self {
        let (mut tiles, mut units, mut row_start) = (vec![0], vec![0], vec![0]);
        for s in 0..tree.len() {
            let shape = Shape::of(tree, s);
            tiles.push(tiles[s] + shape.at(shape.units()));
            units.push(units[s] + shape.units());
            row_start.push(row_start[s] + shape.rows);
        }
        Self { tiles, units, row_start }
    }

    /// Tiles of all fronts together.
    pub(super) fn tile_count(&self) -> usize {
        self.tiles[self.tiles.len() - 1]
    }

    /// Units of all fronts together.
    pub(super) fn unit_count(&self) -> usize {
        self.units[self.units.len() - 1]
    }

    /// Bytes of a copy.
    pub(super) fn bytes(&self) -> usize {
        self.tile_count() * TILE * size_of::<i16>() + self.unit_count() * HEAD * size_of::<f32>()
    }

    /// Rows of all fronts together.
    pub(super) fn rows(&self) -> usize {
        self.row_start[self.row_start.len() - 1]
    }

    /// First row of the front `s`.
    pub(super) fn row_start(&self, s: usize) -> usize {
        self.row_start[s]
    }

    /// First tile of the front `s`; for the number of fronts, the end.
    pub(super) fn first_tile(&self, s: usize) -> usize {
        self.tiles[s]
    }

    /// First unit of the front `s`; for the number of fronts, the end.
    pub(super) fn first_unit(&self, s: usize) -> usize {
        self.units[s]
    }

    pub(super) fn shape(&self, tree: &SupernodeTree, s: usize) -> Shape {
        Shape::of(tree, s)
    }
}
