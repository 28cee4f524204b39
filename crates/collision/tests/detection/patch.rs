//! Does a patch of skin around a tool find the contacts that the whole surface has, and keep the nearest when it is full?

use std::collections::BTreeMap;

use crate::common::{box_hull, standard_block, turned};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::patch::renumbering::NO_NODE;
use palpate_collision::{
    Contact, ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, PatchConfig, PatchDetection, PatchGathering,
    SkinPatch, SurfaceGeometry, ToolShape, detect,
};

const TOP: f64 = 0.05;

fn config(kind: ContactKind) -> DetectionConfig {
    DetectionConfig { kind, margin: 1e-3, max_contacts: 500, ..DetectionConfig::default() }
}

fn by_feature(contacts: &[Contact]) -> BTreeMap<u64, Contact> {
    contacts.iter().map(|c| (c.feature, *c)).collect()
}

/// Nodes that carry a contact, with their weights to rounding.
fn carriers(nodes: [u32; 3], weights: [f64; 3]) -> BTreeMap<u32, i64> {
    let mut carriers = BTreeMap::new();
    for (node, weight) in nodes.into_iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
        *carriers.entry(node).or_insert(0) += (weight * 1e9).round() as i64;
    }
    carriers
}

#[test]
fn contacts_on_a_patch_are_those_on_the_whole_surface() {
    let (surface, positions) = standard_block();
    let tools = [ToolShape::sphere(0.007).unwrap(), ToolShape::capsule(0.01, 0.003).unwrap(), box_hull([0.006; 3])];
    let mut touched = 0;
    for kind in [ContactKind::Nodes, ContactKind::Faces] {
        for tool in &tools {
            let mut ws = DetectionWorkspace::new(&surface);
            let mut set = ContactSet::with_capacity(500);
            let mut gathering = PatchGathering::new(&surface);
            let mut patch = SkinPatch::new(400);
            let mut local = PatchDetection::new(400, 500, tool);
            for k in 0..60 {
                let f = f64::from(k) * 0.1;
                let z = TOP + 0.004 + 0.006 * (f * 1.3).cos();
                let turn = Vector3::new(0.2 * f, 0.1 * f, 0.0);
                let pose = turned(Vector3::new(0.05 + 0.02 * f.sin(), 0.05, z), turn);
                detect(&surface, &positions, tool, &pose, &config(kind), &mut ws, &mut set);
                // Gathered for a pose nearby, as a step does, and used at another, as a tick does.
                let away = Isometry3::translation(1e-3 * f.cos(), 1e-3 * f.sin(), 1e-3) * pose;
                let about = PatchConfig { margin: 1e-3, travel: 4e-3, side: set.side };
                let report = gathering.gather(&surface, &positions, (tool, &away), &about, |n| n % 3 != 0, &mut patch);
                assert_eq!((report.left_out, patch.clearance()), (0, 4e-3));
                let at: Vec<_> = patch.nodes().iter().map(|&n| positions[n as usize]).collect();
                assert_eq!(local.detect(&patch, &at, tool, &pose, &config(kind)), 0);
                let (all, found) = (by_feature(&set.contacts), by_feature(local.contacts()));
                assert!(all.keys().eq(found.keys()), "{kind:?} {k}: {} of {} contacts", found.len(), all.len());
                touched += found.values().filter(|c| c.gap < 0.0).count();
                for (a, b) in all.values().zip(found.values()) {
                    assert_eq!(
                        (a.gap.to_bits(), a.normal, a.tissue_point),
                        (b.gap.to_bits(), b.normal, b.tissue_point)
                    );
                    // The same nodes carry it with the same weights; which of two triangles names them is chance.
                    let named = b.nodes.map(|n| patch.nodes()[n as usize]);
                    assert_eq!(carriers(a.nodes, a.weights), carriers(named, b.weights));
                }
            }
        }
    }
    assert!(touched > 500, "{touched}");
}

