//! Quadratic elements in packs, straight and curved, answer what one element at a time answers.
#![allow(non_snake_case)]

use crate::tissue_setup::{Random, all_materials};
use nalgebra::{Matrix3, Rotation3, Vector3};
use palpate_fem::{
    element::{
        QuadraticTetrahedron, Tetrahedron,
        quadratic::{EDGES, POINTS, QuadraticMatrices},
    },
    material::{Law, Material},
    pack::{PACK, PackMatrices, QuadraticPack, QuadraticPackMatrices},
};

/// Edge of an element (m).
const SIZE: f64 = 0.02;

/// Elements with nodes of their own in all orders of corners, and where a map takes those.
struct Body {
    elements: Vec<QuadraticTetrahedron>,
    corners: Vec<Tetrahedron>,
    q: Vec<Vector3<f64>>,
}

fn body(count: usize, curvature: f64, map: impl Fn(usize, &Vector3<f64>) -> Vector3<f64>) -> Body {
    let mut random = Random(17);
    let unit = [[0.0; 3], [SIZE, 0.0, 0.0], [0.0, SIZE, 0.0], [0.0, 0.0, SIZE]].map(Vector3::from);
    let (mut elements, mut corners, mut rest) = (Vec::new(), Vec::new(), Vec::new());
    for e in 0..count {
        let first = 10 * e as u32;
        let x = unit.map(|x| x + random.vector() * (0.2 * SIZE) + Vector3::new(0.3, -0.2, 0.1));
        rest.extend(x);
        rest.extend(EDGES.map(|(a, b)| (x[a] + x[b]) * 0.5 + random.vector() * (curvature * SIZE)));
        let mut order = [0, 1, 2, 3];
        order.rotate_left(e % 4);
        order[1..].rotate_left(e / 4 % 3);
        let of = |order: [usize; 4]| order.map(|a| first + a as u32);
        if Tetrahedron::new(of(order), &rest).is_none() {
            order.swap(2, 3);
        }
        let mids = EDGES.map(|(a, b)| {
            let (a, b) = (order[a].min(order[b]), order[a].max(order[b]));
            first + 4 + EDGES.iter().position(|&edge| edge == (a, b)).expect("an edge") as u32
        });
        let nodes: Vec<u32> = of(order).into_iter().chain(mids).collect();
        elements.push(QuadraticTetrahedron::new(nodes.try_into().expect("ten"), &rest).expect("a sound element"));
        corners.push(Tetrahedron::new(of(order), &rest).expect("one of two orders has positive volume"));
    }
    let q = rest.iter().enumerate().map(|(i, x)| map(i / 10, x)).collect();
    Body { elements, corners, q }
}

/// What packs answer to an element: forces, all blocks of its own nodes, volume ratio, whether filtered, checksum.
#[derive(Clone, Debug, PartialEq)]
struct Answer {
    forces: [Vector3<f64>; 10],
    blocks: Vec<Matrix3<f64>>,
    jacobian: f64,
    filtered: bool,
    checksum: f64,
}

