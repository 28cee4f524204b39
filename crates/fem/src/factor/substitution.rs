//! `L y = b` and `Lᵀ x = y` for one vector, front by front: independent subtrees side by side, large fronts in parts.
//!
//! Each front adds to its parent's what it subtracts from the rows below it, as its update in the factorisation, so that
//! subtrees share nothing:
//! ```text
//! forward:   [x_s; u_s] = [b_s; 0] + u of the children,   x_s <- L11⁻¹ x_s,   u_s <- u_s - L21 x_s
//! backward:  x_s <- L11⁻ᵀ (x_s - L21ᵀ x below),           x below of each child from x of this front
//! ```

#![allow(non_snake_case)]

use pulp::Arch;

use super::column_kernels::{Columns, Stored, solve_lower, solve_upper, subtract_product, subtract_transposed};
use super::supernodal_tree::Run;
use super::symbolic::SymbolicFactor;
use super::workers::join;

/// Columns that are eliminated at once.
const PANEL: usize = 256;

/// Numbers of `L` in a product above which it is cut in two: a tenth of a millisecond.
const TASK_NUMBERS: usize = 300_000;

/// What a walk reads.
struct Walk<'a, T> {
    symbolic: &'a SymbolicFactor,
    values: &'a [T],
    arch: Arch,
}

/// The part of the vector, and of the memory for rows below fronts, that some subtrees own, and where each begins.
struct Part<'a> {
    x: &'a mut [f64],
    x_at: usize,
    below: &'a mut [f64],
    below_at: usize,
}

impl<'a> Part<'a> {
    /// Parts at the first column and the first row below of a subtree.
    fn split(self, column: usize, below: usize) -> (Part<'a>, Part<'a>) {
        let (x, later_x) = self.x.split_at_mut(column - self.x_at);
        let (rows, later_rows) = self.below.split_at_mut(below - self.below_at);
        (
            Part { x, x_at: self.x_at, below: rows, below_at: self.below_at },
            Part { x: later_x, x_at: column, below: later_rows, below_at: below },
        )
    }

    fn reborrow(&mut self) -> Part<'_> {
        Part { x: self.x, x_at: self.x_at, below: self.below, below_at: self.below_at }
    }
}

/// `x <- L⁻¹ x`; `below` holds one number per row of every pattern.
pub(super) fn forward<T: Stored>(symbolic: &SymbolicFactor, values: &[T], x: &mut [f64], below: &mut [f64]) {
    let walk = Walk { symbolic, values, arch: Arch::new() };
    walk.forward_siblings(symbolic.tree().roots(), Part { x, x_at: 0, below, below_at: 0 });
}

/// `x <- L⁻ᵀ x`.
pub(super) fn backward<T: Stored>(symbolic: &SymbolicFactor, values: &[T], x: &mut [f64], below: &mut [f64]) {
    let walk = Walk { symbolic, values, arch: Arch::new() };
    walk.backward_siblings(symbolic.tree().roots(), Part { x, x_at: 0, below, below_at: 0 });
}

