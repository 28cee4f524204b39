//! Symbolic factorisation: ordering, supernodes and the way from 3 x 3 blocks to the values that are factored.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SymbolicSupernodalParams;
use faer::sparse::linalg::cholesky::{simplicial, supernodal};
use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};
use nalgebra::Vector3;

use super::permuted_blocks::{PermutedBlocks, Triangle};
use super::supernodal_tree::SupernodeTree;
use crate::ordering::{NodeOrdering, nested_dissection};
use crate::sparse::{BlockPattern, SystemMatrix};

/// Why a pattern cannot be analysed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FactorError {
    /// Nothing to factor.
    #[error("the body has no free node: release some of its fixed nodes, or leave the body out of the dynamics")]
    NoFreeNodes,
    /// One position per free node is needed.
    #[error("{positions} positions were given for {nodes} free nodes: give one per free node, in the pattern's order")]
    PositionCount {
        /// Positions that were given.
        positions: usize,
        /// Free nodes of the pattern.
        nodes: usize,
    },
    /// The ordering is not a permutation of the free nodes.
    #[error("the ordering has {ordered} nodes but the pattern {nodes}")]
    OrderingCount {
        /// Nodes of the ordering.
        ordered: usize,
        /// Free nodes of the pattern.
        nodes: usize,
    },
    /// A node without its own block.
    #[error("free node {node} has no diagonal block: build the pattern with BlockPattern::from_elements")]
    MissingDiagonal {
        /// The free node.
        node: usize,
    },
    /// Beyond 32-bit indices or memory.
    #[error("the factor of {nodes} free nodes is too large ({reason}): use a coarser mesh")]
    TooLarge {
        /// Free nodes of the pattern.
        nodes: usize,
        /// What faer said.
        reason: String,
    },
}

/// Everything about the factorisation that depends on the topology alone. Immutable; share it in an `Arc`.
#[derive(Debug)]
pub struct SymbolicFactor {
    ordering: NodeOrdering,
    /// Pattern of the lower triangle of `P A Pᵀ` over degrees of freedom.
    lower: SymbolicSparseColMat<u32>,
    /// For each node column of the lower triangle, where its blocks lie in `source`; the diagonal block comes first.
    column_start: Vec<usize>,
    /// Position in [`SystemMatrix::blocks`] of each lower block, column by column.
    source: Vec<u32>,
    supernodes: supernodal::SymbolicSupernodalCholesky<u32>,
    tree: SupernodeTree,
    blocks: usize,
    nonzeros: usize,
    flops: f64,
    change_capacity: usize,
}

impl SymbolicFactor {
    /// Orders by nested dissection of `positions` (in m, one per free node) and analyses. Takes milliseconds to seconds.
    pub fn new(pattern: &BlockPattern, positions: &[Vector3<f64>]) -> Result<Self, FactorError> {
        if positions.len() != pattern.rows() {
            return Err(FactorError::PositionCount { positions: positions.len(), nodes: pattern.rows() });
        }
        Self::with_ordering(pattern, nested_dissection(pattern, positions))
    }

    /// Analyses under a given ordering. It should be a postorder of its own elimination tree (those of
    /// [`crate::ordering`] are): otherwise supernodes fall apart and everything is slow, though still right.
    pub fn with_ordering(pattern: &BlockPattern, ordering: NodeOrdering) -> Result<Self, FactorError> {
        let nodes = pattern.rows();
        if nodes == 0 {
            return Err(FactorError::NoFreeNodes);
        }
        if ordering.len() != nodes {
            return Err(FactorError::OrderingCount { ordered: ordering.len(), nodes });
        }
        if let Some(node) = (0..nodes).find(|&i| pattern.find(i as u32, i as u32).is_none()) {
            return Err(FactorError::MissingDiagonal { node });
        }
        let too_large = |reason: &dyn std::fmt::Debug| FactorError::TooLarge { nodes, reason: format!("{reason:?}") };
        if 9 * pattern.blocks() > u32::MAX as usize {
            return Err(too_large(&"more matrix entries than 32-bit indices can number"));
        }

        let permuted = PermutedBlocks::new(pattern, &ordering);
        let upper = permuted.degree_of_freedom_pattern(Triangle::Upper);
        let lower = permuted.degree_of_freedom_pattern(Triangle::Lower);

        let n = 3 * nodes;
        let mut memory = MemBuffer::new(
            simplicial::prefactorize_symbolic_cholesky_scratch::<u32>(n, upper.compute_nnz())
                .or(supernodal::factorize_supernodal_symbolic_cholesky_scratch::<u32>(n)),
        );
        let stack = MemStack::new(&mut memory);
        let mut parent = vec![0i32; n];
        let mut column_counts = vec![0u32; n];
        let elimination_tree =
            simplicial::prefactorize_symbolic_cholesky(&mut parent, &mut column_counts, upper.as_ref(), stack);
        let supernodes = supernodal::factorize_supernodal_symbolic_cholesky(
            upper.as_ref(),
            elimination_tree,
            &column_counts,
            stack,
            // merging more eagerly (up to twice the widths) changes no time beyond the noise
            SymbolicSupernodalParams::default(),
        )
        .map_err(|error| too_large(&error))?;

        let counts = || column_counts.iter().map(|&c| c as usize);
        Ok(Self {
            tree: SupernodeTree::new(&supernodes),
            supernodes,
            lower,
            column_start: permuted.column_start,
            source: permuted.source,
            ordering,
            blocks: pattern.blocks(),
            nonzeros: counts().sum(),
            flops: counts().map(|c| (c * c) as f64).sum(),
            change_capacity: 0,
        })
    }

