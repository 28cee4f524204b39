//! What holds for any shape, pose and surface, also with numbers that are not numbers.

use crate::common::{block, config, turned};
use nalgebra::Vector3;
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, SurfaceGeometry, ToolShape, detect,
};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    (-size..size, -size..size, -size..size).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn any_tool() -> impl Strategy<Value = ToolShape> {
    prop_oneof![
        (1e-3..2e-2).prop_map(|r| ToolShape::sphere(r).unwrap()),
        (0.0..2e-2, 1e-3..1e-2).prop_map(|(l, r)| ToolShape::capsule(l, r).unwrap()),
        proptest::collection::vec(vector(1e-2), 8..20).prop_filter_map("flat hull", |v| ToolShape::convex(&v).ok()),
    ]
}

/// A bumpy block and a list of nodes to spoil.
fn any_surface() -> impl Strategy<Value = (Vec<[u32; 3]>, Vec<Vector3<f64>>)> {
    (1u32..7, 1u32..7, 1u32..4, 0.0..4e-3f64, 0.0..6.0f64).prop_map(|(nx, ny, nz, bump, phase)| {
        let (triangles, mut positions) = block(Vector3::new(0.06, 0.05, 0.02), [nx, ny, nz]);
        for p in &mut positions {
            p.z += bump * (p.x * 200.0 + phase).sin() * (p.y * 150.0).cos();
        }
        (triangles, positions)
    })
}

proptest! {
    /// Every contact is sound, whatever comes in; what is not finite is counted and touches nothing.
    #[test]
    fn contacts_are_sound(
        (triangles, mut positions) in any_surface(),
        tool in any_tool(),
        (p, turn) in (vector(0.04), vector(3.0)),
        nodes in any::<bool>(),
        spoiled in proptest::collection::vec((0usize..500, 0usize..3, prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300)]), 0..4),
        bad_pose in 0..20,
        capacity in 1usize..40,
        merge in prop_oneof![Just(0.0), Just(3e-3)],
    ) {
        let mut surface = SurfaceGeometry::new(triangles, &positions).unwrap();
        for (node, axis, value) in spoiled {
            let node = node % positions.len();
            positions[node][axis] = value;
        }
        let finite = |t: &[u32; 3]| t.iter().all(|&n| positions[n as usize].iter().all(|x| x.abs() < 1e6));
        let spoiled = surface.triangles().iter().filter(|t| !finite(t)).count();
        prop_assert_eq!(surface.refit(&positions), spoiled);
        let mut pose = turned(p + Vector3::new(0.03, 0.025, 0.01), turn);
        if bad_pose == 0 {
            pose.translation.vector.x = f64::NAN;
        }
        let kind = if nodes { ContactKind::Nodes } else { ContactKind::Faces };
        let config = DetectionConfig { max_contacts: capacity, merge_distance: merge, ..config(kind) };
        let mut set = ContactSet::default();
        let mut ws = DetectionWorkspace::new(&surface);
        let report = detect(&surface, &positions, &tool, &pose, &config, &mut ws, &mut set);
        prop_assert_eq!(report.contacts, set.contacts.len());
        prop_assert!(report.contacts <= capacity);
        prop_assert!(report.dropped == 0 || report.contacts == capacity);
        prop_assert_eq!(report.non_finite, spoiled + usize::from(bad_pose == 0));
        prop_assert!(bad_pose != 0 || report.contacts == 0);
        for c in &set.contacts {
            prop_assert!((c.normal.norm() - 1.0).abs() < 1e-9);
            prop_assert!(c.gap <= config.margin && c.gap.is_finite() && report.deepest_gap <= c.gap);
            prop_assert!((c.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(c.weights.iter().all(|w| *w >= 0.0));
            prop_assert!(((c.tissue_point - c.tool_point).dot(&c.normal) - c.gap).abs() < 1e-12);
            let x: Vector3<f64> = (0..3).map(|k| positions[c.nodes[k] as usize] * c.weights[k]).sum();
            prop_assert!((x - c.tissue_point).norm() < 1e-12);
        }
        // The same again, with the history of the first call.
        let mut again = ContactSet::default();
        let repeated = detect(&surface, &positions, &tool, &pose, &config, &mut ws, &mut again);
        prop_assert_eq!((repeated, again), (report, set));
    }

    /// The nearest point by the tree is the nearest of all triangles, and inside by winding agrees with its sign.
    #[test]
    fn nearest_is_nearest((triangles, positions) in any_surface(), p in vector(0.05)) {
        let surface = SurfaceGeometry::new(triangles, &positions).unwrap();
        let p = p + Vector3::new(0.03, 0.025, 0.01);
        let near = surface.nearest(&p, &positions).unwrap();
        let least = (0..surface.triangles().len() as u32)
            .map(|t| {
                let corners = surface.corners(t, &positions).unwrap();
                (palpate_collision::triangle::closest_on_triangle(&p, &corners).position(&corners) - p).norm()
            })
            .fold(f64::INFINITY, f64::min);
        prop_assert_eq!(near.signed_distance.abs(), least);
        prop_assume!(least > 1e-6);
        prop_assert_eq!(surface.contains(&p, &positions), near.signed_distance < 0.0);
    }

    /// A tool that touches nothing within its margin reports nothing, and one that penetrates reports it (faces).
    #[test]
    fn contact_is_found_exactly_when_there_is_one((triangles, positions) in any_surface(), r in 2e-3..1e-2, p in vector(0.05)) {
        let surface = SurfaceGeometry::new(triangles, &positions).unwrap();
        let p = p + Vector3::new(0.03, 0.025, 0.01);
        let near = surface.nearest(&p, &positions).unwrap();
        prop_assume!(near.signed_distance > 1e-4);
        let tool = ToolShape::sphere(r).unwrap();
        let (mut ws, mut set) = (DetectionWorkspace::new(&surface), ContactSet::default());
        let report = detect(&surface, &positions, &tool, &turned(p, Vector3::zeros()), &config(ContactKind::Faces), &mut ws, &mut set);
        let gap = near.signed_distance - r;
        prop_assume!((gap - 2e-3).abs() > 1e-9);
        prop_assert_eq!(report.contacts > 0, gap < 2e-3);
        if report.contacts > 0 && gap > 0.0 {
            // The bend of normals near the tool's equator may shorten a gap by 6e-4 of the radius, never lengthen it.
            prop_assert!(report.deepest_gap <= gap + 1e-12, "{} {}", report.deepest_gap, gap);
            prop_assert!(report.deepest_gap >= gap - 1e-3 * r, "{} {}", report.deepest_gap, gap);
        }
    }
}
