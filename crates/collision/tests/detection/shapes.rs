//! Distances of tools against closed forms, against parry, and against their own definition.

use crate::common::{box_hull, turned};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::convert::to_parry;
use palpate_collision::{ShapeError, ToolShape};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::ConvexPolyhedron;
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    (-size..size, -size..size, -size..size).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn any_tool() -> impl Strategy<Value = ToolShape> {
    prop_oneof![
        (1e-3..2e-2).prop_map(|r| ToolShape::sphere(r).unwrap()),
        (0.0..2e-2, 1e-3..1e-2).prop_map(|(l, r)| ToolShape::capsule(l, r).unwrap()),
        proptest::collection::vec(vector(1e-2), 8..30).prop_filter_map("flat hull", |v| ToolShape::convex(&v).ok()),
    ]
}

proptest! {
    /// The gradient of the distance is the normal, `point` lies on the surface at that distance, and the normal's
    /// support plane passes through it.
    #[test]
    fn distance_point_and_normal_agree(tool in any_tool(), p in vector(0.05), turn in vector(3.0), x in vector(0.04)) {
        let pose = turned(p, turn);
        let x = x + p;
        let near = tool.signed_distance(&pose, &x);
        prop_assume!(near.normal != Vector3::zeros());
        prop_assert!((near.normal.norm() - 1.0).abs() < 1e-12);
        prop_assert!((x - near.point - near.normal * near.distance).norm() < 1e-9);
        prop_assert!(tool.signed_distance(&pose, &near.point).distance.abs() < 1e-9);
        prop_assert!((tool.support(&pose, &near.normal) - near.point).dot(&near.normal).abs() < 1e-9);
        // Differences of a distance are exact to (step / radius of curvature)²; next to an edge of a hull the distance
        // bends within the step, which a one-sided check cannot see: compare with the smaller of the two sides.
        let step = 1e-7;
        for k in 0..3 {
            let e = Vector3::ith(k, step);
            let forward = (tool.signed_distance(&pose, &(x + e)).distance - near.distance) / step;
            let backward = (near.distance - tool.signed_distance(&pose, &(x - e)).distance) / step;
            let off = (forward - near.normal[k]).abs().min((backward - near.normal[k]).abs());
            prop_assert!(off < 2e-4, "{off} {near:?}");
        }
    }

    /// Parry's projection onto the same hull agrees from outside.
    #[test]
    fn hull_agrees_with_parry(points in proptest::collection::vec(vector(1e-2), 8..30), x in vector(0.03)) {
        let Ok(tool) = ToolShape::convex(&points) else { return Ok(()) };
        let hull = tool.hull().unwrap();
        let parry = ConvexPolyhedron::from_convex_hull(&hull.vertices().iter().map(to_parry).collect::<Vec<_>>());
        let Some(parry) = parry else { return Ok(()) };
        let ours = tool.signed_distance(&Isometry3::identity(), &x).distance;
        prop_assume!(ours > 1e-6);
        let theirs = parry.distance_to_local_point(to_parry(&x), true);
        // GJK stops at a relative 1e-6 or so of the distance.
        prop_assert!((ours - theirs).abs() < 1e-6 * (1e-2 + ours), "{ours} {theirs}");
    }

    /// A point is within the outline exactly if the line through it along the direction meets the tool.
    #[test]
    fn outline_is_what_a_line_meets(tool in any_tool(), turn in vector(3.0), x in vector(0.03), d in vector(1.0)) {
        prop_assume!(d.norm() > 0.1);
        let d = d.normalize();
        let pose = turned(Vector3::zeros(), turn);
        let lateral = tool.outline(&pose, &x, &d).distance;
        prop_assume!(lateral.abs() > 1e-5);
        // The distance is convex along a line: golden section finds its least value.
        let f = |t: f64| tool.signed_distance(&pose, &(x + d * t)).distance;
        let (mut a, mut b) = (-0.2, 0.2);
        for _ in 0..80 {
            let (c, e) = (b - 0.618 * (b - a), a + 0.618 * (b - a));
            if f(c) < f(e) { b = e } else { a = c }
        }
        let least = f((a + b) / 2.0);
        prop_assert_eq!(least < 0.0, lateral < 0.0, "least {} lateral {}", least, lateral);
    }

    /// Box and ball hold the tool.
    #[test]
    fn bounds_hold_the_tool(tool in any_tool(), p in vector(0.05), turn in vector(3.0), d in vector(1.0)) {
        prop_assume!(d.norm() > 0.1);
        let pose = turned(p, turn);
        let s = tool.support(&pose, &d.normalize());
        let (low, high) = tool.bounding_box(&pose);
        let (centre, radius) = tool.bounding_sphere(&pose);
        prop_assert!((0..3).all(|k| low[k] - 1e-12 <= s[k] && s[k] <= high[k] + 1e-12));
        prop_assert!((s - centre).norm() <= radius + 1e-12);
    }
}

