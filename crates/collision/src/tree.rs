//! A tree of boxes over triangles, built once and refitted from moving nodes.
//!
//! Nodes lie in depth-first order, so a refit is one backward pass, and a query is one forward pass that skips what it
//! misses: no stack, no allocation, and the same order every time. Parry's tree does the same work behind conversions
//! to its own vector types, and hands out results in an order that depends on its history of updates.

use nalgebra::Vector3;

/// Triangles in a leaf. Four keep the tree shallow while a leaf still fits into two cache lines of indices.
const LEAF: usize = 4;

/// A box along the world's axes; empty where `low > high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner \[m\].
    pub low: Vector3<f64>,
    /// Upper corner \[m\].
    pub high: Vector3<f64>,
}

impl Aabb {
    /// The box that holds nothing.
    pub fn empty() -> Self {
        Self { low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) }
    }

    /// Grows to hold a point; coordinates that are not numbers are ignored.
    pub fn include(&mut self, p: &Vector3<f64>) {
        for k in 0..3 {
            self.low[k] = self.low[k].min(p[k]);
            self.high[k] = self.high[k].max(p[k]);
        }
    }

    fn union(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// True where the boxes share a point.
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    /// Square of the distance of a point to the box \[m²\]; infinite for the empty box.
    pub fn distance_squared(&self, p: &Vector3<f64>) -> f64 {
        (0..3).map(|k| (self.low[k] - p[k]).max(p[k] - self.high[k]).max(0.0).powi(2)).sum()
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// The node that follows this one's subtree.
    skip: u32,
    /// First entry in `order` and number of triangles; 0 triangles for an inner node.
    first: u32,
    count: u32,
}

/// The tree.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl TriangleTree {
    /// A tree over triangles given by their centroids, split at medians.
    pub fn new(centroids: &[Vector3<f64>]) -> Self {
        let mut order: Vec<u32> = (0..centroids.len() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * centroids.len() / LEAF + 1);
        if !order.is_empty() {
            let count = order.len();
            build(&mut nodes, &mut order, 0, count, centroids);
        }
        Self { nodes, order }
    }

    /// Recomputes every box from the boxes of the triangles.
    pub fn refit(&mut self, bounds_of: impl Fn(u32) -> Aabb) {
        for i in (0..self.nodes.len()).rev() {
            let node = self.nodes[i];
            self.nodes[i].bounds = if node.count > 0 {
                let triangles = &self.order[node.first as usize..(node.first + node.count) as usize];
                triangles.iter().fold(Aabb::empty(), |sum, &t| sum.union(&bounds_of(t)))
            } else {
                let right = self.nodes[i + 1].skip as usize;
                self.nodes[i + 1].bounds.union(&self.nodes[right].bounds)
            };
        }
    }

    /// Calls `visit` for each triangle in a leaf that meets the box. The order depends on the tree alone.
    pub fn query(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        let mut i = 0;
        while let Some(node) = self.nodes.get(i) {
            if !node.bounds.meets(bounds) {
                i = node.skip as usize;
                continue;
            }
            for &triangle in &self.order[node.first as usize..(node.first + node.count) as usize] {
                visit(triangle);
            }
            i += 1;
        }
    }

    /// The triangle with the least `distance_squared(triangle)`, and that distance; the nearer child goes first.
    pub fn nearest(&self, p: &Vector3<f64>, mut distance_squared: impl FnMut(u32) -> f64) -> Option<(u32, f64)> {
        // Median splits halve the triangles at each level: 32 levels hold more than a u32 can count.
        let mut stack = [0u32; 40];
        let mut depth = usize::from(!self.nodes.is_empty());
        let mut best: Option<(u32, f64)> = None;
        while depth > 0 {
            depth -= 1;
            let i = stack[depth] as usize;
            let node = &self.nodes[i];
            let bound = best.map_or(f64::INFINITY, |(_, d)| d);
            if node.bounds.distance_squared(p) > bound {
                continue;
            }
            if node.count > 0 {
                for &triangle in &self.order[node.first as usize..(node.first + node.count) as usize] {
                    let d = distance_squared(triangle);
                    if best.is_none_or(|(t, least)| d < least || (d == least && triangle < t)) && d.is_finite() {
                        best = Some((triangle, d));
                    }
                }
                continue;
            }
            let (left, right) = (i + 1, self.nodes[i + 1].skip as usize);
            let nearer_left =
                self.nodes[left].bounds.distance_squared(p) <= self.nodes[right].bounds.distance_squared(p);
            let (near, far) = if nearer_left { (left, right) } else { (right, left) };
            stack[depth] = far as u32;
            stack[depth + 1] = near as u32;
            depth += 2;
        }
        best
    }
}

/// Appends the subtree over `order[first .. first + count]`.
fn build(nodes: &mut Vec<Node>, order: &mut [u32], first: usize, count: usize, centroids: &[Vector3<f64>]) {
    let at = nodes.len();
    let leaf = count <= LEAF;
    nodes.push(Node {
        bounds: Aabb::empty(),
        skip: 0,
        first: first as u32,
        count: if leaf { count as u32 } else { 0 },
    });
    if !leaf {
        let part = &mut order[first..first + count];
        let mut bounds = Aabb::empty();
        part.iter().for_each(|&t| bounds.include(&centroids[t as usize]));
        let axis = (bounds.high - bounds.low).imax();
        let key = |t: &u32| centroids[*t as usize][axis];
        part.select_nth_unstable_by(count / 2, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        build(nodes, order, first, count / 2, centroids);
        build(nodes, order, first + count / 2, count - count / 2, centroids);
    }
    nodes[at].skip = nodes.len() as u32;
}
