//! Stencils: the part of a lattice tetrahedron that lies inside, as tetrahedra.
//!
//! Cutting off outside vertices leaves quadrilaterals on the faces. Each is shared with a neighbour, so that its
//! diagonal must follow from the face alone, and it must not be the long thin one: where a cut point lies on a long
//! edge the diagonal ends there; where both lie on short edges (and the uncut edge a–b is long) the parity rule
//! decides: a is joined with the cut point of b's edge if an odd number of a's coordinates exceed it; on the
//! lattice of centres, if an even number do. [Labelle and Shewchuk 2007, section 3.4]

use super::cut::CutLattice;

/// A vertex of the result: a lattice vertex, or a cut point counted from the number of lattice vertices up.
pub(super) type Key = u32;

/// Inside parts of all tetrahedra, positively oriented.
pub(super) fn clip(cut: &CutLattice) -> Vec<[Key; 4]> {
    let mut inside = Vec::new();
    cut.lattice.for_each_tetrahedron(|tetrahedron| clip_one(cut, tetrahedron, &mut inside));
    inside
}

/// Key of the cut point between an inside and an outside vertex.
fn cut_key(cut: &CutLattice, u: u32, v: u32) -> Key {
    // Every edge between signs +1 and -1 has one: only warping removes cut points, and it makes one end 0.
    cut.cut_index(u, v).map_or(u, |index| cut.lattice.vertex_count() + index)
}

fn clip_one(cut: &CutLattice, tetrahedron: [u32; 4], inside: &mut Vec<[Key; 4]>) {
    let sign = |v: u32| cut.signs[v as usize];
    let plus = tetrahedron.iter().filter(|&&v| sign(v) > 0).count();
    let minus = tetrahedron.iter().filter(|&&v| sign(v) < 0).count();
    let key = |u, v| cut_key(cut, u, v);
    match (plus, minus) {
        (0, _) => {}
        (_, 0) => inside.push(tetrahedron),
        (1, _) => {
            let [a] = ordered(tetrahedron, |v| sign(v) < 1)[..1] else { return };
            inside.push(tetrahedron.map(|v| if sign(v) < 0 { key(a, v) } else { v }));
        }
        (2, 1) => {
            // A quadrilateral (a, b, bm, am) under the surface vertex z.
            let [a, b, z, m] = ordered_even(tetrahedron, |v| 1 - sign(v));
            let (am, bm) = (key(a, m), key(b, m));
            if joins_first(cut, a, b, m) {
                inside.extend([[a, b, z, bm], [a, bm, z, am]]);
            } else {
                inside.extend([[a, b, z, am], [b, bm, z, am]]);
            }
        }
        (2, _) => {
            // A wedge with the end faces (a, am, ak) and (b, bm, bk). The diagonals of its two lattice faces differ,
            // because m and k differ in one coordinate only (or each has its own long edge); the third must join
            // their ends on the surface, or no tetrahedra fit.
            let [a, b, m, k] = ordered_even(tetrahedron, |v| 1 - sign(v));
            let (am, bm, ak, bk) = (key(a, m), key(b, m), key(a, k), key(b, k));
            if joins_first(cut, a, b, m) {
                inside.extend([[a, b, bm, ak], [a, bm, am, ak], [b, bm, ak, bk]]);
            } else {
                inside.extend([[a, b, am, bk], [b, bm, am, bk], [a, bk, am, ak]]);
            }
        }
        _ => {
            // A tetrahedron without its tip m; a is m's partner over a long edge, where both diagonals end.
            let [a, b, c, m] = ordered_even(tetrahedron, |v| match sign(v) {
                s if s < 0 => 3,
                _ if is_partner(cut, v, tetrahedron, sign) => 0,
                _ => 1,
            });
            let (am, bm, cm) = (key(a, m), key(b, m), key(c, m));
            inside.push([a, b, c, am]);
            if joins_first(cut, b, c, m) {
                inside.extend([[am, b, c, cm], [am, b, cm, bm]]);
            } else {
                inside.extend([[am, b, c, bm], [am, c, cm, bm]]);
            }
        }
    }
}

/// Whether `v` and the outside vertex of the tetrahedron are ends of a long edge.
fn is_partner(cut: &CutLattice, v: u32, tetrahedron: [u32; 4], sign: impl Fn(u32) -> i8) -> bool {
    tetrahedron.iter().any(|&m| m != v && sign(m) < 0 && cut.lattice.is_long(v, m))
}

/// Vertices in ascending order of a rank; equal ranks keep their order.
fn ordered<R: Ord>(tetrahedron: [u32; 4], rank: impl Fn(u32) -> R) -> [u32; 4] {
    let mut order = tetrahedron;
    order.sort_by_key(|&v| rank(v));
    order
}

