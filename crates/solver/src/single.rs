//! `W` between the rows of some blocks, in single precision: half the memory, which is what a product with it costs.
//!
//! Products are fused with sums where the processor can. What is found with these numbers is judged in double precision by
//! sums that are not (see [`crate::vectors`]).

use crate::problem::{Block, ProblemView};
use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Columns begin at multiples of this many numbers and end in zeros, so that no vector of the processor is cut.
const LANES: usize = 16;

/// No place.
const NOWHERE: usize = usize::MAX;

/// `W` between the rows of the blocks that were admitted since [`SingleCompliance::begin`], in the order in which they came.
#[derive(Clone, Debug)]
pub(crate) struct SingleCompliance {
    /// By columns of `stride`, m/N.
    numbers: Vec<f32>,
    stride: usize,
    /// Rows of the problem that follow one another here.
    runs: Vec<Range<usize>>,
    /// Where the first row of a block lies here, by its first row in the problem.
    places: Vec<usize>,
    /// Rows.
    rows: usize,
}

impl SingleCompliance {
    pub(crate) fn with_capacity(rows: usize) -> Self {
        Self {
            numbers: Vec::with_capacity(rows * Self::longest(rows)),
            stride: 0,
            runs: Vec::with_capacity(rows),
            places: Vec::with_capacity(rows),
            rows: 0,
        }
    }

    /// Forgets the last problem; room for another of so many rows.
    pub(crate) fn begin(&mut self, rows: usize) {
        self.stride = Self::longest(rows);
        self.places.clear();
        self.places.resize(rows, NOWHERE);
        self.runs.clear();
        self.rows = 0;
        // Numbers that are there are written before they are read.
        self.numbers.resize(rows * self.stride, 0.0);
    }

    /// Length of the longest columns that `rows` rows can have.
    pub(crate) fn longest(rows: usize) -> usize {
        rows.next_multiple_of(LANES)
    }

    /// Length of the columns with the zeros behind them.
    pub(crate) fn length(&self) -> usize {
        self.rows.next_multiple_of(LANES)
    }

    /// The first row of a block; `None` where it was not admitted.
    #[inline(always)]
    pub(crate) fn place(&self, block: &Block) -> Option<usize> {
        self.places.get(block.start).copied().filter(|place| *place != NOWHERE)
    }

    /// Admits blocks, those that are there already included.
    pub(crate) fn admit<'a>(&mut self, view: &ProblemView<'_>, blocks: impl Iterator<Item = &'a Block>) {
        let (old_runs, old_rows) = (self.runs.len(), self.rows);
        for block in blocks {
            match self.places.get_mut(block.start) {
                Some(place) if *place == NOWHERE => *place = self.rows,
                _ => continue,
            }
            let range = block.start..block.start + block.law.rows();
            self.rows += range.len();
            match self.runs[old_runs..].last_mut() {
                Some(last) if last.end == range.start => last.end = range.end,
                _ => self.runs.push(range),
            }
        }
        if self.rows == old_rows {
            return;
        }
        let length = self.length();
        let columns = self.runs.iter().cloned().flatten().zip(self.numbers.chunks_exact_mut(self.stride));
        for (j, (row, column)) in columns.enumerate() {
            let (runs, first) = if j < old_rows { (&self.runs[old_runs..], old_rows) } else { (&self.runs[..], 0) };
            column[first..length].fill(0.0);
            Arch::new().dispatch(Round { from: view.column(row), runs, to: &mut column[first..length] });
        }
    }

    /// The diagonal block of `rows` rows at `place`, by columns and padded with zeros.
    #[inline(always)]
    pub(crate) fn diagonal_block(&self, place: usize, rows: usize) -> [[f32; 4]; 3] {
        let mut block = [[0.0; 4]; 3];
        for (c, to) in block.iter_mut().enumerate().take(rows) {
            match self.column(place + c).get(place..).unwrap_or(&[]) {
                [x, y, z, ..] if rows == 3 => *to = [*x, *y, *z, 0.0],
                [x, y, ..] if rows == 2 => *to = [*x, *y, 0.0, 0.0],
                [x, ..] => *to = [*x, 0.0, 0.0, 0.0],
                [] => {}
            }
        }
        block
    }

    /// Column `j`; empty where there is none.
    #[inline(always)]
    pub(crate) fn column(&self, j: usize) -> &[f32] {
        self.numbers.get(j * self.stride..).and_then(|tail| tail.get(..self.length())).unwrap_or(&[])
    }
}

