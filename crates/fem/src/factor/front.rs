//! One front of the multifrontal method (Duff and Reid 1983): assembly, dense Cholesky, update matrix.
//!
//! ```text
//! [ F11      ]     A and the updates of the children, added over the front's rows
//! [ F21  F22 ]
//! F11 = L11 L11ᵀ,  L21 = F21 L11⁻ᵀ,  U = F22 - L21 L21ᵀ      U is passed on
//! ```
//! Large products are cut by their sizes alone, never by the number of threads, so that every number comes from the same
//! operations in the same order wherever it is computed.

#![allow(non_snake_case)]

use std::ops::Range;

use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization, cholesky_in_place};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par, Spec};

use super::arena::Arena;
use super::number::Number;
use super::supernodal_tree::{Run, SupernodeTree};
use super::workers::join;

/// Columns that are eliminated at once.
const PANEL: usize = 128;

/// Multiplications of a product above which it is cut in two: about a tenth of a millisecond.
const TASK_PRODUCTS: usize = 2_000_000;

/// Bytes of scratch that faer asks for to factor a panel: one aligned column.
const PANEL_SCRATCH: usize = 8 * PANEL + 512;

/// The update of a child and where it belongs in the front.
struct Child<'a, T> {
    runs: &'a [Run],
    /// Square, by columns; only the lower triangle counts.
    update: &'a [T],
    size: usize,
}

/// The children of a front, whose updates lie in `updates`.
#[derive(Clone, Copy)]
pub(super) struct Children<'a, T> {
    pub(super) list: &'a [u32],
    pub(super) tree: &'a SupernodeTree,
    pub(super) arena: &'a Arena,
    pub(super) updates: &'a [T],
    /// Where `updates` begins in the whole memory for updates.
    pub(super) updates_at: usize,
}

impl<'a, T> Children<'a, T> {
    fn iter(self) -> impl Iterator<Item = Child<'a, T>> {
        self.list.iter().map(move |&c| {
            let Range { start, end } = self.arena.update(c as usize);
            let update = &self.updates[start - self.updates_at..end - self.updates_at];
            Child { runs: self.tree.runs(c as usize), update, size: self.tree.below(c as usize) }
        })
    }
}

/// Columns `columns` of a front, from its row `first_row` down, in memory with `rows` numbers a column.
struct FrontColumns<'a, T> {
    values: &'a mut [T],
    rows: usize,
    first_row: usize,
    columns: Range<usize>,
}

impl<'a, T: Number> FrontColumns<'a, T> {
    fn split(self, column: usize) -> (FrontColumns<'a, T>, FrontColumns<'a, T>) {
        let (left, right) = self.values.split_at_mut((column - self.columns.start) * self.rows);
        let part = |values, columns| FrontColumns { values, rows: self.rows, first_row: self.first_row, columns };
        (part(left, self.columns.start..column), part(right, column..self.columns.end))
    }

    /// Adds what the children pass on to these columns.
    fn add_updates(&mut self, child: &Child<'_, T>) {
        for (k, run) in child.runs.iter().enumerate() {
            let target = run.target();
            let from = target.start.max(self.columns.start);
            for column in from..target.end.min(self.columns.end) {
                let j = run.from as usize + column - target.start;
                let source = &child.update[j * child.size..(j + 1) * child.size];
                let place = (column - self.columns.start) * self.rows;
                let into = &mut self.values[place..place + self.rows];
                add(&mut into[column - self.first_row..target.end - self.first_row], &source[j..run.source().end]);
                for below in &child.runs[k + 1..] {
                    let rows = below.target();
                    add(&mut into[rows.start - self.first_row..rows.end - self.first_row], &source[below.source()]);
                }
            }
        }
    }

