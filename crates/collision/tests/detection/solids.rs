//! Solids: signed distances, and contacts of solids with one another and with a skin.

use crate::common::{at, standard_block, turned};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::solid_contact::{Placed, SolidContact, meet};
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, Solid, SolidError, SurfaceGeometry, ToolShape,
    detect_solid,
};
use proptest::prelude::*;

/// A surface of triangles from quadrilaterals by corner.
fn quads(vertices: Vec<Vector3<f64>>, faces: &[[u32; 4]]) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    (vertices, faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// An L of two boxes: sharp outer edges, and one that turns inward.
fn corner_piece() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
    let vertices = [0.0, 1.0].iter().flat_map(|z| outline.map(|[x, y]| Vector3::new(x, y, *z))).collect();
    let sides = (0..6u32).map(|k| [k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6]);
    let caps = [[0, 3, 2, 1], [0, 5, 4, 3], [6, 7, 8, 9], [6, 9, 10, 11]];
    quads(vertices, &sides.chain(caps).collect::<Vec<_>>())
}

proptest! {
    /// The sign of the pseudo-normals is that of the winding number everywhere, in front of edges and corners too, and the
    /// distance is that to the nearest triangle.
    #[test]
    fn a_mesh_knows_its_inside(x in -1.0..3.0f64, y in -1.0..4.0f64, z in -1.0..2.0f64) {
        let (vertices, triangles) = corner_piece();
        let surface = SurfaceGeometry::new(triangles.clone(), &vertices).unwrap();
        let solid = Solid::mesh(vertices.clone(), triangles).unwrap();
        let p = Vector3::new(x, y, z);
        let pose = turned(Vector3::new(0.3, -0.2, 0.9), Vector3::new(0.5, 1.2, -0.3));
        let near = solid.signed_distance(&pose, &pose.transform_point(&p.into()).coords);
        let expected = surface.nearest(&p, &vertices).unwrap().signed_distance.abs();
        prop_assert!((near.distance.abs() - expected).abs() < 1e-12, "{} {expected}", near.distance);
        prop_assume!(expected > 1e-9);
        prop_assert_eq!(near.distance < 0.0, surface.contains(&p, &vertices));
        // The normal is the gradient: a step along it changes the distance by its length.
        let step = 1e-4 * near.distance.abs();
        let there = pose.transform_point(&p.into()).coords + near.normal * step;
        let along = solid.signed_distance(&pose, &there).distance - near.distance;
        prop_assert!((along - step).abs() < 1e-6 * step.max(1e-9), "{along} {step}");
    }
}

#[test]
fn a_box_as_a_mesh_measures_as_the_box() {
    let size = Vector3::new(0.3, 0.2, 0.1);
    let hull = Solid::cuboid(size).unwrap();
    let Solid::Convex(shape) = &hull else { panic!("a box is convex") };
    let of_hull = shape.hull().unwrap();
    let mesh = Solid::mesh(of_hull.vertices().to_vec(), of_hull.triangles().to_vec()).unwrap();
    let pose = turned(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.2, 0.4, -0.7));
    for k in 0..500 {
        let f = f64::from(k);
        let x = pose.translation.vector + Vector3::new((f * 0.77).sin(), (f * 1.31).cos(), (f * 0.37).sin()) * 0.3;
        let (a, b) = (hull.signed_distance(&pose, &x), mesh.signed_distance(&pose, &x));
        assert!((a.distance - b.distance).abs() < 1e-12, "{a:?} {b:?}");
        assert!((a.normal - b.normal).norm() < 1e-6 || a.distance < 0.0, "{a:?} {b:?}");
    }
}

fn contacts(a: &Solid, a_pose: &Isometry3<f64>, b: &Solid, b_pose: &Isometry3<f64>, margin: f64) -> Vec<SolidContact> {
    let config = DetectionConfig { margin, merge_distance: 1e-6, ..DetectionConfig::default() };
    let mut out = Vec::new();
    let report = meet(Placed { solid: a, pose: a_pose }, Placed { solid: b, pose: b_pose }, &config, &mut out);
    assert_eq!((report.contacts, report.dropped, report.non_finite), (out.len(), 0, false));
    out
}

fn sphere(radius: f64) -> Solid {
    ToolShape::sphere(radius).unwrap().into()
}

