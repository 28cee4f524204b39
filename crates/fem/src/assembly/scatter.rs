//! Where the blocks and forces of the elements go: lists built once with the body.
//!
//! Only blocks `(i, j)` with `i <= j` are summed, those on the diagonal as triangles. Each of them, and each nodal force,
//! is the sum over its elements in ascending order, whether elements are scattered one after the other or gathered by
//! rows in parallel: the same additions in the same order, and so the same bits.

use nalgebra::{Matrix3, Vector3};

use crate::{
    material::BATCH,
    pack::{OFF_DIAGONAL, PACK, Pack, PackMatrices},
    sparse::{BlockPattern, FIXED},
};

/// Set in a position below the diagonal: the block above it, transposed.
const TRANSPOSED: u32 = 1 << 31;

/// Destination of a block that has a fixed node.
const NOWHERE: u32 = u32::MAX;

/// The sums over the elements.
#[derive(Clone, Debug)]
pub(crate) struct Sums {
    /// Blocks of `K` above the diagonal (N/m).
    pub(crate) upper: Vec<Matrix3<f64>>,
    /// Triangles of the diagonal blocks of `K` (N/m), one for each mesh node.
    pub(crate) diagonal: Vec<[f64; 6]>,
    /// Internal force on every mesh node (N).
    pub(crate) forces: Vec<Vector3<f64>>,
}

impl Sums {
    /// Sets all to zero.
    pub(crate) fn clear(&mut self) {
        self.upper.fill(Matrix3::zeros());
        self.diagonal.fill([0.0; 6]);
        self.forces.fill(Vector3::zeros());
    }
}

/// Lists that take element results to the upper blocks and nodal forces, and those to the full pattern.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScatterLists {
    /// For each element the position of its six off-diagonal blocks in the upper half.
    positions: Vec<[u32; 6]>,
    /// For each upper block the range of its entries in `block_sources`.
    block_start: Vec<u32>,
    /// `element << 3 | block`.
    block_sources: Vec<u32>,
    /// For each mesh node the range of its entries in `node_sources`.
    node_start: Vec<u32>,
    /// `element << 2 | local node`.
    node_sources: Vec<u32>,
    /// For each block of the pattern its upper block, with [`TRANSPOSED`] below the diagonal.
    upper_of_block: Vec<u32>,
}

impl ScatterLists {
    /// Elements that fit the packed entries.
    pub(crate) const MAX_ELEMENTS: usize = 1 << 27;

    pub(crate) fn new(pattern: &BlockPattern, packs: &[Pack], free_of_node: &[u32]) -> Self {
        let (upper_of_block, uppers) = number_upper_blocks(pattern);
        let elements = || packs.iter().flat_map(|pack| &pack.nodes[..pack.len]);
        let positions: Vec<[u32; 6]> = elements()
            .map(|nodes| {
                // Ascending like the nodes, but for fixed ones.
                let free = nodes.map(|i| free_of_node[i as usize]);
                OFF_DIAGONAL.map(|(a, b)| match (free[a], free[b]) {
                    (FIXED, _) | (_, FIXED) => NOWHERE,
                    (i, j) => pattern.find(i, j).map_or(NOWHERE, |p| upper_of_block[p]),
                })
            })
            .collect();
        let blocks = positions.iter().enumerate().flat_map(|(e, positions)| {
            let used = positions.iter().enumerate().filter(|(_, p)| **p != NOWHERE);
            used.map(move |(k, &p)| (p as usize, (e as u32) << 3 | k as u32))
        });
        let (block_start, block_sources) = group(blocks, uppers);
        let of_nodes = elements()
            .enumerate()
            .flat_map(|(e, nodes)| (0..4).map(move |a| (nodes[a] as usize, (e as u32) << 2 | a as u32)));
        let (node_start, node_sources) = group(of_nodes, free_of_node.len());
        Self { positions, block_start, block_sources, node_start, node_sources, upper_of_block }
    }