#[test]
fn closed_forms() {
    let pose = turned(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.0, std::f64::consts::FRAC_PI_2, 0.0));
    // The capsule's axis now points along x.
    let capsule = ToolShape::capsule(0.02, 0.005).unwrap();
    let d = |x, y, z| capsule.signed_distance(&pose, &(pose.translation.vector + Vector3::new(x, y, z))).distance;
    assert!((d(0.01, 0.006, 0.0) - 0.001).abs() < 1e-15);
    assert!((d(0.03, 0.0, 0.0) - 0.005).abs() < 1e-15);
    assert!((d(0.023, 0.0, 0.004) - 0.0).abs() < 1e-15);
    assert!((d(0.0, 0.0, 0.002) + 0.003).abs() < 1e-15);
    let sphere = ToolShape::sphere(0.005).unwrap();
    assert!((sphere.signed_distance(&pose, &Vector3::new(0.1, 0.2, 0.308)).distance - 0.003).abs() < 1e-15);
    let block = box_hull([0.01, 0.02, 0.03]);
    let b = |x, y, z| block.signed_distance(&Isometry3::identity(), &Vector3::new(x, y, z)).distance;
    assert!((b(0.013, 0.024, 0.0) - 0.005).abs() < 1e-15);
    assert!((b(0.0, 0.018, 0.0) + 0.002).abs() < 1e-15);
    assert!((b(0.013, 0.024, 0.03 + 0.012) - 0.013).abs() < 1e-15);
    assert_eq!(block.hull().unwrap().edges().len(), 12, "diagonals of faces are no edges");
    assert_eq!(block.hull().unwrap().face_normals().len(), 6);
}

#[test]
fn bad_shapes_are_refused_with_the_value() {
    assert!(matches!(ToolShape::sphere(-1.0), Err(ShapeError::Length { what: "radius", value: -1.0, .. })));
    assert!(ToolShape::sphere(f64::NAN).is_err());
    assert!(ToolShape::capsule(-0.1, 0.1).is_err());
    let flat: Vec<_> = (0..8).map(|k| Vector3::new(f64::from(k), f64::from(k * k), 0.0)).collect();
    assert!(matches!(ToolShape::convex(&flat), Err(ShapeError::Hull { points: 8, .. })));
    assert!(ToolShape::convex(&[Vector3::zeros(); 3]).is_err());
    assert!(ToolShape::convex(&[]).is_err());
    let nan = vec![Vector3::zeros(), Vector3::x(), Vector3::new(0.0, f64::NAN, 0.0), Vector3::z()];
    assert_eq!(ToolShape::convex(&nan), Err(ShapeError::NotFinite { what: "vertices", index: 2 }));
}

#[test]
fn shapes_are_read_and_written() {
    for text in [
        r#"{"kind":"sphere","radius":0.005}"#,
        r#"{"kind":"capsule","half_length":0.02,"radius":0.003}"#,
        r#"{"kind":"convex","vertices":[[0.0,0.0,0.0],[0.1,0.0,0.0],[0.0,0.1,0.0],[0.0,0.0,0.1]]}"#,
    ] {
        let shape: ToolShape = serde_json::from_str(text).unwrap();
        assert_eq!(serde_json::from_str::<ToolShape>(&serde_json::to_string(&shape).unwrap()).unwrap(), shape);
    }
    let refused = |text: &str| serde_json::from_str::<ToolShape>(text).unwrap_err().to_string();
    assert!(refused(r#"{"kind":"sphere","radius":0}"#).contains("radius = 0 m must be positive"));
    assert!(refused(r#"{"kind":"sphere","radius":1,"colour":2}"#).contains("colour"));
    assert!(refused(r#"{"kind":"cube"}"#).contains("cube"));
}
