//! Half solves over the reach: compliance against the dense inverse, corrections against full solves, reports.

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, dense, dense_rows, factored, relative_difference};
use nalgebra::{DMatrix, Vector3};
use palpate_fem::factor::{
    Factor, FactorStatus, ReachStatus, ReachWorkspace, SolveStatus, SolveWorkspace, SymbolicFactor,
};
use palpate_fem::nodal_rows::NodalRows;

#[test]
fn compliance_by_reach_is_that_of_the_dense_inverse() {
    for (cells, contacts) in [([3, 4, 3], 1), ([6, 5, 5], 9), ([9, 8, 3], 30)] {
        let body = Body::block(cells, 1);
        let a = body.system(2);
        let factor = factored(&body, &a);
        let rows = body.contact_rows(contacts, 3);
        let h = dense_rows(&rows, body.free_nodes());
        let inverse_times_h = dense(&a).cholesky().unwrap().solve(&h.transpose());
        let exact = 0.25 * &h * inverse_times_h;
        let mut w = DMatrix::zeros(rows.len(), rows.len());
        let mut workspace = ReachWorkspace::new(factor.symbolic(), 90);
        let report = factor.compliance_into(&rows, 0.25, &mut w, &mut workspace);
        assert_eq!(report.status, ReachStatus::Ok);
        assert_eq!(report.rows, rows.len());
        assert!(report.degrees_of_freedom <= 3 * body.free_nodes());
        assert!((&w - &exact).norm() < 1e-12 * exact.norm(), "{:e}", (&w - &exact).norm() / exact.norm());
        assert_eq!(w, w.transpose(), "symmetric to the bit");
    }
}

/// Rows that are far apart, empty, doubled, or of one entry, in an order that has nothing to do with elimination.
#[test]
fn compliance_of_scattered_rows_is_exact_whatever_their_order() {
    let body = Body::block([8, 7, 6], 1);
    let a = body.system(2);
    let n = body.free_nodes();
    let factor = factored(&body, &a);
    let inverse = dense(&a).cholesky().unwrap().inverse();
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 40);
    for seed in 0..6 {
        let mut random = Random(seed);
        let mut rows = NodalRows::with_capacity(40, 3);
        for r in 0..33 {
            let mut nodes: Vec<u32> = (0..r % 4).map(|_| random.below(n) as u32).collect();
            nodes.sort_unstable();
            nodes.dedup();
            rows.push_row(nodes.into_iter().map(|k| (k, Vector3::from_fn(|_, _| random.signed()))));
        }
        let h = dense_rows(&rows, n);
        let exact = &h * &inverse * h.transpose();
        let mut w = DMatrix::from_element(50, 50, 7.0);
        let report = factor.compliance_into(&rows, 1.0, w.view_mut((4, 9), (33, 33)), &mut workspace);
        assert_eq!(report.status, ReachStatus::Ok);
        let written = w.view((4, 9), (33, 33)).into_owned();
        assert!((&written - &exact).norm() < 1e-12 * exact.norm());
        assert_eq!(written, written.transpose());
        assert_eq!(w.iter().filter(|&&v| v == 7.0).count(), 50 * 50 - 33 * 33, "only the view is written");
    }
}

#[test]
fn correction_by_half_solves_is_the_full_solve() {
    let body = Body::block([7, 6, 5], 1);
    let factor = factored(&body, &body.system(2));
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 60);
    for contacts in [1, 7, 20] {
        let rows = body.contact_rows(contacts, 3);
        assert_eq!(factor.half_solve(&rows, &mut workspace).status, ReachStatus::Ok);
        let lambda = Random(4).vector(rows.len());
        let mut x = vec![f64::NAN; 3 * body.free_nodes()];
        assert!(factor.correct(&lambda, &mut x, &mut workspace).is_ok());
        let mut exact = vec![0.0; x.len()];
        rows.add_transposed(&lambda, &mut exact);
        assert!(factor.solve(&mut exact, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
        assert!(relative_difference(&x, &exact) < 1e-13);
    }
}

#[test]
fn running_past_capacity_is_reported_and_leaves_the_workspace_usable() {
    let body = Body::block([5, 5, 3], 1);
    let factor = factored(&body, &body.system(2));
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 10);
    let (few, many) = (body.contact_rows(3, 1), body.contact_rows(4, 1));
    assert_eq!(factor.half_solve(&many, &mut workspace).status, ReachStatus::TooManyRows { capacity: 10 });
    assert_eq!(workspace.rows(), 0);
    assert_eq!(factor.correct(&[], &mut [], &mut workspace), SolveStatus::OtherFactor);
    assert_eq!(factor.half_solve(&few, &mut workspace).status, ReachStatus::Ok);
    assert_eq!(workspace.gram_into(1.0, &mut DMatrix::zeros(10, 10)), ReachStatus::WrongSize);
    assert_eq!(workspace.gram_into(1.0, &mut DMatrix::zeros(9, 9)), ReachStatus::Ok);

    let mut unknown = NodalRows::default();
    unknown.push_row([(body.free_nodes() as u32, Vector3::x())]);
    let status = factor.half_solve(&unknown, &mut workspace).status;
    assert_eq!(status, ReachStatus::UnknownNode { node: body.free_nodes() as u32 });

    let none = NodalRows::default();
    assert_eq!(factor.half_solve(&none, &mut workspace).status, ReachStatus::Ok);
    assert_eq!(workspace.gram_into(1.0, &mut DMatrix::zeros(0, 0)), ReachStatus::Ok);

    let mut x = vec![1.0; 3 * body.free_nodes()];
    assert!(factor.correct(&[], &mut x, &mut workspace).is_ok());
    assert!(x.iter().all(|&v| v == 0.0), "no row, no correction");
}

