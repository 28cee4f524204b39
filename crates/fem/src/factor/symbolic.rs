//! Symbolic factorisation: ordering, supernodes and the way from 3 x 3 blocks to the values that are factored.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SymbolicSupernodalParams;
use faer::sparse::linalg::cholesky::{simplicial, supernodal};
use nalgebra::Vector3;

use super::arena::Arena;
use super::number::Number;
use super::numeric::FactorStatus;
use super::packed::PackedLayout;
use super::permuted_blocks::{PermutedBlocks, Triangle};
use super::supernodal_tree::SupernodeTree;
use crate::ordering::{NodeOrdering, nested_dissection, postordered};
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
    /// For each node column of the lower triangle of `P A Pᵀ`, where its blocks lie in `source` and `place`; the diagonal
    /// block comes first.
    column_start: Vec<usize>,
    /// Position in [`SystemMatrix::blocks`] of each lower block, column by column.
    source: Vec<u32>,
    /// Its first row in the front of its column's supernode.
    place: Vec<u32>,
    supernodes: supernodal::SymbolicSupernodalCholesky<u32>,
    tree: SupernodeTree,
    arena: Arena,
    packed: PackedLayout,
    /// Of the matrices that can be factored.
    pattern: BlockPattern,
    nonzeros: usize,
    flops: f64,
    change_capacity: usize,
}

impl SymbolicFactor {
    /// Orders by nested dissection of `positions` (in m, one per free node) and analyses. Takes milliseconds to seconds.
    ///
    /// # Errors
    /// [`FactorError::PositionCount`], and as [`SymbolicFactor::with_ordering`].
    pub fn new(pattern: &BlockPattern, positions: &[Vector3<f64>]) -> Result<Self, FactorError> {
        if positions.len() != pattern.rows() {
            return Err(FactorError::PositionCount { positions: positions.len(), nodes: pattern.rows() });
        }
        Self::with_ordering(pattern, nested_dissection(pattern, positions))
    }

    /// Analyses under a given ordering, or the postorder of its elimination tree if it is not one already (those of
    /// [`crate::ordering`] are): the fill is the same, and subtrees lie in one piece.
    ///
    /// # Errors
    /// [`FactorError::NoFreeNodes`], [`FactorError::OrderingCount`], [`FactorError::MissingDiagonal`],
    /// [`FactorError::TooLarge`].
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
        let ordering = postordered(pattern, ordering);
        let too_large = |reason: &dyn std::fmt::Debug| FactorError::TooLarge { nodes, reason: format!("{reason:?}") };
        if 9 * pattern.blocks() > u32::MAX as usize {
            return Err(too_large(&"more matrix entries than 32-bit indices can number"));
        }

        let permuted = PermutedBlocks::new(pattern, &ordering);
        let upper = permuted.degree_of_freedom_pattern(Triangle::Upper);

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
        let tree = SupernodeTree::new(&supernodes);
        Ok(Self {
            place: places(&permuted, &tree, &supernodes),
            arena: Arena::new(&tree),
            packed: PackedLayout::new(&tree),
            tree,
            supernodes,
            column_start: permuted.column_start,
            source: permuted.source,
            ordering,
            pattern: pattern.clone(),
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

    /// Bytes of the copy of `L` in 16 bits, zeros that fill up its tiles included.
    pub fn packed_bytes(&self) -> usize {
        self.packed.bytes()
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

    pub(super) fn arena(&self) -> &Arena {
        &self.arena
    }

    /// Where the copies in 16 bits have the fronts.
    pub(super) fn packed(&self) -> &PackedLayout {
        &self.packed
    }

    /// True if `a` has the pattern that was analysed.
    pub(super) fn fits(&self, a: &SystemMatrix) -> bool {
        *a.pattern == self.pattern && a.blocks.len() == self.pattern.blocks()
    }

    /// The status of a factorisation whose pivot in this row of `P A Pᵀ` is not positive.
    pub(super) fn not_positive_at(&self, row: usize) -> FactorStatus {
        let node = self.ordering.old_of_new.get(row / 3).copied().unwrap_or(0);
        FactorStatus::NotPositiveDefinite { node, component: (row % 3) as u8 }
    }

    /// Puts the columns of supernode `s` of `P A Pᵀ` into the columns of its front, zeros elsewhere. Only one of the
    /// blocks `(i, j)` and `(j, i)` is read. False if a value is not finite.
    pub(super) fn assemble<T: Number>(&self, s: usize, a: &SystemMatrix, own: &mut [T]) -> bool {
        let columns = self.tree.columns(s);
        let rows = columns.len() + self.tree.below(s);
        own.fill(T::ZERO);
        // 0 x (infinity or NaN) = NaN: one test at the end instead of one per value
        let mut poison = T::ZERO;
        let nodes = columns.start / 3..columns.end / 3;
        for (node, own) in nodes.zip(own.chunks_exact_mut(3 * rows)) {
            let blocks = self.column_start[node]..self.column_start[node + 1];
            for (k, (&source, &place)) in self.source[blocks.clone()].iter().zip(&self.place[blocks]).enumerate() {
                let place = place as usize;
                for (c, column) in a.blocks[source as usize].data.0.iter().enumerate() {
                    // of the diagonal block, the lower triangle
                    let first = if k == 0 { c } else { 0 };
                    for r in first..3 {
                        own[c * rows + place + r] = T::rounded(column[r]);
                        poison += T::ZERO * T::rounded(column[r]);
                    }
                }
            }
        }
        poison == T::ZERO
    }

    /// The diagonal entry of `P A Pᵀ` in this row.
    pub(super) fn diagonal(&self, a: &SystemMatrix, row: usize) -> f64 {
        a.blocks[self.source[self.column_start[row / 3]] as usize][(row % 3, row % 3)]
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

/// First row of each lower block in the front of its column's supernode.
fn places(
    permuted: &PermutedBlocks,
    tree: &SupernodeTree,
    supernodes: &supernodal::SymbolicSupernodalCholesky<u32>,
) -> Vec<u32> {
    let mut places = Vec::with_capacity(permuted.row.len());
    for (node, range) in permuted.column_start.windows(2).enumerate() {
        let s = tree.owner(3 * node);
        let (columns, pattern) = (tree.columns(s), supernodes.supernode(s).pattern());
        places.extend(permuted.row[range[0]..range[1]].iter().map(|&i| {
            let row = 3 * i;
            if (row as usize) < columns.end {
                row - columns.start as u32
            } else {
                (columns.len() + pattern.partition_point(|&r| r < row)) as u32
            }
        }));
    }
    places
}
