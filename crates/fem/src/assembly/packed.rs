//! Where the blocks and forces of packs of elements go: lists built once with the body.
//!
//! A body of many elements is cut into parts, stretches of its packs that are summed side by side. Each has a place of its own
//! for every block and node that its elements touch, and a block or force of the body is the sum over the parts that have it,
//! in their order. Within a part elements are added by pack, then by block of the element, then by place in the pack. How a
//! body is cut depends on its elements alone, and so the bits do not depend on the threads. Of blocks on the diagonal only the
//! lower triangle is summed, and mirrored at the end.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::upper::{NOWHERE, TRANSPOSED, UpperBlocks};
use crate::{
    model::Batch,
    pack::{PACK, PackShares},
    sparse::{BlockPattern, FIXED},
};

/// Places of a stored triangle in a matrix by columns.
const LOWER: [usize; 6] = [0, 1, 2, 4, 5, 8];

/// Most parts of a body: as many threads find work.
const PARTS: usize = 8;

/// Fewest packs of a part, on the mean: a tenth of a millisecond.
const PACKS_OF_PART: usize = 128;

/// A stretch of the elements, and its places among those of all parts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    pub(super) batches: Range<usize>,
    pub(super) blocks: Range<usize>,
    pub(super) nodes: Range<usize>,
}

/// Lists that take the results of packs to the upper blocks and nodal forces.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PackLists {
    /// For each pack the places of the nodes of its elements in its part, by local node and place in the pack; where there is
    /// one part, the mesh nodes.
    nodes: Vec<[u32; PACK]>,
    /// For each pack the places of its blocks in its part, by block and place; where there is one part, in the upper half.
    positions: Vec<[u32; PACK]>,
    /// Position of each diagonal block, ascending.
    diagonals: Vec<u32>,
    parts: Vec<Part>,
    /// For each upper block, and each mesh node, its places among those of all parts; of no use where there is one part.
    blocks: Places,
    forces: Places,
}

/// Places of numbered things, in ranges of a list.
#[derive(Clone, Debug, Default, PartialEq)]
struct Places {
    start: Vec<u32>,
    places: Vec<u32>,
}

impl Places {
    /// From what each place holds.
    fn new(held: &[u32], things: usize) -> Self {
        let mut start = vec![0; things + 1];
        held.iter().for_each(|&thing| start[thing as usize + 1] += 1);
        (0..things).for_each(|k| start[k + 1] += start[k]);
        let (mut next, mut places) = (start.clone(), vec![0; held.len()]);
        for (place, &thing) in (0..).zip(held) {
            places[next[thing as usize] as usize] = place;
            next[thing as usize] += 1;
        }
        Self { start, places }
    }

    fn of(&self, thing: usize) -> &[u32] {
        &self.places[self.start[thing] as usize..self.start[thing + 1] as usize]
    }
}

impl PackLists {
    /// Elements whose blocks can be numbered in 31 bits.
    pub(crate) const MAX_ELEMENTS: usize = 1 << 25;

    /// Lists for the packs of consecutive batches, each with the nodes of its elements and their number.
    pub(crate) fn new<const N: usize, const B: usize>(
        packs: &[(&[[u32; N]; PACK], usize)],
        batches: &[Batch],
        free_of_node: &[u32],
        pattern: &BlockPattern,
        upper: &UpperBlocks,
    ) -> Self {
        let position = |i: u32, j: u32| match (i, j) {
            (FIXED, _) | (_, FIXED) => NOWHERE,
            _ if i <= j => upper.position(pattern, i, j).unwrap_or(NOWHERE),
            _ => upper.position(pattern, j, i).map_or(NOWHERE, |p| p | TRANSPOSED),
        };
        let pairs: Vec<_> = (0..PackShares::<N, B>::BLOCKS).map(PackShares::<N, B>::nodes_of_block).collect();
        let (mut nodes, mut positions) = (Vec::new(), Vec::new());
        for &(of_element, len) in packs {
            let row = |of_lane: &dyn Fn(usize) -> u32| -> [u32; PACK] {
                std::array::from_fn(|lane| if lane < len { of_lane(lane) } else { NOWHERE })
            };
            nodes.extend((0..N).map(|a| row(&|lane| of_element[lane][a])));
            let free = |lane: usize, a: usize| free_of_node[of_element[lane][a] as usize];
            positions.extend(pairs.iter().map(|&(a, b)| row(&|lane| position(free(lane, a), free(lane, b)))));
        }
        let diagonals = (0..pattern.rows() as u32).map(|i| position(i, i)).collect();
        let mut lists = Self { nodes, positions, diagonals, ..Self::default() };
        lists.cut(batches, (N, N + B), (upper.count(), free_of_node.len()));
        lists
    }

    /// Cuts the batches into parts of about as many packs; packs have so many rows of nodes and blocks, the body so many upper
    /// blocks and nodes.
    fn cut(&mut self, batches: &[Batch], rows: (usize, usize), (blocks, nodes): (usize, usize)) {
        let packs = batches.last().map_or(0, |batch| batch.packs.end);
        let count = (packs / PACKS_OF_PART).clamp(1, PARTS.min(batches.len().max(1)));
        let (mut held_blocks, mut held_nodes, mut from) = (Vec::new(), Vec::new(), 0);
        for k in 1..=count {
            let ends = |batch: &Batch| batch.packs.end * count > k * packs;
            let to =
                if k == count { batches.len() } else { from + batches[from..].iter().take_while(|b| !ends(b)).count() };
            let packs = batches[from..to].first().map_or(0..0, |first| first.packs.start..batches[to - 1].packs.end);
            let mut part = Part { batches: from..to, blocks: 0..blocks, nodes: 0..nodes };
            if count > 1 {
                part.nodes = number(&mut self.nodes[rows.0 * packs.start..rows.0 * packs.end], &mut held_nodes);
                part.blocks = number(&mut self.positions[rows.1 * packs.start..rows.1 * packs.end], &mut held_blocks);
            }
            self.parts.push(part);
            from = to;
        }
        if count > 1 {
            (self.blocks, self.forces) = (Places::new(&held_blocks, blocks), Places::new(&held_nodes, nodes));
        }
    }

