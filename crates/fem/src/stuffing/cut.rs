//! Cut points, and warping: lattice vertices that the surface passes too closely are moved onto it.
//!
//! A vertex is violated if the surface cuts one of its edges within a fraction α of the edge's length. The two
//! thresholds make the worst dihedral angles of the stencils 10.78° and 164.71° (Labelle and Shewchuk prove
//! [10.7°, 164.8°] for the uniform lattice); a test in `stencil` enumerates the stencils over the extremes of
//! their warps and cuts. The pair 0.24999 and 0.41189 that is often quoted does a little better on planes, but its
//! worst case is 9.3°.
//!
//! Departures: among several violating cut points the nearest is taken; cut points are roots of the level set along
//! the edge and not only of its linear interpolant; and the order of warping is fixed (see `warp`), without which the
//! same enumeration gives 10.62°.

use nalgebra::Vector3;

use super::lattice::{Lattice, NEIGHBOURS};
use super::level_set::LevelSet;

/// Warping threshold of long edges.
pub(super) const ALPHA_LONG: f64 = 0.285;
/// Warping threshold of short edges.
pub(super) const ALPHA_SHORT: f64 = 0.399;
/// A root is known to this fraction of the edge.
const ROOT_TOLERANCE: f64 = 1e-9;

/// The lattice after warping, with what is left of its cut points.
pub(super) struct CutLattice {
    pub(super) lattice: Lattice,
    /// 1 inside, -1 outside, 0 on the surface; one per lattice vertex.
    pub(super) signs: Vec<i8>,
    /// Positions of warped vertices, ascending by vertex.
    warped: Vec<(u32, Vector3<f64>)>,
    /// Cut points, ascending by edge (lower vertex, higher vertex).
    cuts: Vec<Cut>,
}

struct Cut {
    edge: (u32, u32),
    /// From the lower to the higher vertex, in (0, 1).
    fraction: f64,
    point: Vector3<f64>,
}

impl CutLattice {
    /// Samples the level set, finds the cut points, and warps.
    pub(super) fn new(lattice: Lattice, level_set: &(impl LevelSet + ?Sized)) -> Self {
        let values: Vec<f64> = (0..lattice.vertex_count()).map(|v| level_set.value(&lattice.position(v))).collect();
        // A value that is not a number counts as outside.
        let signs = values
            .iter()
            .map(|&f| {
                if f > 0.0 {
                    1
                } else if f == 0.0 {
                    0
                } else {
                    -1
                }
            })
            .collect();
        let cuts = cut_points(&lattice, &values, level_set);
        let mut cut = Self { lattice, signs, warped: Vec::new(), cuts };
        cut.warp();
        cut
    }

    /// A state as it might be left by warping: moved vertices have the sign 0, cuts are (edge, fraction).
    #[cfg(test)]
    pub(super) fn assembled(
        lattice: Lattice,
        signs: Vec<i8>,
        mut warped: Vec<(u32, Vector3<f64>)>,
        cuts: &[((u32, u32), f64)],
    ) -> Self {
        warped.sort_unstable_by_key(|w| w.0);
        let mut cuts: Vec<Cut> = cuts
            .iter()
            .map(|&((u, v), t)| {
                let point = lattice.position(u) * (1.0 - t) + lattice.position(v) * t;
                let fraction = if u < v { t } else { 1.0 - t };
                Cut { edge: (u.min(v), u.max(v)), fraction, point }
            })
            .collect();
        cuts.sort_unstable_by_key(|c| c.edge);
        Self { lattice, signs, warped, cuts }
    }

    /// Position of a lattice vertex, moved if it was warped.
    pub(super) fn vertex_position(&self, vertex: u32) -> Vector3<f64> {
        match self.warped.binary_search_by_key(&vertex, |w| w.0) {
            Ok(i) => self.warped[i].1,
            Err(_) => self.lattice.position(vertex),
        }
    }

    /// Number of the cut point on an edge, if it has one.
    pub(super) fn cut_index(&self, u: u32, v: u32) -> Option<u32> {
        self.cuts.binary_search_by_key(&(u.min(v), u.max(v)), |c| c.edge).ok().map(|i| i as u32)
    }

    pub(super) fn cut_position(&self, index: u32) -> Vector3<f64> {
        self.cuts[index as usize].point
    }

    /// Outside vertices are warped first, and only towards inside vertices that are not violated themselves, as long
    /// as there are any; what is then still violated lies inside, and moves out towards vertices that stay. So no
    /// vertex moves towards one that moves, which would flatten the tetrahedra between them.
    fn warp(&mut self) {
        // The ends of cut edges, in lattice order.
        let mut ends: Vec<u32> = self.cuts.iter().flat_map(|c| [c.edge.0, c.edge.1]).collect();
        ends.sort_unstable();
        ends.dedup();
        let mut violated: Vec<bool> = ends.iter().map(|&v| self.nearest_violation(v, |_| true).is_some()).collect();
        let place = |v: u32| ends.binary_search(&v).ok();
        loop {
            let mut moved = false;
            for i in 0..ends.len() {
                let vertex = ends[i];
                if !violated[i] || self.signs[vertex as usize] >= 0 {
                    continue;
                }
                let steady = |inside: u32| place(inside).is_none_or(|p| !violated[p]);
                if let Some(point) = self.nearest_violation(vertex, steady) {
                    self.move_to(vertex, point);
                    violated[i] = false;
                    moved = true;
                    let around: Vec<u32> = neighbours(&self.lattice, vertex).map(|(_, v)| v).collect();
                    for p in around.into_iter().filter_map(place) {
                        violated[p] = violated[p] && self.nearest_violation(ends[p], |_| true).is_some();
                    }
                }
            }
            if !moved {
                break;
            }
        }
        for &vertex in &ends {
            if self.signs[vertex as usize] > 0
                && let Some(point) = self.nearest_violation(vertex, |_| true)
            {
                self.move_to(vertex, point);
            }
        }
        self.warped.sort_unstable_by_key(|w| w.0);
        let signs = &self.signs;
        self.cuts.retain(|c| signs[c.edge.0 as usize] * signs[c.edge.1 as usize] < 0);
    }

