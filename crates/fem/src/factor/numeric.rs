//! Numeric factorisation into kept memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use faer::sparse::linalg::cholesky::supernodal;

use super::low_rank::LowRankUpdate;
use super::multifrontal::{self, Fault};
use super::packed_copy::PackedCopy;
use super::symbolic::SymbolicFactor;
use crate::sparse::SystemMatrix;

/// Numbers every successful refactorisation in the process, so that half solves are never paired with another factor.
static REVISIONS: AtomicU64 = AtomicU64::new(0);

fn next_revision() -> u64 {
    1 + REVISIONS.fetch_add(1, Ordering::Relaxed)
}

/// Squares of pivots (unit of `A`) with which solves in single precision have room to spare: its numbers reach from 1e-38 to
/// 3e38.
const SOUND: std::ops::RangeInclusive<f64> = 1e-24..=1e24;

/// Share of a diagonal entry of `A` that a pivot must keep for single precision: numbers that are rounded by 6e-8 and have lost
/// all but this share are wrong by 6e-5, less than what a copy in 16 bits rounds.
const SMALLEST_SHARE: f64 = 1e-3;

/// What a factorisation computes with. The factor is stored in double precision in either case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FactorPrecision {
    /// Exact to rounding.
    #[default]
    Double,
    /// Half the memory traffic and twice as many numbers in a vector: for factors that are about to be those of an older
    /// matrix. `L Lᵀ` differs from `A` by about 1e-7 of its diagonal. A matrix that it does not suffice for is factored
    /// in double precision.
    Single,
}

/// How a refactorisation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FactorStatus {
    /// `L` holds the factor of the matrix.
    Ok,
    /// A pivot was zero, negative or NaN. The factor is invalid: keep using an older one.
    NotPositiveDefinite {
        /// Free node of the pivot.
        node: u32,
        /// Its component: 0, 1, 2 for x, y, z.
        component: u8,
    },
    /// The matrix holds a value that is not finite. The factor is invalid.
    NonFinite {
        /// A free node in whose column the value lies.
        node: u32,
    },
    /// The matrix does not have the pattern that was analysed. The factor keeps its previous numbers.
    OtherPattern,
}

/// What a refactorisation reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorReport {
    /// Whether there is a factor.
    pub status: FactorStatus,
    /// Smallest diagonal entry of `L`, squared, in the unit of `A`; zero unless the status is `Ok`.
    pub smallest_pivot: f64,
    /// Largest diagonal entry of `L`, squared, in the unit of `A`; zero unless the status is `Ok`. The ratio of the two
    /// bounds the condition number of `A` from below.
    pub largest_pivot: f64,
    /// Whether a copy in 16 bits is kept and the pivots lie beyond the range of solves with it, which then go by the stored
    /// values.
    pub copy_refused: bool,
    /// What was computed with: double precision as well where single was wanted and did not suffice.
    pub precision: FactorPrecision,
}

/// The numbers of one factorisation `P A Pᵀ = L Lᵀ`, and the memory to compute them again.
///
/// `Send` and `Sync`: move it between threads inside a buffer that goes round.
pub struct Factor {
    symbolic: Arc<SymbolicFactor>,
    values: Vec<f64>,
    /// `L` in 16 bits and in the order of a solve, where a copy is kept.
    packed: Option<PackedCopy>,
    /// Whether the numbers of this factor lie well within the range of solves with it.
    packed_is_sound: bool,
    precision: FactorPrecision,
    /// Update matrices of the fronts; scratch.
    updates: Vec<f64>,
    /// Zero while there is no valid factor.
    revision: u64,
    /// What a change since the factorisation takes from the inverse, where there is room for changes.
    pub(super) update: Option<Box<LowRankUpdate>>,
}

impl Clone for Factor {
    /// The same numbers in memory of its own, without a change since the factorisation; the scratch memory is made anew.
    fn clone(&self) -> Self {
        let mut copy = Self::new(Arc::clone(&self.symbolic));
        copy.values.copy_from_slice(&self.values);
        // Without the change it is another inverse.
        let changed = self.update.as_ref().is_some_and(|update| !update.is_empty());
        copy.revision = if changed && self.is_valid() { next_revision() } else { self.revision };
        copy.packed.clone_from(&self.packed);
        copy.packed_is_sound = self.packed_is_sound;
        copy.precision = self.precision;
        copy
    }
}

impl Factor {
    /// Memory for a factor; invalid until the first [`Self::refactor`] succeeds.
    pub fn new(symbolic: Arc<SymbolicFactor>) -> Self {
        Self {
            values: vec![0.0; symbolic.stored_values()],
            updates: vec![0.0; symbolic.arena().len()],
            update: (symbolic.change_capacity() > 0).then(|| Box::new(LowRankUpdate::new(&symbolic))),
            symbolic,
            packed: None,
            packed_is_sound: false,
            precision: FactorPrecision::Double,
            revision: 0,
        }
    }

