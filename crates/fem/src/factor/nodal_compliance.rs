//! Compliance from the half solves of single nodes, which are kept as long as the factor lasts.
//!
//! Rows of contacts change with every step, and the nodes that they touch hardly do: with `H = B S`, where `S` picks the
//! touched nodes,
//! ```text
//! Y = L⁻¹ P Sᵀ,   G = Yᵀ Y,   H A⁻¹ Hᵀ = B G Bᵀ,   A⁻¹ Hᵀ λ = Pᵀ L⁻ᵀ Y Bᵀ λ
//! ```
//! and `Y` and `G` are those of the factor alone. A node is solved for once for each factor, by whichever rows touch it
//! first: those of the contacts, of the tissue around the tool, or of the step before. Which nodes are solved for together
//! decides the last digits.

use faer::MatMut;
use nalgebra::{DMatrixViewMut, Vector3};

use super::gram::product;
use super::half_block::{BLOCK_ROWS, HalfBlock};
use super::numeric::Factor;
use super::symbolic::SymbolicFactor;
use super::workers::join;
use crate::nodal_rows::NodalRows;

/// Nodes that are solved for together.
const NODES_OF_BLOCK: usize = BLOCK_ROWS / 3;

/// Most blocks: beyond it all nodes are forgotten, since blocks of a few nodes each are slow to multiply.
const MOST_BLOCKS: usize = 12;

/// Nodes that there is room for, in those of as many rows as a compliance may have: while a tool slides, one node in
/// the place of another must not make all others to be solved for anew.
const SETS: usize = 2;

/// Unit rows of new nodes for each row that wants them, up to which nodes are solved for in the place of rows: others will
/// want them too.
const WORTH: usize = 2;

const NOT_KEPT: u32 = u32::MAX;
/// Among those that are looked up, and not kept yet.
const WANTED: u32 = u32::MAX - 1;

/// Half solves of nodes with one factor.
pub struct NodalCompliance {
    /// Most nodes.
    pub(super) capacity: usize,
    pub(super) blocks: Vec<HalfBlock>,
    pub(super) used: usize,
    /// First node of each block in `nodes`, and the end.
    pub(super) start: Vec<usize>,
    pub(super) nodes: Vec<u32>,
    /// For each of them the latest of the compliances so far that wanted it; 0 where none did.
    pub(super) wanted_at: Vec<u64>,
    pub(super) compliances: u64,
    /// Place in `nodes` of each free node, or [`NOT_KEPT`].
    pub(super) place: Vec<u32>,
    pub(super) wanted: Vec<u32>,
    /// Unit rows of the nodes of each block.
    pub(super) units: Vec<NodalRows>,
    /// `G`, by columns that are three times the capacity long.
    pub(super) gram: Vec<f64>,
    /// One number per degree of freedom of the nodes.
    pub(super) column: Vec<f64>,
    /// The latest rows.
    pub(super) rows: NodalRows,
    pub(super) most_entries: usize,
    pub(super) revision: u64,
}

impl NodalCompliance {
    /// Memory for up to `max_rows` rows, and as many unit rows of nodes.
    pub(super) fn new(symbolic: &SymbolicFactor, max_rows: usize) -> Self {
        let capacity = (SETS * max_rows / 3).min(MOST_BLOCKS * NODES_OF_BLOCK);
        let blocks = if capacity > 0 { MOST_BLOCKS } else { 0 };
        let blocks = (0..blocks).map(|_| HalfBlock::new(symbolic, 3 * NODES_OF_BLOCK)).collect();
        Self::empty(capacity, blocks, symbolic.nodes(), max_rows)
    }

    /// Nothing yet, in blocks for up to `capacity` of `nodes` nodes.
    pub(super) fn empty(capacity: usize, blocks: Vec<HalfBlock>, nodes: usize, max_rows: usize) -> Self {
        Self {
            capacity,
            used: 0,
            start: Vec::with_capacity(blocks.len() + 1),
            nodes: Vec::with_capacity(capacity),
            wanted_at: Vec::with_capacity(capacity),
            compliances: 0,
            place: vec![NOT_KEPT; nodes],
            wanted: Vec::with_capacity(capacity),
            units: blocks.iter().map(|_| NodalRows::with_capacity(3 * NODES_OF_BLOCK, 1)).collect(),
            blocks,
            gram: vec![0.0; 9 * capacity * capacity],
            column: vec![0.0; 3 * capacity],
            rows: NodalRows::with_capacity(max_rows, 3),
            most_entries: 3 * max_rows,
            revision: 0,
        }
    }

