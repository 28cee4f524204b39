//! Tools of several parts touch what their parts touch, and say so in scene files.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use palpate_collision::shape::ToolShape;
use palpate_collision::tool::{Jaw, MAX_PARTS, Part, Tool, ToolPose, jaw_of, part_of};
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, SurfaceGeometry, Turn, detect, detect_tool,
};

/// A flat sheet of `n` by `n` cells of 1 cm at z = 0.
fn sheet(n: u32) -> (SurfaceGeometry, Vec<Vector3<f64>>) {
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let nodes: Vec<_> = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| Vector3::new(f64::from(i) * 0.01, f64::from(j) * 0.01, 0.0)))
        .collect();
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = cells
        .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]);
    (SurfaceGeometry::new(triangles.collect(), &nodes).unwrap(), nodes)
}

fn part(shape: &ToolShape, x: f64, y: f64, z: f64) -> Part {
    Part { shape: shape.clone(), place: Isometry3::translation(x, y, z), jaw: None }
}

#[test]
fn a_compound_of_two_touches_what_the_two_touch() {
    let (surface, nodes) = sheet(8);
    let shapes = [
        ToolShape::sphere(0.012).unwrap(),
        ToolShape::capsule(0.01, 0.008).unwrap(),
        ToolShape::cuboid(Vector3::new(0.02, 0.01, 0.02)).unwrap(),
    ];
    for kind in [ContactKind::Nodes, ContactKind::Faces] {
        let config = DetectionConfig { kind, max_contacts: 500, ..DetectionConfig::default() };
        for shape in &shapes {
            let places = [[0.021, 0.024, 0.007], [0.055, 0.052, 0.0068]];
            let parts = places.map(|[x, y, z]| part(shape, x, y, z)).to_vec();
            let tool = Tool::compound(parts, None).unwrap();
            let mut ws = DetectionWorkspace::new(&surface);
            let mut all = ContactSet::with_capacity(500);
            let report =
                detect_tool(&surface, &nodes, &tool, &Isometry3::identity().into(), &config, &mut ws, &mut all);
            let mut expected = Vec::new();
            for (k, [x, y, z]) in places.into_iter().enumerate() {
                let mut one = ContactSet::with_capacity(500);
                detect(&surface, &nodes, shape, &Isometry3::translation(x, y, z), &config, &mut ws, &mut one);
                expected.extend(one.contacts.iter().map(|c| (k, *c)));
            }
            assert!(report.contacts > 1 && report.contacts == expected.len(), "{kind:?} {shape:?}");
            for contact in &all.contacts {
                let k = part_of(contact.feature);
                let same = expected.iter().any(|(part, c)| {
                    let features = c.feature & !(0x7f << 54) == contact.feature & !(0x7f << 54);
                    *part == k && features && c.gap == contact.gap && c.normal == contact.normal
                });
                assert!(same, "{kind:?} {contact:?}");
            }
            assert_eq!(all.other_sides, [Some(Vector3::z())]);
        }
    }
}

