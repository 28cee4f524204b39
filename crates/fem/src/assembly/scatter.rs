//! Where the blocks and forces of the elements go: lists built once with the body.
//!
//! Only blocks `(i, j)` with `i <= j` are summed. Each of them, and each nodal force, is the sum over its elements in
//! ascending order, whether elements are scattered one after the other or gathered by rows in parallel: the same
//! additions in the same order, and so the same bits.

use nalgebra::{Matrix3, Vector3};

use crate::{
    element::NodalShares,
    sparse::{BlockPattern, FIXED},
};

/// Set in an upper position where the element's block must be transposed.
const TRANSPOSED: u32 = 1 << 31;

/// Destination of a block that has a fixed node.
pub(super) const NOWHERE: u32 = u32::MAX;

/// Lists that take element results to the upper blocks and nodal forces, and those to the full pattern.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScatterLists {
    /// For each element its `N` mesh nodes.
    nodes: Vec<u32>,
    /// For each element the position of its `N (N + 1) / 2` blocks in the upper half.
    positions: Vec<u32>,
    /// For each upper block the range of its entries in `block_sources`.
    block_start: Vec<u32>,
    /// `element << 7 | block << 1 | transposed`.
    block_sources: Vec<u32>,
    /// For each mesh node the range of its entries in `force_sources`.
    force_start: Vec<u32>,
    /// `element << 4 | local node`.
    force_sources: Vec<u32>,
    /// For each block of the pattern its upper block, with [`TRANSPOSED`] below the diagonal.
    upper_of_block: Vec<u32>,
}

impl ScatterLists {
    /// Elements that fit the packed entries.
    pub(crate) const MAX_ELEMENTS: usize = 1 << 25;

    /// Lists over the mesh nodes of each element, which `free_of_node` takes to the rows of the pattern.
    pub(crate) fn new<const N: usize>(pattern: &BlockPattern, elements: &[[u32; N]], free_of_node: &[u32]) -> Self {
        let (upper_of_block, uppers) = number_upper_blocks(pattern);
        let pairs = || (0..N).flat_map(|a| (a..N).map(move |b| (a, b)));
        let place = |i, j| pattern.find(i, j).map_or(NOWHERE, |p| upper_of_block[p]);
        let position = |i: u32, j: u32| match (i, j) {
            (FIXED, _) | (_, FIXED) => NOWHERE,
            _ if i <= j => place(i, j),
            _ => place(j, i) | TRANSPOSED,
        };
        let mut positions = Vec::with_capacity(elements.len() * pairs().count());
        for element in elements {
            let free = element.map(|i| free_of_node[i as usize]);
            positions.extend(pairs().map(|(a, b)| position(free[a], free[b])));
        }
        let blocks = positions.chunks_exact(pairs().count()).enumerate().flat_map(|(e, positions)| {
            positions.iter().enumerate().filter(|(_, p)| **p != NOWHERE).map(move |(k, &p)| {
                let transposed = u32::from(p & TRANSPOSED != 0);
                ((p & !TRANSPOSED) as usize, (e as u32) << 7 | (k as u32) << 1 | transposed)
            })
        });
        let (block_start, block_sources) = group(blocks, uppers);
        let forces = elements
            .iter()
            .enumerate()
            .flat_map(|(e, element)| (0..N).map(move |a| (element[a] as usize, (e as u32) << 4 | a as u32)));
        let (force_start, force_sources) = group(forces, free_of_node.len());
        let nodes = elements.iter().flatten().copied().collect();
        Self { nodes, positions, block_start, block_sources, force_start, force_sources, upper_of_block }
    }

    /// Number of upper blocks.
    pub(crate) fn upper_blocks(&self) -> usize {
        self.block_start.len() - 1
    }

    /// Adds the results of consecutive elements from `first` on to `upper` and `forces`; an empty `upper` gets nothing.
    pub(crate) fn scatter<R: NodalShares>(
        &self,
        first: usize,
        results: &[R],
        upper: &mut [Matrix3<f64>],
        forces: &mut [Vector3<f64>],
    ) {
        let n = R::NODES;
        let blocks = n * (n + 1) / 2;
        let nodes = self.nodes[n * first..].chunks_exact(n);
        let positions = self.positions[blocks * first..].chunks_exact(blocks);
        for ((nodes, positions), result) in nodes.zip(positions).zip(results) {
            for (a, &node) in nodes.iter().enumerate() {
                forces[node as usize] += result.force(a);
            }
            if upper.is_empty() {
                continue;
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

    /// Upper block `p` from all element results, kept in the slots that `slot` names.
    pub(crate) fn gather_block<R: NodalShares>(&self, p: usize, results: &[R], slot: &[u32]) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for &source in &self.block_sources[self.block_start[p] as usize..self.block_start[p + 1] as usize] {
            let block = results[slot[(source >> 7) as usize] as usize].upper((source >> 1 & 63) as usize);
            sum += if source & 1 == 0 { block } else { block.transpose() };
        }
        sum
    }

    /// Internal force of mesh node `i` from all element results.
    pub(crate) fn gather_force<R: NodalShares>(&self, i: usize, results: &[R], slot: &[u32]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for &source in &self.force_sources[self.force_start[i] as usize..self.force_start[i + 1] as usize] {
            sum += results[slot[(source >> 4) as usize] as usize].force((source & 15) as usize);
        }
        sum
    }

    /// Position of block `(i, j)` of the pattern in the upper half, for `i <= j`.
    pub(crate) fn upper_position(&self, pattern: &BlockPattern, i: u32, j: u32) -> Option<u32> {
        pattern.find(i, j).map(|p| self.upper_of_block[p])
    }

    /// Block `p` of the pattern from the upper half.
    #[inline]
    pub(crate) fn block(&self, p: usize, upper: &[Matrix3<f64>]) -> Matrix3<f64> {
        let u = self.upper_of_block[p];
        if u & TRANSPOSED == 0 { upper[u as usize] } else { upper[(u & !TRANSPOSED) as usize].transpose() }
    }
}

/// Slots of the elements in a buffer of `size` results per batch.
pub(crate) fn slots(batches: &[crate::model::Batch], size: usize) -> Vec<u32> {
    batches
        .iter()
        .enumerate()
        .flat_map(|(b, batch)| (0..batch.elements.len()).map(move |k| (b * size + k) as u32))
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
pub(super) fn group(items: impl Iterator<Item = (usize, u32)> + Clone, keys: usize) -> (Vec<u32>, Vec<u32>) {
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
