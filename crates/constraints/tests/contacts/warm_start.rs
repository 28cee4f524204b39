//! Forces find their contacts again: same feature, near place, other frame; and nothing is invented.

use nalgebra::Vector3;
use palpate_collision::Contact;
use palpate_constraints::rows::{ContactRows, Counterpart, RowInput, ToolMotion, build_rows};
use palpate_constraints::warm_start::{WarmStart, WarmStartReport};

fn contact(feature: u64, x: f64, normal: Vector3<f64>) -> Contact {
    let point = Vector3::new(x, 0.0, 0.0);
    Contact {
        feature,
        nodes: [0, 1, 2],
        weights: [0.2, 0.3, 0.5],
        normal,
        tissue_point: point,
        tool_point: point,
        gap: 0.0,
    }
}

fn rows(contacts: &[Contact], friction: bool) -> ContactRows {
    let input = RowInput {
        free_of_node: &[0, 1, 2],
        v_free: &[0.0; 9],
        dt: 0.01,
        counterpart: Counterpart::Tool { reference: Vector3::zeros(), motion: ToolMotion::none() },
        friction,
    };
    let mut rows = ContactRows::with_capacity(contacts.len());
    build_rows(contacts, &input, &mut rows);
    rows
}

fn world(rows: &ContactRows, block: usize, lambda: &[f64]) -> Vector3<f64> {
    rows.frames[block].to_world(&lambda[rows.blocks[block].range()])
}

#[test]
fn same_feature_keeps_the_world_force_in_a_turned_frame() {
    let old = [contact(7, 0.0, -Vector3::z()), contact(9, 0.01, -Vector3::z())];
    let old_rows = rows(&old, true);
    let lambda = [2.0, 0.3, -0.4, 1.0, 0.0, 0.1];
    let mut warm = WarmStart::with_capacity(4);
    assert_eq!(warm.store(&old, &old_rows, 0..2, &lambda), 0);
    // Listed the other way round, moved, and with a normal that turned by 0.3 rad.
    let turned = Vector3::new(0.3f64.sin(), 0.0, -(0.3f64.cos()));
    let new = [contact(9, 0.012, turned), contact(7, 0.1, turned)];
    let new_rows = rows(&new, true);
    let mut guess = vec![f64::NAN; 6];
    let report = warm.fetch(&new, &new_rows, 0..2, 1e-3, &mut guess);
    assert_eq!(report, WarmStartReport { same: 2, near: 0, fresh: 0 });
    assert!((world(&new_rows, 0, &guess) - world(&old_rows, 1, &lambda)).norm() < 1e-15);
    assert!((world(&new_rows, 1, &guess) - world(&old_rows, 0, &lambda)).norm() < 1e-15);
}

#[test]
fn near_contact_takes_a_force_once() {
    let n = -Vector3::z();
    let old = [contact(1, 0.0, n), contact(2, 0.010, n)];
    let old_rows = rows(&old, false);
    let mut warm = WarmStart::with_capacity(2);
    warm.store(&old, &old_rows, 0..2, &[3.0, 5.0]);
    // Feature 2 stays; 11 and 12 are new near feature 1; 13 is far from all.
    let new = [contact(2, 0.010, n), contact(11, 0.0004, n), contact(12, -0.0004, n), contact(13, 0.5, n)];
    let new_rows = rows(&new, false);
    let mut guess = vec![f64::NAN; 4];
    let report = warm.fetch(&new, &new_rows, 0..4, 1e-3, &mut guess);
    assert_eq!(report, WarmStartReport { same: 1, near: 1, fresh: 2 });
    assert_eq!(guess, [5.0, 3.0, 0.0, 0.0]);
    // A force near a contact that belongs to another one by feature is not taken, whatever the order of the list.
    let new = [contact(14, 0.0101, n), contact(2, 0.0100, n)];
    let report = warm.fetch(&new, &rows(&new, false), 0..2, 1e-3, &mut guess[..2]);
    assert_eq!((report.same, report.fresh, &guess[..2]), (1, 1, &[0.0, 5.0][..]));
}

#[test]
fn nothing_is_invented() {
    let n = -Vector3::z();
    let mut warm = WarmStart::with_capacity(1);
    let one = [contact(1, 0.0, n), contact(2, 0.001, n)];
    let one_rows = rows(&one, true);
    let mut guess = vec![f64::NAN; 6];
    assert_eq!(warm.fetch(&one, &one_rows, 0..2, 1.0, &mut guess).fresh, 2);
    assert_eq!(guess, [0.0; 6]);
    // Beyond the capacity: told. Not finite: forgotten.
    assert_eq!(warm.store(&one, &one_rows, 0..2, &[1.0; 6]), 1);
    warm.store(&one, &one_rows, 0..2, &[f64::NAN; 6]);
    assert!(warm.is_empty());
    // A normal that turned right over would make the force pull: zero.
    warm.store(&one, &one_rows, 0..1, &[1.0, 0.0, 0.0]);
    let over = [contact(1, 0.0, Vector3::z())];
    let report = warm.fetch(&over, &rows(&over, true), 0..1, 1.0, &mut guess[..3]);
    assert_eq!((report.same, &guess[..3]), (1, &[0.0; 3][..]));
    // A list of forces that is too short is no panic.
    assert_eq!(warm.store(&one, &one_rows, 0..2, &[1.0]), 0);
    warm.clear();
    assert_eq!(warm.len(), 0);
}

/// Two tools on one body: each keeps its own forces in its own range of blocks.
#[test]
fn ranges_keep_tools_apart() {
    let n = -Vector3::z();
    let contacts = [contact(1, 0.0, n), contact(2, 0.001, n)];
    let all = rows(&contacts, false);
    let mut warm = WarmStart::with_capacity(2);
    warm.store(&contacts, &all, 1..2, &[3.0, 5.0]);
    assert_eq!(warm.len(), 1);
    let mut guess = vec![7.0, 7.0];
    warm.fetch(&contacts, &all, 1..2, 1e-4, &mut guess);
    assert_eq!(guess, [7.0, 5.0], "rows of other blocks are left alone");
}