#[test]
fn shapes_meet_where_they_are_nearest() {
    let floor = Solid::half_space(Vector3::new(0.0, 0.0, 3.0)).unwrap();
    let origin = Isometry3::identity();
    let [ball] = contacts(&sphere(0.1), &at(0.4, 0.0, 0.101), &floor, &origin, 0.01)[..] else { panic!("one contact") };
    assert!((ball.gap - 0.001).abs() < 1e-15 && ball.normal == Vector3::z() && ball.point.z.abs() < 0.0011);

    let [balls] = contacts(&sphere(0.1), &at(0.0, 0.0, 0.0), &sphere(0.2), &at(0.0, 0.3, 0.0), 0.01)[..] else {
        panic!("one")
    };
    assert!(balls.gap.abs() < 1e-15 && (balls.normal + Vector3::y()).norm() < 1e-15);

    let brick = Solid::cuboid(Vector3::new(0.2, 0.1, 0.04)).unwrap();
    let flat = contacts(&brick, &at(0.0, 0.0, 0.019), &floor, &origin, 0.01);
    assert_eq!(flat.len(), 4);
    assert!(flat.iter().all(|c| (c.gap + 0.001).abs() < 1e-15 && c.normal == Vector3::z()));
    let on_edge = turned(Vector3::new(0.0, 0.0, 0.05), Vector3::new(std::f64::consts::FRAC_PI_2, 0.0, 0.0));
    assert_eq!(contacts(&brick, &on_edge, &floor, &origin, 0.01).len(), 4, "on its narrow side");

    let capsule: Solid = ToolShape::capsule(0.05, 0.02).unwrap().into();
    let lying = turned(Vector3::new(0.0, 0.0, 0.02), Vector3::new(0.0, std::f64::consts::FRAC_PI_2, 0.0));
    assert_eq!(contacts(&capsule, &lying, &floor, &origin, 0.001).len(), 2, "both ends");
    let standing = at(0.0, 0.0, 0.07);
    assert_eq!(contacts(&capsule, &standing, &floor, &origin, 0.001).len(), 1, "one end");
}

/// Two bricks that cross edge over edge touch along the common perpendicular, near and into one another, and no corner
/// of one is near the other.
#[test]
fn edges_that_cross_touch() {
    let brick = Solid::cuboid(Vector3::new(0.2, 0.1, 0.1)).unwrap();
    let quarter = std::f64::consts::FRAC_PI_4;
    // Each stands on its long edge; one lies across the other.
    let below = turned(Vector3::zeros(), Vector3::new(quarter, 0.0, 0.0));
    let half = 0.05 * std::f64::consts::SQRT_2;
    for gap in [0.002, -0.002] {
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::z() * 1.2) * below.rotation;
        let above = Isometry3::from_parts(Vector3::new(0.01, 0.005, 2.0 * half + gap).into(), turn);
        let found = contacts(&brick, &above, &brick, &below, 0.005);
        let [c] = found[..] else { panic!("one contact: {found:?}") };
        assert!((c.gap - gap).abs() < 1e-12 && (c.normal - Vector3::z()).norm() < 1e-9, "{c:?}");
        let capsule: Solid = ToolShape::capsule(0.2, 0.01).unwrap().into();
        let across = turned(Vector3::new(0.0, 0.0, half + 0.01 + gap), Vector3::new(quarter * 2.0, 0.0, 0.0));
        let found = contacts(&capsule, &across, &brick, &below, 0.005);
        let [c] = found[..] else { panic!("one contact of the axis: {found:?}") };
        assert!((c.gap - gap).abs() < 1e-12 && (c.normal - Vector3::z()).norm() < 1e-9, "{c:?}");
    }
    // A brick that hangs over the side of another stands on corners and crossings, all upright, none sideways.
    let wide = Solid::cuboid(Vector3::new(0.3, 0.3, 0.1)).unwrap();
    let over = turned(Vector3::new(0.148, 0.02, 0.0999), Vector3::new(0.0, 0.0, 0.3));
    let found = contacts(&brick, &over, &wide, &Isometry3::identity(), 0.004);
    assert!(found.len() >= 4 && found.iter().all(|c| c.normal.z > 0.999 && (c.gap + 1e-4).abs() < 1e-9), "{found:?}");
}

