//! faer's own numeric factorisation over the same supernodes: left-looking, in sequence. The yardstick of tests and benches
//! for [`Factor::refactor`].

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::cholesky::supernodal;
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Par, Spec};

use super::numeric::{Factor, FactorStatus};
use super::permuted_blocks::{PermutedBlocks, Triangle};
use super::symbolic::SymbolicFactor;
use crate::sparse::SystemMatrix;

/// `P A Pᵀ = L Lᵀ` by faer, for tests and benches to compare [`Factor`] with: no step uses it.
pub struct LeftLookingFactor {
    symbolic: Arc<SymbolicFactor>,
    lower: SymbolicSparseColMat<u32>,
    /// Node columns of the lower triangle, and the block of `A` behind each of their blocks.
    column_start: Vec<usize>,
    source: Vec<u32>,
    entries: Vec<f64>,
    values: Vec<f64>,
    memory: MemBuffer,
}

impl LeftLookingFactor {
    /// Memory for factors of matrices with the pattern of `a`, over the supernodes of `symbolic`; `None` where that is
    /// of another pattern.
    pub fn new(symbolic: Arc<SymbolicFactor>, a: &SystemMatrix) -> Option<Self> {
        if !symbolic.fits(a) {
            return None;
        }
        let permuted = PermutedBlocks::new(&a.pattern, symbolic.ordering());
        let lower = permuted.degree_of_freedom_pattern(Triangle::Lower);
        let scratch = supernodal::factorize_supernodal_numeric_llt_scratch::<u32, f64>(
            symbolic.supernodes(),
            Par::Seq,
            Spec::default(),
        );
        Some(Self {
            entries: vec![0.0; lower.row_idx().len()],
            values: vec![0.0; symbolic.stored_values()],
            memory: MemBuffer::new(scratch),
            column_start: permuted.column_start,
            source: permuted.source,
            lower,
            symbolic,
        })
    }

    /// Factors `a`. Allocates nothing.
    pub fn refactor(&mut self, a: &SystemMatrix) -> FactorStatus {
        if !self.symbolic.fits(a) {
            return FactorStatus::OtherPattern;
        }
        let mut entries = self.entries.iter_mut();
        for range in self.column_start.windows(2) {
            for c in 0..3 {
                for (k, &block) in self.source[range[0]..range[1]].iter().enumerate() {
                    let first = if k == 0 { c } else { 0 };
                    let column = &a.blocks[block as usize].data.0[c][first..];
                    column.iter().zip(&mut entries).for_each(|(value, entry)| *entry = *value);
                }
            }
        }
        let outcome = supernodal::factorize_supernodal_numeric_llt(
            &mut self.values,
            SparseColMatRef::new(self.lower.as_ref(), &self.entries),
            LltRegularization::default(),
            self.symbolic.supernodes(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Spec::default(),
        );
        match outcome {
            Ok(_) => FactorStatus::Ok,
            Err(LltError::NonPositivePivot { index }) => self.symbolic.not_positive_at(index),
        }
    }

    /// Largest difference of an entry of `L` from that of another factor, relative to the largest entry; infinite
    /// where the two are of different patterns.
    pub fn difference(&self, other: &Factor) -> f64 {
        if other.values().len() != self.values.len() {
            return f64::INFINITY;
        }
        let (mut difference, mut largest) = (0.0f64, 0.0f64);
        let ours = supernodal::SupernodalLltRef::new(self.symbolic.supernodes(), &self.values);
        for s in 0..self.symbolic.supernode_count() {
            let (ours, theirs) = (ours.supernode(s).val(), other.llt().supernode(s).val());
            for j in 0..ours.ncols() {
                // above the diagonal lies what the two left there
                for i in j..ours.nrows() {
                    difference = difference.max((ours[(i, j)] - theirs[(i, j)]).abs());
                    largest = largest.max(ours[(i, j)].abs());
                }
            }
        }
        difference / largest
    }
}
