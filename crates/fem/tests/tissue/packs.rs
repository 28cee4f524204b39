//! Elements in packs, several at once, answer what one element at a time answers.
#![allow(non_snake_case)]

use crate::tissue_setup::{Random, all_materials};
use nalgebra::{Matrix3, Rotation3, SMatrix, Vector3};
use palpate_fem::{
    element::{ElementMatrices, Tetrahedron, UPPER},
    material::{BatchReport, Law, Material},
    pack::{DeformedPack, PACK, Pack, PackMatrices},
};

/// Forces of four nodes in the first column, the stiffness in the others, by ascending mesh node.
type Matrix12x13 = SMatrix<f64, 12, 13>;

/// Deformations at which every law has a derivative, and their names.
fn deformations() -> Vec<(&'static str, Matrix3<f64>)> {
    let turn = Rotation3::new(Vector3::new(2.1, -0.4, 1.3)).into_inner();
    let lean = Matrix3::new(1.0, 0.4, -0.2, 0.0, 1.0, 0.3, 0.0, 0.0, 1.0);
    let diagonal = |x, y, z| Matrix3::from_diagonal(&Vector3::new(x, y, z));
    vec![
        ("rest", Matrix3::identity()),
        ("turned", turn),
        ("stretched", turn * diagonal(1.7, 0.8, 0.9)),
        ("equal stretches", turn * diagonal(0.8, 0.8, 0.8)),
        ("sheared", lean),
        ("pressed to J = 0.3", turn * diagonal(1.1, 0.9, 0.3) * lean),
        ("flat", turn * diagonal(1.2, 0.9, 0.0)),
        ("flat in its plane", diagonal(1.2, 0.9, 0.0)),
        ("almost flat", turn * diagonal(1.2, 0.9, 1e-9) * lean),
        ("inverted", turn * diagonal(1.1, 0.9, -0.5) * lean),
        ("far inverted", turn * diagonal(1.6, 1.3, -1.0) * lean),
        ("swollen", turn * diagonal(3.0, 2.5, 2.8) * lean),
    ]
}

/// Elements of all shapes and orders of nodes, each with nodes of its own, and where a deformation takes those.
fn elements(count: usize, F: impl Fn(usize) -> Matrix3<f64>) -> (Vec<Tetrahedron>, Vec<Vector3<f64>>) {
    let mut random = Random(11);
    let corners = [[0.0; 3], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]].map(Vector3::from);
    let (mut elements, mut rest, mut q) = (Vec::new(), Vec::new(), Vec::new());
    for e in 0..count {
        let first = 4 * e as u32;
        rest.extend(corners.map(|x| x + random.vector() * 0.004));
        // All orders of the nodes in turn; of an odd one two nodes change places, so that the volume is positive.
        let mut nodes = [0, 1, 2, 3].map(|a| first + a);
        nodes.rotate_left(e % 4);
        nodes[1..].rotate_left(e / 4 % 3);
        let element = Tetrahedron::new(nodes, &rest).or_else(|| {
            nodes.swap(2, 3);
            Tetrahedron::new(nodes, &rest)
        });
        elements.push(element.expect("one of two orders has positive volume"));
        q.extend(rest[4 * e..].iter().map(|x| F(e) * x + Vector3::new(0.1, -0.2, 0.3)));
    }
    (elements, q)
}

/// Entries over the element's nodes in ascending order.
fn sorted(nodes: &[u32; 4], out: &ElementMatrices) -> Matrix12x13 {
    let place = |a: usize| 3 * nodes.iter().filter(|&&n| n < nodes[a]).count();
    let mut all = Matrix12x13::zeros();
    for a in 0..4 {
        all.fixed_view_mut::<3, 1>(place(a), 0).copy_from(&out.force(a));
    }
    for (k, (a, b)) in UPPER.into_iter().enumerate() {
        let block = out.upper(k);
        all.fixed_view_mut::<3, 3>(place(b), 1 + place(a)).copy_from(&block.transpose());
        all.fixed_view_mut::<3, 3>(place(a), 1 + place(b)).copy_from(&block);
    }
    all
}

