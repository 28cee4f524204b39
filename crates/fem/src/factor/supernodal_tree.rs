//! The tree of supernodes and the ranges of rows that they own.

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

use crate::ordering::NO_PARENT;

/// Parent of each supernode and owner of each row.
#[derive(Debug)]
pub(super) struct SupernodeTree {
    parent: Vec<u32>,
    owner: Vec<u32>,
    /// `begin(s)..begin[s + 1]` are the columns of supernode `s`.
    begin: Vec<u32>,
    widest_pattern: usize,
}

impl SupernodeTree {
    pub(super) fn new(supernodes: &SymbolicSupernodalCholesky<u32>) -> Self {
        let count = supernodes.n_supernodes();
        let mut owner = vec![0; supernodes.nrows()];
        let mut begin = supernodes.supernode_begin().to_vec();
        begin.push(supernodes.nrows() as u32);
        for s in 0..count {
            owner[begin[s] as usize..begin[s + 1] as usize].fill(s as u32);
        }
        // patterns ascend, and the first row below a supernode's own block belongs to its parent
        let parent = (0..count)
            .map(|s| supernodes.supernode(s).pattern().first().map_or(NO_PARENT, |&row| owner[row as usize]))
            .collect();
        let widest_pattern = (0..count).map(|s| supernodes.supernode(s).pattern().len()).max().unwrap_or(0);
        Self { parent, owner, begin, widest_pattern }
    }

    pub(super) fn parents(&self) -> &[u32] {
        &self.parent
    }

    /// Supernode that holds row (and column) `row` of `L`.
    pub(super) fn owner(&self, row: usize) -> usize {
        self.owner[row] as usize
    }

    pub(super) fn columns(&self, s: usize) -> std::ops::Range<usize> {
        self.begin[s] as usize..self.begin[s + 1] as usize
    }

    /// Most rows below the own block of any supernode.
    pub(super) fn widest_pattern(&self) -> usize {
        self.widest_pattern
    }
}
