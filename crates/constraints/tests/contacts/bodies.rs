//! Rows with two sides: tissue and rigid bodies in one problem.

use crate::common::{find, free_nodes, patch, pose};
use nalgebra::{DMatrix, Isometry3, Matrix3, UnitQuaternion, Vector3};
use palpate_collision::{ContactKind, SolidContact, ToolShape};
use palpate_constraints::body::{self, Body, RigidBodies, RigidInverse, SoftBody};
use palpate_constraints::compliance::{ComplianceWorkspace, WarpedInverse};
use palpate_constraints::lumped::LumpedInverse;
use palpate_constraints::rows::{
    ContactRows, Counterpart, RigidSide, RowInput, Twist, append_rows, append_solid_rows, build_rows,
};
use palpate_fem::nodal_rows::NodalRows;

const DT: f64 = 0.02;

/// Two rigid bodies of unlike mass and inertia.
fn inverses() -> [RigidInverse; 2] {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 0.5)).to_rotation_matrix();
    let inertia = |moments: [f64; 3]| {
        turn * Matrix3::from_diagonal(&moments.into()).map(|x| if x == 0.0 { 0.0 } else { 1.0 / x }) * turn.transpose()
    };
    [
        RigidInverse { mass: 1.0 / 0.4, inertia: inertia([2e-4, 3e-4, 4e-4]) },
        RigidInverse { mass: 1.0 / 1.3, inertia: inertia([2e-3, 2e-3, 1e-3]) },
    ]
}

fn side(body: u32, centre: Vector3<f64>, free: Twist) -> RigidSide {
    RigidSide { body, centre, free }
}

fn twist(k: f64) -> Twist {
    Twist { linear: Vector3::new(0.1 * k, -0.2, 0.3), angular: Vector3::new(1.0, -2.0 * k, 0.5) }
}

/// The rows of a ball (body 0) on tissue, and of that ball with body 1.
fn problem() -> (ContactRows, Vec<f64>, Vec<f64>, [Vector3<f64>; 2]) {
    let (surface, positions) = patch(8, 0.006);
    let (free, n) = free_nodes(positions.len(), 3);
    let v_free: Vec<f64> = (0..3 * n).map(|i| 0.02 * (((i * 29) % 23) as f64 / 11.0 - 1.0)).collect();
    let mass: Vec<f64> = (0..n).map(|i| 1e-3 * (1.0 + (i % 5) as f64)).collect();
    let ball = ToolShape::sphere(0.02).unwrap();
    let centres = [Vector3::new(0.0007, 0.0011, 0.019), Vector3::new(0.03, 0.0, 0.05)];
    let set = find(&surface, &positions, &ball, &pose(centres[0], Vector3::zeros()), ContactKind::Faces);
    let input = RowInput {
        free_of_node: &free,
        v_free: &v_free,
        dt: DT,
        counterpart: Counterpart::Rigid(side(0, centres[0], twist(1.0))),
        friction: true,
    };
    let mut rows = ContactRows::with_capacity(set.contacts.len() + 2);
    let report = build_rows(&set.contacts, &input, &mut rows);
    assert!(report.contacts > 3 && report.dropped == 0 && report.rigid == 0);
    let between = (centres[0] - centres[1]).normalize();
    let contact = SolidContact { feature: 7, normal: between, point: centres[0] - between * 0.02, gap: 1e-3 };
    let with = Counterpart::Rigid(side(1, centres[1], twist(-1.0)));
    append_solid_rows(&[contact], &side(0, centres[0], twist(1.0)), &with, DT, true, &mut rows);
    let tip = SolidContact { feature: 9, normal: Vector3::z(), point: centres[1] - Vector3::z() * 0.01, gap: -2e-3 };
    append_solid_rows(&[tip], &side(1, centres[1], twist(-1.0)), &Counterpart::Fixed, DT, false, &mut rows);
    (rows, mass, v_free, centres)
}

/// `W` of all bodies is how far the gaps open under unit forces when every body moves by its own `A`, and the corrections
/// are those motions.
#[test]
fn compliance_is_the_motion_of_all_bodies_under_unit_forces() {
    let (rows, mass, _, _) = problem();
    let m = rows.len();
    let inverse = LumpedInverse::new(mass.iter().copied());
    let mut ws = ComplianceWorkspace::new(m, NodalRows::with_capacity(m, 3));
    let (mut dv, mut twists) = (vec![0.0; 3 * mass.len()], vec![Twist::default(); 2]);
    let inverses = inverses();
    let mut w = DMatrix::from_element(m, m, f64::NAN);
    let mut soft = SoftBody {
        inverse: WarpedInverse { inverse: &inverse, rotations: None },
        workspace: &mut ws,
        correction: &mut dv,
    };
    let mut rigid = RigidBodies { inverse: &inverses, correction: &mut twists };
    let report = body::assemble(&mut [&mut soft, &mut rigid], &rows, DT, &mut w);
    assert!(report.usable && report.asymmetry == 0.0, "{report:?}");
    let mut unit = vec![0.0; m];
    for j in 0..m {
        unit.fill(0.0);
        unit[j] = 1.0;
        let mut soft = SoftBody {
            inverse: WarpedInverse { inverse: &inverse, rotations: None },
            workspace: &mut ws,
            correction: &mut dv,
        };
        let mut rigid = RigidBodies { inverse: &inverses, correction: &mut twists };
        assert!(soft.correct(&rows, &unit, DT) && rigid.correct(&rows, &unit, DT));
        for i in 0..m {
            let opened = DT * (rows.tissue.dot(i, &dv) + rows.rigid.dot(i, &twists));
            assert!(
                (opened - w[(i, j)]).abs() < 1e-15 * w[(j, j)].max(w[(i, i)]) * 10.0,
                "{i} {j}: {opened} {}",
                w[(i, j)]
            );
        }
        // Newton's second law for each rigid body, in numbers of its own: M Δv = h f.
        for (k, inverse) in inverses.iter().enumerate() {
            let part =
                rows.rigid.row(j).iter().find(|(body, _)| *body as usize == k).map(|(_, row)| *row).unwrap_or_default();
            let inertia = inverse.inertia.try_inverse().unwrap();
            assert!((twists[k].linear / inverse.mass - part.force * DT).norm() < 1e-15);
            assert!((inertia * twists[k].angular - part.torque * DT).norm() < 1e-12 * DT);
        }
    }
}