/// Who meets whom changes only the sign of the normals.
#[test]
fn meeting_is_mutual() {
    let (vertices, triangles) = corner_piece();
    let vertices = vertices.iter().map(|v| v * 0.05).collect();
    let shapes = [
        sphere(0.04),
        ToolShape::capsule(0.05, 0.02).unwrap().into(),
        Solid::cuboid(Vector3::new(0.1, 0.08, 0.06)).unwrap(),
        Solid::mesh(vertices, triangles).unwrap(),
    ];
    let mut met = 0;
    for (i, a) in shapes.iter().enumerate() {
        for (j, b) in shapes.iter().enumerate() {
            for k in 0..20 {
                let f = f64::from(k) + 0.1 * (i as f64) + 0.01 * (j as f64);
                let pose = turned(
                    Vector3::new(0.08 * (f * 0.7).sin(), 0.07 * (f * 1.1).cos(), 0.06),
                    Vector3::new(f, 0.3 * f, -0.2),
                );
                let origin = Isometry3::identity();
                let (one, other) = (contacts(a, &pose, b, &origin, 0.01), contacts(b, &origin, a, &pose, 0.01));
                // Which of two contacts at one place is kept may differ; the deepest of all is the same.
                let deepest = |all: &[SolidContact]| all.iter().map(|c| c.gap).fold(f64::INFINITY, f64::min);
                let gaps = [deepest(&one), deepest(&other)];
                assert!(gaps[0] == gaps[1] || (gaps[0] - gaps[1]).abs() < 1e-12, "shapes {i} {j}, place {k}: {gaps:?}");
                met += usize::from(gaps[0].is_finite());
            }
        }
    }
    assert!(met > 100, "{met}");
}

#[test]
fn the_deepest_contacts_are_kept_and_bad_places_reported() {
    let brick = Solid::cuboid(Vector3::new(0.2, 0.1, 0.04)).unwrap();
    let floor = Solid::half_space(Vector3::z()).unwrap();
    let tilted = turned(Vector3::new(0.0, 0.0, 0.02), Vector3::new(0.0, 0.01, 0.0));
    let config = DetectionConfig { margin: 0.01, max_contacts: 2, merge_distance: 0.0, ..DetectionConfig::default() };
    let mut out = Vec::with_capacity(2);
    let origin = Isometry3::identity();
    let place = |pose| Placed { solid: &brick, pose };
    let report = meet(place(&tilted), Placed { solid: &floor, pose: &origin }, &config, &mut out);
    assert_eq!((report.contacts, report.dropped), (2, 2));
    assert!(out.iter().all(|c| c.gap < 0.0), "{out:?}");
    let nowhere = at(f64::NAN, 0.0, 0.0);
    let report = meet(place(&nowhere), Placed { solid: &floor, pose: &origin }, &config, &mut out);
    assert!(report.non_finite && out.is_empty());
}

#[test]
fn a_skin_touches_a_plane_and_a_mesh_at_its_nodes() {
    let (surface, positions) = standard_block();
    let mut ws = DetectionWorkspace::new(&surface);
    let mut out = ContactSet::with_capacity(2000);
    let config =
        DetectionConfig { kind: ContactKind::Faces, margin: 1e-3, max_contacts: 2000, ..DetectionConfig::default() };
    let floor = Solid::half_space(Vector3::z()).unwrap();
    let below = at(0.0, 0.0, -0.0005);
    let report = detect_solid(&surface, &positions, &floor, &below, &config, &mut ws, &mut out);
    assert_eq!((report.contacts, report.dropped), (21 * 21, 0));
    assert!(out.contacts.iter().all(|c| (c.gap - 0.0005).abs() < 1e-15 && c.normal == Vector3::z()));
    // The inner corner of the L takes the edge of the block: nodes near both of its sides keep to the nearer.
    let (vertices, triangles) = corner_piece();
    let piece = Solid::mesh(vertices.iter().map(|v| v * 0.1).collect(), triangles).unwrap();
    let pose = at(-0.1005, -0.1005, -0.02);
    let report = detect_solid(&surface, &positions, &piece, &pose, &config, &mut ws, &mut out);
    assert!(report.contacts > 100, "{report:?}");
    // Beyond the end of the arm nodes are nearest to its edge.
    for c in out.contacts.iter().filter(|c| c.tissue_point.x < 0.099) {
        assert!((c.gap - 0.0005).abs() < 1e-12, "{c:?}");
        assert!((c.normal - Vector3::x()).norm() < 1e-9 || (c.normal - Vector3::y()).norm() < 1e-9, "{c:?}");
    }
}

#[test]
fn shapes_that_are_none_are_refused() {
    for normal in [Vector3::zeros(), Vector3::new(f64::NAN, 0.0, 1.0), Vector3::new(f64::INFINITY, 0.0, 0.0)] {
        assert!(matches!(Solid::half_space(normal), Err(SolidError::Normal(_))), "{normal:?}");
    }
    for size in [Vector3::new(1.0, 0.0, 1.0), Vector3::new(1.0, -1.0, 1.0), Vector3::repeat(f64::NAN)] {
        assert!(matches!(Solid::cuboid(size), Err(SolidError::Size(_))), "{size:?}");
    }
    assert!(matches!(Solid::mesh(vec![Vector3::zeros()], vec![[0, 1, 2]]), Err(SolidError::Surface(_))));
}