    /// Subtracts `panel panelᵀ`, of which row `r` belongs to row `first_row + r` of the front; or puts its negative in the
    /// place of what was there. Then adds the updates of `children`.
    fn subtract_product(mut self, panel: MatRef<'_, T>, accum: Accum, children: Option<Children<'_, T>>) {
        let Range { start, end } = self.columns;
        let (height, width) = (self.first_row + self.rows - start, end - start);
        if height * width * panel.ncols().max(1) > TASK_PRODUCTS && width >= 32 {
            // the left half is the taller one
            let middle = (start + width / 2).next_multiple_of(8).min(end - 8);
            let (left, right) = self.split(middle);
            join(|| left.subtract_product(panel, accum, children), || right.subtract_product(panel, accum, children));
            return;
        }
        let top = start - self.first_row;
        let panel = panel.subrows(top, panel.nrows() - top);
        let target = MatMut::from_column_major_slice_with_stride_mut(self.values, self.rows, width, self.rows);
        let (mut square, mut below) = target.subrows_mut(top, self.rows - top).split_at_row_mut(width);
        let (beside, under) = panel.split_at_row(width);
        triangular::matmul(
            square.rb_mut(),
            BlockStructure::TriangularLower,
            accum,
            beside,
            BlockStructure::Rectangular,
            beside.transpose(),
            BlockStructure::Rectangular,
            T::MINUS_ONE,
            Par::Seq,
        );
        matmul(below.rb_mut(), accum, under, beside.transpose(), T::MINUS_ONE, Par::Seq);
        for child in children.into_iter().flat_map(Children::iter) {
            self.add_updates(&child);
        }
    }
}

fn add<T: Number>(into: &mut [T], source: &[T]) {
    for (into, source) in into.iter_mut().zip(source) {
        *into += *source;
    }
}

/// Adds the children's updates to the assembled columns, factors them, and leaves the update of this front in `update`,
/// whatever that held before.
///
/// `own` are `width` columns of all rows of the front, `update` is square over the rest.
///
/// # Errors
/// The column, within the front, whose pivot is not positive.
pub(super) fn factor_front<T: Number>(
    own: &mut [T],
    width: usize,
    update: &mut [T],
    children: Children<'_, T>,
) -> Result<(), usize> {
    let rows = own.len() / width;
    let mut columns = FrontColumns { values: own, rows, first_row: 0, columns: 0..width };
    for child in children.iter() {
        columns.add_updates(&child);
    }
    for start in (0..width).step_by(PANEL) {
        let end = (start + PANEL).min(width);
        let (panel, rest) = own[start * rows..].split_at_mut((end - start) * rows);
        factor_panel(MatMut::from_column_major_slice_mut(panel, rows, end - start).subrows_mut(start, rows - start))
            .map_err(|column| start + column)?;
        if end < width {
            let panel = MatRef::from_column_major_slice(panel, rows, end - start);
            let rest =
                FrontColumns { values: &mut rest[..(width - end) * rows], rows, first_row: 0, columns: end..width };
            rest.subtract_product(panel, Accum::Add, None);
        }
    }
    let below = rows - width;
    if below > 0 {
        let panel = MatRef::from_column_major_slice(&*own, rows, width).subrows(width, below);
        let columns = FrontColumns { values: update, rows: below, first_row: width, columns: width..rows };
        columns.subtract_product(panel, Accum::Replace, Some(children));
    }
    Ok(())
}

/// Cholesky of the square at the top, and the rows below times its inverse transpose.
fn factor_panel<T: Number>(panel: MatMut<'_, T>) -> Result<(), usize> {
    let width = panel.ncols();
    let (mut top, below) = panel.split_at_row_mut(width);
    let mut scratch = [std::mem::MaybeUninit::uninit(); PANEL_SCRATCH];
    let outcome = cholesky_in_place(
        top.rb_mut(),
        LltRegularization::default(),
        Par::Seq,
        MemStack::new(&mut scratch),
        Spec::default(),
    );
    if let Err(LltError::NonPositivePivot { index }) = outcome {
        return Err(index);
    }
    divide_rows(top.rb(), below);
    Ok(())
}

/// `rows <- rows Lᵀ⁻¹`.
fn divide_rows<T: Number>(L: MatRef<'_, T>, rows: MatMut<'_, T>) {
    let (height, width) = (rows.nrows(), rows.ncols());
    if height * width * width > 2 * TASK_PRODUCTS && height >= 64 {
        let (upper, lower) = rows.split_at_row_mut((height / 2).next_multiple_of(8));
        join(|| divide_rows(L, upper), || divide_rows(L, lower));
        return;
    }
    solve_lower_triangular_in_place(L, rows.transpose_mut(), Par::Seq);
}
