//! The elimination tree of a pattern under an ordering (Liu 1990).

use super::NodeOrdering;
use crate::sparse::BlockPattern;

/// Marks a root of the elimination forest.
pub const NO_PARENT: u32 = u32::MAX;

/// Parent of each node in elimination order: the first later node that its elimination touches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EliminationTree {
    /// One per place of the order; [`NO_PARENT`] at roots. Parents come later than their children.
    pub parent: Vec<u32>,
}

impl EliminationTree {
    /// The tree of `pattern` eliminated in the order `ordering`; path compression over virtual ancestors.
    pub fn new(pattern: &BlockPattern, ordering: &NodeOrdering) -> Self {
        let n = pattern.rows();
        let mut parent = vec![NO_PARENT; n];
        let mut ancestor = vec![NO_PARENT; n];
        for j in 0..n {
            let old = ordering.old_of_new[j] as usize;
            for p in pattern.row(old) {
                let mut i = ordering.new_of_old[pattern.columns()[p] as usize] as usize;
                // climb from every earlier neighbour to the root of its present subtree, which j then takes over
                while i < j {
                    let next = ancestor[i];
                    ancestor[i] = j as u32;
                    if next == NO_PARENT {
                        parent[i] = j as u32;
                        break;
                    }
                    i = next as usize;
                }
            }
        }
        Self { parent }
    }

    /// Places listed so that every subtree is contiguous and ends with its root; children keep their order.
    pub fn postorder(&self) -> Vec<u32> {
        let n = self.parent.len();
        let mut first_child = vec![NO_PARENT; n];
        let mut next_sibling = vec![NO_PARENT; n];
        let mut roots = Vec::new();
        for j in (0..n).rev() {
            match self.parent[j] {
                NO_PARENT => roots.push(j as u32),
                p => {
                    next_sibling[j] = first_child[p as usize];
                    first_child[p as usize] = j as u32;
                }
            }
        }
        let mut order = Vec::with_capacity(n);
        // roots were pushed last to first, so the first one is on top of the stack
        let mut stack = roots;
        while let Some(&top) = stack.last() {
            let child = first_child[top as usize];
            if child == NO_PARENT {
                order.push(top);
                stack.pop();
            } else {
                first_child[top as usize] = next_sibling[child as usize];
                stack.push(child);
            }
        }
        order
    }
}
