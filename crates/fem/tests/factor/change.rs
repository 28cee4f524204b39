//! A factor after a cut, a clamp closed or opened, without a refactorisation: it must be what a refactorisation is.

use std::sync::Arc;

use crate::factor_bodies::{Body, Random, dense, relative_difference};
use nalgebra::{DMatrix, Matrix3};
use palpate_fem::factor::{
    ChangeStatus, Factor, FactorStatus, MatrixChange, ReachStatus, ReachWorkspace, SolveWorkspace, SymbolicFactor,
    UpdateStatus,
};
use palpate_fem::sparse::SystemMatrix;

/// Condition numbers here are about 1e4, so that rounding leaves eleven digits; the aim is nine.
const AGREE: f64 = 1e-9;

/// Nodes that a change may touch.
const ROOM: usize = 120;

/// A block, its matrix, and the matrix without `cut` of its elements, over the same pattern.
fn cut_block(cut: usize) -> (Body, SystemMatrix, SystemMatrix) {
    let mut body = Body::block([6, 6, 6], 1);
    // Elements of the two inner layers, in one row: no node loses all its elements.
    let middle = |body: &Body, t: &[u32; 4]| {
        let centre: nalgebra::Vector3<f64> =
            t.iter().map(|&i| body.nodes[i as usize]).sum::<nalgebra::Vector3<f64>>() / 4.0;
        (centre.z - 0.03).abs() < 0.01 && (centre.y - 0.03).abs() < 0.01
    };
    let (inside, outside): (Vec<_>, Vec<_>) = body.tetrahedra.iter().partition(|t| middle(&body, t));
    assert!(inside.len() > cut);
    let kept = inside.len() - cut;
    // The moduli are drawn in the order of the elements: those that go are the last.
    body.tetrahedra = outside.iter().chain(&inside).copied().collect();
    let before = body.system(7);
    body.tetrahedra.truncate(outside.len() + kept);
    let after = body.system(7);
    (body, before, after)
}

fn factored_with_room(body: &Body, a: &SystemMatrix) -> Factor {
    let symbolic = SymbolicFactor::new(&body.pattern, &body.positions).unwrap().with_room_for_changes(ROOM);
    let mut factor = Factor::new(Arc::new(symbolic));
    assert_eq!(factor.refactor(a).status, FactorStatus::Ok);
    factor
}

/// Rows and columns of held nodes as those of a unit mass alone.
fn hold(a: &SystemMatrix, held: &[bool]) -> SystemMatrix {
    let mut a = a.clone();
    for i in 0..held.len() {
        for p in a.pattern.row(i) {
            let j = a.pattern.columns()[p] as usize;
            if held[i] || held[j] {
                a.blocks[p] = if i == j { Matrix3::identity() } else { Matrix3::zeros() };
            }
        }
    }
    a
}

/// Solves, compliances and corrections of the changed factor are those of a factor of `after`.
fn assert_is_factor_of(changed: &Factor, body: &Body, after: &SystemMatrix, held: &[bool]) {
    let fresh = factored_with_room(body, after);
    let mut solve = SolveWorkspace::with_columns(changed.symbolic(), 2);
    let mut b = Random(3).vector(2 * 3 * body.free_nodes());
    for (k, held) in held.iter().cycle().take(2 * body.free_nodes()).enumerate() {
        if *held {
            b[3 * k..3 * k + 3].fill(0.0);
        }
    }
    let (mut x, mut y) = (b.clone(), b);
    assert!(changed.solve_columns(&mut x, &mut solve).is_ok() && fresh.solve_columns(&mut y, &mut solve).is_ok());
    assert!(relative_difference(&x, &y) < AGREE, "solve: {:e}", relative_difference(&x, &y));

    let rows = body.contact_rows(12, 5);
    let touches_held = |r: usize| rows.row(r).any(|(k, _)| held[k as usize]);
    assert!((0..rows.len()).all(|r| !touches_held(r)), "contact on a held node has no tissue part");
    let mut reach = ReachWorkspace::new(changed.symbolic(), rows.len());
    let (mut w, mut w_fresh) = (DMatrix::zeros(36, 36), DMatrix::zeros(36, 36));
    let lambda = Random(4).vector(rows.len());
    let (mut dv, mut dv_fresh) = (vec![0.0; 3 * body.free_nodes()], vec![0.0; 3 * body.free_nodes()]);
    assert_eq!(fresh.compliance_into(&rows, 1e-3, &mut w_fresh, &mut reach).status, ReachStatus::Ok);
    assert!(fresh.correct(&lambda, &mut dv_fresh, &mut reach).is_ok());
    assert_eq!(changed.compliance_into(&rows, 1e-3, &mut w, &mut reach).status, ReachStatus::Ok);
    assert!(changed.correct(&lambda, &mut dv, &mut reach).is_ok());
    assert!(relative_difference(w.as_slice(), w_fresh.as_slice()) < AGREE);
    assert!(relative_difference(&dv, &dv_fresh) < AGREE);
    assert_eq!(w, w.transpose(), "symmetric to the bit");
}