    /// Has the half solves of all nodes that `rows` touch, and remembers the rows; false where solving for the rows
    /// themselves is better, or where there is no room. The factor is valid and of this topology.
    pub(super) fn keep(&mut self, factor: &Factor, rows: &NodalRows) -> bool {
        let entries: usize = (0..rows.len()).map(|r| rows.row(r).count()).sum();
        if !self.is_for(factor.symbolic().nodes()) || entries > self.most_entries {
            return false;
        }
        self.turn_to(factor);
        if !self.look_up(touched(rows)) || WORTH * rows.len() < 3 * self.wanted.len() {
            self.unmark();
            return false;
        }
        if !self.has_room() {
            self.unmark();
            self.forget();
            if !self.look_up(touched(rows)) || !self.has_room() {
                self.unmark();
                return false;
            }
        }
        self.append(factor);
        self.compliances += 1;
        for node in touched(rows) {
            self.wanted_at[self.place[node as usize] as usize] = self.compliances;
        }
        self.rows.clear();
        (0..rows.len()).for_each(|r| self.rows.push_row(rows.row(r)));
        true
    }

    /// Whether its memory is for bodies of so many free nodes.
    pub(super) fn is_for(&self, nodes: usize) -> bool {
        self.place.len() == nodes
    }

    /// Forgets the nodes of another factor.
    pub(super) fn turn_to(&mut self, factor: &Factor) {
        if self.revision != factor.revision() {
            self.forget();
            self.revision = factor.revision();
        }
    }

    fn forget(&mut self) {
        self.nodes.iter().for_each(|&node| self.place[node as usize] = NOT_KEPT);
        self.nodes.clear();
        self.wanted_at.clear();
        self.start.clear();
        self.start.push(0);
        self.used = 0;
    }

    /// Lists the nodes that are not kept; false where one does not exist, or where they are too many.
    pub(super) fn look_up(&mut self, nodes: impl Iterator<Item = u32>) -> bool {
        self.wanted.clear();
        for node in nodes {
            match self.place.get_mut(node as usize) {
                Some(place) if *place == NOT_KEPT && self.wanted.len() < self.capacity => {
                    *place = WANTED;
                    self.wanted.push(node);
                }
                Some(place) if *place != NOT_KEPT => {}
                _ => return false,
            }
        }
        true
    }

    pub(super) fn unmark(&mut self) {
        self.wanted.iter().for_each(|&node| self.place[node as usize] = NOT_KEPT);
        self.wanted.clear();
    }

    pub(super) fn has_room(&self) -> bool {
        self.nodes.len() + self.wanted.len() <= self.capacity
            && self.used + self.wanted.len().div_ceil(NODES_OF_BLOCK) <= self.blocks.len()
    }

    /// Solves for the wanted nodes, and multiplies them with all.
    pub(super) fn append(&mut self, factor: &Factor) {
        if self.wanted.is_empty() {
            return;
        }
        let symbolic = factor.symbolic();
        let place_in_order = &symbolic.ordering().new_of_old;
        self.wanted.sort_unstable_by_key(|&node| place_in_order[node as usize]);
        let first = self.used;
        let size = self.wanted.len().div_ceil(self.wanted.len().div_ceil(NODES_OF_BLOCK));
        for nodes in self.wanted.chunks(size) {
            let units = &mut self.units[self.used];
            units.clear();
            for &node in nodes {
                self.place[node as usize] = self.nodes.len() as u32;
                self.nodes.push(node);
                self.wanted_at.push(self.compliances);
                (0..3).for_each(|k| units.push_row([(node, Vector3::ith(k, 1.0))]));
            }
            self.used += 1;
            self.start.push(self.nodes.len());
        }
        solve(factor, &self.units[first..self.used], &mut self.blocks[first..self.used]);
        let side = 3 * self.capacity;
        let gram = MatMut::from_column_major_slice_mut(&mut self.gram, side, side);
        multiply(&self.blocks[..self.used], &self.start, first, 0..self.used, 0, gram);
        for i in 3 * self.start[first]..3 * self.nodes.len() {
            for j in 0..i {
                self.gram[i * side + j] = self.gram[j * side + i];
            }
        }
    }

