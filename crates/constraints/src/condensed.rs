//! Condensed compliance: what is felt at some rows while others stay closed.
//!
//! With rows p that somebody pushes and rows o that hold (`δ_o` stays what it is: closed contacts, sticking friction,
//! sutures, clamps), a change of force at p draws one at o:
//!
//! ```text
//! 0 = W_op Δλ_p + W_oo Δλ_o     =>     Δδ_p = (W_pp - W_po W_oo⁻¹ W_op) Δλ_p          m
//! ```
//!
//! The bracket, a Schur complement, is never more compliant than `W_pp`. Eliminated row by row in place; a row that others
//! hold already (its pivot is rounding) holds nothing more and is left out.

/// Pivots below this share of the row's own compliance are rounding: the row depends on those eliminated before.
const DEPENDENT: f64 = 1e-12;

/// Eliminates the rows from `kept` on out of the symmetric `n x n` matrix `w` (m/N, by columns) in place, `n` the length of
/// `free`: afterwards its leading `kept x kept` block is the condensed compliance, and the rest is spent. `free` (m) is how the
/// rows move without forces; afterwards its leading `kept` numbers are that with the others held.
///
/// Returns how many rows held something; `None`, and nothing changed, where `w` is not `n x n` or a number is not finite.
pub fn condense(w: &mut [f64], free: &mut [f64], kept: usize) -> Option<usize> {
    let n = free.len();
    if w.len() != n * n || kept > n || !w.iter().chain(&*free).all(|x| x.is_finite()) {
        return None;
    }
    let mut held = 0;
    // Against the largest compliance, since what a row had by itself is not known any more at its turn.
    let largest = (0..n).fold(0.0_f64, |most, k| most.max(w[k * n + k]));
    for k in (kept..n).rev() {
        let (before, from) = w.split_at_mut(k * n);
        let pivot = from[k];
        if pivot <= DEPENDENT * largest {
            continue;
        }
        held += 1;
        for (j, column) in before.chunks_exact_mut(n).enumerate() {
            let share = from[j] / pivot;
            if share != 0.0 {
                column[..k].iter_mut().zip(&from[..k]).for_each(|(entry, x)| *entry -= share * x);
            }
        }
        let share = free[k] / pivot;
        free[..k].iter_mut().zip(&from[..k]).for_each(|(entry, x)| *entry -= share * x);
    }
    Some(held)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// A compliance as a chain of springs to the ground has it, plus a part that couples all.
    fn compliance(n: usize) -> DMatrix<f64> {
        DMatrix::from_fn(n, n, |i, j| 1e-3 * (-0.3 * i.abs_diff(j) as f64).exp() + if i == j { 1e-4 } else { 0.0 })
    }

    #[test]
    fn it_is_the_inverse_of_the_kept_block_of_the_stiffness_with_the_others_held() {
        // (W_pp - W_po W_oo⁻¹ W_op)⁻¹ is the leading block of W⁻¹.
        for (n, kept) in [(1, 1), (5, 5), (5, 4), (9, 3), (12, 1), (4, 0)] {
            let full = compliance(n);
            let mut w = full.as_slice().to_vec();
            let free = DVector::from_fn(n, |i, _| 1e-3 * (i as f64).sin() + 2e-3);
            let mut kept_free = free.as_slice().to_vec();
            assert_eq!(condense(&mut w, &mut kept_free, kept), Some(n - kept));
            // The forces that bring the others back move the kept ones by what is left.
            let (across, held) =
                (full.view((0, kept), (kept, n - kept)), full.view((kept, kept), (n - kept, n - kept)));
            let expected = free.rows(0, kept) - across * held.try_inverse().unwrap() * free.rows(kept, n - kept);
            assert!(
                (DVector::from_column_slice(&kept_free[..kept]) - expected).amax() < 1e-15,
                "{n} rows, {kept} kept"
            );
            let condensed = DMatrix::from_column_slice(n, n, &w).view((0, 0), (kept, kept)).into_owned();
            let stiffness = full.try_inverse().unwrap();
            let product = condensed * stiffness.view((0, 0), (kept, kept));
            assert!((product - DMatrix::identity(kept, kept)).amax() < 1e-12, "{n} rows, {kept} kept");
        }
    }

    #[test]
    fn a_row_that_holds_twice_holds_once() {
        let full = compliance(4);
        let twice = DMatrix::from_fn(5, 5, |i, j| full[(i.min(3), j.min(3))]);
        let (mut once, mut w) = (full.as_slice().to_vec(), twice.as_slice().to_vec());
        assert_eq!((condense(&mut once, &mut [0.0; 4], 3), condense(&mut w, &mut [0.0; 5], 3)), (Some(1), Some(1)));
        for i in 0..3 {
            for j in 0..3 {
                assert!((once[4 * j + i] - w[5 * j + i]).abs() < 1e-18);
            }
        }
    }

    #[test]
    fn what_is_not_finite_or_not_square_is_refused_untouched() {
        let mut w = compliance(3).as_slice().to_vec();
        let before = w.clone();
        assert_eq!(condense(&mut w, &mut [0.0; 2], 1), None);
        assert_eq!(condense(&mut w, &mut [0.0; 3], 4), None);
        assert_eq!(w, before);
        assert_eq!(condense(&mut w, &mut [0.0, f64::NAN, 0.0], 1), None);
        w[4] = f64::NAN;
        assert_eq!(condense(&mut w, &mut [0.0; 3], 1), None);
    }
}