#[test]
fn a_cut_equals_a_refactorisation() {
    for cut in [1, 5, 20] {
        let (body, before, after) = cut_block(cut);
        let free = vec![false; body.free_nodes()];
        let mut factor = factored_with_room(&body, &before);
        let mut change = MatrixChange::with_capacity(body.free_nodes(), ROOM);
        assert_eq!(change.between(&before, &after, &free), ChangeStatus::Ok);
        println!("{cut} elements cut: {} nodes touched", change.nodes().len());
        assert_eq!(factor.change(&change), UpdateStatus::Ok);
        assert_is_factor_of(&factor, &body, &after, &free);
    }
}

#[test]
fn held_and_released_nodes_equal_a_refactorisation() {
    let (body, a, cut) = cut_block(4);
    let clamp = |centre: usize, count: usize| {
        let mut held = vec![false; body.free_nodes()];
        let x = body.positions[centre];
        let mut near: Vec<usize> = (0..held.len()).filter(|k| !body.top.contains(&(*k as u32))).collect();
        near.sort_by(|&i, &j| (body.positions[i] - x).norm().total_cmp(&(body.positions[j] - x).norm()));
        near[..count].iter().for_each(|&k| held[k] = true);
        held
    };
    let (first, second) = (clamp(30, 7), clamp(100, 5));
    let none = vec![false; body.free_nodes()];
    let mut change = MatrixChange::with_capacity(body.free_nodes(), ROOM);

    // closed, opened, one opened while the other closes and a cut is made
    let cases = [(&a, &none, &a, &first), (&a, &first, &a, &none), (&a, &first, &cut, &second)];
    for (k, (before, held_before, after, held_after)) in cases.into_iter().enumerate() {
        let (before, after) = (hold(before, held_before), hold(after, held_after));
        let newly: Vec<bool> = held_after.iter().zip(held_before).map(|(now, then)| *now && !then).collect();
        let mut factor = factored_with_room(&body, &before);
        assert_eq!(change.between(&before, &after, &newly), ChangeStatus::Ok);
        println!("case {k}: {} nodes touched", change.nodes().len());
        assert_eq!(factor.change(&change), UpdateStatus::Ok);
        assert_is_factor_of(&factor, &body, &after, held_after);
    }
}

#[test]
fn a_second_change_replaces_the_first_and_a_refactorisation_absorbs_it() {
    let (body, before, after) = cut_block(6);
    let none = vec![false; body.free_nodes()];
    let mut factor = factored_with_room(&body, &before);
    let mut change = MatrixChange::with_capacity(body.free_nodes(), ROOM);
    assert_eq!(change.between(&before, &after, &none), ChangeStatus::Ok);
    assert_eq!(factor.change(&change), UpdateStatus::Ok);
    let revision = factor.revision();
    // back to what was factored: the change is none
    assert_eq!(change.between(&before, &before, &none), ChangeStatus::Ok);
    assert!(change.is_empty());
    assert_eq!(factor.change(&change), UpdateStatus::Ok);
    assert_ne!(factor.revision(), revision, "half solves of the cut body must not be taken for those of the whole one");
    assert_is_factor_of(&factor, &body, &before, &none);
    assert_eq!(change.between(&before, &after, &none), ChangeStatus::Ok);
    assert_eq!(factor.change(&change), UpdateStatus::Ok);
    assert_eq!(factor.refactor(&after).status, FactorStatus::Ok);
    assert_is_factor_of(&factor, &body, &after, &none);
}

#[test]
fn what_does_not_fit_or_is_not_definite_is_refused_and_the_factor_stays() {
    let (body, before, after) = cut_block(20);
    let none = vec![false; body.free_nodes()];
    let mut small = MatrixChange::with_capacity(body.free_nodes(), 3);
    assert_eq!(small.between(&before, &after, &none), ChangeStatus::TooManyNodes { capacity: 3 });
    assert!(small.is_empty());
    assert_eq!(small.between(&before, &after, &[]), ChangeStatus::WrongSize);

    let mut change = MatrixChange::with_capacity(body.free_nodes(), ROOM);
    let mut factor = factored_with_room(&body, &before);
    // one node's own block taken away three times over: negative there, while I + N C is regular
    let mut negative = before.clone();
    let p = body.pattern.find(40, 40).unwrap();
    negative.blocks[p] *= -3.0;
    assert!(dense(&negative).cholesky().is_none());
    assert_eq!(change.between(&before, &negative, &none), ChangeStatus::Ok);
    assert_eq!(factor.change(&change), UpdateStatus::NotPositiveDefinite);
    assert_is_factor_of(&factor, &body, &before, &none);

    negative.blocks[p].fill(f64::NAN);
    assert_eq!(change.between(&before, &negative, &none), ChangeStatus::Ok);
    assert_eq!(factor.change(&change), UpdateStatus::NotPositiveDefinite);
    assert_is_factor_of(&factor, &body, &before, &none);

    let symbolic = SymbolicFactor::new(&body.pattern, &body.positions).unwrap();
    let mut without_room = Factor::new(Arc::new(symbolic));
    assert_eq!(without_room.refactor(&before).status, FactorStatus::Ok);
    assert_eq!(change.between(&before, &after, &none), ChangeStatus::Ok);
    assert_eq!(without_room.change(&change), UpdateStatus::WrongSize);
}
