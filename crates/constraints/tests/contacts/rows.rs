//! Rows against differences of the gap, virtual power, and the third law.

use crate::common::{box_hull, find, free_nodes, patch, pose};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use palpate_collision::contact::{FeatureKind, feature_kind};
use palpate_collision::narrow_phase::touch;
use palpate_collision::{Contact, ContactKind, ContactSet, SurfaceGeometry, ToolShape};
use palpate_constraints::frame::ContactFrame;
use palpate_constraints::rows::{
    ContactRows, Counterpart, RowInput, ToolMotion, ToolRow, build_fixed_rows, build_rows,
};
use palpate_fem::sparse::FIXED;
use proptest::prelude::*;

const KINDS: [ContactKind; 2] = [ContactKind::Nodes, ContactKind::Faces];

fn tools() -> Vec<(ToolShape, Isometry3<f64>)> {
    let p = |z| Vector3::new(0.0007, 0.0011, z);
    vec![
        (ToolShape::sphere(0.008).unwrap(), pose(p(0.0075), Vector3::zeros())),
        (ToolShape::capsule(0.008, 0.004).unwrap(), pose(p(0.0042), Vector3::new(0.1, 1.5, 0.3))),
        (box_hull([0.006, 0.007, 0.005]), pose(p(0.0078), Vector3::new(0.5, 0.4, 0.2))),
        (box_hull([0.006, 0.007, 0.005]), pose(p(0.0072), Vector3::new(0.6, 0.02, 0.7))),
    ]
}

fn rows_of(
    contacts: &[Contact],
    free: &[u32],
    v_free: &[f64],
    pose: &Isometry3<f64>,
    motion: ToolMotion,
) -> ContactRows {
    let input = RowInput {
        free_of_node: free,
        v_free,
        dt: 0.03,
        counterpart: Counterpart::Tool { reference: pose.translation.vector, motion },
        friction: true,
    };
    let mut rows = ContactRows::with_capacity(contacts.len());
    let report = build_rows(contacts, &input, &mut rows);
    assert_eq!((report.contacts, report.rows), (contacts.len(), 3 * contacts.len()), "{report:?}");
    rows
}

/// The gap of a feature is differentiated by running detection again on moved nodes and poses.
///
/// Central differences with a step of 1e-6 m (rad): the gap's curvature is at most that of the tool, about 300 / m, and
/// the third derivative 1e5 / m², so truncation is 1e-7; rounding is 1e-17 / 1e-6 = 1e-11. The ends of a capsule and points
/// clipped to edges slide along the face when nodes move: they are tested with frozen weights below.
fn difference(
    contact: &Contact,
    mut surface: SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &ToolShape,
    kind: ContactKind,
    change: impl Fn(&mut Vec<Vector3<f64>>, f64) -> Isometry3<f64>,
) -> Option<f64> {
    let step = 1e-6;
    let mut gap = |s: f64| {
        let mut moved = positions.to_vec();
        let pose = change(&mut moved, s);
        surface.refit(&moved);
        let set: ContactSet = find(&surface, &moved, tool, &pose, kind);
        set.contacts.iter().find(|c| c.feature == contact.feature).map(|c| c.gap)
    };
    Some((gap(step)? - gap(-step)?) / (2.0 * step))
}

