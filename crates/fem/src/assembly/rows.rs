//! Rows of the system matrix from the upper blocks of `K`, in parallel where there are threads.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::{Coefficients, ROWS, upper::Half};
use crate::{model::FemModel, sparse::SystemMatrix};

/// One block of `mass M + stiffness K`. Diagonal blocks are made symmetric: their sums are so only up to rounding.
#[inline]
pub(super) fn system_block(K: Half<'_>, coefficients: Coefficients, mass: f64, diagonal: bool) -> Matrix3<f64> {
    let mut block = K.scaled(coefficients.stiffness);
    if diagonal {
        block = (block + block.transpose()) * 0.5;
        for c in 0..3 {
            block[(c, c)] += coefficients.mass * mass;
        }
    }
    block
}

/// The row of a held node: a mass alone.
fn hold(i: usize, model: &FemModel, blocks: &mut [Matrix3<f64>]) {
    let mass = model.held_mass();
    for (p, block) in model.pattern().row(i).zip(blocks) {
        let diagonal = model.pattern().columns()[p] as usize == i;
        *block = if diagonal { Matrix3::from_diagonal_element(mass) } else { Matrix3::zeros() };
    }
}

/// Calls `row(free node, mesh node, blocks of the row)` for every row, in parallel where there are threads; what it
/// returns goes to the right side. Held nodes have a row of their own.
pub(super) fn for_rows(
    model: &FemModel,
    system: &mut SystemMatrix,
    rhs: &mut [f64],
    row: impl Fn(usize, usize, &mut [Matrix3<f64>]) -> Vector3<f64> + Sync,
) {
    let pattern = model.pattern();
    // Halves the rows until they are few, so that no task list is needed.
    fn split(
        rows: std::ops::Range<usize>,
        model: &FemModel,
        blocks: &mut [Matrix3<f64>],
        rhs: &mut [f64],
        row: &(impl Fn(usize, usize, &mut [Matrix3<f64>]) -> Vector3<f64> + Sync),
        threads: usize,
    ) {
        let pattern = model.pattern();
        let first = pattern.row(rows.start).start;
        if rows.len() <= ROWS || threads == 1 {
            for (i, rhs) in rows.zip(rhs.chunks_exact_mut(3)) {
                let range = pattern.row(i);
                let blocks = &mut blocks[range.start - first..range.end - first];
                if model.held()[i] {
                    hold(i, model, blocks);
                    rhs.fill(0.0);
                    continue;
                }
                rhs.copy_from_slice(row(i, model.node_of_free()[i] as usize, blocks).as_slice());
            }
            return;
        }
        let middle = rows.start + rows.len() / 2;
        let (low, high) = blocks.split_at_mut(pattern.row(middle).start - first);
        let (rhs_low, rhs_high) = rhs.split_at_mut(3 * (middle - rows.start));
        rayon::join(
            || split(rows.start..middle, model, low, rhs_low, row, threads),
            || split(middle..rows.end, model, high, rhs_high, row, threads),
        );
    }
    let threads = rayon::current_num_threads();
    split(0..pattern.rows(), model, &mut system.blocks, rhs, &row, threads);
}