#[test]
fn jaws_on_both_sides_of_a_fold_each_remember_their_own_skin() {
    // A sheet bent to a fold: two walls 6 mm apart, closed above.
    let (n, height) = (6u32, 0.03);
    let at = |side: u32, i: u32, j: u32| side * (n + 1) * (n + 1) + j * (n + 1) + i;
    let mut nodes = Vec::new();
    for side in [-1.0, 1.0] {
        for j in 0..=n {
            for i in 0..=n {
                let (y, z) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                nodes.push(Vector3::new(side * 0.003, 0.03 * y, height * z));
            }
        }
    }
    let mut triangles = Vec::new();
    for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
        let corners = |side| [at(side, i, j), at(side, i + 1, j), at(side, i + 1, j + 1), at(side, i, j + 1)];
        let [a, b, c, d] = corners(0);
        triangles.extend([[a, c, b], [a, d, c]]);
        let [a, b, c, d] = corners(1);
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    for i in 0..n {
        let [a, b, c, d] = [at(0, i, n), at(1, i, n), at(1, i + 1, n), at(0, i + 1, n)];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let surface = SurfaceGeometry::new(triangles, &nodes).unwrap();
    let text = r#"
        kind = "compound"
        parts = [
            { shape = { kind = "sphere", radius = 0.004 }, position = [0, 0, -0.03], jaw = 1 },
            { shape = { kind = "sphere", radius = 0.004 }, position = [0, 0, -0.03], jaw = 2 },
        ]
        gripper = { pivot = [0, 0, 0], axis = [0, -1, 0], open_degrees = 60 }
    "#;
    let tool: Tool = toml::from_str(text).unwrap();
    let mut ws = DetectionWorkspace::new(&surface);
    let mut set = ContactSet::with_capacity(64);
    let config = DetectionConfig { margin: 1e-3, ..DetectionConfig::default() };
    // Centres 5.5 mm from the middle: 1.5 mm deep in each wall.
    for half in [0.012, 0.009, 0.0065, 0.0055] {
        let pose = ToolPose { frame: Isometry3::translation(0.0, 0.015, 0.05), opening: 2.0 * f64::asin(half / 0.03) };
        detect_tool(&surface, &nodes, &tool, &pose, &config, &mut ws, &mut set);
    }
    assert_eq!((set.side, set.other_sides.as_slice()), (Some(Vector3::x()), &[Some(-Vector3::x())][..]));
    let deepest = |jaw| {
        let of_jaw = set.contacts.iter().filter(|c| jaw_of(c.feature) == Some(jaw));
        of_jaw.min_by(|a, b| a.gap.total_cmp(&b.gap)).copied().unwrap()
    };
    let (first, second) = (deepest(Jaw::First), deepest(Jaw::Second));
    for (contact, x) in [(first, 1.0), (second, -1.0)] {
        assert!((contact.normal + Vector3::x() * x).norm() < 1e-12, "{contact:?}");
        assert!((contact.gap + 0.0015).abs() < 1e-12, "{contact:?}");
    }
}

#[test]
fn the_opening_turns_the_jaws_about_the_pivot_by_half_each() {
    let text = r#"
        kind = "compound"
        parts = [
            { shape = { kind = "sphere", radius = 0.001 }, position = [0.03, 0, 0.01], jaw = 1 },
            { shape = { kind = "sphere", radius = 0.001 }, position = [0.03, 0, 0.01], jaw = 2 },
            { shape = { kind = "sphere", radius = 0.001 } },
        ]
        gripper = { pivot = [0.01, 0, 0.01], axis = [0, 0, 2], closed_degrees = 10, open_degrees = 50 }
    "#;
    let tool: Tool = toml::from_str(text).unwrap();
    let hinge = *tool.hinge().unwrap();
    assert!((hinge.opening(0.5) - 30f64.to_radians()).abs() < 1e-15 && hinge.opening(7.0) == hinge.open);
    let frame = Isometry3::from_parts(
        Translation3::new(0.1, 0.2, 0.3),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.4),
    );
    let pose = ToolPose { frame, opening: 0.6 };
    for (k, angle) in [(0, 0.3f64), (1, -0.3)] {
        let expected = frame * nalgebra::Point3::new(0.01 + 0.02 * angle.cos(), 0.02 * angle.sin(), 0.01);
        let found = tool.part_pose(k, &pose).translation.vector;
        assert!((found - expected.coords).norm() < 1e-16 * 10.0, "{found}");
    }
    assert_eq!(tool.part_pose(2, &pose), frame);
    // The torque of a force on a jaw is its power over the rate of the opening.
    let (force, at) = (Vector3::new(1.0, -2.0, 0.5), tool.part_pose(0, &pose).translation.vector);
    let e = 1e-6;
    let place = |opening| tool.part_pose(0, &ToolPose { frame, opening }).translation.vector;
    let rate = (place(0.6 + e) - place(0.6 - e)) / (2.0 * e);
    let torque = hinge.torque(&pose, Some(Jaw::First), &at, &force, &Vector3::zeros());
    assert!((torque - force.dot(&rate)).abs() < 1e-9, "{torque}");
    assert_eq!(hinge.torque(&pose, None, &at, &force, &Vector3::zeros()), 0.0);
    // Nothing of the tool goes farther than its path says.
    let other = ToolPose { frame: frame * Isometry3::translation(0.001, 0.0, 0.0), opening: 0.2 };
    let path = tool.path(&pose, &other);
    for k in 0..3 {
        let moved = (tool.part_pose(k, &other).translation.vector - tool.part_pose(k, &pose).translation.vector).norm();
        assert!(moved <= path + 1e-12, "{moved} {path}");
    }
}

