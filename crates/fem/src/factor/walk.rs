//! The walk of a solve over the fronts: independent subtrees side by side, children before parents or after them.
//!
//! Each front adds to its parent's what it subtracts from the rows below it, as its update in the factorisation, so that
//! subtrees share nothing: a subtree owns a stretch of the vector, and a stretch of the memory in which fronts keep rows.

use super::supernodal_tree::{Run, SupernodeTree};
use super::symbolic::SymbolicFactor;
use super::workers::join;

/// What is done at one front.
pub(super) trait Fronts: Sync {
    /// Numbers of the vector, and of the rows that fronts keep.
    type Number: Send;

    /// Where the rows that the front `s` keeps begin in the memory for them; ascending.
    fn start(&self, s: usize) -> usize;

    /// `x <- L11⁻¹ x` for the columns of the front, and what it subtracts from the rows below them. Its children are done.
    fn forward(&self, s: usize, part: &mut Part<'_, Self::Number>);

    /// `x <- L11⁻ᵀ (x - L21ᵀ x below)`, and the rows below of its children. Its parent is done.
    fn backward(&self, s: usize, part: &mut Part<'_, Self::Number>);
}

/// The part of the vector, and of the memory for rows of fronts, that some subtrees own, and where each begins.
pub(super) struct Part<'a, T> {
    pub(super) x: &'a mut [T],
    pub(super) x_at: usize,
    pub(super) rows: &'a mut [T],
    pub(super) rows_at: usize,
}

impl<'a, T> Part<'a, T> {
    fn whole(x: &'a mut [T], rows: &'a mut [T]) -> Self {
        Self { x, x_at: 0, rows, rows_at: 0 }
    }

    /// Parts at the first column and the first kept row of a subtree.
    fn split(self, column: usize, row: usize) -> (Part<'a, T>, Part<'a, T>) {
        let (x, later_x) = self.x.split_at_mut(column - self.x_at);
        let (rows, later_rows) = self.rows.split_at_mut(row - self.rows_at);
        (
            Part { x, x_at: self.x_at, rows, rows_at: self.rows_at },
            Part { x: later_x, x_at: column, rows: later_rows, rows_at: row },
        )
    }

    fn reborrow(&mut self) -> Part<'_, T> {
        Part { x: self.x, x_at: self.x_at, rows: self.rows, rows_at: self.rows_at }
    }
}

/// `x <- L⁻¹ x`.
pub(super) fn forward<F: Fronts>(symbolic: &SymbolicFactor, fronts: &F, x: &mut [F::Number], rows: &mut [F::Number]) {
    let walk = Walk { symbolic, tree: symbolic.tree(), fronts };
    walk.forward_siblings(walk.tree.roots(), Part::whole(x, rows));
}

/// `x <- L⁻ᵀ x`.
pub(super) fn backward<F: Fronts>(symbolic: &SymbolicFactor, fronts: &F, x: &mut [F::Number], rows: &mut [F::Number]) {
    let walk = Walk { symbolic, tree: symbolic.tree(), fronts };
    walk.backward_siblings(walk.tree.roots(), Part::whole(x, rows));
}

struct Walk<'a, F> {
    symbolic: &'a SymbolicFactor,
    tree: &'a SupernodeTree,
    fronts: &'a F,
}

impl<F: Fronts> Walk<'_, F> {
    /// Cuts a list of siblings in two.
    fn halves<'s, 'p>(&self, siblings: &'s [u32], part: Part<'p, F::Number>) -> [(&'s [u32], Part<'p, F::Number>); 2] {
        let (first, second) = siblings.split_at(siblings.len() / 2);
        let begin = self.tree.first(second[0] as usize);
        let (left, right) = part.split(self.tree.columns(begin).start, self.fronts.start(begin));
        [(first, left), (second, right)]
    }

    fn forward_siblings(&self, siblings: &[u32], part: Part<'_, F::Number>) {
        match siblings {
            [] => {}
            [s] => self.forward_subtree(*s as usize, part),
            _ => {
                let [first, second] = self.halves(siblings, part);
                join(|| self.forward_siblings(first.0, first.1), || self.forward_siblings(second.0, second.1));
            }
        }
    }

    fn forward_subtree(&self, s: usize, mut part: Part<'_, F::Number>) {
        if self.symbolic.arena().is_split_for_solve(s) {
            self.forward_siblings(self.tree.children(s), part.reborrow());
            self.fronts.forward(s, &mut part);
        } else {
            (self.tree.first(s)..=s).for_each(|s| self.fronts.forward(s, &mut part));
        }
    }

    fn backward_siblings(&self, siblings: &[u32], part: Part<'_, F::Number>) {
        match siblings {
            [] => {}
            [s] => self.backward_subtree(*s as usize, part),
            _ => {
                let [first, second] = self.halves(siblings, part);
                join(|| self.backward_siblings(first.0, first.1), || self.backward_siblings(second.0, second.1));
            }
        }
    }

    fn backward_subtree(&self, s: usize, mut part: Part<'_, F::Number>) {
        if self.symbolic.arena().is_split_for_solve(s) {
            self.fronts.backward(s, &mut part);
            self.backward_siblings(self.tree.children(s), part);
        } else {
            (self.tree.first(s)..=s).rev().for_each(|s| self.fronts.backward(s, &mut part));
        }
    }
}

/// The numbers of a front with `width` columns, `own` columns or rows below, to which a run of a child leads.
pub(super) fn in_front<'a, T>(run: &Run, width: usize, own: &'a mut [T], below: &'a mut [T]) -> &'a mut [T] {
    let target = run.target();
    if target.start < width { &mut own[target] } else { &mut below[target.start - width..target.end - width] }
}