#[test]
fn normal_rows_are_the_derivative_of_detected_gaps() {
    let (surface, positions) = patch(8, 0.006);
    let mut compared = 0;
    for kind in KINDS {
        for (number, (tool, place)) in tools().into_iter().enumerate() {
            if number == 1 && kind == ContactKind::Faces {
                continue;
            }
            let set = find(&surface, &positions, &tool, &place, kind);
            assert!(!set.contacts.is_empty(), "{number}");
            let (free, n) = free_nodes(positions.len(), 0);
            let rows = rows_of(&set.contacts, &free, &vec![0.0; 3 * n], &place, ToolMotion::none());
            for (block, contact) in rows.blocks.iter().zip(&set.contacts) {
                // Where the skin bends the normal, rows hold it still during the step; the gap is then that to a plane.
                let distance = tool.signed_distance(&place, &contact.tissue_point).distance;
                if feature_kind(contact.feature) == Some(FeatureKind::Vertex) && (distance - contact.gap).abs() > 1e-12
                {
                    continue;
                }
                let r = block.first_row as usize;
                for (node, value) in rows.tissue.row(r) {
                    for axis in 0..3 {
                        let change = |moved: &mut Vec<Vector3<f64>>, s: f64| {
                            moved[node as usize][axis] += s;
                            place
                        };
                        // A feature that vanishes under the step (a corner that leaves its triangle) has no difference.
                        let Some(d) = difference(contact, surface.clone(), &positions, &tool, kind, change) else {
                            continue;
                        };
                        assert!(
                            (d - value[axis]).abs() < 1e-5,
                            "{kind:?} {number} node {node}: {d} {value:?} {contact:?}"
                        );
                        compared += 1;
                    }
                }
                for axis in 0..3 {
                    let along = |_: &mut Vec<Vector3<f64>>, s: f64| Translation3::from(Vector3::ith(axis, s)) * place;
                    let turn = |_: &mut Vec<Vector3<f64>>, s: f64| {
                        let step = UnitQuaternion::from_scaled_axis(Vector3::ith(axis, s));
                        Isometry3::from_parts(place.translation, step * place.rotation)
                    };
                    if let Some(d) = difference(contact, surface.clone(), &positions, &tool, kind, along) {
                        assert!((d - rows.tool[r].force[axis]).abs() < 1e-5, "{kind:?} {number}: {d} {contact:?}");
                        compared += 1;
                    }
                    if let Some(d) = difference(contact, surface.clone(), &positions, &tool, kind, turn) {
                        assert!((d - rows.tool[r].torque[axis]).abs() < 1e-5, "{kind:?} {number}: {d} {contact:?}");
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 300, "{compared} differences");
}

/// With frozen weights the same holds for every point contact of every tool.
#[test]
fn normal_rows_are_the_derivative_with_frozen_weights() {
    let (surface, positions) = patch(8, 0.006);
    let step = 1e-6;
    for kind in KINDS {
        for (tool, place) in tools().into_iter().take(2) {
            let set = find(&surface, &positions, &tool, &place, kind);
            for c in &set.contacts {
                let gap = |x: Vector3<f64>, pose: &Isometry3<f64>| touch(&tool, pose, &x, &Vector3::z()).unwrap().gap;
                let row = ToolRow::new(&c.normal, &(c.tissue_point - place.translation.vector));
                for axis in 0..3 {
                    let e = Vector3::ith(axis, step);
                    let by_tissue = (gap(c.tissue_point + e, &place) - gap(c.tissue_point - e, &place)) / (2.0 * step);
                    let turned = |s: f64| {
                        let q = UnitQuaternion::from_scaled_axis(Vector3::ith(axis, s));
                        Isometry3::from_parts(place.translation, q * place.rotation)
                    };
                    let by_turn =
                        (gap(c.tissue_point, &turned(step)) - gap(c.tissue_point, &turned(-step))) / (2.0 * step);
                    assert!((by_tissue - c.normal[axis]).abs() < 1e-6);
                    assert!((by_turn - row.torque[axis]).abs() < 1e-6);
                }
            }
        }
    }
}

/// Forces and moments (about any point) on tissue and tool add up to zero, and the power of the row forces is
/// `λ · δ̇` for every motion of nodes and tool.
#[test]
fn third_law_and_virtual_power() {
    let (surface, positions) = patch(8, 0.006);
    let (free, n) = free_nodes(positions.len(), 0);
    for kind in KINDS {
        for (tool, place) in tools() {
            let set = find(&surface, &positions, &tool, &place, kind);
            let rows = rows_of(&set.contacts, &free, &vec![0.0; 3 * n], &place, ToolMotion::none());
            let lambda: Vec<f64> = (0..rows.len()).map(|r| ((r * 37) % 17) as f64 / 8.0 - 0.5).collect();
            let mut nodal = vec![0.0; 3 * n];
            rows.tissue.add_transposed(&lambda, &mut nodal);
            let wrench = rows.wrench(&lambda);
            let about = Vector3::new(0.3, -0.2, 0.5);
            let mut force = wrench.force;
            let mut moment = wrench.torque + (place.translation.vector - about).cross(&wrench.force);
            for (k, f) in nodal.chunks_exact(3).enumerate() {
                let f = Vector3::new(f[0], f[1], f[2]);
                force += f;
                moment += (positions[k] - about).cross(&f);
            }
            let size: f64 = lambda.iter().map(|l| l.abs()).sum();
            assert!(force.norm() < 1e-12 * size && moment.norm() < 1e-12 * size, "{force:?} {moment:?}");

            let v: Vec<f64> = (0..3 * n).map(|i| ((i * 29) % 23) as f64 / 11.0 - 1.0).collect();
            let (u, w) = (Vector3::new(0.2, -0.4, 0.1), Vector3::new(3.0, 1.0, -2.0));
            let rates: f64 =
                (0..rows.len()).map(|r| lambda[r] * (rows.tissue.dot(r, &v) + rows.tool[r].dot(&u, &w))).sum();
            let power =
                nodal.iter().zip(&v).map(|(f, v)| f * v).sum::<f64>() + wrench.force.dot(&u) + wrench.torque.dot(&w);
            assert!((rates - power).abs() < 1e-12 * size * 10.0);
        }
    }
}

/// A normal force pushes the tissue along the normal and the tool back, and weights sum to one: the tissue rows of a
/// contact add up to its directions.
#[test]
fn rows_carry_the_frame() {
    let (surface, positions) = patch(8, 0.006);
    let (free, n) = free_nodes(positions.len(), 0);
    for (tool, place) in tools() {
        let set = find(&surface, &positions, &tool, &place, ContactKind::Faces);
        let rows = rows_of(&set.contacts, &free, &vec![0.0; 3 * n], &place, ToolMotion::none());
        for ((block, frame), c) in rows.blocks.iter().zip(&rows.frames).zip(&set.contacts) {
            assert_eq!(*frame, ContactFrame::new(c.normal));
            for (r, d) in block.range().zip(frame.directions()) {
                let sum: Vector3<f64> = rows.tissue.row(r).map(|(_, v)| v).sum();
                assert!((sum - d).norm() < 1e-14 && (rows.tool[r].force + d).norm() == 0.0);
                let mut nodes: Vec<u32> = rows.tissue.row(r).map(|(k, _)| k).collect();
                nodes.sort_unstable();
                assert!(nodes.windows(2).all(|w| w[0] != w[1]), "a node occurs once in a row");
            }
        }
    }
}

/// `δ_free` from its definition: the gap after the free motion, and the slip between tissue and tool points.
#[test]
fn delta_free_is_gap_and_slip_after_free_motion() {
    let (surface, positions) = patch(8, 0.006);
    let (free, n) = free_nodes(positions.len(), 3);
    let v_free: Vec<f64> = (0..3 * n).map(|i| 0.02 * (((i * 29) % 23) as f64 / 11.0 - 1.0)).collect();
    let (tool, place) = tools().swap_remove(0);
    let before = pose(place.translation.vector - Vector3::new(0.003, 0.001, -0.002), Vector3::new(0.1, -0.2, 0.05));
    let set = find(&surface, &positions, &tool, &place, ContactKind::Faces);
    let input = RowInput {
        free_of_node: &free,
        v_free: &v_free,
        dt: 0.03,
        counterpart: Counterpart::Tool {
            reference: place.translation.vector,
            motion: ToolMotion::between(&before, &place),
        },
        friction: true,
    };
    let mut rows = ContactRows::with_capacity(set.contacts.len());
    build_rows(&set.contacts, &input, &mut rows);
    assert!(!rows.is_empty());
    for (block, frame) in rows.blocks.iter().zip(&rows.frames) {
        let c = &set.contacts[block.contact as usize];
        let tissue: Vector3<f64> = (0..3)
            .filter(|&k| free[c.nodes[k] as usize] != FIXED)
            .map(|k| {
                let at = 3 * free[c.nodes[k] as usize] as usize;
                Vector3::new(v_free[at], v_free[at + 1], v_free[at + 2]) * c.weights[k] * 0.03
            })
            .sum();
        // The tool's material point that is at the contact now was here one step ago.
        let local = place.inverse_transform_point(&c.tissue_point.into());
        let tool_path = c.tissue_point - before.transform_point(&local).coords;
        let [dn, dt, ds] = [0, 1, 2].map(|k| rows.delta_free[block.first_row as usize + k]);
        let [_, t, s] = frame.directions();
        assert!((dn - (c.gap + c.normal.dot(&tissue))).abs() < 1e-15);
        assert!((dt - t.dot(&(tissue - tool_path))).abs() < 1e-15);
        assert!((ds - s.dot(&(tissue - tool_path))).abs() < 1e-15);
    }
}

#[test]
fn fixed_nodes_capacity_and_bad_numbers_are_reported() {
    let (surface, positions) = patch(8, 0.006);
    let tool = ToolShape::sphere(0.02).unwrap();
    let place = pose(Vector3::new(0.0007, 0.0011, 0.019), Vector3::zeros());
    let set = find(&surface, &positions, &tool, &place, ContactKind::Nodes);
    let count = set.contacts.len();
    assert!(count > 4);
    let (free, n) = free_nodes(positions.len(), 0);
    let v_free = vec![0.0; 3 * n];
    let input = RowInput {
        free_of_node: &free,
        v_free: &v_free,
        dt: 0.03,
        counterpart: Counterpart::Tool { reference: place.translation.vector, motion: ToolMotion::none() },
        friction: false,
    };
    let mut rows = ContactRows::with_capacity(3);
    let report = build_rows(&set.contacts, &input, &mut rows);
    assert_eq!((report.contacts, report.rows, report.dropped), (3, 3, count - 3));
    assert!(rows.blocks.iter().all(|b| b.rows == 1));

    let mut fixed = free.clone();
    fixed[set.contacts[0].nodes[0] as usize] = FIXED;
    let mut bad = set.contacts.clone();
    bad[1].gap = f64::NAN;
    bad[2].nodes = [100_000; 3];
    let mut rows = ContactRows::with_capacity(count);
    let report = build_rows(&bad, &RowInput { free_of_node: &fixed, ..input }, &mut rows);
    assert_eq!((report.rigid, report.invalid, report.contacts), (1, 2, count - 3));
    assert_eq!(rows.blocks[0].contact, 3, "blocks name their contact");
    let mut of_fixed = ContactRows::with_capacity(count);
    assert_eq!(build_fixed_rows(&bad, &RowInput { free_of_node: &fixed, ..input }, &mut of_fixed), 1);
    assert_eq!((of_fixed.blocks[0].contact, of_fixed.tissue.row(0).count()), (0, 0), "nothing there can move");
    assert_eq!(of_fixed.tool[0].force, -bad[0].normal, "but the tool is pushed back along the normal");
    // A velocity vector that is too short, or not a number, is no panic either.
    assert!(build_rows(&set.contacts, &RowInput { v_free: &v_free[..9], ..input }, &mut rows).invalid > 0);
    let nan = vec![f64::NAN; 3 * n];
    assert_eq!(build_rows(&set.contacts, &RowInput { v_free: &nan, ..input }, &mut rows).invalid, count);
    assert!(rows.is_empty());
}

proptest! {
    /// The exact displacement of a tool point differs from its linear form by at most `|rotation|² |r| / 2`.
    #[test]
    fn motion_agrees_with_the_linear_row(a in -0.2..0.2f64, b in -0.2..0.2f64, c in -0.2..0.2f64, x in -0.1..0.1f64) {
        let rotation = Vector3::new(a, b, c);
        let before = pose(Vector3::new(x, 0.1, 0.0), Vector3::new(1.0, x, 0.3));
        let step = UnitQuaternion::from_scaled_axis(rotation);
        let after = Isometry3::from_parts(Translation3::new(x + a, 0.1 - b, c), step * before.rotation);
        let motion = ToolMotion::between(&before, &after);
        let lever = Vector3::new(0.05, x, -0.02);
        let local = after.rotation.inverse() * lever;
        let exact = after.translation.vector + lever - before.transform_point(&local.into()).coords;
        prop_assert!((motion.displacement(&lever) - exact).norm() < 1e-14);
        for d in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let linear = ToolRow::new(&d, &lever).dot(&Vector3::new(a, -b, c), &rotation);
            prop_assert!((linear + d.dot(&exact)).abs() <= 0.5 * rotation.norm_squared() * lever.norm() + 1e-14);
        }
    }
}