    /// Writes `scale B G Bᵀ` of the rows that were kept last into `w`, which is as large. Symmetric to the bit.
    pub(super) fn write(&mut self, scale: f64, w: &mut DMatrixViewMut<'_, f64>) {
        let (side, used) = (3 * self.capacity, 3 * self.nodes.len());
        for j in 0..self.rows.len() {
            let column = &mut self.column[..used];
            column.fill(0.0);
            for (node, value) in self.rows.row(j) {
                let at = 3 * self.place[node as usize] as usize;
                for k in 0..3 {
                    let of_gram = &self.gram[(at + k) * side..(at + k) * side + used];
                    column.iter_mut().zip(of_gram).for_each(|(c, g)| *c += g * value[k]);
                }
            }
            for i in j..self.rows.len() {
                let sum = |(node, value): (u32, Vector3<f64>)| {
                    let at = 3 * self.place[node as usize] as usize;
                    value[0] * column[at] + value[1] * column[at + 1] + value[2] * column[at + 2]
                };
                let value = scale * self.rows.row(i).map(sum).sum::<f64>();
                w[(i, j)] = value;
                w[(j, i)] = value;
            }
        }
    }

    /// Adds `Y Bᵀ λ` of the rows that were kept last to a vector in elimination order.
    pub(super) fn add_combination(&mut self, symbolic: &SymbolicFactor, lambda: &[f64], into: &mut [f64]) {
        let force = &mut self.column[..3 * self.nodes.len()];
        force.fill(0.0);
        for (r, lambda) in lambda.iter().enumerate().take(self.rows.len()).filter(|(_, lambda)| **lambda != 0.0) {
            for (node, value) in self.rows.row(r) {
                let at = 3 * self.place[node as usize] as usize;
                (0..3).for_each(|k| force[at + k] += value[k] * lambda);
            }
        }
        for (block, range) in self.blocks[..self.used].iter().zip(self.start.windows(2)) {
            block.add_combination(symbolic, &force[3 * range[0]..3 * range[1]], into);
        }
    }
}

/// Nodes that rows touch, as often as they do.
fn touched(rows: &NodalRows) -> impl Iterator<Item = u32> {
    (0..rows.len()).flat_map(|r| rows.row(r)).map(|(node, _)| node)
}

/// Solves for the nodes of some blocks, side by side.
fn solve(factor: &Factor, units: &[NodalRows], blocks: &mut [HalfBlock]) {
    match (units, blocks) {
        ([units], [block]) => {
            let mut order = [0; BLOCK_ROWS];
            order.iter_mut().zip(0..).for_each(|(order, k)| *order = k);
            block.solve(factor, units, &order[..units.len()]);
        }
        (units, blocks) if units.len() > 1 => {
            let half = units.len() / 2;
            let (first, second) = blocks.split_at_mut(half);
            join(|| solve(factor, &units[..half], first), || solve(factor, &units[half..], second));
        }
        _ => {}
    }
}

/// The products of the blocks from `new` on with those of `columns` that come no later; `gram` begins with the columns of
/// the node `from`.
fn multiply(
    blocks: &[HalfBlock],
    start: &[usize],
    new: usize,
    columns: std::ops::Range<usize>,
    from: usize,
    mut gram: MatMut<'_, f64>,
) {
    if columns.len() > 1 {
        let middle = columns.start + columns.len() / 2;
        let (left, right) = gram.split_at_col_mut(3 * (start[middle] - from));
        join(
            || multiply(blocks, start, new, columns.start..middle, from, left),
            || multiply(blocks, start, new, middle..columns.end, start[middle], right),
        );
        return;
    }
    let column = columns.start;
    let places = |block: usize| (3 * start[block], 3 * (start[block + 1] - start[block]));
    for row in new.max(column)..blocks.len() {
        let ((i, rows), (_, width)) = (places(row), places(column));
        product(&blocks[row], &blocks[column], gram.as_mut().submatrix_mut(i, 0, rows, width));
    }
}