    /// Makes room in every factor and workspace of this topology for changes of up to `nodes` nodes between two
    /// factorisations ([`super::Factor::change`]): `72 n nodes` bytes a factor.
    #[must_use]
    pub fn with_room_for_changes(mut self, nodes: usize) -> Self {
        self.make_room_for_changes(nodes);
        self
    }

    /// As [`SymbolicFactor::with_room_for_changes`]: before any factor or workspace is made for it.
    pub fn make_room_for_changes(&mut self, nodes: usize) {
        self.change_capacity = nodes.min(self.nodes());
    }

    /// The most nodes that a change between two factorisations may touch.
    pub fn change_capacity(&self) -> usize {
        self.change_capacity
    }

    /// Free nodes `n`; the factor has `3 n` rows.
    pub fn nodes(&self) -> usize {
        self.ordering.len()
    }

    /// Degrees of freedom, `3 n`.
    pub fn degrees_of_freedom(&self) -> usize {
        3 * self.ordering.len()
    }

    /// The order of elimination.
    pub fn ordering(&self) -> &NodeOrdering {
        &self.ordering
    }

    /// Nonzeros of `L`, diagonal included, without the zeros that supernodes store.
    pub fn nonzeros(&self) -> usize {
        self.nonzeros
    }

    /// Numbers that a [`Factor`](super::Factor) stores for `L`, zeros of supernodes included.
    pub fn stored_values(&self) -> usize {
        self.supernodes.len_val()
    }

    /// Floating-point operations of one numeric factorisation, the sum of squared column counts of `L`.
    pub fn flops(&self) -> f64 {
        self.flops
    }

    /// Supernodes: groups of neighbouring columns of `L` with one dense block each.
    pub fn supernode_count(&self) -> usize {
        self.supernodes.n_supernodes()
    }

    pub(super) fn tree(&self) -> &SupernodeTree {
        &self.tree
    }

    pub(super) fn supernodes(&self) -> &supernodal::SymbolicSupernodalCholesky<u32> {
        &self.supernodes
    }

    pub(super) fn lower(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.lower.as_ref()
    }

    /// True if `a` has the size that was analysed.
    pub(super) fn fits(&self, a: &SystemMatrix) -> bool {
        a.pattern.rows() == self.nodes() && a.pattern.blocks() == self.blocks && a.blocks.len() == self.blocks
    }

    /// Copies the lower triangle of `P A Pᵀ` into `values`, in the order of [`Self::lower`]. Only one of the blocks
    /// `(i, j)` and `(j, i)` is read. Returns false if a value is not finite.
    pub(super) fn gather_lower(&self, a: &SystemMatrix, values: &mut [f64]) -> bool {
        let mut values = values.iter_mut();
        // 0 x finite = 0, 0 x (infinity or NaN) = NaN: one test at the end instead of one per value
        let mut poison = 0.0;
        for range in self.column_start.windows(2) {
            let sources = &self.source[range[0]..range[1]];
            for c in 0..3 {
                let mut first_row = c;
                for &block in sources {
                    let column = &a.blocks[block as usize].data.0[c];
                    for (&value, slot) in column[first_row..].iter().zip(&mut values) {
                        *slot = value;
                        poison += 0.0 * value;
                    }
                    first_row = 0;
                }
            }
        }
        poison == 0.0
    }

    /// The first node, in free-node numbers, one of whose lower blocks holds a value that is not finite.
    pub(super) fn first_non_finite(&self, a: &SystemMatrix) -> Option<u32> {
        self.column_start.windows(2).enumerate().find_map(|(column, range)| {
            let bad =
                self.source[range[0]..range[1]].iter().any(|&p| a.blocks[p as usize].iter().any(|v| !v.is_finite()));
            bad.then(|| self.ordering.old_of_new[column])
        })
    }
}
