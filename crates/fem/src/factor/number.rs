//! The numbers that a factorisation computes with.
//!
//! In single precision twice as many fit into a vector and into a cache line. The factor is kept in double precision in
//! either case: what reads it need not know how it was made.

use std::ops::{AddAssign, Mul};

use faer::traits::RealField;
use pulp::bytemuck::{Pod, cast_slice};

/// Numbers that are widened at once.
const WIDEN: usize = 64;

/// Double or single precision.
pub(super) trait Number: RealField + Pod + AddAssign + Mul<Output = Self> {
    const ZERO: Self;
    const MINUS_ONE: Self;

    /// The number nearest to `x`; infinite beyond the range.
    fn rounded(x: f64) -> Self;

    /// Turns numbers that fill memory for numbers in double precision from its begin into as many of those.
    fn widen(memory: &mut [f64]);
}

impl Number for f64 {
    const ZERO: Self = 0.0;
    const MINUS_ONE: Self = -1.0;

    fn rounded(x: f64) -> Self {
        x
    }

    fn widen(_: &mut [f64]) {}
}

impl Number for f32 {
    const ZERO: Self = 0.0;
    const MINUS_ONE: Self = -1.0;

    fn rounded(x: f64) -> Self {
        x as f32
    }

    fn widen(memory: &mut [f64]) {
        // From the end, for the numbers of a piece lie before the place of that piece.
        for start in (0..memory.len()).step_by(WIDEN).rev() {
            let end = memory.len().min(start + WIDEN);
            let mut piece = [0.0f32; WIDEN];
            let piece = &mut piece[..end - start];
            piece.copy_from_slice(&cast_slice(memory)[start..end]);
            memory[start..end].iter_mut().zip(piece).for_each(|(to, from)| *to = f64::from(*from));
        }
    }
}

#[cfg(test)]
mod tests {
    use pulp::bytemuck::cast_slice_mut;

    use super::*;

    #[test]
    fn numbers_are_widened_in_their_place() {
        for count in [0, 1, 2, 3, 63, 64, 65, 127, 128, 129, 1000] {
            let mut memory = vec![f64::NAN; count];
            let single = |k: usize| (k as f32 + 0.1).sqrt();
            cast_slice_mut::<f64, f32>(&mut memory)[..count].iter_mut().enumerate().for_each(|(k, x)| *x = single(k));
            f32::widen(&mut memory);
            assert!(memory.iter().enumerate().all(|(k, x)| *x == f64::from(single(k))), "{count}");
        }
    }
}