    /// The same, and every refactorisation leaves a copy of `L` in 16 bits for [`Self::precondition`].
    pub fn with_packed_copy(symbolic: Arc<SymbolicFactor>) -> Self {
        let packed = Some(PackedCopy::new(symbolic.packed()));
        Self { packed, ..Self::new(symbolic) }
    }

    /// The same factor, which later refactorisations compute with numbers of this precision.
    #[must_use]
    pub fn computed_in(self, precision: FactorPrecision) -> Self {
        Self { precision, ..self }
    }

    /// The shared symbolic part.
    pub fn symbolic(&self) -> &Arc<SymbolicFactor> {
        &self.symbolic
    }

    /// True if the last refactorisation succeeded.
    pub fn is_valid(&self) -> bool {
        self.revision != 0
    }

    /// A number that no other successful refactorisation in this process has; zero while invalid. Anything derived
    /// from a factor's numbers (half solves, condensed compliances) may be kept as long as it stays the same.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Factors `a`. Reads one triangle only, so an asymmetry of `a` goes unnoticed. Allocates nothing.
    ///
    /// The same matrix gives the same bits whatever the memory held before. On failure the factor is invalid: every
    /// solve with it refuses and says so.
    pub fn refactor(&mut self, a: &SystemMatrix) -> FactorReport {
        let mut report = FactorReport {
            status: FactorStatus::OtherPattern,
            smallest_pivot: 0.0,
            largest_pivot: 0.0,
            copy_refused: false,
            precision: FactorPrecision::Double,
        };
        if !self.symbolic.fits(a) {
            return report;
        }
        self.revision = 0;
        if let Some(update) = &mut self.update {
            update.clear();
        }
        if self.precision == FactorPrecision::Single && self.factor_in_single(a) {
            report.precision = FactorPrecision::Single;
        } else if let Err(fault) = multifrontal::factor::<f64>(&self.symbolic, a, &mut self.values, &mut self.updates) {
            report.status = match (self.symbolic.first_non_finite(a), fault) {
                (Some(node), _) => FactorStatus::NonFinite { node },
                (None, Fault::Pivot(row)) => self.symbolic.not_positive_at(row),
                (None, Fault::NonFinite) => FactorStatus::NonFinite { node: 0 },
            };
            return report;
        }
        // a non-finite entry in row i of L would have made pivot i fail, so L is finite here
        let (smallest, largest) = self.pivot_range();
        if let Some(packed) = &mut self.packed {
            packed.take(self.symbolic.packed(), self.symbolic.tree(), &self.values);
            // no entry of L is larger than the root of the largest diagonal entry of A, of which pivots tell the order
            self.packed_is_sound = SOUND.contains(&smallest) && SOUND.contains(&largest);
        }
        self.revision = next_revision();
        (report.status, report.smallest_pivot, report.largest_pivot) = (FactorStatus::Ok, smallest, largest);
        report.copy_refused = self.keeps_copy() && !self.packed_is_sound;
        report
    }

    /// Factors `a` in single precision; false where that does not suffice, be it that there is no factor at all.
    fn factor_in_single(&mut self, a: &SystemMatrix) -> bool {
        if multifrontal::factor::<f32>(&self.symbolic, a, &mut self.values, &mut self.updates).is_err() {
            return false;
        }
        self.pivots()
            .enumerate()
            .all(|(row, pivot)| SOUND.contains(&pivot) && pivot >= SMALLEST_SHARE * self.symbolic.diagonal(a, row))
    }

    /// Parts what is derived from now on from what was before.
    pub(super) fn renew(&mut self) {
        if self.is_valid() {
            self.revision = next_revision();
        }
    }

    /// Squared diagonal entries of `L`.
    fn pivots(&self) -> impl Iterator<Item = f64> + '_ {
        let tree = self.symbolic.tree();
        (0..tree.len()).flat_map(move |s| {
            let rows = tree.columns(s).len() + tree.below(s);
            let own = &self.values[tree.value_start(s)..tree.value_start(s + 1)];
            own.iter().step_by(rows + 1).map(|entry| entry * entry)
        })
    }

    /// Smallest and largest squared diagonal entry of `L`.
    fn pivot_range(&self) -> (f64, f64) {
        self.pivots().fold((f64::INFINITY, 0.0f64), |(least, most), pivot| (least.min(pivot), most.max(pivot)))
    }

    /// Whether refactorisations leave a copy in 16 bits, sound or not.
    pub(super) fn keeps_copy(&self) -> bool {
        self.packed.is_some()
    }

    /// The copy in 16 bits, if there is a sound one.
    pub(super) fn packed(&self) -> Option<&PackedCopy> {
        self.packed.as_ref().filter(|_| self.packed_is_sound)
    }

    /// Stored values of `L`, supernode by supernode.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    pub(super) fn llt(&self) -> supernodal::SupernodalLltRef<'_, u32, f64> {
        supernodal::SupernodalLltRef::new(self.symbolic.supernodes(), &self.values)
    }
}
