//! The tree of supernodes, the ranges of rows that they own, and how their fronts lie in one another.
//!
//! The front of a supernode is the list of its own columns followed by the rows below them (its *pattern*). What a
//! supernode passes on concerns its pattern alone, and that lies wholly in the front of its parent: the map is kept
//! as runs of neighbouring rows, since separators are numbered in one piece.

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

use crate::ordering::NO_PARENT;

/// Neighbouring rows of a supernode's pattern that are neighbours in its parent's front as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// First of them in the pattern.
    pub(super) from: u32,
    /// Its place in the front of the parent.
    pub(super) to: u32,
    pub(super) len: u32,
}

impl Run {
    pub(super) fn source(&self) -> Range<usize> {
        self.from as usize..(self.from + self.len) as usize
    }

    pub(super) fn target(&self) -> Range<usize> {
        self.to as usize..(self.to + self.len) as usize
    }
}

/// Parents, children and owners. Supernodes ascend in elimination order, so that the subtree of `s` is
/// `first(s)..=s`.
#[derive(Debug)]
pub(super) struct SupernodeTree {
    parent: Vec<u32>,
    child_start: Vec<u32>,
    child: Vec<u32>,
    roots: Vec<u32>,
    first: Vec<u32>,
    owner: Vec<u32>,
    /// `begin[s]..begin[s + 1]` are the columns of supernode `s`.
    begin: Vec<u32>,
    /// Where the dense block of each supernode begins in the stored values.
    value_start: Vec<usize>,
    /// Where the pattern of each supernode begins if all are listed one after another.
    pattern_start: Vec<usize>,
    run_start: Vec<u32>,
    runs: Vec<Run>,
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
        let pattern = |s: usize| supernodes.supernode(s).pattern();
        // patterns ascend, and the first row below a supernode's own block belongs to its parent
        let parent: Vec<u32> =
            (0..count).map(|s| pattern(s).first().map_or(NO_PARENT, |&row| owner[row as usize])).collect();
        let mut pattern_start = vec![0];
        for s in 0..count {
            pattern_start.push(pattern_start[s] + pattern(s).len());
        }
        let (child_start, child) = children(&parent);
        let mut first: Vec<u32> = (0..count as u32).collect();
        for s in 0..count {
            if let Some(before) = first.get_mut(parent[s] as usize).map(|before| *before) {
                first[parent[s] as usize] = before.min(first[s]);
            }
        }
        let (mut run_start, mut runs) = (vec![0], Vec::new());
        for s in 0..count {
            if parent[s] != NO_PARENT {
                let p = parent[s] as usize;
                push_runs(pattern(s), begin[p]..begin[p + 1], pattern(p), &mut runs);
            }
            run_start.push(runs.len() as u32);
        }
        Self {
            roots: (0..count as u32).filter(|&s| parent[s as usize] == NO_PARENT).collect(),
            parent,
            child_start,
            child,
            first,
            owner,
            begin,
            value_start: supernodes.col_ptr_for_val().iter().map(|&v| v as usize).collect(),
            widest_pattern: (0..count).map(|s| pattern(s).len()).max().unwrap_or(0),
            pattern_start,
            run_start,
            runs,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.parent.len()
    }

    pub(super) fn parents(&self) -> &[u32] {
        &self.parent
    }

    /// Children of a supernode, ascending.
    pub(super) fn children(&self, s: usize) -> &[u32] {
        &self.child[self.child_start[s] as usize..self.child_start[s + 1] as usize]
    }

    /// Supernodes without a parent, ascending.
    pub(super) fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// First supernode of the subtree of `s`.
    pub(super) fn first(&self, s: usize) -> usize {
        self.first[s] as usize
    }

    /// Supernode that holds row (and column) `row` of `L`.
    pub(super) fn owner(&self, row: usize) -> usize {
        self.owner[row] as usize
    }

    pub(super) fn columns(&self, s: usize) -> Range<usize> {
        self.begin[s] as usize..self.begin[s + 1] as usize
    }

    /// Where the dense block of `s` lies in the stored values; for `len()`, the end of them.
    pub(super) fn value_start(&self, s: usize) -> usize {
        self.value_start[s]
    }

    /// Where the pattern of `s` lies if all are listed one after another; for `len()`, the end of them.
    pub(super) fn pattern_start(&self, s: usize) -> usize {
        self.pattern_start[s]
    }

    /// Rows below the own block of `s`.
    pub(super) fn below(&self, s: usize) -> usize {
        self.pattern_start[s + 1] - self.pattern_start[s]
    }

    /// How the pattern of `s` lies in the front of its parent; empty for roots. No run holds own columns of the parent
    /// together with rows below them.
    pub(super) fn runs(&self, s: usize) -> &[Run] {
        &self.runs[self.run_start[s] as usize..self.run_start[s + 1] as usize]
    }

    /// Most rows below the own block of any supernode.
    pub(super) fn widest_pattern(&self) -> usize {
        self.widest_pattern
    }
}

/// Children of each supernode in one list.
fn children(parent: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; parent.len() + 1];
    for &p in parent.iter().filter(|&&p| p != NO_PARENT) {
        start[p as usize + 1] += 1;
    }
    for s in 0..parent.len() {
        start[s + 1] += start[s];
    }
    let mut next = start.clone();
    let mut child = vec![0; start[parent.len()] as usize];
    for (s, &p) in parent.iter().enumerate().filter(|&(_, &p)| p != NO_PARENT) {
        child[next[p as usize] as usize] = s as u32;
        next[p as usize] += 1;
    }
    (start, child)
}

/// Appends the runs of `pattern` in the front made of `columns` and `below`.
fn push_runs(pattern: &[u32], columns: Range<u32>, below: &[u32], runs: &mut Vec<Run>) {
    let width = columns.end - columns.start;
    let (mut at, start) = (0, runs.len());
    for (from, &row) in pattern.iter().enumerate() {
        let to = if row < columns.end {
            row - columns.start
        } else {
            while below[at] < row {
                at += 1;
            }
            width + at as u32
        };
        match runs[start..].last_mut() {
            Some(run) if run.to + run.len == to && to != width => run.len += 1,
            _ => runs.push(Run { from: from as u32, to, len: 1 }),
        }
    }
}
