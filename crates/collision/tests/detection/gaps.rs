//! Contacts on a flat block against closed forms; merging, capacity, determinism.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use crate::common::{at, box_hull, config, detect_once, standard_block, turned};
use nalgebra::Vector3;
use palpate_collision::contact::{FeatureKind, feature_kind};
use palpate_collision::{ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, ToolShape, detect};

const TOP: f64 = 0.05;
const KINDS: [ContactKind; 2] = [ContactKind::Nodes, ContactKind::Faces];

/// Every contact is consistent in itself: unit normal, weights that sum to 1, points and gap.
fn check(set: &ContactSet, positions: &[Vector3<f64>]) {
    for c in &set.contacts {
        assert!((c.normal.norm() - 1.0).abs() < 1e-12);
        assert!((c.weights.iter().sum::<f64>() - 1.0).abs() < 1e-14 && c.weights.iter().all(|w| *w >= 0.0));
        let x: Vector3<f64> = (0..3).map(|k| positions[c.nodes[k] as usize] * c.weights[k]).sum();
        assert!((x - c.tissue_point).norm() < 1e-14);
        assert!((c.gap - (c.tissue_point - c.tool_point).dot(&c.normal)).abs() < 1e-14);
    }
    assert!(set.contacts.windows(2).all(|w| w[0].feature < w[1].feature), "ascending and unique");
}

/// A sphere above a face: the deepest gap is height - radius on faces, and the distance of the nearest node on nodes.
#[test]
fn sphere_above_plane() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.006).unwrap();
    for (x, y, height) in [(0.0513, 0.0477, 0.0055), (0.05, 0.05, 0.0062), (0.0525, 0.0511, 0.004)] {
        let pose = at(x, y, TOP + height);
        let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
        check(&set, &positions);
        assert!((report.deepest_gap - (height - 0.006)).abs() < 1e-15, "{report:?}");
        let (set, _) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Nodes));
        check(&set, &positions);
        let expected: Vec<f64> = positions
            .iter()
            .map(|p| (p - pose.translation.vector).norm() - 0.006)
            .filter(|gap| *gap <= config(ContactKind::Nodes).margin)
            .collect();
        assert_eq!(set.contacts.len(), expected.len());
        for c in &set.contacts {
            assert!(expected.iter().any(|gap| (gap - c.gap).abs() < 1e-15));
            assert_eq!(c.weights, [1.0, 0.0, 0.0]);
            assert_eq!(feature_kind(c.feature), Some(FeatureKind::Vertex));
        }
    }
}

/// A capsule that lies on a face has contacts at both ends of its axis, each at the height of the axis less the radius.
#[test]
fn capsule_lies_on_two_ends() {
    let (surface, positions) = standard_block();
    let (half, radius) = (0.011, 0.004);
    let tool = ToolShape::capsule(half, radius).unwrap();
    for turn in [0.0, 0.3, FRAC_PI_4, FRAC_PI_2] {
        // Lay the axis along x, then turn about z.
        let lie = turned(Vector3::zeros(), Vector3::new(0.0, FRAC_PI_2, 0.0));
        let pose = turned(Vector3::new(0.0512, 0.0483, TOP + 0.0035), Vector3::new(0.0, 0.0, turn)) * lie;
        let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
        check(&set, &positions);
        assert!((report.deepest_gap - (0.0035 - radius)).abs() < 1e-14, "{turn}: {report:?}");
        let axis = pose.rotation * Vector3::z();
        let along = |c: &palpate_collision::Contact| (c.tissue_point - pose.translation.vector).dot(&axis);
        let on_axis = |c: &&palpate_collision::Contact| (c.gap - (0.0035 - radius)).abs() < 1e-12;
        let reach: Vec<f64> = set.contacts.iter().filter(on_axis).map(along).collect();
        let (least, most) = reach.iter().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        assert!((least + half).abs() < 1e-12 && (most - half).abs() < 1e-12, "{turn}: {least} {most}");
    }
}