impl SingleCompliance {
    /// `gap += W_{.,a} force` (m), `force` in N; nothing for a block that was not admitted.
    pub(crate) fn accumulate(&self, block: &Block, force: &Vector3<f64>, gap: &mut [f32]) {
        let Some(place) = self.place(block) else { return };
        let force = [force.x as f32, force.y as f32, force.z as f32, 0.0];
        Arch::new().dispatch(Accumulate { w: self, place, rows: block.law.rows(), force, gap });
    }

    /// `gap += W_{.,a} force` (m) for the block with `rows` rows at `place`. Its own rows and those after it come first: the
    /// next block waits for them.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(&self, simd: S, place: usize, rows: usize, force: &[f32; 4], gap: &mut [f32]) {
        let first = place / LANES * LANES;
        let (before, after) = gap.split_at_mut(first.min(gap.len()));
        let columns: [&[f32]; 3] = std::array::from_fn(|c| self.column(place + c));
        let tails: [&[f32]; 3] = columns.map(|column| column.get(first..).unwrap_or(&[]));
        match rows {
            3 => {
                add_three(simd, after, tails, force);
                add_three(simd, before, columns, force);
            }
            _ => {
                for c in 0..rows.min(3) {
                    add_one(simd, after, tails[c], force[c]);
                    add_one(simd, before, columns[c], force[c]);
                }
            }
        }
    }
}

/// [`SingleCompliance::add`] by itself.
struct Accumulate<'a> {
    w: &'a SingleCompliance,
    place: usize,
    rows: usize,
    force: [f32; 4],
    gap: &'a mut [f32],
}

impl WithSimd for Accumulate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.w.add(simd, self.place, self.rows, &self.force, self.gap);
    }
}

/// `gap += sum of force times column`; what does not fill a vector of the processor is left out.
#[inline(always)]
fn add_three<S: Simd>(simd: S, gap: &mut [f32], [a, b, c]: [&[f32]; 3], force: &[f32; 4]) {
    let (gap, a) = (S::as_mut_simd_f32s(gap).0, S::as_simd_f32s(a).0);
    let (b, c) = (S::as_simd_f32s(b).0, S::as_simd_f32s(c).0);
    let (x, y, z) = (simd.splat_f32s(force[0]), simd.splat_f32s(force[1]), simd.splat_f32s(force[2]));
    for (gap, (a, (b, c))) in gap.iter_mut().zip(a.iter().zip(b.iter().zip(c))) {
        let sum = simd.mul_add_e_f32s(*b, y, simd.mul_add_e_f32s(*a, x, *gap));
        *gap = simd.mul_add_e_f32s(*c, z, sum);
    }
}

#[inline(always)]
fn add_one<S: Simd>(simd: S, gap: &mut [f32], column: &[f32], force: f32) {
    let force = simd.splat_f32s(force);
    for (gap, w) in S::as_mut_simd_f32s(gap).0.iter_mut().zip(S::as_simd_f32s(column).0) {
        *gap = simd.mul_add_e_f32s(*w, force, *gap);
    }
}

/// `to` is the `runs` of `from` in single precision, one after the other.
struct Round<'a> {
    from: &'a [f64],
    runs: &'a [Range<usize>],
    to: &'a mut [f32],
}

impl WithSimd for Round<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut to = self.to.iter_mut();
        for run in self.runs {
            for (from, to) in self.from.get(run.clone()).unwrap_or(&[]).iter().zip(&mut to) {
                *to = *from as f32;
            }
        }
    }
}