    fn move_to(&mut self, vertex: u32, point: Vector3<f64>) {
        self.signs[vertex as usize] = 0;
        self.warped.push((vertex, point));
    }

    /// The nearest cut point that violates a vertex, on an edge to a neighbour that `allowed` admits. Edges whose
    /// other end was warped have lost theirs.
    fn nearest_violation(&self, vertex: u32, allowed: impl Fn(u32) -> bool) -> Option<Vector3<f64>> {
        let mut nearest: Option<(f64, Vector3<f64>)> = None;
        for (n, neighbour) in neighbours(&self.lattice, vertex) {
            if self.signs[vertex as usize] * self.signs[neighbour as usize] >= 0 || !allowed(neighbour) {
                continue;
            }
            let Some(index) = self.cut_index(vertex, neighbour) else { continue };
            let cut = &self.cuts[index as usize];
            let fraction = if cut.edge.0 == vertex { cut.fraction } else { 1.0 - cut.fraction };
            let (alpha, length) = if n < 6 { (ALPHA_LONG, 1.0) } else { (ALPHA_SHORT, 0.75f64.sqrt()) };
            let distance = fraction * length;
            if fraction < alpha && nearest.is_none_or(|(d, _)| distance < d) {
                nearest = Some((distance, cut.point));
            }
        }
        nearest.map(|(_, point)| point)
    }
}

/// Neighbours of a vertex within the block, with their number in [`NEIGHBOURS`].
fn neighbours(lattice: &Lattice, vertex: u32) -> impl Iterator<Item = (usize, u32)> + '_ {
    let c = lattice.coordinates(vertex);
    NEIGHBOURS.iter().enumerate().filter_map(move |(n, step)| {
        lattice.vertex_at([c[0] + step[0], c[1] + step[1], c[2] + step[2]]).map(|other| (n, other))
    })
}

/// One cut point on every edge whose ends differ in sign.
fn cut_points(lattice: &Lattice, values: &[f64], level_set: &(impl LevelSet + ?Sized)) -> Vec<Cut> {
    let mut cuts = Vec::new();
    for u in 0..lattice.vertex_count() {
        let f_u = values[u as usize];
        if f_u == 0.0 || f_u.is_nan() {
            continue;
        }
        for (_, v) in neighbours(lattice, u) {
            let f_v = values[v as usize];
            if v > u && f_u * f_v < 0.0 {
                let (p, q) = (lattice.position(u), lattice.position(v));
                let fraction = root(f_u, f_v, |t| level_set.value(&(p + (q - p) * t)));
                cuts.push(Cut { edge: (u, v), fraction, point: p + (q - p) * fraction });
            }
        }
    }
    cuts.sort_unstable_by_key(|c| c.edge);
    cuts
}

/// A root of `f` in (0, 1) from its values of opposite sign at the ends: regula falsi in the Illinois form (an end
/// that stays twice has its value halved), with a bisection whenever three steps have not halved the bracket.
fn root(f_0: f64, f_1: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut a, mut f_a, mut b, mut f_b) = (0.0, f_0, 1.0, f_1);
    let mut allowed = 0.5;
    let mut last = 0;
    for step in 1..=90 {
        if b - a <= ROOT_TOLERANCE {
            break;
        }
        let mut t = a + (b - a) * (f_a / (f_a - f_b));
        if !(t > a && t < b) {
            t = 0.5 * (a + b);
        }
        if step % 3 == 0 {
            if b - a > allowed {
                t = 0.5 * (a + b);
            }
            allowed = 0.5 * (b - a);
        }
        let f_t = f(t);
        if f_t == 0.0 {
            return t;
        }
        if (f_t > 0.0) == (f_0 > 0.0) {
            (a, f_a) = (t, f_t);
            f_b *= if last == 1 { 0.5 } else { 1.0 };
            last = 1;
        } else {
            (b, f_b) = (t, f_t);
            f_a *= if last == -1 { 0.5 } else { 1.0 };
            last = -1;
        }
    }
    0.5 * (a + b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_smooth_steep_and_flat_functions_are_found() {
        let cases: [(f64, &dyn Fn(f64) -> f64); 4] = [
            (0.3, &|t| t - 0.3),
            (0.7, &|t| (t - 0.7).powi(5)),
            (0.001, &|t| (t / 0.001).ln().max(-30.0)),
            (0.5, &|t| if t < 0.5 { -1.0 } else { 1e-3 }),
        ];
        for (expected, f) in cases {
            let found = root(f(0.0), f(1.0), f);
            assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
        }
    }
}