/// A box on a face touches at its four corners and at the nodes beneath it; on an edge or corner, at that.
#[test]
fn hull_on_plane() {
    let (surface, positions) = standard_block();
    let tool = box_hull([0.006, 0.007, 0.004]);
    let pose = at(0.0513, 0.0482, TOP + 0.0038);
    let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
    check(&set, &positions);
    assert!((report.deepest_gap + 0.0002).abs() < 1e-12);
    let corners = set.contacts.iter().filter(|c| feature_kind(c.feature) == Some(FeatureKind::Triangle));
    let corners: Vec<_> = corners.filter(|c| (c.gap + 0.0002).abs() < 1e-12).collect();
    assert_eq!(corners.len(), 4, "{corners:?}");
    assert!(corners.iter().all(|c| (c.normal + Vector3::z()).norm() < 1e-12));
    let under = |p: &&Vector3<f64>| p.z == TOP && (p.x - 0.0513).abs() < 0.006 && (p.y - 0.0482).abs() < 0.007;
    let nodes = set.contacts.iter().filter(|c| feature_kind(c.feature) == Some(FeatureKind::Vertex) && c.gap < 0.0);
    assert_eq!(nodes.count(), positions.iter().filter(under).count());

    // Standing on one corner 0.5 mm deep: that corner holds the deepest contact, straight down.
    let tilt = turned(Vector3::zeros(), Vector3::new(0.6, 0.5, 0.0));
    let lowest = -tool.support(&tilt, &-Vector3::z()).z;
    let pose = turned(Vector3::new(0.0513, 0.0482, TOP + lowest - 0.0005), Vector3::new(0.6, 0.5, 0.0));
    let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
    check(&set, &positions);
    assert!((report.deepest_gap + 0.0005).abs() < 1e-12, "{report:?}");
}

/// A blade whose edge crosses triangles between nodes is held by edge against edge.
#[test]
fn blade_between_nodes_touches_edges() {
    let (surface, positions) = standard_block();
    // A prism with its edge along x, pointing down; longer than the block so that no corner touches.
    let (l, w, h) = (0.1, 0.001, 0.01);
    let vertices = [[-l, 0.0, 0.0], [l, 0.0, 0.0], [-l, -w, h], [-l, w, h], [l, -w, h], [l, w, h]].map(Vector3::from);
    let tool = ToolShape::convex(&vertices).unwrap();
    let pose = at(0.05, 0.0525, TOP - 0.0003);
    let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
    check(&set, &positions);
    assert!((report.deepest_gap + 0.0003).abs() < 1e-12, "{report:?}");
    let deep = set.contacts.iter().filter(|c| (c.gap + 0.0003).abs() < 1e-12);
    let deep: Vec<_> = deep.filter(|c| feature_kind(c.feature) == Some(FeatureKind::Edge)).collect();
    assert!(deep.len() >= 20, "an edge in each of the 20 cells: {}", deep.len());
    assert!(deep.iter().all(|c| (c.normal + Vector3::z()).norm() < 1e-12));
    // Node contacts alone would miss it: the blade passes between two rows of nodes.
    let (_, nodes) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Nodes));
    assert!(nodes.deepest_gap > 0.0);
}

