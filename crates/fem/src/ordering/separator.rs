//! Splitting a set of nodes in two by a vertex separator.

use nalgebra::Vector3;

use super::cover::BipartiteGraph;
use crate::sparse::BlockPattern;

/// Where the nodes, sorted along a direction, are cut. Cuts off the middle often meet a thinner section.
const FRACTIONS: [f64; 5] = [0.5, 0.45, 0.55, 0.4, 0.6];

/// A split is useful if each part keeps at least this share of the nodes.
const SMALLEST_PART: f64 = 0.15;

/// No edge joins `first` and `second`.
pub(super) struct Split {
    pub(super) first: Vec<u32>,
    pub(super) second: Vec<u32>,
    pub(super) separator: Vec<u32>,
}

/// Side of a node in the cut that is under trial; nodes outside the set keep `OUTSIDE`.
const OUTSIDE: u8 = 0;
const FIRST: u8 = 1;
const SECOND: u8 = 2;

/// The graph, its positions and marks over all nodes that are reused from split to split.
pub(super) struct Splitter<'a> {
    pattern: &'a BlockPattern,
    positions: &'a [Vector3<f64>],
    side: Vec<u8>,
    local: Vec<u32>,
}

impl<'a> Splitter<'a> {
    pub(super) fn new(pattern: &'a BlockPattern, positions: &'a [Vector3<f64>]) -> Self {
        let n = pattern.rows();
        Self { pattern, positions, side: vec![OUTSIDE; n], local: vec![0; n] }
    }

    pub(super) fn pattern(&self) -> &'a BlockPattern {
        self.pattern
    }

    fn neighbours(&self, node: u32) -> &'a [u32] {
        &self.pattern.columns()[self.pattern.row(node as usize)]
    }

    /// The connected components of the subgraph on `nodes`, each in breadth-first order.
    pub(super) fn components(&mut self, nodes: Vec<u32>) -> Vec<Vec<u32>> {
        for &k in &nodes {
            self.side[k as usize] = FIRST;
        }
        let mut components = Vec::new();
        for &k in &nodes {
            if self.side[k as usize] == FIRST {
                components.push(self.take_connected(k));
            }
        }
        components
    }

    /// All nodes marked `FIRST` that are connected to `start`, in breadth-first order; their marks are cleared.
    fn take_connected(&mut self, start: u32) -> Vec<u32> {
        let mut found = vec![start];
        self.side[start as usize] = OUTSIDE;
        let mut head = 0;
        while head < found.len() {
            for &j in self.neighbours(found[head]) {
                if self.side[j as usize] == FIRST {
                    self.side[j as usize] = OUTSIDE;
                    found.push(j);
                }
            }
            head += 1;
        }
        found
    }

    /// The best useful split over the planes of three axes; `None` where no plane gives one, as for equal positions.
    /// Expects finite positions.
    pub(super) fn split(&mut self, nodes: &[u32]) -> Option<Split> {
        let mut best: Option<(f64, Split)> = None;
        for axis in 0..3 {
            let coordinate = |k: u32| self.positions[k as usize][axis];
            let mut sorted = nodes.to_vec();
            sorted.sort_unstable_by(|&a, &b| coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(&b)));
            if coordinate(sorted[0]) < coordinate(sorted[sorted.len() - 1]) {
                self.try_cuts(&sorted, &mut best);
            }
        }
        best.map(|(_, split)| split)
    }

    /// Cuts the sorted nodes at each fraction and keeps the best split so far.
    fn try_cuts(&mut self, sorted: &[u32], best: &mut Option<(f64, Split)>) {
        for fraction in FRACTIONS {
            let cut = (fraction * sorted.len() as f64).round() as usize;
            let split = self.separate(sorted, cut);
            let smaller = split.first.len().min(split.second.len());
            if (smaller as f64) < SMALLEST_PART * sorted.len() as f64 {
                continue;
            }
            let cost = cost_of(&split);
            if best.as_ref().is_none_or(|(lowest, _)| cost < *lowest) {
                *best = Some((cost, split));
            }
        }
    }

    /// Separates `sorted[..cut]` from `sorted[cut..]` by the fewest nodes that touch every edge between them.
    fn separate(&mut self, sorted: &[u32], cut: usize) -> Split {
        for &k in &sorted[..cut] {
            self.side[k as usize] = FIRST;
        }
        for &k in &sorted[cut..] {
            self.side[k as usize] = SECOND;
        }
        let mut right_nodes = Vec::new();
        for &k in &sorted[cut..] {
            if self.neighbours(k).iter().any(|&j| self.side[j as usize] == FIRST) {
                self.local[k as usize] = right_nodes.len() as u32;
                right_nodes.push(k);
            }
        }
        let mut left_nodes = Vec::new();
        let mut graph = BipartiteGraph { row_start: vec![0], right_of_edge: Vec::new(), right: right_nodes.len() };
        for &k in &sorted[..cut] {
            let across = self.neighbours(k).iter().filter(|&&j| self.side[j as usize] == SECOND);
            let before = graph.right_of_edge.len();
            graph.right_of_edge.extend(across.map(|&j| self.local[j as usize]));
            if graph.right_of_edge.len() > before {
                left_nodes.push(k);
                graph.row_start.push(graph.right_of_edge.len() as u32);
            }
        }
        let cover = graph.minimum_cover();
        let mut separator = Vec::new();
        for (nodes, covered) in [(&left_nodes, &cover.left), (&right_nodes, &cover.right)] {
            for (&k, _) in nodes.iter().zip(covered).filter(|&(_, &covered)| covered) {
                self.side[k as usize] = OUTSIDE;
                separator.push(k);
            }
        }
        let remaining = |part: &[u32]| part.iter().copied().filter(|&k| self.side[k as usize] != OUTSIDE).collect();
        let (first, second) = (remaining(&sorted[..cut]), remaining(&sorted[cut..]));
        for &k in sorted {
            self.side[k as usize] = OUTSIDE;
        }
        Split { first, second, separator }
    }
}

/// Cost of a split, lower is better: the separator's share against the balance of what it leaves (ratio cut).
fn cost_of(split: &Split) -> f64 {
    let separator = split.separator.len() as f64;
    separator * (1.0 / split.first.len() as f64 + 1.0 / split.second.len() as f64)
}
