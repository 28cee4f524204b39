//! The first substitution of a Newton step's system, which takes the forces that the laws give along.
//!
//! With the matrix `M = P + U` of [`crate::krylov`], right sides `f` and given forces `g`, the system is
//! `M x = f - T W g`. Forming its right side takes one pass over the columns of `W`. The same pass does a substitution, each
//! contact with the gaps that the forces before it make, given ones included:
//!
//! ```text
//! x_a = N_a (f_a - T_a (gap_a + W_aa g_a)) ,   gap += W_{.,a} (g_a + D_a x_a)
//! ```
//!
//! At its end the gaps are those of all forces, and what is left of the right side, `f - T gap - own x`, is known.

use crate::active_block::ActiveBlock;
use crate::active_rows::GivenForce;
use crate::coupled_block::{CoupledBlock, Quad, times};
use crate::single::SingleCompliance;
use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

/// Memory of the substitution, a quad for each block.
#[derive(Clone, Debug)]
pub(crate) struct FirstSubstitution {
    /// `f`; then what is left of it.
    right: Vec<[f64; 4]>,
    /// `g`.
    given: Vec<Quad>,
    x: Vec<Quad>,
    /// Gaps of all forces.
    gap: Vec<f32>,
    /// What all of these are relative to, so that they stay in the range of single precision: the size of `f` and `g`
    /// together, N/(N/m)^1/2.
    size: f64,
}

impl FirstSubstitution {
    /// Memory of systems of up to `blocks` blocks on `rows` rows.
    pub(crate) fn with_capacity(blocks: usize, rows: usize) -> Self {
        Self {
            right: Vec::with_capacity(blocks),
            given: Vec::with_capacity(blocks),
            x: Vec::with_capacity(blocks),
            gap: Vec::with_capacity(SingleCompliance::longest(rows)),
            size: 0.0,
        }
    }

    /// Runs over `blocks`, whose equations are `coupled`, with the forces of `others` that have none. What is left of the
    /// right sides, and by what errors of the whole are multiplied to be relative to that; `None` for numbers that are not finite.
    pub(crate) fn run(
        &mut self,
        w: &SingleCompliance,
        coupled: &[CoupledBlock],
        blocks: &[ActiveBlock],
        others: &[GivenForce],
    ) -> Option<(&[[f64; 4]], f64)> {
        let Self { right, given, x, gap, size } = self;
        right.clear();
        right.extend(blocks.iter().map(|active| active.right(&Vector3::zeros())));
        let squared = right.as_flattened().iter().map(|f| f * f).sum::<f64>()
            + blocks.iter().map(|active| (active.given / active.scale).norm_squared()).sum::<f64>()
            + others.iter().map(|other| (other.force / other.scale).norm_squared()).sum::<f64>();
        *size = squared.sqrt();
        if !size.is_finite() {
            return None;
        }
        let inverse = if *size > 0.0 { 1.0 / *size } else { 0.0 };
        right.as_flattened_mut().iter_mut().for_each(|f| *f *= inverse);
        gap.clear();
        gap.resize(w.length(), 0.0);
        for other in others {
            w.accumulate(&other.block, &(other.force * inverse), gap);
        }
        given.clear();
        given.extend(blocks.iter().map(|active| {
            let force = active.given * inverse;
            [force.x as f32, force.y as f32, force.z as f32, 0.0]
        }));
        x.clear();
        x.resize(blocks.len(), [0.0; 4]);
        let left = Arch::new().dispatch(Pass { w, blocks: coupled, given, right, x, gap });
        left.is_finite().then(|| (right.as_slice(), if left > 0.0 { 1.0 / left } else { 1.0 }))
    }

    /// Adds the forces of the unknowns to `direction` (N), with what was found after the substitution.
    pub(crate) fn add(&self, blocks: &[ActiveBlock], found: &[[f64; 4]], direction: &mut [f64]) {
        for ((active, first), found) in blocks.iter().zip(&self.x).zip(found) {
            let z: [f64; 3] = std::array::from_fn(|l| self.size * (f64::from(first[l]) + found[l]));
            active.add(&z, direction);
        }
    }
}

/// The substitution; the result is the size of what is left of the right sides.
struct Pass<'a> {
    w: &'a SingleCompliance,
    blocks: &'a [CoupledBlock],
    given: &'a [Quad],
    right: &'a mut [[f64; 4]],
    x: &'a mut [Quad],
    /// Of given forces of blocks without unknowns; then of all forces.
    gap: &'a mut [f32],
}

impl WithSimd for Pass<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { w, blocks, given, right, x, gap } = self;
        for (((block, given), right), x) in blocks.iter().zip(given).zip(right.iter()).zip(x.iter_mut()) {
            let mut own = block.read(gap);
            let diagonal = times(&w.diagonal_block(block.place, block.rows), given);
            for i in 0..4 {
                own[i] += diagonal[i];
            }
            let (mut force, unknowns) = block.substitute(&right.map(|f| f as f32), &own);
            for i in 0..4 {
                force[i] += given[i];
            }
            *x = unknowns;
            w.add(simd, block.place, block.rows, &force, gap);
        }
        let mut squared = 0.0;
        for ((block, right), x) in blocks.iter().zip(right).zip(x) {
            let closed = times(&block.tests, &block.read(gap));
            for i in 0..4 {
                right[i] -= f64::from(closed[i] + block.own[i] * x[i]);
                squared += right[i] * right[i];
            }
        }
        squared.sqrt()
    }
}
