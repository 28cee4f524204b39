//! A tree of bounding boxes over triangles: nearest distance, and winding number along a ray.

use nalgebra::{Vector2, Vector3};

/// Triangles of a leaf.
const LEAF: usize = 4;

/// Boxes in depth-first order: the left child follows its parent, `right` names the other one.
#[derive(Clone, Debug)]
pub(super) struct TriangleTree {
    nodes: Vec<Node>,
    /// Corners of the triangles, in the order of the leaves.
    triangles: Vec<[Vector3<f64>; 3]>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// First triangle of a leaf, or the right child.
    next: u32,
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
}

impl TriangleTree {
    pub(super) fn new(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut triangles: Vec<_> = triangles.iter().map(|t| t.map(|v| vertices[v as usize])).collect();
        let mut nodes = Vec::new();
        let count = triangles.len();
        build(&mut nodes, &mut triangles, 0, count);
        Self { nodes, triangles }
    }

    pub(super) fn bounds(&self) -> [Vector3<f64>; 2] {
        [self.nodes[0].low, self.nodes[0].high]
    }

    /// Distance (m) to the nearest triangle.
    pub(super) fn distance(&self, point: &Vector3<f64>) -> f64 {
        let mut best = f64::INFINITY;
        self.nearest(0, point, &mut best);
        best.sqrt()
    }

    fn nearest(&self, node: usize, point: &Vector3<f64>, best: &mut f64) {
        let Node { next, count, .. } = self.nodes[node];
        if count > 0 {
            for triangle in &self.triangles[next as usize..(next + count) as usize] {
                *best = best.min(distance_squared(triangle, point));
            }
            return;
        }
        let children = [node + 1, next as usize].map(|c| (self.box_distance_squared(c, point), c));
        let [near, far] = if children[0].0 <= children[1].0 { children } else { [children[1], children[0]] };
        for (distance, child) in [near, far] {
            if distance < *best {
                self.nearest(child, point, best);
            }
        }
    }

    fn box_distance_squared(&self, node: usize, point: &Vector3<f64>) -> f64 {
        let node = &self.nodes[node];
        (point - point.sup(&node.low).inf(&node.high)).norm_squared()
    }

    /// How often the surface winds around a point: the sum of its crossings with the ray along +x, +1 where the
    /// surface faces along the ray. 0 outside, 1 inside a simple body.
    pub(super) fn winding(&self, point: &Vector3<f64>) -> i32 {
        let mut winding = 0;
        let mut stack = vec![0usize];
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at];
            let beside = (1..3).any(|a| point[a] < node.low[a] || point[a] > node.high[a]);
            if beside || point.x > node.high.x {
                continue;
            }
            if node.count == 0 {
                stack.extend([at + 1, node.next as usize]);
            } else {
                let leaf = node.next as usize..(node.next + node.count) as usize;
                winding += self.triangles[leaf].iter().map(|t| crossing(t, point)).sum::<i32>();
            }
        }
        winding
    }
}

/// Median split along the longest axis of the centroids; returns the number of the node.
fn build(nodes: &mut Vec<Node>, triangles: &mut [[Vector3<f64>; 3]], first: usize, count: usize) -> usize {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    let centroid = |t: &[Vector3<f64>; 3]| t[0] + t[1] + t[2];
    let (mut least, mut most) = (low, high);
    for triangle in triangles.iter() {
        for corner in triangle {
            low = low.inf(corner);
            high = high.sup(corner);
        }
        least = least.inf(&centroid(triangle));
        most = most.sup(&centroid(triangle));
    }
    let index = nodes.len();
    nodes.push(Node { low, high, next: first as u32, count: count as u32 });
    if count > LEAF {
        let axis = (most - least).imax();
        let half = count / 2;
        triangles.select_nth_unstable_by(half, |s, t| centroid(s)[axis].total_cmp(&centroid(t)[axis]));
        let (left, right) = triangles.split_at_mut(half);
        build(nodes, left, first, half);
        let other = build(nodes, right, first + half, count - half);
        nodes[index].next = other as u32;
        nodes[index].count = 0;
    }
    index
}