#[test]
fn half_solves_are_not_mixed_with_another_factor() {
    let body = Body::block([4, 4, 3], 1);
    let mut factor = factored(&body, &body.system(2));
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 9);
    let rows = body.contact_rows(3, 1);
    assert_eq!(factor.half_solve(&rows, &mut workspace).status, ReachStatus::Ok);
    factor.refactor(&body.system(3));
    let mut x = vec![0.0; 3 * body.free_nodes()];
    assert_eq!(factor.correct(&[0.0; 9], &mut x, &mut workspace), SolveStatus::OtherFactor);

    let other = Body::block([5, 4, 3], 1);
    let stranger = factored(&other, &other.system(2));
    assert_eq!(stranger.half_solve(&rows, &mut workspace).status, ReachStatus::WrongSize);
    let mut y = vec![0.0; 3 * other.free_nodes()];
    assert_eq!(stranger.solve(&mut y, &mut SolveWorkspace::new(factor.symbolic())), SolveStatus::WrongSize);
    assert_eq!(factor.refactor(&other.system(2)).status, FactorStatus::OtherPattern);
    assert!(factor.is_valid(), "a matrix of another body leaves the factor as it was");
}

/// More rows than one block holds, near each other and far apart.
#[test]
fn many_rows_are_exact_and_have_the_same_bits_on_any_number_of_threads() {
    let body = Body::block([6, 6, 5], 1);
    let a = body.system(2);
    let factor = factored(&body, &a);
    let inverse = dense(&a).cholesky().unwrap().inverse();
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 210);
    for (contacts, scattered) in [(22, false), (43, true), (70, true), (65, false)] {
        let rows = if scattered { body.scattered_contact_rows(contacts, 3) } else { body.contact_rows(contacts, 3) };
        let h = dense_rows(&rows, body.free_nodes());
        let exact = &h * &inverse * h.transpose();
        let lambda = Random(5).vector(rows.len());
        let mut results = [1, 2, 4].map(|threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut w = DMatrix::zeros(rows.len(), rows.len());
                let mut x = vec![0.0; 3 * body.free_nodes()];
                assert_eq!(factor.compliance_into(&rows, 1.0, &mut w, &mut workspace).status, ReachStatus::Ok);
                assert!(factor.correct(&lambda, &mut x, &mut workspace).is_ok());
                (w, x)
            })
        });
        let (w, x) = &results[0];
        assert!((w - &exact).norm() < 1e-12 * exact.norm());
        assert_eq!(w, &w.transpose());
        let mut full = vec![0.0; x.len()];
        rows.add_transposed(&lambda, &mut full);
        assert!(factor.solve(&mut full, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
        assert!(relative_difference(x, &full) < 1e-12);
        assert!(results[1] == results[0] && results[2] == results[0]);
        results[0].0[(1, 0)] += f64::EPSILON * results[0].0[(1, 0)].abs().max(1e-300);
        assert!(results[1] != results[0], "the comparison sees one bit");
    }
}

/// One block of rows, at whose large fronts threads share the work.
#[test]
fn one_block_of_rows_is_right_and_has_the_same_bits_on_any_number_of_threads() {
    let body = Body::block([12, 12, 11], 1);
    let factor = factored(&body, &body.system(2));
    let mut workspace = ReachWorkspace::new(factor.symbolic(), 63);
    let rows = body.contact_rows(20, 3);
    let lambda = Random(5).vector(rows.len());
    let results = [1, 2, 4].map(|threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut w = DMatrix::zeros(rows.len(), rows.len());
            assert_eq!(factor.compliance_into(&rows, 1.0, &mut w, &mut workspace).status, ReachStatus::Ok);
            w
        })
    });
    assert!(results[1] == results[0] && results[2] == results[0]);
    let mut full = vec![0.0; 3 * body.free_nodes()];
    rows.add_transposed(&lambda, &mut full);
    assert!(factor.solve(&mut full, &mut SolveWorkspace::new(factor.symbolic())).is_ok());
    let exact: Vec<f64> = (0..rows.len()).map(|r| rows.dot(r, &full)).collect();
    let by_w = &results[0] * DMatrix::from_column_slice(rows.len(), 1, &lambda);
    assert!(relative_difference(by_w.as_slice(), &exact) < 1e-12);
}

