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