    /// Zero sums.
    pub(crate) fn sums(&self) -> Sums {
        let nodes = self.node_start.len() - 1;
        Sums {
            upper: vec![Matrix3::zeros(); self.block_start.len() - 1],
            diagonal: vec![[0.0; 6]; nodes],
            forces: vec![Vector3::zeros(); nodes],
        }
    }

    /// Adds the results of packs whose first element has number `first`.
    pub(crate) fn scatter(&self, packs: &[Pack], first: usize, results: &[PackMatrices], sums: &mut Sums) {
        let mut positions = self.positions[first..].iter();
        for (pack, result) in packs.iter().zip(results) {
            for (lane, (nodes, positions)) in pack.nodes[..pack.len].iter().zip(&mut positions).enumerate() {
                for (a, &node) in nodes.iter().enumerate() {
                    let force = &mut sums.forces[node as usize];
                    for c in 0..3 {
                        force[c] += result.forces[a][c][lane];
                    }
                    let triangle = &mut sums.diagonal[node as usize];
                    for k in 0..6 {
                        triangle[k] += result.diagonal[a][k][lane];
                    }
                }
                for (block, &p) in result.off_diagonal.iter().zip(positions) {
                    if let Some(sum) = sums.upper.get_mut(p as usize) {
                        let sum = sum.as_mut_slice();
                        for k in 0..9 {
                            sum[k] += block[k][lane];
                        }
                    }
                }
            }
        }
    }

    /// Upper block `p` from all element results, kept in slots of [`BATCH`] per batch through `slot`.
    pub(crate) fn gather_block(&self, p: usize, results: &[PackMatrices], slot: &[u32]) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for &source in &self.block_sources[self.block_start[p] as usize..self.block_start[p + 1] as usize] {
            let slot = slot[(source >> 3) as usize] as usize;
            let block = &results[slot / PACK].off_diagonal[(source & 7) as usize];
            for (sum, row) in sum.iter_mut().zip(block) {
                *sum += row[slot % PACK];
            }
        }
        sum
    }

    /// Force on mesh node `i` and its diagonal block from all element results.
    pub(crate) fn gather_node(&self, i: usize, results: &[PackMatrices], slot: &[u32]) -> (Vector3<f64>, [f64; 6]) {
        let mut force = Vector3::zeros();
        let mut triangle = [0.0; 6];
        for &source in &self.node_sources[self.node_start[i] as usize..self.node_start[i + 1] as usize] {
            let slot = slot[(source >> 2) as usize] as usize;
            let (result, lane, a) = (&results[slot / PACK], slot % PACK, (source & 3) as usize);
            for c in 0..3 {
                force[c] += result.forces[a][c][lane];
            }
            for k in 0..6 {
                triangle[k] += result.diagonal[a][k][lane];
            }
        }
        (force, triangle)
    }

    /// Block `p` of the pattern, which lies off the diagonal.
    #[inline]
    pub(crate) fn block(&self, p: usize, upper: &[Matrix3<f64>]) -> Matrix3<f64> {
        let u = self.upper_of_block[p];
        if u & TRANSPOSED == 0 { upper[u as usize] } else { upper[(u & !TRANSPOSED) as usize].transpose() }
    }
}

/// The symmetric matrix of a triangle `11, 21, 31, 22, 32, 33`.
#[inline]
pub(crate) fn symmetric([a, b, c, d, e, f]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(a, b, c, b, d, e, c, e, f)
}

/// Slots of the elements in a buffer of [`BATCH`] results per batch.
pub(crate) fn slots(batches: &[crate::model::Batch]) -> Vec<u32> {
    batches
        .iter()
        .enumerate()
        .flat_map(|(b, batch)| (0..batch.elements.len()).map(move |k| (b * BATCH + k) as u32))
        .collect()
}

/// Numbers the blocks above the diagonal by rows; blocks below refer to their mirror image, those on it to nothing.
fn number_upper_blocks(pattern: &BlockPattern) -> (Vec<u32>, usize) {
    let mut upper_of_block = vec![NOWHERE; pattern.blocks()];
    let mut count = 0;
    for i in 0..pattern.rows() {
        for p in pattern.row(i).filter(|&p| pattern.columns()[p] as usize > i) {
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