    /// The parts, in order; there is one at least.
    pub(crate) fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Blocks and nodes of all parts; none where there is one part, which is summed in its place.
    pub(super) fn places(&self) -> (usize, usize) {
        (self.blocks.places.len(), self.forces.places.len())
    }

    /// Adds the results of a range of packs to the places of their part, whose blocks and forces these are; an empty `blocks`
    /// gets nothing.
    pub(super) fn scatter<const N: usize, const B: usize>(
        &self,
        packs: Range<usize>,
        results: &[PackShares<N, B>],
        blocks: &mut [Matrix3<f64>],
        part_forces: &mut [Vector3<f64>],
    ) {
        let nodes = self.nodes[N * packs.start..].chunks_exact(N);
        let positions = self.positions[(N + B) * packs.start..].chunks_exact(N + B);
        for ((result, nodes), positions) in results.iter().zip(nodes).zip(positions).take(packs.len()) {
            for (forces, nodes) in result.forces.iter().zip(nodes) {
                for (lane, &node) in nodes.iter().enumerate() {
                    // `NOWHERE` is beyond the end, here and below.
                    if let Some(f) = part_forces.get_mut(node as usize) {
                        add_force(f, forces, lane);
                    }
                }
            }
            if blocks.is_empty() {
                continue;
            }
            let (on_diagonal, others) = positions.split_at(N);
            for (triangle, positions) in result.diagonal.iter().zip(on_diagonal) {
                for (lane, &p) in positions.iter().enumerate() {
                    if let Some(sum) = blocks.get_mut(p as usize) {
                        add_triangle(sum, triangle, lane);
                    }
                }
            }
            for (block, positions) in result.off_diagonal.iter().zip(others) {
                for (lane, &p) in positions.iter().enumerate() {
                    if let Some(sum) = blocks.get_mut((p & !TRANSPOSED) as usize) {
                        add_block(sum, block, lane, p & TRANSPOSED != 0);
                    }
                }
            }
        }
    }

    /// Fills the upper blocks from `first` on with the sums over all parts.
    pub(super) fn gather_blocks(&self, first: usize, parts: &[Matrix3<f64>], upper: &mut [Matrix3<f64>]) {
        for (u, block) in (first..).zip(upper) {
            *block = self.blocks.of(u).iter().fold(Matrix3::zeros(), |sum, &place| sum + parts[place as usize]);
        }
    }

    /// Fills the forces of the mesh nodes from `first` on with the sums over all parts.
    pub(super) fn gather_forces(&self, first: usize, parts: &[Vector3<f64>], f_int: &mut [Vector3<f64>]) {
        for (i, f) in (first..).zip(f_int) {
            *f = self.forces.of(i).iter().fold(Vector3::zeros(), |sum, &place| sum + parts[place as usize]);
        }
    }

    /// Completes the blocks on the diagonal among the upper blocks from `first` on.
    pub(super) fn finish(&self, first: usize, upper: &mut [Matrix3<f64>]) {
        let from = self.diagonals.partition_point(|&p| (p as usize) < first);
        for &p in &self.diagonals[from..] {
            let Some(block) = upper.get_mut(p as usize - first) else { break };
            mirror(block);
        }
    }
}

/// Replaces the things in the rows of a part, with [`TRANSPOSED`] or not, by their places in the part, and appends which thing
/// each place holds; ascending within the part.
fn number(rows: &mut [[u32; PACK]], held: &mut Vec<u32>) -> Range<usize> {
    let first = held.len();
    let mut own: Vec<u32> = rows.iter().flatten().filter(|&&t| t != NOWHERE).map(|t| t & !TRANSPOSED).collect();
    own.sort_unstable();
    own.dedup();
    for thing in rows.iter_mut().flatten().filter(|thing| **thing != NOWHERE) {
        let place = own.partition_point(|held| *held < *thing & !TRANSPOSED) as u32;
        *thing = place | (*thing & TRANSPOSED);
    }
    held.append(&mut own);
    first..held.len()
}

#[inline]
fn add_force(sum: &mut Vector3<f64>, force: &[[f64; PACK]; 3], lane: usize) {
    for (sum, row) in sum.as_mut_slice().iter_mut().zip(force) {
        *sum += row[lane];
    }
}

#[inline]
fn add_triangle(sum: &mut Matrix3<f64>, triangle: &[[f64; PACK]; 6], lane: usize) {
    let sum = sum.as_mut_slice();
    for (at, row) in LOWER.into_iter().zip(triangle) {
        sum[at] += row[lane];
    }
}

#[inline]
fn add_block(sum: &mut Matrix3<f64>, block: &[[f64; PACK]; 9], lane: usize, transposed: bool) {
    let sum = sum.as_mut_slice();
    if transposed {
        for (at, row) in [0, 3, 6, 1, 4, 7, 2, 5, 8].into_iter().zip(block) {
            sum[at] += row[lane];
        }
    } else {
        for (sum, row) in sum.iter_mut().zip(block) {
            *sum += row[lane];
        }
    }
}

/// Copies the lower triangle to the upper one.
#[inline]
fn mirror(block: &mut Matrix3<f64>) {
    for (r, c) in [(0, 1), (0, 2), (1, 2)] {
        block[(r, c)] = block[(c, r)];
    }
}
