//! Sums of columns into a long vector: as many numbers at once as the processor's vectors hold, found at run time.
//!
//! This is what nearly all of the time of a solver goes to. A product is never fused with a sum, so that the bits do not
//! depend on the width of the vectors.

use crate::problem::{Block, ProblemView, gather};
use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

/// `delta += W_{.,a} change`, one pass over `delta` (m), `change` in N.
#[inline]
pub(crate) fn add_columns(view: &ProblemView<'_>, block: &Block, change: &Vector3<f64>, delta: &mut [f64]) {
    let first = view.column(block.start);
    match block.law.rows() {
        1 => Arch::new().dispatch(Add { to: delta, columns: [first], first: block.start, factors: [change.x] }),
        2 => {
            let columns = [first, view.column(block.start + 1)];
            Arch::new().dispatch(Add { to: delta, columns, first: block.start, factors: [change.x, change.y] });
        }
        _ => {
            let columns = [first, view.column(block.start + 1), view.column(block.start + 2)];
            Arch::new().dispatch(Add {
                to: delta,
                columns,
                first: block.start,
                factors: [change.x, change.y, change.z],
            });
        }
    }
}

/// `to += sum of factor times column`, as far as all are long.
#[inline]
pub fn add_scaled<const N: usize>(to: &mut [f64], columns: [&[f64]; N], factors: [f64; N]) {
    Arch::new().dispatch(Add { to, columns, factors, first: 0 });
}

/// `delta = W lambda + delta_free`, block by block: blocks without force cost nothing.
pub(crate) fn form_gap(view: &ProblemView<'_>, lambda: &[f64], delta: &mut [f64]) {
    delta.copy_from_slice(view.delta_free);
    for block in view.blocks {
        let force = gather(lambda, block);
        if force != Vector3::zeros() {
            add_columns(view, block, &force, delta);
        }
    }
}

/// `to += sum of factor times column`.
struct Add<'a, const N: usize> {
    to: &'a mut [f64],
    columns: [&'a [f64]; N],
    factors: [f64; N],
    /// Where to begin: the next block waits for its rows.
    first: usize,
}

impl<const N: usize> WithSimd for Add<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { to, columns, factors, first } = self;
        // As long as the shortest.
        let length = columns.iter().fold(to.len(), |length, column| length.min(column.len()));
        let first = first.min(length);
        let (before, after) = to[..length].split_at_mut(first);
        add(simd, after, columns.map(|column| &column[first..length]), factors);
        add(simd, before, columns.map(|column| &column[..first]), factors);
    }
}

#[inline(always)]
fn add<S: Simd, const N: usize>(simd: S, to: &mut [f64], columns: [&[f64]; N], factors: [f64; N]) {
    let (to, rest) = S::as_mut_simd_f64s(to);
    let halves = columns.map(|column| S::as_simd_f64s(column));
    let wide = halves.map(|(wide, _)| &wide[..to.len()]);
    let splat = factors.map(|factor| simd.splat_f64s(factor));
    for (i, to) in to.iter_mut().enumerate() {
        let mut sum = simd.mul_f64s(wide[0][i], splat[0]);
        for c in 1..N {
            sum = simd.add_f64s(sum, simd.mul_f64s(wide[c][i], splat[c]));
        }
        *to = simd.add_f64s(*to, sum);
    }
    let last = halves.map(|(_, last)| &last[..rest.len()]);
    for (i, to) in rest.iter_mut().enumerate() {
        let mut sum = last[0][i] * factors[0];
        for c in 1..N {
            sum += last[c][i] * factors[c];
        }
        *to += sum;
    }
}