fn packed(law: &Material, body: &Body, from: usize, to: usize, filter: bool) -> Vec<Answer> {
    let mut answers = Vec::new();
    let mut out = Box::new(QuadraticPackMatrices::ZERO);
    for (elements, corners) in body.elements[from..to].chunks(PACK).zip(body.corners[from..to].chunks(PACK)) {
        let pack = QuadraticPack::new(elements, corners).expect("one to eight elements");
        let mut points = [PackMatrices::ZERO; POINTS];
        for (at, point) in pack.at_points(&body.q).iter().zip(&mut points) {
            law.pack(at, filter, point);
        }
        pack.sum_points(&points, &mut out);
        for (lane, element) in elements.iter().enumerate() {
            let place = |i: usize| pack.nodes[lane].iter().position(|&n| n == element.nodes[i]).expect("its node");
            let block = |i: usize, j: usize| {
                let (a, b) = (place(i).min(place(j)), place(i).max(place(j)));
                if a == b {
                    let [x, xy, xz, y, yz, z] = out.diagonal[a].map(|row| row[lane]);
                    return Matrix3::new(x, xy, xz, xy, y, yz, xz, yz, z);
                }
                let number = a * (19 - a) / 2 + b - a - 1;
                let block = Matrix3::from_fn(|r, c| out.off_diagonal[number][3 * c + r][lane]);
                if a == place(i) { block } else { block.transpose() }
            };
            answers.push(Answer {
                forces: std::array::from_fn(|i| Vector3::from(out.forces[place(i)].map(|row| row[lane]))),
                blocks: (0..10).flat_map(|i| (i..10).map(move |j| (i, j))).map(|(i, j)| block(i, j)).collect(),
                jacobian: out.jacobian[lane],
                filtered: out.filtered[lane] > 0.0,
                checksum: out.checksum[lane],
            });
        }
    }
    answers
}

/// Asserts that packs and single elements agree; returns how many elements the filter acted on.
fn agree(what: &str, law: &Material, body: &Body, filter: bool) -> usize {
    let answers = packed(law, body, 0, body.elements.len(), filter);
    let mut expected = QuadraticMatrices::ZERO;
    for (e, (element, ours)) in body.elements.iter().zip(&answers).enumerate() {
        let filtered = element.answer(law, &body.q, filter, &mut expected);
        let size = expected.blocks.iter().map(Matrix3::amax).fold(0.0, f64::max);
        let off = ours.blocks.iter().zip(&expected.blocks).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        let forces = ours.forces.iter().zip(&expected.forces).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        // Sums of the same terms in another order. Forces against the size of K q: stresses cancel near rest.
        assert!(
            off < 1e-12 * size && forces < 1e-12 * size * SIZE,
            "{} {what}, filter {filter}, element {e}: {:e} in K, {:e} in forces",
            law.name(),
            off / size,
            forces / (size * SIZE)
        );
        let J = element.deformation_gradients(&body.q).iter().map(Matrix3::determinant).fold(f64::INFINITY, f64::min);
        assert!((ours.jacobian - J).abs() <= 1e-13 * (1.0 + J.abs()), "{} instead of {J}", ours.jacobian);
        assert_eq!(ours.filtered, filtered, "{} {what}, element {e}", law.name());
        assert!(ours.checksum.is_finite());
    }
    answers.iter().filter(|answer| answer.filtered).count()
}

/// Maps that strain every point of an element differently, and their names.
fn maps() -> Vec<(&'static str, Matrix3<f64>, f64)> {
    let turn = Rotation3::new(Vector3::new(2.1, -0.4, 1.3)).into_inner();
    let lean = Matrix3::new(1.0, 0.4, -0.2, 0.0, 1.0, 0.3, 0.0, 0.0, 1.0);
    let diagonal = |x, y, z| Matrix3::from_diagonal(&Vector3::new(x, y, z));
    vec![
        ("rest", Matrix3::identity(), 0.0),
        ("bent", turn, 0.1),
        ("stretched", turn * diagonal(1.7, 0.8, 0.9), 0.1),
        ("pressed to J = 0.3", turn * diagonal(1.1, 0.9, 0.3) * lean, 0.02),
        ("flat", turn * diagonal(1.2, 0.9, 0.0), 0.0),
        ("almost flat", turn * diagonal(1.2, 0.9, 1e-9) * lean, 0.0),
        ("partly inverted", turn * diagonal(1.2, 0.9, 0.05) * lean, 0.1),
        ("inverted", turn * diagonal(1.1, 0.9, -0.5) * lean, 0.02),
        ("swollen", turn * diagonal(3.0, 2.5, 2.8) * lean, 0.1),
    ]
}

