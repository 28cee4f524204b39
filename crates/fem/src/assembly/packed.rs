//! Where the blocks and forces of packs of elements go: lists built once with the body.
//!
//! Each upper block, and each nodal force, is the sum over its elements by pack, then by block of the element, then by
//! place in the pack, whether packs are scattered one after the other or gathered by rows in parallel: the same additions
//! in the same order, and so the same bits. Of blocks on the diagonal only the lower triangle is summed, and mirrored at
//! the end.

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

/// Upper blocks that one task handles.
pub(super) const CHUNK: usize = 512;

/// Lists that take the results of packs to the upper blocks and nodal forces.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PackLists {
    /// For each pack the mesh nodes of its elements, by local node and place.
    nodes: Vec<[u32; PACK]>,
    /// For each pack the positions of its blocks in the upper half, by block and place.
    positions: Vec<[u32; PACK]>,
    /// Position of each diagonal block, ascending.
    diagonals: Vec<u32>,
    /// For each chunk of upper blocks the range of its entries in `block_sources`.
    block_start: Vec<u32>,
    /// `slot << 6 | block`, and the position. A slot is a place among the results of all batches.
    block_sources: Vec<[u32; 2]>,
    /// For each mesh node the range of its entries in `force_sources`.
    force_start: Vec<u32>,
    /// `slot << 4 | local node`.
    force_sources: Vec<u32>,
}

impl PackLists {
    /// Elements that fit the packed entries.
    pub(crate) const MAX_ELEMENTS: usize = 1 << 25;

    /// Lists for the packs of consecutive batches, each with the nodes of its elements and their number; a batch has `size`
    /// packs at most.
    pub(crate) fn new<const N: usize, const B: usize>(
        packs: &[(&[[u32; N]; PACK], usize)],
        batches: &[Batch],
        size: usize,
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
        // Result of each pack.
        let results: Vec<usize> =
            (0..).zip(batches).flat_map(|(b, batch)| (0..batch.packs.len()).map(move |k| b * size + k)).collect();
        let entries = |rows: usize| {
            let slot = move |result: usize, lane: usize, row: usize| ((PACK * result + lane) as u32, row as u32);
            results.iter().flat_map(move |&result| {
                (0..rows).flat_map(move |row| (0..PACK).map(move |lane| slot(result, lane, row)))
            })
        };
        let blocks = entries(pairs.len()).zip(positions.iter().flatten()).filter(|(_, p)| **p != NOWHERE);
        let chunk = |p: u32| (p & !TRANSPOSED) as usize / CHUNK;
        let blocks = blocks.map(|((slot, k), &p)| (chunk(p), [slot << 6 | k, p]));
        let (block_start, block_sources) = group(blocks, upper.count().div_ceil(CHUNK));
        let forces = entries(N).zip(nodes.iter().flatten()).filter(|(_, node)| **node != NOWHERE);
        let forces = forces.map(|((slot, a), &node)| (node as usize, slot << 4 | a));
        let (force_start, force_sources) = group(forces, free_of_node.len());
        let diagonals = (0..pattern.rows() as u32).map(|i| position(i, i)).collect();
        Self { nodes, positions, diagonals, block_start, block_sources, force_start, force_sources }
    }

    /// Adds the results of a range of packs; an empty `upper` gets nothing.
    pub(super) fn scatter<const N: usize, const B: usize>(
        &self,
        packs: Range<usize>,
        results: &[PackShares<N, B>],
        upper: &mut [Matrix3<f64>],
        f_int: &mut [Vector3<f64>],
    ) {
        let nodes = self.nodes[N * packs.start..].chunks_exact(N);
        let positions = self.positions[(N + B) * packs.start..].chunks_exact(N + B);
        for ((result, nodes), positions) in results.iter().zip(nodes).zip(positions).take(packs.len()) {
            for (forces, nodes) in result.forces.iter().zip(nodes) {
                for (lane, &node) in nodes.iter().enumerate() {
                    // `NOWHERE` is beyond the end, here and below.
                    if let Some(f) = f_int.get_mut(node as usize) {
                        add_force(f, forces, lane);
                    }
                }
            }
            if upper.is_empty() {
                continue;
            }
            let (on_diagonal, others) = positions.split_at(N);
            for (triangle, positions) in result.diagonal.iter().zip(on_diagonal) {
                for (lane, &p) in positions.iter().enumerate() {
                    if let Some(sum) = upper.get_mut(p as usize) {
                        add_triangle(sum, triangle, lane);
                    }
                }
            }
            for (block, positions) in result.off_diagonal.iter().zip(others) {
                for (lane, &p) in positions.iter().enumerate() {
                    if let Some(sum) = upper.get_mut((p & !TRANSPOSED) as usize) {
                        add_block(sum, block, lane, p & TRANSPOSED != 0);
                    }
                }
            }
        }
    }

    /// Completes the blocks on the diagonal.
    pub(super) fn finish(&self, upper: &mut [Matrix3<f64>]) {
        for &p in &self.diagonals {
            if let Some(block) = upper.get_mut(p as usize) {
                mirror(block);
            }
        }
    }

    /// Fills chunk `chunk` of the upper blocks from the results of all batches.
    pub(super) fn gather_blocks<const N: usize, const B: usize>(
        &self,
        chunk: usize,
        results: &[PackShares<N, B>],
        upper: &mut [Matrix3<f64>],
    ) {
        upper.fill(Matrix3::zeros());
        let first = (CHUNK * chunk) as u32;
        for &[source, p] in &self.block_sources[self.block_start[chunk] as usize..self.block_start[chunk + 1] as usize]
        {
            let (slot, k) = ((source >> 6) as usize, (source & 63) as usize);
            let (result, lane) = (&results[slot / PACK], slot % PACK);
            let sum = &mut upper[((p & !TRANSPOSED) - first) as usize];
            if k < N {
                add_triangle(sum, &result.diagonal[k], lane);
            } else {
                add_block(sum, &result.off_diagonal[k - N], lane, p & TRANSPOSED != 0);
            }
        }
        let from = self.diagonals.partition_point(|&p| p < first);
        for &p in &self.diagonals[from..] {
            let Some(block) = upper.get_mut((p - first) as usize) else { break };
            mirror(block);
        }
    }

    /// Internal force of mesh node `i` from the results of all batches.
    pub(super) fn gather_force<const N: usize, const B: usize>(
        &self,
        i: usize,
        results: &[PackShares<N, B>],
    ) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for &source in &self.force_sources[self.force_start[i] as usize..self.force_start[i + 1] as usize] {
            let (slot, a) = ((source >> 4) as usize, (source & 15) as usize);
            add_force(&mut sum, &results[slot / PACK].forces[a], slot % PACK);
        }
        sum
    }
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

/// Counting sort of `(key, value)` into ranges by key; values keep their order.
fn group<T: Copy + Default>(items: impl Iterator<Item = (usize, T)> + Clone, keys: usize) -> (Vec<u32>, Vec<T>) {
    let mut start = vec![0u32; keys + 1];
    for (key, _) in items.clone() {
        start[key + 1] += 1;
    }
    for key in 0..keys {
        start[key + 1] += start[key];
    }
    let mut next = start.clone();
    let mut values = vec![T::default(); start[keys] as usize];
    for (key, value) in items {
        values[next[key] as usize] = value;
        next[key] += 1;
    }
    (start, values)
}