/// What packs answer for each element, over its nodes in ascending order, node 0 as it is stored.
fn packed(
    law: &Material,
    elements: &[Tetrahedron],
    q: &[Vector3<f64>],
    filter: bool,
) -> (Vec<Matrix12x13>, BatchReport) {
    let packs: Vec<Pack> = elements.chunks(PACK).map(|e| Pack::new(e).expect("one to eight elements")).collect();
    let mut out = vec![PackMatrices::ZERO; packs.len()];
    let report = law.packed(&packs, q, filter, &mut out);
    let mut all = Vec::new();
    for (pack, out) in packs.iter().zip(&out) {
        for lane in 0..pack.len {
            let mut entries = sorted(&[0, 1, 2, 3], &out.element(lane));
            for c in 0..3 {
                entries[(c, 0)] = out.forces[0][c][lane];
                for (b, block) in out.off_diagonal[..3].iter().enumerate() {
                    for r in 0..3 {
                        entries[(r, 4 + 3 * b + c)] = block[3 * c + r][lane];
                        entries[(3 + 3 * b + c, 1 + r)] = block[3 * c + r][lane];
                    }
                }
            }
            for (row, (r, c)) in out.diagonal[0].iter().zip([(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)]) {
                entries[(r, 1 + c)] = row[lane];
                entries[(c, 1 + r)] = row[lane];
            }
            all.push(entries);
        }
    }
    (all, report)
}

/// What one element at a time answers.
fn plain(
    law: &Material,
    elements: &[Tetrahedron],
    q: &[Vector3<f64>],
    filter: bool,
) -> (Vec<Matrix12x13>, BatchReport) {
    let mut report = BatchReport::default();
    let one = |(k, element): (usize, &Tetrahedron)| {
        let mut out = ElementMatrices::ZERO;
        let edges = element.edges(q);
        let filtered = law.element(element, &edges, filter, &mut out);
        let entries = sorted(&element.nodes, &out);
        let finite = entries.iter().all(|x| x.is_finite());
        report.note(k as u32, edges.determinant() / (6.0 * element.volume), filtered, finite);
        entries
    };
    (elements.iter().enumerate().map(one).collect(), report)
}

/// Asserts that both agree; forces against the size of `K q`, since stresses cancel near rest.
fn agree(what: &str, law: &Material, elements: &[Tetrahedron], q: &[Vector3<f64>], filter: bool) -> BatchReport {
    let ((ours, report), (expected, plain_report)) =
        (packed(law, elements, q, filter), plain(law, elements, q, filter));
    assert_eq!(ours.len(), expected.len());
    for (e, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
        let (K, difference) = (expected.columns(1, 12), ours - expected);
        // The same formulas in another order; 0.02 m is the size of an element.
        let error = difference.columns(1, 12).amax() / K.amax();
        let force_error = difference.column(0).amax() / (K.amax() * 0.02);
        assert!(
            error < 1e-12 && force_error < 1e-12,
            "{} {what}, filter {filter}, element {e}: {error:e} in K, {force_error:e} in forces",
            law.name()
        );
    }
    // The sign of a J that is nothing but rounding is no one's.
    let flat = plain_report.min_jacobian.abs() < 1e-14;
    let counts = |r: &BatchReport| (r.filtered, if flat { 0 } else { r.inverted }, r.non_finite);
    assert_eq!(counts(&report), counts(&plain_report), "{} {what}, filter {filter}", law.name());
    assert!((report.min_jacobian - plain_report.min_jacobian).abs() <= 1e-14 * (1.0 + report.min_jacobian.abs()));
    report
}

#[test]
fn packs_answer_as_one_element_at_a_time_at_every_deformation() {
    for (name, F) in deformations() {
        let (elements, q) = elements(24, |_| F);
        for law in all_materials(5e3, 0.45) {
            for filter in [false, true] {
                let report = agree(name, &law, &elements, &q, filter);
                if name == "rest" {
                    assert_eq!(report.filtered, 0, "{}: nothing to filter at rest", law.name());
                }
            }
        }
    }
}

#[test]
fn every_length_of_batch_and_every_neighbour_give_the_same_bits() {
    let all = deformations();
    let (elements, q) = elements(33, |e| all[e % all.len()].1);
    for law in all_materials(5e3, 0.4) {
        for filter in [false, true] {
            let (whole, report) = packed(&law, &elements, &q, filter);
            assert_eq!(report.inverted, plain(&law, &elements, &q, filter).1.inverted);
            for length in 1..=elements.len() {
                let (part, report) = packed(&law, &elements[..length], &q, filter);
                assert_eq!(part, whole[..length], "{}, {length} elements", law.name());
                assert!(report.min_jacobian_element < length as u32);
                // Moved along by one, every element has other neighbours and another lane.
                let (moved, _) = packed(&law, &elements[length - 1..], &q, filter);
                assert_eq!(moved, whole[length - 1..], "{}, from element {length} on", law.name());
            }
        }
    }
}

