//! `L y = b` and `Lᵀ x = y` for one vector with the packed copy of `L`.
//!
//! The same recursion as with the stored values. A front keeps own and lower rows in one piece, `[x_s; u_s]`.

use pulp::Arch;

use super::packed::EIGHT;
use super::packed_copy::PackedCopy;
use super::packed_kernels::Front;
use super::symbolic::SymbolicFactor;
use super::walk::{self, Fronts, Part, in_front};

struct PackedFronts<'a> {
    symbolic: &'a SymbolicFactor,
    packed: &'a PackedCopy,
    arch: Arch,
}

/// A vector, scaled to the middle of the range of single precision, and the rows of all fronts.
pub(super) struct PackedWorkspace {
    x: Vec<f32>,
    rows: Vec<f32>,
    /// What the vector was multiplied with.
    scale: f64,
}

impl PackedWorkspace {
    pub(super) fn new(symbolic: &SymbolicFactor) -> Self {
        Self { x: vec![0.0; symbolic.degrees_of_freedom()], rows: vec![0.0; symbolic.packed().rows()], scale: 1.0 }
    }

    pub(super) fn fits(&self, symbolic: &SymbolicFactor) -> bool {
        self.x.len() == symbolic.degrees_of_freedom() && self.rows.len() == symbolic.packed().rows()
    }

    /// Takes a vector in elimination order.
    pub(super) fn take(&mut self, permuted: &[f64]) {
        let largest = permuted.iter().fold(0.0, |most: f64, x| if x.abs() > most { x.abs() } else { most });
        // By a power of two nothing is rounded: that which takes the largest number to between one and two.
        let exponent = (largest.to_bits() >> 52).clamp(1, 2045);
        self.scale = f64::from_bits((2046 - exponent) << 52);
        self.x.iter_mut().zip(permuted).for_each(|(x, from)| *x = (from * self.scale) as f32);
    }

    /// Puts the vector back; false where it has left the range of single precision, and `permuted` is as it was.
    pub(super) fn give(&self, permuted: &mut [f64]) -> bool {
        let finite = self.x.iter().all(|x| x.is_finite());
        if finite {
            permuted.iter_mut().zip(&self.x).for_each(|(to, x)| *to = f64::from(*x) / self.scale);
        }
        finite
    }

    /// `x <- L⁻¹ x` for the vector that was taken.
    pub(super) fn forward(&mut self, symbolic: &SymbolicFactor, packed: &PackedCopy) {
        walk::forward(symbolic, &PackedFronts { symbolic, packed, arch: Arch::new() }, &mut self.x, &mut self.rows);
    }

    /// `x <- L⁻ᵀ x`.
    pub(super) fn backward(&mut self, symbolic: &SymbolicFactor, packed: &PackedCopy) {
        walk::backward(symbolic, &PackedFronts { symbolic, packed, arch: Arch::new() }, &mut self.x, &mut self.rows);
    }
}

impl Fronts for PackedFronts<'_> {
    type Number = f32;

    fn start(&self, s: usize) -> usize {
        self.symbolic.packed().row_start(s)
    }

    fn forward(&self, s: usize, part: &mut Part<'_, f32>) {
        let tree = self.symbolic.tree();
        let front = self.front(s);
        let shape = front.shape;
        let x = &mut part.x[tree.columns(s).start - part.x_at..tree.columns(s).end - part.x_at];
        let (updates, rest) = part.rows.split_at_mut(self.start(s) - part.rows_at);
        let rows = &mut rest[..shape.rows];
        let (own, below) = rows.split_at_mut(shape.own);
        own[..shape.width].copy_from_slice(x);
        own[shape.width..].fill(0.0);
        below.fill(0.0);
        for &c in tree.children(s) {
            let c = c as usize;
            let start = self.start(c) - part.rows_at + tree.columns(c).len().next_multiple_of(EIGHT);
            let passed = &updates[start..start + tree.below(c)];
            for run in tree.runs(c) {
                let into = in_front(run, shape.width, own, below);
                into.iter_mut().zip(&passed[run.source()]).for_each(|(into, passed)| *into += passed);
            }
        }
        front.solve(rows.as_chunks_mut().0);
        x.copy_from_slice(&rows[..shape.width]);
    }

    fn backward(&self, s: usize, part: &mut Part<'_, f32>) {
        let tree = self.symbolic.tree();
        let front = self.front(s);
        let shape = front.shape;
        let x = &mut part.x[tree.columns(s).start - part.x_at..tree.columns(s).end - part.x_at];
        let (earlier, rest) = part.rows.split_at_mut(self.start(s) - part.rows_at);
        let rows = &mut rest[..shape.rows];
        rows[..shape.width].copy_from_slice(x);
        rows[shape.width..shape.own].fill(0.0);
        rows[shape.own + tree.below(s)..].fill(0.0);
        front.solve_transposed(rows.as_chunks_mut().0);
        x.copy_from_slice(&rows[..shape.width]);
        let (own, below) = rows.split_at_mut(shape.own);
        for &c in tree.children(s) {
            let c = c as usize;
            let start = self.start(c) - part.rows_at + tree.columns(c).len().next_multiple_of(EIGHT);
            let passed = &mut earlier[start..start + tree.below(c)];
            for run in tree.runs(c) {
                passed[run.source()].copy_from_slice(in_front(run, shape.width, own, below));
            }
        }
    }
}

impl PackedFronts<'_> {
    fn front(&self, s: usize) -> Front<'_> {
        let (tree, layout) = (self.symbolic.tree(), self.symbolic.packed());
        Front { shape: layout.shape(tree, s), packed: self.packed.front(layout, s), arch: self.arch }
    }
}
