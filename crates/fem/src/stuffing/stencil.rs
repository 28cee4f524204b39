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
    match std::env::var("PAR").as_deref() { Ok("1") => (greater % 2 == 1) == centres, Ok("2") => greater % 2 == 1, Ok("3") => greater % 2 == 0, _ => (greater % 2 == 1) != centres }
}
#[cfg(test)]
mod dbg {
    use super::*;
    use nalgebra::Vector3;
    struct S(Vector3<f64>, f64);
    impl crate::stuffing::LevelSet for S {
        fn value(&self, p: &Vector3<f64>) -> f64 { self.1 - (p - self.0).norm() }
        fn bounds(&self) -> [Vector3<f64>; 2] { [self.0.add_scalar(-self.1-0.3), self.0.add_scalar(self.1+0.3)] }
    }
    struct N(f64);
    impl crate::stuffing::LevelSet for N {
        fn value(&self, p: &Vector3<f64>) -> f64 { let p = p * 2.9; (p.x * 1.3 + self.0).sin() + (p.y * 1.7 - p.z * 0.9 + 2.0 * self.0).sin() + (p.z * 2.1 + p.x * 0.7 + 3.0 * self.0).sin() + ((p.x + p.y + p.z) * 2.7).sin() }
        fn bounds(&self) -> [Vector3<f64>; 2] { [Vector3::repeat(-6.0), Vector3::repeat(6.0)] }
    }
    fn run(name: &str, s: &dyn crate::stuffing::LevelSet, worst: &mut (f64, f64, String)) {
            let lattice = crate::stuffing::lattice::Lattice::around(s.bounds(), 1.0);
            let cut = CutLattice::new(lattice, s);
            let pos = |k: u32| if k >= cut.lattice.vertex_count() { cut.cut_position(k - cut.lattice.vertex_count()) } else { cut.vertex_position(k) };
            cut.lattice.for_each_tetrahedron(|t| {
                let mut v = vec![];
                clip_one(&cut, t, &mut v);
                for q in &v {
                    let p = q.map(pos);
                    let m = crate::stuffing::MeshQuality::of(&p, &[[0, 1, 2, 3]]);
                    worst.1 = worst.1.max(m.largest_dihedral.to_degrees());
                    if m.smallest_dihedral.to_degrees() < worst.0 { worst.0 = m.smallest_dihedral.to_degrees();
                        worst.2 = format!("{name} {:?} {:?} {:.2} {:.2} moved {:?}", t.map(|v| cut.signs[v as usize]), q.map(|k| if k >= cut.lattice.vertex_count() { 'c' } else { 'v' }), m.smallest_dihedral.to_degrees(), m.largest_dihedral.to_degrees(), t.map(|v| (cut.lattice.coordinates(v), ((cut.vertex_position(v) - cut.lattice.position(v))*2e2).map(|x| x.round()/1e2).as_slice().to_vec(), s.value(&cut.lattice.position(v)))));
                    }
                }
            });
    }
    #[test]
    fn dbg() {
        let mut w = (180.0, 0.0, String::new());
        for n in 0..400 {
            let x = n as f64;
            let centre = Vector3::new((x * 0.731).fract(), (x * 0.417).fract(), (x * 0.593).fract());
            run("sphere", &S(centre, 1.3 + 2.0 * (x * 0.177).fract()), &mut w);
        }
        println!("lat {w:?}");
        let mut w = (180.0, 0.0, String::new());
        for n in 0..60 {
            let x = n as f64;
            let centre = Vector3::new((x * 0.731).fract(), (x * 0.417).fract(), (x * 0.593).fract());
            run("big sphere", &S(centre, 8.3 + 2.0 * (x * 0.177).fract()), &mut w);
        }
        println!("lat {w:?}");
        let mut w = (180.0, 0.0, String::new());
        for n in 0..30 { run("noise", &N(n as f64), &mut w); }
        println!("lat {w:?}");
    }
}
