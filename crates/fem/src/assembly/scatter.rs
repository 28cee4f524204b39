//! Where the blocks and forces of the elements go: lists built once with the body.
//!
//! Only blocks `(i, j)` with `i <= j` are summed. Each of them, and each nodal force, is the sum over its elements in
//! ascending order, whether elements are scattered one after the other or gathered by rows in parallel: the same
//! additions in the same order, and so the same bits.

use nalgebra::{Matrix3, Vector3};

use crate::{
    element::{ElementMatrices, Tetrahedron, UPPER},
    material::BATCH,
    sparse::{BlockPattern, FIXED},
};

/// Set in an upper position where the element's block must be transposed.
const TRANSPOSED: u32 = 1 << 31;

/// Destination of a block that has a fixed node.
const NOWHERE: u32 = u32::MAX;

/// Lists that take element results to the upper blocks and nodal forces, and those to the full pattern.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScatterLists {
    /// For each element the position of its ten blocks in the upper half.
    positions: Vec<[u32; 10]>,
    /// For each upper block the range of its entries in `block_sources`.
    block_start: Vec<u32>,
    /// `element << 5 | block << 1 | transposed`.
    block_sources: Vec<u32>,
    /// For each mesh node the range of its entries in `force_sources`.
    force_start: Vec<u32>,
    /// `element << 2 | local node`.
    force_sources: Vec<u32>,
    /// For each block of the pattern its upper block, with [`TRANSPOSED`] below the diagonal.
    upper_of_block: Vec<u32>,
}

impl ScatterLists {
    /// Elements that fit the packed entries.
    pub(crate) const MAX_ELEMENTS: usize = 1 << 27;

    pub(crate) fn new(
        pattern: &BlockPattern,
        elements: &[Tetrahedron],
        free_tetrahedra: &[[u32; 4]],
        nodes: usize,
    ) -> Self {
        let (upper_of_block, uppers) = number_upper_blocks(pattern);
        let positions: Vec<[u32; 10]> = free_tetrahedra
            .iter()
            .map(|free| {
                UPPER.map(|(a, b)| {
                    let (i, j) = (free[a], free[b]);
                    let place = |i, j| pattern.find(i, j).map_or(NOWHERE, |p| upper_of_block[p]);
                    match (i, j) {
                        (FIXED, _) | (_, FIXED) => NOWHERE,
                        _ if i <= j => place(i, j),
                        _ => place(j, i) | TRANSPOSED,
                    }
                })
            })
            .collect();

        let blocks = positions.iter().enumerate().flat_map(|(e, positions)| {
            positions.iter().enumerate().filter(|(_, p)| **p != NOWHERE).map(move |(k, &p)| {
                let transposed = u32::from(p & TRANSPOSED != 0);
                ((p & !TRANSPOSED) as usize, (e as u32) << 5 | (k as u32) << 1 | transposed)
            })
        });
        let (block_start, block_sources) = group(blocks, uppers);
        let forces = elements
            .iter()
            .enumerate()
            .flat_map(|(e, element)| (0..4).map(move |a| (element.nodes[a] as usize, (e as u32) << 2 | a as u32)));
        let (force_start, force_sources) = group(forces, nodes);
        Self { positions, block_start, block_sources, force_start, force_sources, upper_of_block }
    }

    /// Number of upper blocks.
    pub(crate) fn upper_blocks(&self) -> usize {
        self.block_start.len() - 1
    }

    /// Adds the results of consecutive elements from `first` on to `upper` and `forces`.
    pub(crate) fn scatter(
        &self,
        elements: &[Tetrahedron],
        first: usize,
        results: &[ElementMatrices],
        upper: &mut [Matrix3<f64>],
        forces: &mut [Vector3<f64>],
    ) {
        let range = first..first + results.len();
        for ((element, positions), result) in elements[range.clone()].iter().zip(&self.positions[range]).zip(results) {
            for (a, &node) in element.nodes.iter().enumerate() {
                forces[node as usize] += result.force(a);
            }
            for (k, &p) in positions.iter().enumerate().filter(|(_, p)| **p != NOWHERE) {
                let block = result.upper(k);
                if p & TRANSPOSED == 0 {
                    upper[p as usize] += block;
                } else {
                    upper[(p & !TRANSPOSED) as usize] += block.transpose();
                }
            }
        }
    }

    /// Upper block `p` from all element results, kept in slots of [`BATCH`] per batch through `slot`.
    pub(crate) fn gather_block(&self, p: usize, results: &[ElementMatrices], slot: &[u32]) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for &source in &self.block_sources[self.block_start[p] as usize..self.block_start[p + 1] as usize] {
            let block = results[slot[(source >> 5) as usize] as usize].upper((source >> 1 & 15) as usize);
            sum += if source & 1 == 0 { block } else { block.transpose() };
        }
        sum
    }

    /// Internal force of mesh node `i` from all element results.
    pub(crate) fn gather_force(&self, i: usize, results: &[ElementMatrices], slot: &[u32]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for &source in &self.force_sources[self.force_start[i] as usize..self.force_start[i + 1] as usize] {
            sum += results[slot[(source >> 2) as usize] as usize].force((source & 3) as usize);
        }
        sum
    }

    /// Block `p` of the pattern from the upper half.
    #[inline]
    pub(crate) fn block(&self, p: usize, upper: &[Matrix3<f64>]) -> Matrix3<f64> {
        let u = self.upper_of_block[p];
        if u & TRANSPOSED == 0 { upper[u as usize] } else { upper[(u & !TRANSPOSED) as usize].transpose() }
    }
}

/// Slots of the elements in a buffer of [`BATCH`] results per batch.
pub(crate) fn slots(batches: &[crate::model::Batch]) -> Vec<u32> {
    batches
        .iter()
        .enumerate()
        .flat_map(|(b, batch)| (0..batch.elements.len()).map(move |k| (b * BATCH + k) as u32))
        .collect()
}

/// Numbers the blocks on and above the diagonal by rows; blocks below refer to their mirror image.
fn number_upper_blocks(pattern: &BlockPattern) -> (Vec<u32>, usize) {
    let mut upper_of_block = vec![NOWHERE; pattern.blocks()];
    let mut count = 0;
    for i in 0..pattern.rows() {
        for p in pattern.row(i).filter(|&p| pattern.columns()[p] as usize >= i) {
            upper_of_block[p] = count;
            count += 1;
        }
    }
    for i in 0..pattern.rows() {
        for p in pattern.row(i) {
            let j = pattern.columns()[p];
            if (j as usize) < i {
                let mirror = pattern.find(j, i as u32).map_or(NOWHERE, |m| upper_of_block[m]);
                upper_of_block[p] = mirror | TRANSPOSED;
            }
        }
    }
    (upper_of_block, count as usize)
}

/// Counting sort of `(key, value)` into ranges by key; values keep their order.
fn group(items: impl Iterator<Item = (usize, u32)> + Clone, keys: usize) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; keys + 1];
    for (key, _) in items.clone() {
        start[key + 1] += 1;
    }
    for key in 0..keys {
        start[key + 1] += start[key];
    }
    let mut next = start.clone();
    let mut values = vec![0; start[keys] as usize];
    for (key, value) in items {
        values[next[key] as usize] = value;
        next[key] += 1;
    }
    (start, values)
}
