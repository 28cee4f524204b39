//! Packs of elements summed over the body: as [`scatter`](super::scatter), for results in rows of eight elements.
//!
//! The nodes of a packed element ascend, so no block is transposed on its way; of blocks on the diagonal only the lower
//! triangle is summed, and mirrored at the end.

use nalgebra::{Matrix3, Vector3};

use super::{
    ScatterLists,
    destination::Destination,
    scatter::{NOWHERE, group, slots},
};
use crate::{
    material::BATCH,
    model::Batch,
    pack::{OFF_DIAGONAL, PACK, Pack, PackMatrices},
    sparse::{BlockPattern, FIXED},
};

/// Places of a stored triangle in a matrix by columns.
const LOWER: [usize; 6] = [0, 1, 2, 4, 5, 8];

/// Lists that take the results of packs to the upper blocks and nodal forces.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PackLists {
    /// For each element the position of its four diagonal blocks and six others in the upper half.
    positions: Vec<[u32; 10]>,
    /// Position of each diagonal block.
    diagonals: Vec<u32>,
    /// For each upper block the range of its entries in `block_sources`.
    block_start: Vec<u32>,
    /// `slot << 4 | block`; a slot is a place among the results of all batches, [`BATCH`] for each.
    block_sources: Vec<u32>,
    /// For each mesh node the range of its entries in `force_sources`.
    force_start: Vec<u32>,
    /// `slot << 2 | local node`.
    force_sources: Vec<u32>,
}

impl PackLists {
    /// Lists for the packs of consecutive batches; `scatter` numbers the upper blocks.
    pub(crate) fn new(
        packs: &[Pack],
        batches: &[Batch],
        free_of_node: &[u32],
        pattern: &BlockPattern,
        scatter: &ScatterLists,
    ) -> Self {
        let place = |i, j| scatter.upper_position(pattern, i, j).unwrap_or(NOWHERE);
        let elements = || packs.iter().flat_map(|pack| &pack.nodes[..pack.len]);
        let positions: Vec<[u32; 10]> = elements()
            .map(|nodes| {
                // Ascending like the nodes, but for fixed ones.
                let free = nodes.map(|i| free_of_node[i as usize]);
                std::array::from_fn(|k| {
                    let (a, b) = if k < 4 { (k, k) } else { OFF_DIAGONAL[k - 4] };
                    if free[a] == FIXED || free[b] == FIXED { NOWHERE } else { place(free[a], free[b]) }
                })
            })
            .collect();
        let slots = slots(batches, BATCH);
        let blocks = positions.iter().zip(&slots).flat_map(|(positions, &slot)| {
            let used = positions.iter().enumerate().filter(|(_, p)| **p != NOWHERE);
            used.map(move |(k, &p)| (p as usize, slot << 4 | k as u32))
        });
        let (block_start, block_sources) = group(blocks, scatter.upper_blocks());
        let forces = elements()
            .zip(&slots)
            .flat_map(|(nodes, &slot)| (0..4).map(move |a| (nodes[a] as usize, slot << 2 | a as u32)));
        let (force_start, force_sources) = group(forces, free_of_node.len());
        let diagonals = (0..pattern.rows() as u32).map(|i| place(i, i)).collect();
        Self { positions, diagonals, block_start, block_sources, force_start, force_sources }
    }
}

/// Packs, and the lists for their results.
pub(super) struct Packs<'a> {
    pub(super) lists: &'a PackLists,
    pub(super) packs: &'a [Pack],
}

impl Destination<PackMatrices> for Packs<'_> {
    fn results_of(&self, batch: &Batch) -> usize {
        batch.packs.len()
    }

    fn scatter(&self, batch: &Batch, results: &[PackMatrices], upper: &mut [Matrix3<f64>], f_int: &mut [Vector3<f64>]) {
        let mut positions = self.lists.positions[batch.elements.start..].iter();
        for (pack, result) in self.packs[batch.packs.clone()].iter().zip(results) {
            for (lane, (nodes, positions)) in pack.nodes[..pack.len].iter().zip(&mut positions).enumerate() {
                for (forces, &node) in result.forces.iter().zip(nodes) {
                    let f = f_int[node as usize].as_mut_slice();
                    for (f, row) in f.iter_mut().zip(forces) {
                        *f += row[lane];
                    }
                }
                if upper.is_empty() {
                    continue;
                }
                // `NOWHERE` is beyond the end.
                for (triangle, &p) in result.diagonal.iter().zip(positions) {
                    if let Some(sum) = upper.get_mut(p as usize) {
                        add_triangle(sum, triangle, lane);
                    }
                }
                for (block, &p) in result.off_diagonal.iter().zip(&positions[4..]) {
                    if let Some(sum) = upper.get_mut(p as usize) {
                        add_block(sum, block, lane);
                    }
                }
            }
        }
    }

    fn finish(&self, upper: &mut [Matrix3<f64>]) {
        for &p in &self.lists.diagonals {
            if let Some(block) = upper.get_mut(p as usize) {
                mirror(block);
            }
        }
    }

    fn gather_block(&self, p: usize, results: &[PackMatrices]) -> Matrix3<f64> {
        let lists = self.lists;
        let mut sum = Matrix3::zeros();
        let mut diagonal = false;
        for &source in &lists.block_sources[lists.block_start[p] as usize..lists.block_start[p + 1] as usize] {
            let (slot, k) = ((source >> 4) as usize, (source & 15) as usize);
            let result = &results[slot / PACK];
            diagonal = k < 4;
            if diagonal {
                add_triangle(&mut sum, &result.diagonal[k], slot % PACK);
            } else {
                add_block(&mut sum, &result.off_diagonal[k - 4], slot % PACK);
            }
        }
        if diagonal {
            mirror(&mut sum);
        }
        sum
    }

    fn gather_force(&self, i: usize, results: &[PackMatrices]) -> Vector3<f64> {
        let lists = self.lists;
        let mut sum = Vector3::zeros();
        for &source in &lists.force_sources[lists.force_start[i] as usize..lists.force_start[i + 1] as usize] {
            let (slot, a) = ((source >> 2) as usize, (source & 3) as usize);
            for (sum, row) in sum.iter_mut().zip(&results[slot / PACK].forces[a]) {
                *sum += row[slot % PACK];
            }
        }
        sum
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
fn add_block(sum: &mut Matrix3<f64>, block: &[[f64; PACK]; 9], lane: usize) {
    for (sum, row) in sum.as_mut_slice().iter_mut().zip(block) {
        *sum += row[lane];
    }
}

/// Copies the lower triangle to the upper one.
#[inline]
fn mirror(block: &mut Matrix3<f64>) {
    for (r, c) in [(0, 1), (0, 2), (1, 2)] {
        block[(r, c)] = block[(c, r)];
    }
}