/// The same as an even permutation, which keeps the orientation: the first two of equal rank change places if needed.
fn ordered_even<R: Ord>(tetrahedron: [u32; 4], rank: impl Fn(u32) -> R) -> [u32; 4] {
    let mut order = ordered(tetrahedron, &rank);
    let place = |v: u32| tetrahedron.iter().position(|&w| w == v);
    let mut odd = false;
    for i in 0..4 {
        for j in i + 1..4 {
            odd ^= place(order[i]) > place(order[j]);
        }
    }
    if odd && let Some(i) = (0..3).find(|&i| rank(order[i]) == rank(order[i + 1])) {
        order.swap(i, i + 1);
    }
    order
}

/// The diagonal of the quadrilateral (a, b, cut of b–m, cut of a–m): whether it starts at a.
fn joins_first(cut: &CutLattice, a: u32, b: u32, m: u32) -> bool {
    let lattice = &cut.lattice;
    if lattice.is_long(b, m) {
        return true;
    }
    if lattice.is_long(a, m) {
        return false;
    }
    let [pa, pb, pm] = [a, b, m].map(|v| lattice.coordinates(v));
    // The cut point lies within b–m, and b–m and a differ by at least half an edge in every coordinate.
    let greater = (0..3).filter(|&i| 2 * pa[i] > pb[i] + pm[i]).count();
    let centres = pa[0] & 1 == 1;
    (greater % 2 == 1) != centres
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nalgebra::Vector3;

    use super::*;
    use crate::stuffing::StuffingQuality;
    use crate::stuffing::cut::{ALPHA_LONG, ALPHA_SHORT};
    use crate::stuffing::lattice::{Lattice, NEIGHBOURS};

    /// Where a vertex of sign 0 may lie: at home, or at the far end of what warping allows along any of its edges,
    /// but not towards another vertex of sign 0 of the same tetrahedron (the order of warping sees to that).
    fn warps(lattice: &Lattice, vertex: u32, zeros: &[u32]) -> Vec<Vector3<f64>> {
        let home = lattice.position(vertex);
        let c = lattice.coordinates(vertex);
        let mut places = vec![home];
        for (n, step) in NEIGHBOURS.iter().enumerate() {
            let other = lattice.vertex_at([c[0] + step[0], c[1] + step[1], c[2] + step[2]]).unwrap();
            if !zeros.contains(&other) {
                let alpha = if n < 6 { ALPHA_LONG } else { ALPHA_SHORT };
                places.push(home + (lattice.position(other) - home) * alpha);
            }
        }
        places
    }

    /// All ways to take one of each list.
    fn combinations(sizes: &[usize]) -> Vec<Vec<usize>> {
        sizes.iter().fold(vec![Vec::new()], |all, &size| {
            all.iter().flat_map(|head| (0..size).map(move |i| [head.as_slice(), &[i]].concat())).collect()
        })
    }

    /// Smallest and largest dihedral angle (°) and volume over everything that warping can leave of a tetrahedron.
    fn extremes(lattice: &Lattice, tetrahedron: [u32; 4], signs: [i8; 4], range: &mut (f64, f64, f64)) {
        let with = |s: i8| (0..4).filter(move |&i| signs[i] == s).map(|i| tetrahedron[i]).collect::<Vec<_>>();
        let (plus, zeros, minus) = (with(1), with(0), with(-1));
        let places: Vec<_> = zeros.iter().map(|&z| warps(lattice, z, &zeros)).collect();
        let edges: Vec<_> = plus.iter().flat_map(|&p| minus.iter().map(move |&m| (p, m))).collect();
        let cuts: Vec<_> = edges
            .iter()
            .map(|&(p, m)| {
                let alpha = if lattice.is_long(p, m) { ALPHA_LONG } else { ALPHA_SHORT };
                [alpha, 0.5, 1.0 - alpha]
            })
            .collect();
        let mut all_signs = vec![-1; lattice.vertex_count() as usize];
        (0..4).for_each(|i| all_signs[tetrahedron[i] as usize] = signs[i]);
        let sizes: Vec<usize> = places.iter().map(Vec::len).chain(cuts.iter().map(|c| c.len())).collect();
        for pick in combinations(&sizes) {
            let warped = (0..zeros.len()).map(|i| (zeros[i], places[i][pick[i]])).collect();
            let cut: Vec<_> = (0..edges.len()).map(|i| (edges[i], cuts[i][pick[zeros.len() + i]])).collect();
            let cut = CutLattice::assembled(lattice.clone(), all_signs.clone(), warped, &cut);
            let mut inside = Vec::new();
            clip_one(&cut, tetrahedron, &mut inside);
            let count = lattice.vertex_count();
            let nodes: Vec<_> = inside
                .iter()
                .flatten()
                .map(|&k| if k < count { cut.vertex_position(k) } else { cut.cut_position(k - count) })
                .collect();
            let tetrahedra: Vec<_> = (0..inside.len() as u32).map(|t| [0, 1, 2, 3].map(|i| 4 * t + i)).collect();
            let quality = StuffingQuality::of(&nodes, &tetrahedra);
            range.0 = range.0.min(quality.smallest_dihedral.to_degrees());
            range.1 = range.1.max(quality.largest_dihedral.to_degrees());
            range.2 = range.2.min(quality.smallest_volume);
        }
    }

    #[test]
    fn dihedral_angles_lie_between_10_7_and_164_8_degrees_over_all_warps_and_cuts() {
        let lattice = Lattice::around([Vector3::zeros(), Vector3::repeat(1.0)], 1.0);
        // One tetrahedron around each axis, both chiralities of the parity rule among them.
        let middle = lattice.vertex_at([3, 3, 3]).unwrap();
        let mut tetrahedra = Vec::new();
        lattice.for_each_tetrahedron(|t| {
            if t[0] == middle {
                tetrahedra.push(t);
            }
        });
        assert_eq!(tetrahedra.len(), 12);
        let mut range = (180.0, 0.0, f64::INFINITY);
        for &tetrahedron in [0, 1, 4, 9].map(|i| &tetrahedra[i]) {
            for signs in combinations(&[3, 3, 3, 3]) {
                let signs = [0, 1, 2, 3].map(|i| signs[i] as i8 - 1);
                if signs.contains(&1) {
                    extremes(&lattice, tetrahedron, signs, &mut range);
                }
            }
        }
        // 10.780° and 164.702°; the least volume is a thirtieth of a lattice tetrahedron.
        assert!(range.0 > 10.7 && range.1 < 164.8 && range.2 > 2.69e-3, "{range:?}");
    }

    #[test]
    fn the_stencils_of_a_tetrahedron_fill_its_inside() {
        // All cuts in the middle of their edges: the clipped-off parts have known volumes.
        let lattice = Lattice::around([Vector3::zeros(), Vector3::repeat(1.0)], 1.0);
        let middle = lattice.vertex_at([3, 3, 3]).unwrap();
        lattice.for_each_tetrahedron(|t| {
            if t[0] != middle {
                return;
            }
            for signs in combinations(&[2, 2, 2, 2]) {
                let signs = [0, 1, 2, 3].map(|i| 2 * signs[i] as i8 - 1);
                let plus = signs.iter().filter(|&&s| s > 0).count();
                let mut all_signs = vec![-1; lattice.vertex_count() as usize];
                (0..4).for_each(|i| all_signs[t[i] as usize] = signs[i]);
                let edges = combinations(&[4, 4]).into_iter().filter(|e| signs[e[0]] > 0 && signs[e[1]] < 0);
                let cuts: Vec<_> = edges.map(|e| ((t[e[0]], t[e[1]]), 0.5)).collect();
                let cut = CutLattice::assembled(lattice.clone(), all_signs, Vec::new(), &cuts);
                let mut inside = Vec::new();
                clip_one(&cut, t, &mut inside);
                let count = lattice.vertex_count();
                let volume: f64 = inside
                    .iter()
                    .map(|t| {
                        let at = |k: u32| if k < count { cut.vertex_position(k) } else { cut.cut_position(k - count) };
                        let [p, q, r, s] = t.map(at);
                        (q - p).cross(&(r - p)).dot(&(s - p)) / 6.0
                    })
                    .sum();
                let expected = [0.0, 0.125, 0.5, 0.875, 1.0][plus] / 12.0;
                assert!((volume - expected).abs() < 1e-14, "{signs:?}: {volume} for {expected}");
            }
        });
    }

    #[test]
    fn both_sides_of_a_face_choose_the_same_diagonal() {
        // The rule looks at the face only; a and b may come in either order.
        let lattice = Lattice::around([Vector3::zeros(), Vector3::repeat(1.0)], 1.0);
        let cut = CutLattice::assembled(lattice.clone(), vec![1; lattice.vertex_count() as usize], Vec::new(), &[]);
        let mut parity: BTreeMap<bool, usize> = BTreeMap::new();
        lattice.for_each_tetrahedron(|t| {
            for [a, b, m] in [[0, 1, 2], [0, 1, 3], [2, 3, 0], [2, 3, 1], [0, 2, 1], [0, 2, 3]].map(|f| f.map(|i| t[i]))
            {
                assert_ne!(joins_first(&cut, a, b, m), joins_first(&cut, b, a, m));
                if lattice.is_long(a, b) {
                    *parity.entry(joins_first(&cut, a, b, m)).or_default() += 1;
                }
            }
        });
        assert_eq!(parity.len(), 2, "the parity rule must take both values");
    }
}