/// Triangles around a vertex or edge find the same point once; near points merge into the deepest of them.
#[test]
fn duplicates_merge_into_the_deepest() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.006).unwrap();
    let node = positions.iter().find(|p| (*p - Vector3::new(0.05, 0.05, TOP)).norm() < 1e-9).expect("a node there");
    let pose = at(node.x, node.y, node.z + 0.0055);
    let (set, report) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
    assert!(report.merged >= 3, "{report:?}");
    assert_eq!(set.contacts.iter().filter(|c| (c.tissue_point - node).norm() < 1e-9).count(), 1);

    let wide = DetectionConfig { merge_distance: 4e-3, merge_angle: 3.0, ..config(ContactKind::Faces) };
    let pose = at(0.0513, 0.0477, TOP + 0.004);
    let (all, _) = detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces));
    let (few, report) = detect_once(&surface, &positions, &tool, &pose, &wide);
    assert!(few.contacts.len() < all.contacts.len() && report.merged > 0);
    for (k, a) in few.contacts.iter().enumerate() {
        assert!(few.contacts[..k].iter().all(|b| (a.tissue_point - b.tissue_point).norm() > 4e-3));
    }
    for a in &all.contacts {
        let deeper =
            |b: &palpate_collision::Contact| b.gap <= a.gap && (a.tissue_point - b.tissue_point).norm() <= 4e-3;
        assert!(few.contacts.iter().any(deeper), "each contact is kept or gave way to a deeper one near it");
    }
    // Normals that differ more than the angle keep both.
    let narrow = DetectionConfig { merge_angle: 0.0, ..wide };
    assert_eq!(detect_once(&surface, &positions, &tool, &pose, &narrow).0.contacts.len(), all.contacts.len());
}

#[test]
fn capacity_keeps_the_deepest_and_says_so() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.02).unwrap();
    let pose = at(0.0513, 0.0477, TOP + 0.015);
    for kind in KINDS {
        let (all, full) = detect_once(&surface, &positions, &tool, &pose, &config(kind));
        assert_eq!(full.dropped, 0);
        let few = DetectionConfig { max_contacts: 7, ..config(kind) };
        let (kept, report) = detect_once(&surface, &positions, &tool, &pose, &few);
        assert_eq!((report.contacts, report.dropped), (7, full.contacts - 7));
        let mut gaps: Vec<f64> = all.contacts.iter().map(|c| c.gap).collect();
        gaps.sort_by(f64::total_cmp);
        assert!(kept.contacts.iter().all(|c| c.gap <= gaps[6]));
        assert_eq!(report.deepest_gap, gaps[0]);
        check(&kept, &positions);
    }
}

/// The same bits whatever the workspace has seen before.
#[test]
fn detection_does_not_depend_on_the_workspace() {
    let (surface, positions) = standard_block();
    let tools = [ToolShape::sphere(0.007).unwrap(), ToolShape::capsule(0.01, 0.003).unwrap(), box_hull([0.004; 3])];
    for kind in KINDS {
        let mut ws = DetectionWorkspace::new(&surface);
        for step in 0..200 {
            let f = f64::from(step) * 0.1;
            let tool = &tools[step as usize % 3];
            let pose = turned(
                Vector3::new(0.05 + 0.02 * f.sin(), 0.05 + 0.02 * f.cos(), TOP + 0.003),
                Vector3::new(f, 0.3, 0.1),
            );
            let mut used = ContactSet::default();
            let used_report = detect(&surface, &positions, tool, &pose, &config(kind), &mut ws, &mut used);
            let (fresh, report) = detect_once(&surface, &positions, tool, &pose, &config(kind));
            assert_eq!((&used, used_report), (&fresh, report));
            check(&fresh, &positions);
        }
    }
}

#[test]
fn bad_parameters_are_named() {
    assert!(DetectionConfig::default().validate().is_ok());
    let bad = DetectionConfig { margin: -1.0, ..DetectionConfig::default() };
    assert!(bad.validate().unwrap_err().to_string().contains("margin = -1"));
    assert!(DetectionConfig { max_contacts: 0, ..DetectionConfig::default() }.validate().is_err());
    assert!(DetectionConfig { reach: f64::NAN, ..DetectionConfig::default() }.validate().is_err());
    let parsed: DetectionConfig = serde_json::from_str(r#"{"kind":"nodes","margin":0.001}"#).unwrap();
    assert_eq!(parsed, DetectionConfig { kind: ContactKind::Nodes, margin: 1e-3, ..DetectionConfig::default() });
}