#[test]
fn a_full_patch_keeps_the_nearest_and_says_how_far_it_serves() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.007).unwrap();
    let pose = Isometry3::translation(0.0513, 0.0487, TOP + 0.006);
    let about = PatchConfig { margin: 1e-3, travel: 8e-3, side: Some(Vector3::z()) };
    let mut gathering = PatchGathering::new(&surface);
    let mut gather = |nodes: usize| {
        let mut patch = SkinPatch::new(nodes);
        let report = gathering.gather(&surface, &positions, (&tool, &pose), &about, |n| n % 2 == 0, &mut patch);
        (patch, report)
    };
    let (all, everything) = gather(2000);
    assert_eq!(everything.left_out, 0);
    let distance = |patch: &SkinPatch, t: &[u32; 3]| {
        let near = |n: u32| (positions[patch.nodes()[n as usize] as usize] - pose.translation.vector).norm();
        t.iter().map(|&n| near(n)).fold(f64::INFINITY, f64::min)
    };
    let mut before = 0.0;
    for nodes in [3, 10, 40, 100] {
        let (patch, report) = gather(nodes);
        assert!(patch.nodes().len() <= nodes && patch.nodes().len() + 2 >= nodes.min(everything.nodes), "{report:?}");
        assert_eq!(report.triangles + report.left_out, everything.triangles);
        // What can move comes first, both parts ascending, and every name is found where it is.
        let (movable, fixed) = patch.nodes().split_at(patch.movable());
        assert!(movable.iter().all(|n| n % 2 == 0) && fixed.iter().all(|n| n % 2 == 1));
        assert!(movable.is_sorted() && fixed.is_sorted());
        assert!(patch.nodes().iter().enumerate().all(|(k, &n)| patch.number_of(n) == Some(k)));
        assert_eq!(patch.number_of(u32::MAX), None);
        // No triangle that was left out is nearer than the farthest that was kept, by its nearest corner and a cell.
        let farthest = patch.triangles().iter().map(|t| distance(&patch, t)).fold(0.0, f64::max);
        let kept: Vec<Vec<u32>> =
            patch.triangles().iter().map(|t| t.map(|n| patch.nodes()[n as usize]).to_vec()).collect();
        let out = all.triangles().iter().filter(|t| !kept.contains(&t.map(|n| all.nodes()[n as usize]).to_vec()));
        let nearest_out = out.map(|t| distance(&all, t)).fold(f64::INFINITY, f64::min);
        assert!(nearest_out >= farthest - 0.01, "{nodes}: {nearest_out} {farthest}");
        assert!(patch.clearance() >= before && patch.clearance() <= about.travel, "{}", patch.clearance());
        before = patch.clearance();
        let mut copy = SkinPatch::new(nodes);
        assert!(copy.copy_from(&patch) && copy == patch);
        assert!(!SkinPatch::new(2).copy_from(&patch));
    }
    assert!(before > 0.0, "a hundred nodes serve for some way");
}

#[test]
fn a_pose_that_is_none_gives_an_empty_patch() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.007).unwrap();
    let (mut gathering, mut patch) = (PatchGathering::new(&surface), SkinPatch::new(50));
    let about = PatchConfig { margin: 1e-3, travel: 8e-3, side: None };
    for pose in [
        Isometry3::translation(f64::NAN, 0.0, 0.0),
        Isometry3::translation(1e300, 0.0, 0.0),
        Isometry3::translation(0.0, 0.0, 1.0),
    ] {
        let report = gathering.gather(&surface, &positions, (&tool, &pose), &about, |_| true, &mut patch);
        assert_eq!((report.nodes, patch.nodes().len(), patch.triangles().len()), (0, 0, 0));
        let mut detection = PatchDetection::new(50, 10, &tool);
        assert_eq!(detection.detect(&patch, &[], &tool, &pose, &config(ContactKind::Faces)), 0);
        assert!(detection.contacts().is_empty());
    }
}

#[test]
fn a_feature_is_found_by_its_nodes_after_edges_and_triangles_are_numbered_anew() {
    let (surface, positions) = standard_block();
    // Triangles in reverse, begun at another corner; and one of every three alone.
    let turned = surface.triangles().iter().rev().map(|&[a, b, c]| [b, c, a]);
    let other = SurfaceGeometry::new(turned.collect(), &positions).unwrap();
    let left = surface.triangles().iter().enumerate().filter(|(k, _)| k % 3 == 0).map(|(_, t)| *t);
    let open = SurfaceGeometry::new(left.collect(), &positions).unwrap();
    let hull = box_hull([0.006; 3]);
    let mut counts = [0; 4];
    for (tool, kind) in [(ToolShape::sphere(0.007).unwrap(), ContactKind::Faces), (hull, ContactKind::Faces)] {
        let pose = turned_pose();
        let about = PatchConfig { margin: 1e-3, travel: 4e-3, side: Some(Vector3::z()) };
        let found = |surface: &SurfaceGeometry| {
            let mut patch = SkinPatch::new(400);
            let mut detection = PatchDetection::new(400, 500, &tool);
            let given = (&tool, &pose);
            PatchGathering::new(surface).gather(surface, &positions, given, &about, |n| n % 3 != 0, &mut patch);
            let at: Vec<_> = patch.nodes().iter().map(|&n| positions[n as usize]).collect();
            detection.detect(&patch, &at, &tool, &pose, &config(kind));
            (patch, detection.contacts().to_vec())
        };
        let ((patch, before), (renumbered, after), (holed, _)) = (found(&surface), found(&other), found(&open));
        let after = by_feature(&after);
        for contact in &before {
            let mut nodes = [NO_NODE; 3];
            let carriers = carriers(contact.nodes, contact.weights);
            nodes.iter_mut().zip(carriers.keys()).for_each(|(to, &k)| *to = patch.nodes()[k as usize]);
            nodes.sort_unstable();
            assert_eq!(patch.renumbered(contact.feature, &nodes), Some(contact.feature), "in its own numbering");
            let now = renumbered.renumbered(contact.feature, &nodes).expect("it is there");
            let there = after.get(&now).expect("a contact, too");
            assert!((there.tissue_point - contact.tissue_point).norm() < 1e-12, "{contact:?} {there:?}");
            counts[contact.feature as usize >> 61] += 1;
            counts[3] += usize::from(holed.renumbered(contact.feature, &nodes).is_none());
        }
    }
    assert!(counts.iter().all(|&count| count > 0), "vertices, edges, triangles, and some that are gone: {counts:?}");
}

/// A pose in which tools touch the top of the block.
fn turned_pose() -> Isometry3<f64> {
    turned(Vector3::new(0.0517, 0.0491, TOP + 0.002), Vector3::new(0.1, 0.05, 0.3))
}
