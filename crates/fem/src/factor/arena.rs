//! Where the update matrices of the fronts lie while a factorisation runs.
//!
//! The update of a supernode is wanted by its parent alone. Updates of children lie at one end of a region and that of
//! their parent at the other, the ends changing from generation to generation, so that nothing is ever moved: a stack
//! with two ends. Subtrees that run side by side have regions of their own.

use std::ops::Range;

use super::supernodal_tree::SupernodeTree;

/// A subtree with more stored values than this is split into tasks of a factorisation: a millisecond of work.
const TASK_VALUES: usize = 100_000;

/// The same for a solve, which is much shorter and comes many times a step: where another thread takes a core away, as
/// the factor thread does, each task may have to wait for it.
const SOLVE_TASK_VALUES: usize = 300_000;

/// Nor are there more of them than these shares of all values.
const SOLVE_TASKS: usize = 6;

/// Generations that are split at most; deeper ones are walked in sequence. Bounds the depth of the recursion.
const TASK_DEPTH: u32 = 24;

/// Places in the memory for update matrices, and which supernodes are handled as tasks of their own.
#[derive(Debug)]
pub(super) struct Arena {
    /// The update of each supernode, a square matrix over its pattern.
    update: Vec<Range<usize>>,
    /// All that the subtree of each supernode uses.
    region: Vec<Range<usize>>,
    /// Whether the children of a supernode are tasks.
    split: Vec<bool>,
    /// The same for a solve.
    split_solve: Vec<bool>,
    len: usize,
}

impl Arena {
    pub(super) fn new(tree: &SupernodeTree) -> Self {
        let count = tree.len();
        let none = vec![0..0; count];
        let (split, split_solve) = (vec![false; count], vec![false; count]);
        let mut arena = Self { update: none.clone(), region: none, split, split_solve, len: 0 };
        let solve_values = SOLVE_TASK_VALUES.max(tree.value_start(count) / SOLVE_TASKS);
        let mut depth = vec![0u32; count];
        for s in (0..count).rev() {
            let values = tree.value_start(s + 1) - tree.value_start(tree.first(s));
            arena.split[s] = values > TASK_VALUES && depth[s] < TASK_DEPTH;
            arena.split_solve[s] = arena.split[s] && values > solve_values;
            tree.children(s).iter().for_each(|&c| depth[c as usize] = depth[s] + 1);
        }
        let mut need = vec![0; count];
        for s in 0..count {
            need[s] = arena.need(tree, s, &need);
        }
        // parents come after their children, so descending order places every region in that of its parent
        for &root in tree.roots() {
            arena.region[root as usize] = arena.len..arena.len + need[root as usize];
            arena.len += need[root as usize];
        }
        for s in (0..count).rev() {
            arena.place(tree, s, depth[s] % 2 == 0, &need);
        }
        arena
    }

    /// Numbers that the subtree of `s` needs, given what those of its children need.
    fn need(&self, tree: &SupernodeTree, s: usize, need: &[usize]) -> usize {
        let square = |s: usize| tree.below(s) * tree.below(s);
        let (mut kept, mut most, mut last) = (0, 0, 0);
        for &c in tree.children(s) {
            let c = c as usize;
            most = most.max(kept + need[c]);
            last = kept + square(c);
            kept += if self.split[s] { need[c] } else { square(c) };
        }
        most.max(last + square(s))
    }

    /// Places the update of `s` at one end of its region, and the regions of its children at the other.
    fn place(&mut self, tree: &SupernodeTree, s: usize, low: bool, need: &[usize]) {
        let square = |s: usize| tree.below(s) * tree.below(s);
        let Range { start, end } = self.region[s];
        self.update[s] = if low { start..start + square(s) } else { end - square(s)..end };
        let mut kept = 0;
        for &c in tree.children(s) {
            let c = c as usize;
            self.region[c] = if low { end - kept - need[c]..end - kept } else { start + kept..start + kept + need[c] };
            kept += if self.split[s] { need[c] } else { square(c) };
        }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn update(&self, s: usize) -> Range<usize> {
        self.update[s].clone()
    }

    pub(super) fn region(&self, s: usize) -> Range<usize> {
        self.region[s].clone()
    }

    /// Whether the children of `s` are tasks that may run side by side.
    pub(super) fn is_split(&self, s: usize) -> bool {
        self.split[s]
    }

    /// The same for the tasks of a solve.
    pub(super) fn is_split_for_solve(&self, s: usize) -> bool {
        self.split_solve[s]
    }
}
