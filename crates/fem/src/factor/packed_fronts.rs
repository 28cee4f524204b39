//! `L y = b` and `Lᵀ x = y` for one vector with the packed copy of `L`.
//!
//! The same recursion as with the stored values. A front keeps own and lower rows in one piece, `[x_s; u_s]`.

use pulp::Arch;

use super::packed::EIGHT;
use super::packed_kernels::Front;
use super::symbolic::SymbolicFactor;
use super::walk::{self, Fronts, Part, in_front};

struct PackedFronts<'a> {
    symbolic: &'a SymbolicFactor,
    packed: &'a [f32],
    arch: Arch,
}

/// `x <- L⁻¹ x`; `rows` holds one number per row of every front.
pub(super) fn forward(symbolic: &SymbolicFactor, packed: &[f32], x: &mut [f64], rows: &mut [f64]) {
    walk::forward(symbolic, &PackedFronts { symbolic, packed, arch: Arch::new() }, x, rows);
}

/// `x <- L⁻ᵀ x`.
pub(super) fn backward(symbolic: &SymbolicFactor, packed: &[f32], x: &mut [f64], rows: &mut [f64]) {
    walk::backward(symbolic, &PackedFronts { symbolic, packed, arch: Arch::new() }, x, rows);
}

impl Fronts for PackedFronts<'_> {
    fn start(&self, s: usize) -> usize {
        self.symbolic.packed().row_start(s)
    }

    fn forward(&self, s: usize, part: &mut Part<'_>) {
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

    fn backward(&self, s: usize, part: &mut Part<'_>) {
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
        Front { shape: layout.shape(tree, s), packed: layout.front(s, self.packed), arch: self.arch }
    }
}