#[test]
fn tools_come_back_from_their_text_and_mistakes_name_key_and_remedy() {
    for text in [
        r#"kind = "sphere"
radius = 0.01"#,
        r#"kind = "box"
size = [0.01, 0.02, 0.03]"#,
        r#"kind = "compound"
parts = [
  { shape = { kind = "capsule", half_length = 0.01, radius = 0.002 }, position = [0.01, 0.0, 0.0], rotation = { axis = [0, 1, 0], degrees = 30 }, jaw = 1 },
  { shape = { kind = "box", size = [0.01, 0.01, 0.01] }, rotation = [0.5, 0.5, 0.5, 0.5], jaw = 2 },
]
gripper = { pivot = [0, 0, 0], axis = [0, 1, 0], closed_degrees = -5, open_degrees = 40 }"#,
    ] {
        let tool: Tool = toml::from_str(text).unwrap();
        let again: Tool = toml::from_str(&toml::to_string(&tool).unwrap()).unwrap();
        assert_eq!(tool.parts().len(), again.parts().len());
        for (a, b) in tool.parts().iter().zip(again.parts()) {
            assert_eq!((&a.shape, a.jaw), (&b.shape, b.jaw));
            assert!((a.place.inverse() * b.place).rotation.angle() < 1e-12);
        }
        let angles = |tool: &Tool| tool.hinge().map(|h| [h.closed, h.open]);
        let close =
            angles(&tool).zip(angles(&again)).is_none_or(|(a, b)| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-15);
        assert!(close);
    }
    let ball = r#"{ shape = { kind = "sphere", radius = 0.01 }"#;
    let grip = "gripper = { pivot = [0, 0, 0], axis = [0, 1, 0], open_degrees = 40 }";
    for (text, expected) in [
        ("parts = []".to_string(), "at least one part"),
        (format!("parts = [{}]", format!("{ball} }},").repeat(MAX_PARTS + 1)), "33 parts"),
        (format!("parts = [{ball}, jaw = 1 }}]"), "no `gripper`"),
        (format!("parts = [{ball}, jaw = 3 }}]\n{grip}"), "must be 1 or 2"),
        (format!("parts = [{ball}, jaw = 1 }}]\n{grip}"), "no part has jaw = 2"),
        (format!("parts = [{ball}, rotation = [0, 0, 0, 0] }}]"), "parts[0].rotation has no direction"),
        (format!("parts = [{ball}, rotation = {{ axis = [1, 0, 0] }} }}]"), "a rotation is a quaternion"),
        (format!("parts = [{ball}, position = [inf, 0, 0] }}]"), "parts[0].position"),
        (
            format!("parts = [{ball} }}]\ngripper = {{ pivot = [0, 0, 0], axis = [0, 0, 0], open_degrees = 4 }}"),
            "gripper.axis",
        ),
        (
            format!("parts = [{ball} }}]\ngripper = {{ pivot = [0, 0, 0], axis = [0, 0, 1], open_degrees = -4 }}"),
            "above closed_degrees",
        ),
        (
            format!("parts = [{ball} }}]\ngripper = {{ pivot = [0, 0, 0], axis = [0, 0, 1], open_degrees = 400 }}"),
            "open_degrees = 400",
        ),
    ] {
        let error = toml::from_str::<Tool>(&format!("kind = \"compound\"\n{text}")).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let error = toml::from_str::<Tool>("kind = \"sphere\"\nradius = -1").unwrap_err().to_string();
    assert!(error.contains("radius = -1"), "{error}");
    assert_eq!(Turn::NONE.rotation(), Some(UnitQuaternion::identity()));
}
