//! The tableau of Lemke's method, its pivots and the lexicographic ratio test.

use crate::report::SolveStatus;
use std::time::Instant;

/// Entries of a column below this part of its largest are no pivots: they are rounding of numbers of order one.
const PIVOT_FLOOR: f64 = 1e-11;

/// Ratios that differ by less, relative to numbers of order one, are taken as equal and told apart by the next column.
const TIE: f64 = 1e-13;

/// The tableau of `2 n + 2` columns, and which variable each row's basis holds: `w_j` is `j`, `z_j` is `n + j`, `z_0` is
/// `2 n`.
#[derive(Clone, Debug)]
pub(crate) struct Tableau {
    /// `[I, -M, -e, q]` in row order.
    pub(crate) numbers: Vec<f64>,
    basis: Vec<usize>,
    pivot_row: Vec<f64>,
    n: usize,
    capacity: usize,
}

impl Tableau {
    /// Memory for up to `n` variables.
    pub(crate) fn with_capacity(n: usize) -> Self {
        Self {
            numbers: Vec::with_capacity(n * (2 * n + 2)),
            basis: Vec::with_capacity(n),
            pivot_row: Vec::with_capacity(2 * n + 2),
            n: 0,
            capacity: n,
        }
    }

    /// Room for `n` variables.
    pub(crate) fn reserve(&mut self, n: usize) {
        if n > self.capacity {
            *self = Self::with_capacity(n);
        }
    }

    /// Room for the numbers of `n` variables, all zero; `false` past the capacity.
    pub(crate) fn reset(&mut self, n: usize) -> bool {
        if n > self.capacity {
            return false;
        }
        self.n = n;
        self.numbers.clear();
        self.numbers.resize(n * (2 * n + 2), 0.0);
        self.pivot_row.clear();
        self.pivot_row.resize(2 * n + 2, 0.0);
        self.basis.clear();
        self.basis.extend(0..n);
        true
    }

    fn width(&self) -> usize {
        2 * self.n + 2
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        self.numbers[row * self.width() + column]
    }

    /// Pivots until `z_0` has left the basis.
    pub(crate) fn solve(&mut self, most: usize, deadline: Option<Instant>) -> Result<(), SolveStatus> {
        let (n, last) = (self.n, self.width() - 1);
        if (0..n).all(|row| self.at(row, last) >= 0.0) {
            return Ok(());
        }
        if self.numbers.iter().any(|x| !x.is_finite()) {
            return Err(SolveStatus::NotFinite);
        }
        // The lexicographically least row of [q, I] leaves for z_0: of equal ones the last.
        let mut row = (0..n).fold(0, |least, row| if self.at(row, last) <= self.at(least, last) { row } else { least });
        let mut entering = 2 * n;
        for pivot in 0..most {
            let leaving = self.basis[row];
            self.pivot(row, entering);
            if leaving == 2 * n {
                return Ok(());
            }
            entering = if leaving < n { leaving + n } else { leaving - n };
            row = self.ratio_test(entering).ok_or(SolveStatus::NoSolution)?;
            if pivot % 16 == 0 && deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return Err(SolveStatus::TimeLimit);
            }
        }
        Err(SolveStatus::MaxIterations)
    }

    /// The row that leaves for a column: lexicographically least `[q, B^-1] / entry`; `z_0` where it is among the least.
    /// None on a ray.
    fn ratio_test(&self, entering: usize) -> Option<usize> {
        let (n, last) = (self.n, self.width() - 1);
        let largest = (0..n).fold(0.0_f64, |largest, row| largest.max(self.at(row, entering).abs()));
        let floor = PIVOT_FLOOR * largest.max(1.0);
        let ratio = |row: usize, column: usize| self.at(row, column) / self.at(row, entering);
        let eligible = |row: &usize| self.at(*row, entering) > floor;
        let least = (0..n).filter(eligible).map(|row| ratio(row, last)).fold(f64::INFINITY, f64::min);
        let ties = |row: &usize| ratio(*row, last) <= least + TIE * (1.0 + least.abs());
        let mut best: Option<usize> = None;
        for row in (0..n).filter(eligible).filter(ties) {
            if self.basis[row] == 2 * n {
                return Some(row);
            }
            let less = |other: usize| {
                let differs = |c: &usize| (ratio(row, *c) - ratio(other, *c)).abs() > TIE;
                (0..n).find(differs).is_some_and(|c| ratio(row, c) < ratio(other, c))
            };
            if best.is_none_or(less) {
                best = Some(row);
            }
        }
        best
    }

    /// Gauss-Jordan elimination of a column.
    fn pivot(&mut self, row: usize, entering: usize) {
        let width = self.width();
        let inverse = 1.0 / self.at(row, entering);
        let start = row * width;
        for (kept, x) in self.pivot_row.iter_mut().zip(&mut self.numbers[start..start + width]) {
            *x *= inverse;
            *kept = *x;
        }
        for (i, other) in self.numbers.chunks_exact_mut(width).enumerate() {
            let factor = other[entering];
            if i == row || factor == 0.0 {
                continue;
            }
            for (x, p) in other.iter_mut().zip(&self.pivot_row) {
                *x -= factor * p;
            }
            other[entering] = 0.0;
        }
        self.basis[row] = entering;
    }

    /// Calls with number and value of each positive `z_j`.
    pub(crate) fn values(&self, mut of: impl FnMut(usize, f64)) {
        let (n, last) = (self.n, self.width() - 1);
        for (row, &variable) in self.basis.iter().enumerate() {
            let value = self.at(row, last);
            if (n..2 * n).contains(&variable) && value > 0.0 {
                of(variable - n, value);
            }
        }
    }
}
