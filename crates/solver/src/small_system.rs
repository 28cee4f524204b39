//! A small dense, unsymmetric linear system in kept memory: LU with partial pivoting, column by column.
//!
//! Up to some dozens of unknowns this is as fast as a blocked factorisation, and it asks for nothing but its own memory: no
//! packing buffers of the thread, which [`crate::dense`] needs.

use crate::augmented::Augmented;
use pulp::{Arch, WithSimd};

/// Memory of systems of up to a number of unknowns.
#[derive(Clone, Debug)]
pub(crate) struct SmallSystem {
    pub(crate) augmented: Augmented,
}

impl SmallSystem {
    /// Memory for systems of up to `capacity` unknowns.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        Self { augmented: Augmented::with_capacity(capacity) }
    }

    /// Solves, destroying the system; `None` where a number is not finite or a pivot is zero.
    pub(crate) fn solve(&mut self) -> Option<&[f64]> {
        let n = self.augmented.rows();
        let regular = Arch::new().dispatch(Eliminate { numbers: self.augmented.numbers_mut(), n });
        if regular { self.augmented.substitute() } else { None }
    }
}

/// Makes the first `n` columns of `n` rows triangular, and the one behind them the right side of that; `false` for a
/// pivot that is zero or not finite.
struct Eliminate<'a> {
    numbers: &'a mut [f64],
    n: usize,
}

impl WithSimd for Eliminate<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> bool {
        let Self { numbers, n } = self;
        for k in 0..n {
            let (done, rest) = numbers.split_at_mut((k + 1) * n);
            let column = &mut done[k * n..];
            let mut pivot = k;
            for i in k + 1..n {
                if column[i].abs() > column[pivot].abs() {
                    pivot = i;
                }
            }
            column.swap(k, pivot);
            let inverse = 1.0 / column[k];
            if !(inverse.is_finite() && column[k].is_finite()) {
                return false;
            }
            column[k + 1..].iter_mut().for_each(|x| *x *= inverse);
            let below = &column[k + 1..];
            for other in rest.chunks_exact_mut(n) {
                other.swap(k, pivot);
                let factor = other[k];
                other[k + 1..].iter_mut().zip(below).for_each(|(x, l)| *x -= l * factor);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn fill(system: &mut SmallSystem, matrix: &DMatrix<f64>, right: &DVector<f64>) {
        let n = right.len();
        system.augmented.reset(n);
        (0..n).for_each(|j| system.augmented.column_mut(j).copy_from_slice(matrix.column(j).as_slice()));
        system.augmented.column_mut(n).copy_from_slice(right.as_slice());
    }

    #[test]
    fn systems_of_every_size_are_solved_to_rounding() {
        let mut system = SmallSystem::with_capacity(40);
        for n in [1, 2, 3, 7, 16, 40] {
            // No pivot is on the diagonal at first.
            let entry = |i: usize, j: usize| if i == j { 0.0 } else { (1.3 * i as f64 + 0.7 * (j * j) as f64).sin() };
            let matrix = DMatrix::from_fn(n, n, |i, j| if n == 1 { 2.0 } else { entry(i, j) });
            let exact = DVector::from_fn(n, |i, _| (i as f64).cos());
            fill(&mut system, &matrix, &(&matrix * &exact));
            let solution = system.solve().expect("it has a solution");
            let condition = matrix.clone().svd(false, false).singular_values;
            let condition = condition.max() / condition.min();
            for (x, exact) in solution.iter().zip(exact.iter()) {
                assert!((x - exact).abs() < 1e-14 * condition * n as f64, "{x} for {exact} of {n}");
            }
        }
    }

    #[test]
    fn a_singular_system_and_numbers_that_are_none_have_no_solution() {
        let mut system = SmallSystem::with_capacity(2);
        let right = DVector::from_element(2, 1.0);
        for bad in [0.0, f64::NAN, f64::INFINITY] {
            fill(&mut system, &DMatrix::from_row_slice(2, 2, &[bad, 0.0, 0.0, 1.0]), &right);
            assert!(system.solve().is_none(), "{bad}");
        }
        // Past the capacity it is empty, and so is its solution.
        system.augmented.reset(3);
        assert!(system.augmented.column_mut(0).is_empty());
        assert_eq!(system.solve(), Some(&[][..]));
    }
}