/// The map `x -> F (x + warp x²)`, in units of an element.
fn warped(F: &Matrix3<f64>, warp: f64) -> impl Fn(usize, &Vector3<f64>) -> Vector3<f64> {
    move |_, x| {
        let y = (x - Vector3::new(0.3, -0.2, 0.1)) / SIZE;
        F * (x + Vector3::new(y.y * y.z, 0.5 * y.z * y.z, -y.x * y.y) * (warp * SIZE))
    }
}

#[test]
fn packs_answer_as_one_element_at_a_time_at_every_deformation() {
    for curvature in [0.0, 0.03] {
        for law in all_materials(5e3, 0.45) {
            let mut acted = 0;
            for (name, F, warp) in maps() {
                let body = body(13, curvature, warped(&F, warp));
                assert!(body.elements.iter().all(|e| e.is_straight() == (curvature == 0.0)));
                agree(name, &law, &body, false);
                let filtered = agree(name, &law, &body, true);
                assert!(name != "rest" || filtered == 0, "{}: nothing to filter at rest", law.name());
                acted += filtered;
            }
            assert!(acted > 0 || law.name() == "linear", "{}: nothing filtered", law.name());
        }
    }
}

#[test]
fn every_length_of_pack_and_every_neighbour_give_the_same_bits() {
    for curvature in [0.0, 0.03] {
        let maps = maps();
        let body = body(17, curvature, |e, x| {
            let (_, F, warp) = maps[e % maps.len()];
            warped(&F, warp)(e, x)
        });
        for law in all_materials(5e3, 0.4) {
            let whole = packed(&law, &body, 0, 17, true);
            for length in 1..=17 {
                assert_eq!(packed(&law, &body, 0, length, true), whole[..length], "{}, {length}", law.name());
                assert_eq!(packed(&law, &body, length - 1, 17, true), whole[length - 1..], "{}", law.name());
            }
        }
    }
}

#[test]
fn an_element_that_is_not_a_number_leaves_its_neighbours_alone() {
    for curvature in [0.0, 0.03] {
        let mut body = body(8, curvature, |_, x| x * 1.1);
        for law in all_materials(5e3, 0.45) {
            let before = packed(&law, &body, 0, 8, true);
            let node = body.elements[5].nodes[7] as usize;
            for bad in [f64::NAN, f64::INFINITY] {
                let kept = std::mem::replace(&mut body.q[node].y, bad);
                let after = packed(&law, &body, 0, 8, true);
                assert!(!after[5].checksum.is_finite(), "{}", law.name());
                for e in (0..8).filter(|&e| e != 5) {
                    assert_eq!(before[e], after[e]);
                }
                body.q[node].y = kept;
            }
        }
    }
}

#[test]
fn forces_alone_are_those_with_the_tangent() {
    for curvature in [0.0, 0.03] {
        let turn = Rotation3::new(Vector3::new(0.3, -0.4, 0.2)).into_inner();
        let body = body(8, curvature, warped(&(turn * 1.1), 0.1));
        let pack = QuadraticPack::new(&body.elements, &body.corners).expect("eight");
        for law in all_materials(5e3, 0.45) {
            let mut out = [QuadraticPackMatrices::ZERO, QuadraticPackMatrices::ZERO];
            let mut points = [PackMatrices::ZERO; POINTS];
            for (at, point) in pack.at_points(&body.q).iter().zip(&mut points) {
                law.pack(at, false, point);
            }
            pack.sum_points(&points, &mut out[0]);
            for (at, point) in pack.at_points(&body.q).iter().zip(&mut points) {
                law.pack_forces(at, point);
            }
            pack.sum_forces(&points, &mut out[1]);
            let [with, alone] = &out;
            for (with, alone) in with.forces.as_flattened().iter().zip(alone.forces.as_flattened()) {
                for (a, b) in with.iter().zip(alone) {
                    // A kilopascal on the face of an element is 0.4 N.
                    assert!((a - b).abs() < 1e-13, "{}: {a} {b}", law.name());
                }
            }
        }
    }
}