#[test]
fn random_deformations_agree_and_the_filter_acts_on_the_same_elements() {
    let mut random = Random(5);
    let some: Vec<Matrix3<f64>> =
        (0..400).map(|_| Matrix3::identity() + Matrix3::from_fn(|_, _| 0.3 * random.symmetric())).collect();
    let (elements, q) = elements(some.len(), |e| some[e]);
    for law in all_materials(5e3, 0.45) {
        agree("random", &law, &elements, &q, false);
        let report = agree("random", &law, &elements, &q, true);
        assert!(law.name() == "linear" || report.filtered > 100, "{}: {} filtered", law.name(), report.filtered);
    }
}

#[test]
fn an_element_that_is_not_a_number_is_named_and_leaves_its_neighbours_alone() {
    let (elements, mut q) = elements(13, |_| Matrix3::new(1.1, 0.1, 0.0, 0.0, 0.8, 0.2, 0.0, 0.0, 1.2));
    for law in all_materials(5e3, 0.45) {
        for filter in [false, true] {
            let (before, report) = packed(&law, &elements, &q, filter);
            assert_eq!(report.non_finite, None);
            let kept = std::mem::replace(&mut q[4 * 5 + 2].y, f64::NAN);
            let (after, report) = packed(&law, &elements, &q, filter);
            assert_eq!(report.non_finite, Some(5), "{} filter {filter}", law.name());
            for e in (0..13).filter(|&e| e != 5) {
                assert_eq!(before[e], after[e]);
            }
            q[4 * 5 + 2].y = f64::INFINITY;
            assert_eq!(packed(&law, &elements, &q, filter).1.non_finite, Some(5), "{} filter {filter}", law.name());
            q[4 * 5 + 2].y = kept;
        }
    }
}

#[test]
fn packs_under_pressure_answer_as_one_element_at_a_time() {
    let pressures = [0.0, 1e3, -1e3, 5e4, -5e4, 10.0, -3e3, 2e4];
    for (name, F) in deformations() {
        let (elements, q) = elements(PACK, |_| F);
        let pack = Pack::new(&elements).expect("eight elements");
        let at = DeformedPack { pressure: Some(&pressures), ..pack.at(&q) };
        for law in all_materials(5e3, 0.45).iter().filter_map(|law| Some(law.without_bulk()?.0)) {
            for filter in [false, true] {
                let mut out = PackMatrices::ZERO;
                law.pack(&at, filter, &mut out);
                let mut forces = PackMatrices::ZERO;
                law.pack_forces(&at, &mut forces);
                let energies = law.pack_energies(&at);
                for (lane, element) in elements.iter().enumerate() {
                    let mut expected = ElementMatrices::ZERO;
                    let edges = element.edges(&q);
                    let filtered = law.element_under_pressure(element, &edges, pressures[lane], filter, &mut expected);
                    assert_eq!(filtered, Some(out.filtered[lane] > 0.0), "{} {name}, lane {lane}", law.name());
                    let expected = sorted(&element.nodes, &expected);
                    let difference = sorted(&[0, 1, 2, 3], &out.element(lane)) - expected;
                    let size = expected.columns(1, 12).amax();
                    // As without pressure.
                    assert!(
                        difference.columns(1, 12).amax() < 1e-12 * size
                            && difference.column(0).amax() < 1e-12 * size * 0.02,
                        "{} {name}, filter {filter}, lane {lane}: {:e}",
                        law.name(),
                        difference.amax() / size
                    );
                    for c in 0..3 {
                        for (with, alone) in out.forces.iter().zip(&forces.forces) {
                            assert!((with[c][lane] - alone[c][lane]).abs() < 1e-12 * size * 0.02, "{}", law.name());
                        }
                    }
                    let F = element.deformation_gradient(&q);
                    let energy = element.volume * (law.energy_density(&F) + pressures[lane] * F.determinant());
                    assert!((energies[lane] - energy).abs() <= 1e-12 * (1e4 * element.volume + energy.abs()));
                }
            }
        }
    }
}