/// Three unit rows for each node.
fn unit_rows(nodes: &[u32]) -> NodalRows {
    let mut rows = NodalRows::with_capacity(3 * nodes.len(), 1);
    nodes.iter().for_each(|&node| (0..3).for_each(|k| rows.push_row([(node, Vector3::ith(k, 1.0))])));
    rows
}

/// Contacts, the nodes around them, the same again, many others, one row of three new nodes and one of none, contacts
/// elsewhere, and more nodes than there is room for beside all these.
fn rows_of_some_steps(body: &Body) -> [NodalRows; 7] {
    let some: Vec<u32> = (0..60).map(|k| 7 * k).collect();
    let mut alone = NodalRows::with_capacity(2, 3);
    alone.push_row([(3, Vector3::x()), (40, Vector3::y()), (80, Vector3::z())]);
    alone.push_row([]);
    let others: Vec<u32> = (0..80).map(|k| 7 * k + 3).collect();
    let contacts = body.contact_rows(30, 31);
    let scattered = body.scattered_contact_rows(20, 32);
    [contacts.clone(), unit_rows(&some[..20]), contacts, unit_rows(&some), alone, scattered, unit_rows(&others)]
}

#[test]
fn compliance_by_kept_nodes_is_that_by_rows_whatever_came_before() {
    let body = Body::block([9, 8, 7], 30);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let mut factor = Factor::with_packed_copy(symbolic.clone());
    let mut kept = ReachWorkspace::new(&symbolic, 240).keeping_nodes(&symbolic);
    let mut plain = ReachWorkspace::new(&symbolic, 240);
    let sequence = rows_of_some_steps(&body);
    let (mut by_nodes, mut forgotten, mut most) = (0, 0, 0);
    for seed in [33, 34] {
        assert_eq!(factor.refactor(&body.system(seed)).status, FactorStatus::Ok);
        for (k, rows) in sequence.iter().chain(&sequence).enumerate() {
            let m = rows.len();
            let (mut w, mut expected) = (DMatrix::zeros(m, m), DMatrix::zeros(m, m));
            let report = factor.compliance_into(rows, 2.0, &mut w, &mut kept);
            assert_eq!((report.status, report.rows), (ReachStatus::Ok, m));
            assert_eq!(factor.compliance_into(rows, 2.0, &mut expected, &mut plain).status, ReachStatus::Ok);
            assert_eq!(w, w.transpose(), "symmetric to the bit");
            let difference = (&w - &expected).amax() / expected.amax();
            assert!(difference < 1e-12, "rows {k}: {difference:e}");
            // by another way the last digits are others
            by_nodes += usize::from(w != expected);
            forgotten += usize::from(kept.kept_nodes() < most);
            most = kept.kept_nodes();
            let lambda = Random(35).vector(m);
            let [mut x, mut y, mut z] = [(); 3].map(|()| vec![0.0; 3 * body.free_nodes()]);
            assert!(factor.correct(&lambda, &mut x, &mut kept).is_ok());
            assert!(factor.correct(&lambda, &mut y, &mut plain).is_ok());
            assert!(factor.guess_correction(&lambda, &mut z, &mut kept).is_ok());
            assert!(relative_difference(&x, &y) < 1e-12, "rows {k}");
            // rounding of L by 1.5e-5 of a column's largest number, times the condition of L; and it is the copy that was used
            let rough = relative_difference(&z, &y);
            assert!((1e-7..5e-4).contains(&rough), "rows {k}: {rough:e}");
        }
    }
    // not the row of three nodes, nor scattered contacts that touch more nodes than they have rows
    assert!(by_nodes >= 8, "{by_nodes} of 28");
    assert!(forgotten > 2, "{forgotten} times, one of which is the other factor");
    // a failed compliance leaves nothing that a correction would use
    let unknown = unit_rows(&[body.free_nodes() as u32]);
    let status = factor.compliance_into(&unknown, 1.0, &mut DMatrix::zeros(3, 3), &mut kept).status;
    assert_eq!(status, ReachStatus::UnknownNode { node: body.free_nodes() as u32 });
    assert_eq!(factor.correct(&[0.0; 3], &mut vec![0.0; 3 * body.free_nodes()], &mut kept), SolveStatus::OtherFactor);
}

#[test]
fn kept_nodes_have_the_same_bits_on_any_number_of_threads() {
    let body = Body::block([9, 8, 7], 36);
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let factor = factored(&body, &body.system(37));
    let bits = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut kept = ReachWorkspace::new(&symbolic, 240).keeping_nodes(&symbolic);
            let mut bits = Vec::new();
            for rows in &rows_of_some_steps(&body) {
                let mut w = DMatrix::zeros(rows.len(), rows.len());
                assert_eq!(factor.compliance_into(rows, 2.0, &mut w, &mut kept).status, ReachStatus::Ok);
                bits.extend(w.iter().map(|w| w.to_bits()));
            }
            bits
        })
    };
    let one = bits(1);
    assert!([2, 4].into_iter().all(|threads| bits(threads) == one));
}
