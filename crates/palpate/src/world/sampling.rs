//! How often a column of the compliance is compared with the exact one, and within how many iterations.
//!
//! A comparison is a solve by conjugate gradients with the old factor as its preconditioner, and waits for memory: an
//! iteration reads the copy of the factor in 16 bits twice, the matrix once, and vectors. Where the time that the scene
//! grants in a step does not do for one, there is one every so many steps, which together have it.

use palpate_fem::factor::SymbolicFactor;
use palpate_fem::sparse::BlockPattern;

/// Bytes per second that one core of the nominal machine reads in an iteration, most of which it has read in the one before.
const READ_RATE: f64 = 20e9;

/// Bytes of a block of the matrix with its column.
const BLOCK: usize = 76;

/// Bytes of the vectors of an iteration, for each node: about twelve passes over one.
const VECTORS: usize = 12 * 24;

/// Iterations that a comparison is given at least: with the directions of the step's earlier solves, or by a young factor
/// without them, a column of the bundled liver takes up to five.
const ENOUGH: f64 = 6.0;

/// Most iterations that a comparison is given.
const MOST: f64 = 100.0;

/// When a column of `W` is compared with the exact one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Every so many steps, 1 for each of them; 0 for none.
    pub every: u64,
    /// Iterations that one comparison is granted.
    pub iterations: usize,
    /// Predicted time of an iteration (s).
    pub iteration: f64,
}

impl Sampling {
    /// Where nothing is compared.
    pub(super) fn none(iteration: f64) -> Self {
        Self { every: 0, iterations: 0, iteration }
    }

    /// Within `time` (s) of a step on the average; none where there is no time at all.
    pub(super) fn within(time: f64, iteration: f64) -> Self {
        let granted = time / iteration;
        if granted >= ENOUGH {
            return Self { every: 1, iterations: granted.min(MOST) as usize, iteration };
        }
        // Saturates: a share that is next to nothing compares next to never.
        let every = (ENOUGH / granted).ceil() as u64;
        if granted > 0.0 { Self { every, iterations: ENOUGH as usize, iteration } } else { Self::none(iteration) }
    }

    /// In every step, whatever it takes.
    pub(super) fn always(iteration: f64) -> Self {
        Self { every: 1, iterations: MOST as usize, iteration }
    }

    /// Whether a longer time would grant a comparison more iterations.
    pub fn is_limited(&self) -> bool {
        self.iterations < MOST as usize
    }

    /// Whether a column is compared in step `step`.
    pub fn is_due(&self, step: u64) -> bool {
        self.every > 0 && step.is_multiple_of(self.every)
    }

    /// The row whose turn it is in step `step` among `rows`, one after the other; `rows` is positive.
    pub fn row(&self, step: u64, rows: usize) -> usize {
        (step / self.every.max(1) % rows.max(1) as u64) as usize
    }
}

/// Predicted time (s) of an iteration of the conjugate gradients with the copy of a factor in 16 bits.
pub(super) fn iteration(symbolic: &SymbolicFactor, pattern: &BlockPattern) -> f64 {
    let bytes = 2 * symbolic.packed_bytes() + BLOCK * pattern.blocks() + VECTORS * pattern.rows();
    bytes as f64 / READ_RATE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_into_one_step_is_done_every_so_many_and_never_only_for_nothing() {
        let ms = 1e-3;
        let all = Sampling::within(200.0 * ms, ms);
        assert_eq!((all.every, all.iterations), (1, 100));
        let fits = Sampling::within(12.5 * ms, ms);
        assert_eq!((fits.every, fits.iterations), (1, 12));
        for granted in [5.9, 5.0, 2.5, 0.3, 1e-3] {
            let rare = Sampling::within(granted * ms, ms);
            let mean = rare.iterations as f64 / rare.every as f64;
            assert!(rare.every > 1 && mean <= granted && 2.0 * mean > granted, "{granted}: {rare:?}");
        }
        assert_eq!(Sampling::within(0.0, ms).every, 0);
        assert!(!Sampling::within(0.0, ms).is_due(0) && Sampling::within(1e-300, ms).every == u64::MAX);
    }

    #[test]
    fn every_row_has_its_turn_also_where_the_steps_between_divide_their_number() {
        let sampling = Sampling { every: 3, iterations: 10, iteration: 1e-4 };
        let mut rows: Vec<usize> = (0..54).filter(|&k| sampling.is_due(k)).map(|k| sampling.row(k, 18)).collect();
        rows.sort_unstable();
        assert_eq!(rows, (0..18).collect::<Vec<_>>());
    }
}
