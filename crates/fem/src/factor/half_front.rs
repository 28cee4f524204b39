//! The dense part of a half solve at one supernode, for many rows at once, by several threads where it is large.
//!
//! With `L11` the square block of the supernode and `L21` the rows below it, `Y` one line per row of the block:
//! ```text
//! Y <- Y L11⁻ᵀ,   U = Y L21ᵀ
//! ```
//! What threads share are rows of `L`, whose products with `Y` are independent of one another: each is read once, on any
//! number of threads. Independent subtrees would give them little, since the nodes of a patch of contacts lie side by side:
//! some nine tenths of the operations are on one path of the tree, and most of these at its large fronts.
//!
//! Which products are cut, and where, depends on their size alone: the same bits on any number of threads.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};

use super::workers::join;

/// Fewest operations of a piece: some 50 µs, a few times what it takes to wake a thread. With smaller ones one thread is
/// slower, and two are hardly faster.
const PIECE: usize = 2_000_000;

/// Fewest rows of `Y` for which a front is cut. With fewer, arithmetic waits for `L`, which is read in another order then:
/// on one thread that cost a fifth for 30 rows at 8,000 nodes, and a twentieth for 50.
const LEAST_ROWS: usize = 48;

/// Cuts are at multiples of a cache line.
const LINE: usize = 8;

/// Solves for `own`, rows by columns of the supernode, and writes what it passes on into `update`, rows by rows below.
pub(super) fn eliminate(
    top: MatRef<'_, f64>,
    below: MatRef<'_, f64>,
    mut own: MatMut<'_, f64>,
    update: MatMut<'_, f64>,
) {
    substitute(top, own.rb_mut());
    if below.nrows() > 0 {
        add_products(own.rb(), below, update, Accum::Replace, 1.0);
    }
}

/// Whether so much work for so many rows is cut in two.
fn is_cut(operations: usize, rows: usize) -> bool {
    rows >= LEAST_ROWS && operations >= 2 * PIECE
}

/// `Y <- Y L⁻ᵀ`: the first columns, their products with the rows of `L` between, and the other columns.
fn substitute(lower: MatRef<'_, f64>, y: MatMut<'_, f64>) {
    let width = lower.nrows();
    if !is_cut(y.nrows() * width * width, y.nrows()) || width < 4 * LINE {
        solve_lower_triangular_in_place(lower, y.transpose_mut(), Par::Seq);
        return;
    }
    let middle = (width / 2).next_multiple_of(LINE);
    let (first, _, between, last) = lower.split_at(middle, middle);
    let (mut y, mut others) = y.split_at_col_mut(middle);
    substitute(first, y.rb_mut());
    add_products(y.rb(), between, others.rb_mut(), Accum::Add, -1.0);
    substitute(last, others);
}

/// `Z <- sign Y Lᵀ`, or that added to it.
fn add_products(y: MatRef<'_, f64>, l: MatRef<'_, f64>, z: MatMut<'_, f64>, how: Accum, sign: f64) {
    if !is_cut(2 * y.nrows() * l.ncols() * l.nrows(), y.nrows()) || l.nrows() < 4 * LINE {
        matmul(z, how, y, l.transpose(), sign, Par::Seq);
        return;
    }
    let middle = (l.nrows() / 2).next_multiple_of(LINE);
    let ((upper, lower), (left, right)) = (l.split_at_row(middle), z.split_at_col_mut(middle));
    join(|| add_products(y, upper, left, how, sign), || add_products(y, lower, right, how, sign));
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    /// A front of so many columns and rows below, and numbers of rows; `L11` is far from singular.
    fn numbers(width: usize, below: usize, rows: usize) -> [Mat<f64>; 3] {
        let wave = |i: usize, j: usize| ((7 * i + 13 * j) as f64).sin();
        let diagonal = width as f64;
        let top = Mat::from_fn(width, width, |i, j| if i == j { diagonal } else { wave(i, j) });
        [top, Mat::from_fn(below, width, wave), Mat::from_fn(rows, width, |i, j| wave(j, i + 3))]
    }

    #[test]
    fn a_front_that_is_cut_has_the_answer_of_one_that_is_not_and_the_same_bits_on_any_number_of_threads() {
        for (width, below, rows) in [(420, 333, 61), (300, 0, 64), (47, 900, 48), (400, 300, 47)] {
            let cut = is_cut(rows * width * (width + 2 * below), rows);
            assert_eq!(cut, rows >= LEAST_ROWS, "the case is for what it says");
            let [top, low, given] = numbers(width, below, rows);
            let mut expected = given.clone();
            solve_lower_triangular_in_place(top.as_ref(), expected.as_mut().transpose_mut(), Par::Seq);
            let passed = &expected * low.transpose();
            let results = [1, 2, 4].map(|threads| {
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                    let (mut own, mut update) = (given.clone(), Mat::from_fn(rows, below, |_, _| f64::NAN));
                    eliminate(top.as_ref(), low.as_ref(), own.as_mut(), update.as_mut());
                    (own, update)
                })
            });
            let (own, update) = &results[0];
            // Sums of some hundred terms of like size in another order.
            let near = |a: &Mat<f64>, b: &Mat<f64>| (a - b).norm_l2() <= 1e-13 * b.norm_l2();
            assert!(near(own, &expected) && near(update, &passed), "{width} columns, {below} below, {rows} rows");
            assert!(results[1] == results[0] && results[2] == results[0]);
        }
    }
}
