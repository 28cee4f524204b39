//! `L y = b` and `Lᵀ x = y` for one vector with the stored values of `L`, large fronts in parts.
//!
//! ```text
//! forward:   [x_s; u_s] = [b_s; 0] + u of the children,   x_s <- L11⁻¹ x_s,   u_s <- u_s - L21 x_s
//! backward:  x_s <- L11⁻ᵀ (x_s - L21ᵀ x below),           x below of each child from x of this front
//! ```

#![allow(non_snake_case)]

use pulp::Arch;

use super::column_kernels::{Columns, solve_lower, solve_upper, subtract_product, subtract_transposed};
use super::symbolic::SymbolicFactor;
use super::walk::{self, Fronts, Part, in_front};
use super::workers::join;

/// Columns that are eliminated at once.
const PANEL: usize = 256;

/// Numbers of `L` in a product above which it is cut in two: a tenth of a millisecond.
const TASK_NUMBERS: usize = 300_000;

/// Fronts as the factorisation leaves them; each keeps the rows of its pattern.
struct DenseFronts<'a> {
    symbolic: &'a SymbolicFactor,
    values: &'a [f64],
    arch: Arch,
}

/// `x <- L⁻¹ x`; `below` holds one number per row of every pattern.
pub(super) fn forward(symbolic: &SymbolicFactor, values: &[f64], x: &mut [f64], below: &mut [f64]) {
    walk::forward(symbolic, &DenseFronts { symbolic, values, arch: Arch::new() }, x, below);
}

/// `x <- L⁻ᵀ x`.
pub(super) fn backward(symbolic: &SymbolicFactor, values: &[f64], x: &mut [f64], below: &mut [f64]) {
    walk::backward(symbolic, &DenseFronts { symbolic, values, arch: Arch::new() }, x, below);
}

impl Fronts for DenseFronts<'_> {
    type Number = f64;

    fn start(&self, s: usize) -> usize {
        self.symbolic.tree().pattern_start(s)
    }

    fn forward(&self, s: usize, part: &mut Part<'_, f64>) {
        let tree = self.symbolic.tree();
        let columns = tree.columns(s);
        let x = &mut part.x[columns.start - part.x_at..columns.end - part.x_at];
        let (updates, rest) = part.rows.split_at_mut(tree.pattern_start(s) - part.rows_at);
        let update = &mut rest[..tree.below(s)];
        update.fill(0.0);
        for &c in tree.children(s) {
            let start = tree.pattern_start(c as usize) - part.rows_at;
            let passed = &updates[start..start + tree.below(c as usize)];
            for run in tree.runs(c as usize) {
                let into = in_front(run, x.len(), x, update);
                into.iter_mut().zip(&passed[run.source()]).for_each(|(into, passed)| *into += passed);
            }
        }
        let L = self.block(s);
        for start in (0..x.len()).step_by(PANEL) {
            let end = (start + PANEL).min(x.len());
            let (known, rest) = x[start..].split_at_mut(end - start);
            let panel = L.after(start).below(start);
            solve_lower(self.arch, panel, known);
            self.subtract_product(panel.below(known.len()), known, rest);
            self.subtract_product(panel.below(known.len() + rest.len()), known, update);
        }
    }

    fn backward(&self, s: usize, part: &mut Part<'_, f64>) {
        let tree = self.symbolic.tree();
        let columns = tree.columns(s);
        let x = &mut part.x[columns.start - part.x_at..columns.end - part.x_at];
        let (earlier, rest) = part.rows.split_at_mut(tree.pattern_start(s) - part.rows_at);
        let below = &mut rest[..tree.below(s)];
        let L = self.block(s);
        for start in (0..x.len()).step_by(PANEL).rev() {
            let end = (start + PANEL).min(x.len());
            let (wanted, known) = x[start..].split_at_mut(end - start);
            let panel = L.after(start).below(start);
            self.subtract_transposed(panel.below(wanted.len() + known.len()), below, wanted);
            self.subtract_transposed(panel.below(wanted.len()), known, wanted);
            solve_upper(self.arch, panel, wanted);
        }
        for &c in tree.children(s) {
            let start = tree.pattern_start(c as usize) - part.rows_at;
            let passed = &mut earlier[start..start + tree.below(c as usize)];
            for run in tree.runs(c as usize) {
                passed[run.source()].copy_from_slice(in_front(run, x.len(), x, below));
            }
        }
    }
}

impl DenseFronts<'_> {
    fn block(&self, s: usize) -> Columns<'_> {
        let tree = self.symbolic.tree();
        let values = &self.values[tree.value_start(s)..tree.value_start(s + 1)];
        Columns { values, stride: tree.columns(s).len() + tree.below(s), first_row: 0 }
    }

    fn subtract_product(&self, L: Columns<'_>, x: &[f64], y: &mut [f64]) {
        if x.len() * y.len() > TASK_NUMBERS && y.len() >= 64 {
            let half = (y.len() / 2).next_multiple_of(8);
            let (upper, lower) = y.split_at_mut(half);
            join(|| self.subtract_product(L, x, upper), || self.subtract_product(L.below(half), x, lower));
        } else {
            subtract_product(self.arch, L, x, y);
        }
    }

    fn subtract_transposed(&self, L: Columns<'_>, y: &[f64], x: &mut [f64]) {
        if x.len() * y.len() > TASK_NUMBERS && x.len() >= 16 {
            let half = (x.len() / 2).next_multiple_of(4);
            let (left, right) = x.split_at_mut(half);
            join(|| self.subtract_transposed(L, y, left), || self.subtract_transposed(L.after(half), y, right));
        } else {
            subtract_transposed(self.arch, L, y, x);
        }
    }
}