/// Squared distance from a point to a triangle: to its plane if the foot lies within, else to its nearest edge.
fn distance_squared([p, q, r]: &[Vector3<f64>; 3], point: &Vector3<f64>) -> f64 {
    let normal = (q - p).cross(&(r - p));
    let edges = [(p, q), (q, r), (r, p)];
    let area_squared = normal.norm_squared();
    if area_squared > 0.0 && edges.iter().all(|(a, b)| (*b - *a).cross(&(point - *a)).dot(&normal) >= 0.0) {
        let height = (point - p).dot(&normal);
        return height * height / area_squared;
    }
    edges
        .iter()
        .map(|(a, b)| {
            let along = *b - *a;
            let t = ((point - *a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (point - (*a + along * t)).norm_squared()
        })
        .fold(f64::INFINITY, f64::min)
}

/// Crossing of the ray from `point` along +x with a triangle: +1 where its normal has a positive x part, -1 where
/// negative, 0 for none.
///
/// The sides of the edges are decided in the y–z plane as if the point were moved by an infinitesimal step, and for
/// each edge from its ends in a fixed order, so that neighbouring triangles agree and a ray through an edge or a
/// vertex of a closed surface is counted once.
fn crossing(triangle: &[Vector3<f64>; 3], point: &Vector3<f64>) -> i32 {
    let side = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let (a, b) = (Vector2::new(a.y, a.z), Vector2::new(b.y, b.z));
        if (a.x, a.y) <= (b.x, b.y) { left_of(a, b, point) } else { !left_of(b, a, point) }
    };
    let [p, q, r] = triangle;
    let sides = [side(p, q), side(q, r), side(r, p)];
    if sides[0] != sides[1] || sides[1] != sides[2] {
        return 0;
    }
    // Where the ray meets the plane: ahead of the point or not.
    let normal = (q - p).cross(&(r - p));
    let behind = (point - p).dot(&normal);
    match (normal.x, behind) {
        (n, b) if n > 0.0 && b < 0.0 => 1,
        (n, b) if n < 0.0 && b > 0.0 => -1,
        _ => 0,
    }
}

/// Whether a point lies left of the line a → b in the y–z plane; a and b in lexical order.
fn left_of(a: Vector2<f64>, b: Vector2<f64>, point: &Vector3<f64>) -> bool {
    let p = Vector2::new(point.y, point.z);
    let area = (b - a).perp(&(p - a));
    // On the line: the sign that a step (ε, ε²) of the point would give, (b - a) × (ε, ε²).
    area > 0.0 || (area == 0.0 && (b.y < a.y || (b.y == a.y && b.x > a.x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriangleTree {
        let v = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Vector3::from);
        TriangleTree::new(&v, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    }

    #[test]
    fn distances_to_face_edge_and_corner() {
        let tree = tetrahedron();
        let distance = |x, y, z| tree.distance(&Vector3::new(x, y, z));
        assert_eq!(distance(0.2, 0.2, -0.5), 0.5);
        assert!((distance(0.5, -1.0, -1.0) - 2.0f64.sqrt()).abs() < 1e-15);
        assert_eq!(distance(0.0, 0.0, 3.0), 2.0);
    }

    #[test]
    fn rays_through_vertices_and_edges_are_counted_once() {
        let tree = tetrahedron();
        let winding = |x, y, z| tree.winding(&Vector3::new(x, y, z));
        assert_eq!(winding(0.1, 0.1, 0.1), 1);
        assert_eq!(winding(-1.0, 0.1, 0.1), 0);
        assert_eq!(winding(2.0, 0.1, 0.1), 0);
        // Along an edge's line, through corners, through an edge at right angles: outside before and behind.
        for (y, z) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)] {
            assert_eq!(winding(-1.0, y, z), 0, "y {y} z {z}");
            assert_eq!(winding(2.0, y, z), 0, "y {y} z {z}");
        }
    }
}
