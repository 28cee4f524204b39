//! Minimum vertex cover of a bipartite graph by maximum matching (König 1931).

const UNMATCHED: u32 = u32::MAX;

/// Edges from left vertices `0..left` to right vertices `0..right`, in compressed rows.
pub(super) struct BipartiteGraph {
    pub(super) row_start: Vec<u32>,
    pub(super) right_of_edge: Vec<u32>,
    pub(super) right: usize,
}

/// Which vertices of both sides cover all edges; the smallest such choice.
pub(super) struct Cover {
    pub(super) left: Vec<bool>,
    pub(super) right: Vec<bool>,
}

impl BipartiteGraph {
    fn edges(&self, left: usize) -> std::ops::Range<usize> {
        self.row_start[left] as usize..self.row_start[left + 1] as usize
    }

    fn left(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Maximum matching by augmenting paths (breadth first), greedy start: partner of each right and left vertex.
    fn matching(&self) -> (Vec<u32>, Vec<u32>) {
        let mut of_left = vec![UNMATCHED; self.left()];
        let mut of_right = vec![UNMATCHED; self.right];
        for u in 0..self.left() {
            for e in self.edges(u) {
                let w = self.right_of_edge[e] as usize;
                if of_right[w] == UNMATCHED {
                    of_right[w] = u as u32;
                    of_left[u] = w as u32;
                    break;
                }
            }
        }
        let mut reached_from = vec![UNMATCHED; self.right];
        let mut visited_in = vec![UNMATCHED; self.right];
        let mut queue = Vec::new();
        for root in 0..self.left() {
            if of_left[root] != UNMATCHED {
                continue;
            }
            queue.clear();
            queue.push(root as u32);
            let mut head = 0;
            let mut free = None;
            'search: while head < queue.len() {
                let u = queue[head] as usize;
                head += 1;
                for e in self.edges(u) {
                    let w = self.right_of_edge[e] as usize;
                    if visited_in[w] == root as u32 {
                        continue;
                    }
                    visited_in[w] = root as u32;
                    reached_from[w] = u as u32;
                    if of_right[w] == UNMATCHED {
                        free = Some(w);
                        break 'search;
                    }
                    queue.push(of_right[w]);
                }
            }
            // flip the augmenting path back to its root
            let mut w = free;
            while let Some(end) = w {
                let u = reached_from[end] as usize;
                let previous = of_left[u];
                of_right[end] = u as u32;
                of_left[u] = end as u32;
                w = (previous != UNMATCHED).then_some(previous as usize);
            }
        }
        (of_left, of_right)
    }

    /// The minimum cover: right vertices reachable from unmatched left ones by alternating paths, and left vertices
    /// that are not.
    pub(super) fn minimum_cover(&self) -> Cover {
        let (of_left, of_right) = self.matching();
        let mut reached_left = vec![false; self.left()];
        let mut reached_right = vec![false; self.right];
        let mut stack: Vec<usize> = (0..self.left()).filter(|&u| of_left[u] == UNMATCHED).collect();
        for &u in &stack {
            reached_left[u] = true;
        }
        while let Some(u) = stack.pop() {
            for e in self.edges(u) {
                let w = self.right_of_edge[e] as usize;
                if std::mem::replace(&mut reached_right[w], true) || of_right[w] == UNMATCHED {
                    continue;
                }
                let next = of_right[w] as usize;
                if !std::mem::replace(&mut reached_left[next], true) {
                    stack.push(next);
                }
            }
        }
        Cover { left: reached_left.into_iter().map(|reached| !reached).collect(), right: reached_right }
    }
}