impl<T: Stored> Walk<'_, T> {
    /// Cuts a list of siblings in two.
    fn halves<'s, 'p>(&self, siblings: &'s [u32], part: Part<'p>) -> [(&'s [u32], Part<'p>); 2] {
        let tree = self.symbolic.tree();
        let (first, second) = siblings.split_at(siblings.len() / 2);
        let begin = tree.first(second[0] as usize);
        let (left, right) = part.split(tree.columns(begin).start, tree.pattern_start(begin));
        [(first, left), (second, right)]
    }

    fn forward_siblings(&self, siblings: &[u32], part: Part<'_>) {
        match siblings {
            [] => {}
            [s] => self.forward_subtree(*s as usize, part),
            _ => {
                let [first, second] = self.halves(siblings, part);
                join(|| self.forward_siblings(first.0, first.1), || self.forward_siblings(second.0, second.1));
            }
        }
    }

    fn forward_subtree(&self, s: usize, mut part: Part<'_>) {
        let tree = self.symbolic.tree();
        if self.symbolic.arena().is_split_for_solve(s) {
            self.forward_siblings(tree.children(s), part.reborrow());
            self.forward_front(s, &mut part);
        } else {
            (tree.first(s)..=s).for_each(|s| self.forward_front(s, &mut part));
        }
    }

    fn forward_front(&self, s: usize, part: &mut Part<'_>) {
        let tree = self.symbolic.tree();
        let columns = tree.columns(s);
        let x = &mut part.x[columns.start - part.x_at..columns.end - part.x_at];
        let (updates, rest) = part.below.split_at_mut(tree.pattern_start(s) - part.below_at);
        let update = &mut rest[..tree.below(s)];
        update.fill(0.0);
        for &c in tree.children(s) {
            let start = tree.pattern_start(c as usize) - part.below_at;
            let passed = &updates[start..start + tree.below(c as usize)];
            for run in tree.runs(c as usize) {
                let into = in_front(run, x, update);
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

    fn backward_siblings(&self, siblings: &[u32], part: Part<'_>) {
        match siblings {
            [] => {}
            [s] => self.backward_subtree(*s as usize, part),
            _ => {
                let [first, second] = self.halves(siblings, part);
                join(|| self.backward_siblings(first.0, first.1), || self.backward_siblings(second.0, second.1));
            }
        }
    }

    fn backward_subtree(&self, s: usize, mut part: Part<'_>) {
        let tree = self.symbolic.tree();
        if self.symbolic.arena().is_split_for_solve(s) {
            self.backward_front(s, &mut part);
            self.backward_siblings(tree.children(s), part);
        } else {
            (tree.first(s)..=s).rev().for_each(|s| self.backward_front(s, &mut part));
        }
    }

    fn backward_front(&self, s: usize, part: &mut Part<'_>) {
        let tree = self.symbolic.tree();
        let columns = tree.columns(s);
        let x = &mut part.x[columns.start - part.x_at..columns.end - part.x_at];
        let (earlier, rest) = part.below.split_at_mut(tree.pattern_start(s) - part.below_at);
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
            let start = tree.pattern_start(c as usize) - part.below_at;
            let passed = &mut earlier[start..start + tree.below(c as usize)];
            for run in tree.runs(c as usize) {
                passed[run.source()].copy_from_slice(in_front(run, x, below));
            }
        }
    }

    fn block(&self, s: usize) -> Columns<'_, T> {
        let tree = self.symbolic.tree();
        let values = &self.values[tree.value_start(s)..tree.value_start(s + 1)];
        Columns { values, stride: tree.columns(s).len() + tree.below(s), first_row: 0 }
    }

    fn subtract_product(&self, L: Columns<'_, T>, x: &[f64], y: &mut [f64]) {
        if x.len() * y.len() > TASK_NUMBERS && y.len() >= 64 {
            let half = (y.len() / 2).next_multiple_of(8);
            let (upper, lower) = y.split_at_mut(half);
            join(|| self.subtract_product(L, x, upper), || self.subtract_product(L.below(half), x, lower));
        } else {
            subtract_product(self.arch, L, x, y);
        }
    }

    fn subtract_transposed(&self, L: Columns<'_, T>, y: &[f64], x: &mut [f64]) {
        if x.len() * y.len() > TASK_NUMBERS && x.len() >= 16 {
            let half = (x.len() / 2).next_multiple_of(4);
            let (left, right) = x.split_at_mut(half);
            join(|| self.subtract_transposed(L, y, left), || self.subtract_transposed(L.after(half), y, right));
        } else {
            subtract_transposed(self.arch, L, y, x);
        }
    }
}

/// The numbers of a front, own columns or rows below, to which a run of a child leads.
fn in_front<'a>(run: &Run, own: &'a mut [f64], below: &'a mut [f64]) -> &'a mut [f64] {
    let width = own.len();
    let target = run.target();
    if target.start < width { &mut own[target] } else { &mut below[target.start - width..target.end - width] }
}