/// Forces of a row on both its sides add up to zero, and so do their moments about any point.
#[test]
fn both_sides_of_a_row_get_opposite_forces_at_one_point() {
    let (rows, _, _, centres) = problem();
    let about = Vector3::new(0.3, -0.1, 0.2);
    let (_, positions) = patch(8, 0.006);
    let (free, n) = free_nodes(positions.len(), 3);
    let mut place = vec![Vector3::zeros(); n];
    positions.iter().zip(&free).for_each(|(x, &f)| {
        if let Some(place) = place.get_mut(f as usize) {
            *place = *x;
        }
    });
    let mut two = 0;
    for r in 0..rows.len() {
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for (node, f) in rows.tissue.row(r) {
            force += f;
            moment += (place[node as usize] - about).cross(&f);
        }
        for (body, row) in rows.rigid.row(r) {
            force += row.force;
            moment += row.torque + (centres[*body as usize] - about).cross(&row.force);
        }
        // The row with a fixed body, and those on skin that is partly fixed, have a side that is not here.
        let whole = force.norm() < 1e-12;
        two += usize::from(whole);
        assert!(!whole || moment.norm() < 1e-12, "row {r}: {moment}");
    }
    assert!(two > 9 && two < rows.len(), "{two} of {}", rows.len());
}

/// `δ_free` of two rigid bodies is the gap after both have moved by their free twists, to second order in the step.
#[test]
fn delta_free_is_the_gap_after_both_have_moved() {
    let (a, b) = (Vector3::new(0.0, 0.0, 0.1), Vector3::new(0.02, 0.01, -0.1));
    let contact = SolidContact { feature: 1, normal: Vector3::z(), point: Vector3::new(0.03, 0.0, 0.02), gap: 0.004 };
    let error = |dt: f64| {
        let mut rows = ContactRows::with_capacity(1);
        let counterpart = Counterpart::Rigid(side(1, b, twist(-1.0)));
        append_solid_rows(&[contact], &side(0, a, twist(1.0)), &counterpart, dt, true, &mut rows);
        // The two material points of the contact, moved rigidly.
        let moved = |x: Vector3<f64>, centre: Vector3<f64>, t: Twist| {
            Isometry3::new(t.linear * dt, t.angular * dt) * nalgebra::Point3::from(x - centre) + centre
        };
        let apart = moved(contact.point, a, twist(1.0)) - moved(contact.point - Vector3::z() * 0.004, b, twist(-1.0));
        // The far point is the near one's: levers differ by the gap, and so does the row by ω x gap.
        let slip = dt * twist(-1.0).angular.cross(&(Vector3::z() * 0.004));
        let local = rows.frames[0].to_local(&(apart - slip));
        let deltas = [rows.delta_free[0], rows.delta_free[1], rows.delta_free[2]];
        local.iter().zip(deltas).map(|(x, d)| (x - d).abs()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(2e-3), error(1e-3));
    assert!(coarse < 1e-5 && (coarse / fine).log2() > 1.9, "{coarse} {fine}");
}

#[test]
fn what_is_not_a_number_or_finds_no_room_is_counted() {
    let good = SolidContact { feature: 1, normal: Vector3::z(), point: Vector3::zeros(), gap: 0.0 };
    let contacts = [
        SolidContact { gap: f64::NAN, ..good },
        good,
        SolidContact { point: Vector3::repeat(f64::INFINITY), ..good },
        good,
    ];
    let mut rows = ContactRows::with_capacity(1);
    let report =
        append_solid_rows(&contacts, &side(0, Vector3::zeros(), twist(1.0)), &Counterpart::Fixed, DT, true, &mut rows);
    assert_eq!((report.contacts, report.rows, report.invalid, report.dropped), (1, 3, 2, 1));
    assert_eq!(rows.blocks[0].contact, 1);
    // A body that the problem does not have makes the compliance unusable.
    let mut w = DMatrix::zeros(3, 3);
    let mut rigid = RigidBodies { inverse: &[], correction: &mut [] };
    assert!(!body::assemble(&mut [&mut rigid], &rows, DT, &mut w).usable);
    // Tissue that is fixed under a rigid body still carries it; under a fixed one there is nothing to find.
    let (surface, positions) = patch(8, 0.006);
    let ball = ToolShape::sphere(0.02).unwrap();
    let set =
        find(&surface, &positions, &ball, &pose(Vector3::new(0.0, 0.0, 0.0195), Vector3::zeros()), ContactKind::Nodes);
    let fixed = vec![palpate_fem::sparse::FIXED; positions.len()];
    let counterpart = Counterpart::Rigid(side(0, Vector3::zeros(), twist(1.0)));
    let input = RowInput { free_of_node: &fixed, v_free: &[], dt: DT, counterpart, friction: false };
    let mut rows = ContactRows::with_capacity(50);
    assert_eq!(append_rows(&set.contacts, &input, &mut rows).contacts, set.contacts.len());
    let none = RowInput { counterpart: Counterpart::Fixed, ..input };
    assert_eq!(append_rows(&set.contacts, &none, &mut rows).rigid, set.contacts.len());
}
