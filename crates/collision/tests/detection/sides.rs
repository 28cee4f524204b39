//! Tools that have passed below the skin are pushed out through the side they came from; far sides do not attach.

use crate::common::{at, block, box_hull, config, detect_once, standard_block, turned};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::narrow_phase::touch;
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, SurfaceGeometry, ToolShape, detect,
};

const TOP: f64 = 0.05;
const KINDS: [ContactKind; 2] = [ContactKind::Nodes, ContactKind::Faces];

/// Tools with the height of their reference point above their lowest point.
fn tools() -> Vec<(ToolShape, Vector3<f64>)> {
    let lie = Vector3::new(0.0, 1.4, 0.2);
    vec![
        (ToolShape::sphere(0.006).unwrap(), Vector3::zeros()),
        (ToolShape::capsule(0.008, 0.004).unwrap(), Vector3::zeros()),
        (ToolShape::capsule(0.008, 0.004).unwrap(), lie),
        (ToolShape::capsule(0.008, 0.004).unwrap(), Vector3::new(0.0, 0.8, 0.2)),
        (box_hull([0.006, 0.007, 0.005]), Vector3::zeros()),
        (box_hull([0.006, 0.007, 0.005]), Vector3::new(0.4, 0.5, 0.6)),
    ]
}

/// Pressed from above to 9 mm below the skin in 0.1 mm steps: every contact pushes the tissue in, none pulls; and the
/// deepest gap never grows with depth and equals the depth of the lowest point wherever the tool touches the flat top.
#[test]
fn deep_tool_is_always_pushed_out() {
    let (surface, positions) = standard_block();
    for kind in KINDS {
        for (number, (tool, turn)) in tools().into_iter().enumerate() {
            let mut ws = DetectionWorkspace::new(&surface);
            let mut set = ContactSet::default();
            let mut before = f64::INFINITY;
            let height = -tool.support(&turned(Vector3::zeros(), turn), &-Vector3::z()).z;
            for step in 0..=260 {
                let lowest = TOP + 0.001 - 1e-4 * f64::from(step);
                let pose = turned(Vector3::new(0.0513, 0.0487, lowest + height), turn);
                let report = detect(&surface, &positions, &tool, &pose, &config(kind), &mut ws, &mut set);
                let depth = TOP - lowest;
                if height * 2.0 - depth < -0.009 {
                    break;
                }
                if depth > 0.0 && kind == ContactKind::Faces {
                    assert!(report.contacts > 0, "{number} at depth {depth}");
                    // The tool's lowest point bounds every gap; a sphere and a capsule reach it, up to rounding.
                    assert!(report.deepest_gap >= -depth - 1e-12, "{number}: {} at {depth}", report.deepest_gap);
                    assert!(report.deepest_gap <= -0.5 * depth, "{number}: {} at {depth}", report.deepest_gap);
                }
                assert!(report.deepest_gap <= before + 1e-12, "{number} {kind:?}: gap grew at depth {depth}");
                before = report.deepest_gap;
                for c in &set.contacts {
                    assert!(c.normal.z <= 1e-12, "{number} {kind:?} pulls at depth {depth}: {c:?}");
                }
                let push: Vector3<f64> = set.contacts.iter().filter(|c| c.gap < 0.0).map(|c| c.normal).sum();
                assert!(push.z <= 0.0);
            }
        }
    }
}

/// At every point of the skin around a sphere the gap falls with depth, continuously: no faster than 4 m per m, the
/// steepest place of the bend at 60 degrees being 3.5, and the normal never points out of the body.
#[test]
fn gap_is_continuous_and_monotone_in_depth() {
    let up = Vector3::z();
    let tool = ToolShape::sphere(1.0).unwrap();
    let step = 1e-3;
    for lateral in 0..=60 {
        let x = Vector3::new(0.02 * f64::from(lateral), 0.0, 0.0);
        let mut before: Option<f64> = None;
        for k in 0..3000 {
            let height = 1.5 - step * f64::from(k);
            let now = touch(&tool, &at(0.0, 0.0, height), &x, &up);
            let Some(now) = now else {
                assert!(x.x >= 1.0 && height < 0.0, "only beside a sphere below the skin: {} {height}", x.x);
                continue;
            };
            assert!(now.normal.z <= 1e-12);
            if let Some(before) = before {
                assert!(now.gap <= before + 1e-12, "grew at {} {height}", x.x);
                assert!(now.gap >= before - 4.0 * step, "fell by {} at {} {height}", before - now.gap, x.x);
            }
            before = Some(now.gap);
        }
    }
}

/// The same rule is continuous in the tissue point for every tool, also across the lines where the nearest way out of
/// the tool changes: steps of a micrometre change no penetration by more than 40 micrometres.
#[test]
fn gap_is_continuous_across_the_skin() {
    for (number, (tool, turn)) in tools().into_iter().enumerate() {
        for depth in [0.001, 0.004, 0.007, 0.012] {
            let height = -tool.support(&turned(Vector3::zeros(), turn), &-Vector3::z()).z;
            let pose = turned(Vector3::new(0.0, 0.0, height - depth), turn);
            for y in [-0.0031, 0.0, 0.0017] {
                let mut before: Option<f64> = None;
                for k in 0..30_000 {
                    let x = Vector3::new(-0.015 + 1e-6 * f64::from(k), y, 0.0);
                    // No touch, or a positive gap: no force.
                    let now = touch(&tool, &pose, &x, &Vector3::z()).map_or(0.0, |t| t.gap.min(0.0));
                    if let Some(before) = before {
                        assert!((now - before).abs() < 4e-5, "{number} depth {depth} at {x:?}: {before} to {now}");
                    }
                    before = Some(now);
                }
            }
        }
    }
}

fn sheet(thickness: f64) -> (SurfaceGeometry, Vec<Vector3<f64>>) {
    let (triangles, positions) = block(Vector3::new(0.1, 0.1, thickness), [20, 20, 1]);
    (SurfaceGeometry::new(triangles, &positions).unwrap(), positions)
}

/// On a sheet thinner than the tool only the near skin touches: from above, from below, and when the tool's middle has
/// passed through the near skin, or even both.
#[test]
fn far_side_of_a_thin_sheet_does_not_attach() {
    let thickness = 0.002;
    let (surface, positions) = sheet(thickness);
    for kind in KINDS {
        for (tool, turn) in tools() {
            for from_above in [true, false] {
                let mut ws = DetectionWorkspace::new(&surface);
                let mut set = ContactSet::default();
                let sign = if from_above { 1.0 } else { -1.0 };
                let reach = tool.support(&turned(Vector3::zeros(), turn), &(-Vector3::z() * sign)).z.abs();
                for step in 0..90 {
                    let depth = -0.001 + 1e-4 * f64::from(step);
                    let near = if from_above { thickness } else { 0.0 };
                    let pose = turned(Vector3::new(0.0513, 0.0487, near + sign * (reach - depth)), turn);
                    let report = detect(&surface, &positions, &tool, &pose, &config(kind), &mut ws, &mut set);
                    for c in &set.contacts {
                        assert!(c.normal.z * sign <= 1e-12, "{kind:?} above {from_above} depth {depth}: {c:?}");
                        // Beside the tool the far skin may be near, but never holds it.
                        let far = (c.tissue_point.z - near).abs() > 1e-9;
                        assert!(!far || c.gap > 0.0, "{kind:?} above {from_above} depth {depth}: {c:?}");
                    }
                    if kind == ContactKind::Faces && depth > 0.0 {
                        assert!(report.contacts > 0);
                    }
                }
            }
        }
    }
}

/// A tool beside the block touches the wall it faces, and one at an edge both faces, none of them from behind.
#[test]
fn walls_and_edges() {
    let (surface, positions) = standard_block();
    let tool = ToolShape::sphere(0.006).unwrap();
    for kind in KINDS {
        let (set, _) = detect_once(&surface, &positions, &tool, &at(0.1055, 0.05, 0.025), &config(kind));
        assert!(
            !set.contacts.is_empty()
                && set.contacts.iter().all(|c| c.normal.x < 0.0 && (c.tissue_point.x - 0.1).abs() < 1e-9)
        );
        let (set, _) = detect_once(&surface, &positions, &tool, &at(0.1035, 0.05, 0.0535), &config(kind));
        assert!(!set.contacts.is_empty());
        for c in &set.contacts {
            assert!(c.normal.dot(&Vector3::new(-1.0, 0.0, -1.0)) > 0.0, "{c:?}");
        }
        // Above the top near the wall: the wall, seen from behind, does not push the tool sideways.
        let (set, _) = detect_once(&surface, &positions, &tool, &at(0.0965, 0.05, 0.0545), &config(kind));
        assert!(set.contacts.iter().all(|c| (c.tissue_point.z - TOP).abs() < 1e-9), "{kind:?} {:?}", set.contacts);
    }
}

/// A tool in a cavity, between a floor and a thin flap whose upper skin is within reach: that skin is not pushed.
#[test]
fn flap_above_a_tool_in_a_cavity_is_left_alone() {
    let (mut triangles, mut positions) = block(Vector3::new(0.1, 0.1, 0.05), [20, 20, 10]);
    let (flap, above) = block(Vector3::new(0.1, 0.1, 0.006), [20, 20, 1]);
    let first = positions.len() as u32;
    triangles.extend(flap.iter().map(|t| t.map(|n| n + first)));
    positions.extend(above.iter().map(|p| p + Vector3::new(0.0, 0.0, TOP + 0.014)));
    let surface = SurfaceGeometry::new(triangles, &positions).unwrap();
    for kind in KINDS {
        for (tool, turn) in tools() {
            let turned_at = |z: f64| turned(Vector3::new(0.0513, 0.0487, z), turn);
            let lowest = -tool.support(&turned_at(0.0), &-Vector3::z()).z;
            if lowest + tool.support(&turned_at(0.0), &Vector3::z()).z > 0.0135 {
                continue; // does not fit under the flap
            }
            // Apart from the floor, touching it, and pressed 1 mm into it.
            for height in [0.0005, 0.0, -0.001] {
                let pose = turned_at(TOP + lowest + height);
                let (set, _) = detect_once(&surface, &positions, &tool, &pose, &config(kind));
                for c in &set.contacts {
                    assert!(c.tissue_point.z < TOP + 0.0145, "{kind:?} {height}: {c:?}");
                }
            }
        }
    }
}

/// A tool that starts inside is told so; outside, touching, or half way in, it is not.
#[test]
fn tool_inside_is_reported() {
    let (surface, positions) = standard_block();
    for (tool, turn) in tools() {
        let inside = |z: f64| {
            let pose = turned(Vector3::new(0.0513, 0.0487, z), turn);
            detect_once(&surface, &positions, &tool, &pose, &config(ContactKind::Faces)).1.tool_inside
        };
        assert!(inside(0.025));
        assert!(!inside(TOP + 0.02) && !inside(TOP) && !inside(TOP - 0.002));
    }
    let sphere = ToolShape::sphere(0.006).unwrap();
    let deep = |reach| {
        let config = DetectionConfig { reach, ..config(ContactKind::Faces) };
        detect_once(&surface, &positions, &sphere, &at(0.05, 0.05, TOP - 0.012), &config).1
    };
    assert!(deep(0.0).contacts == 0 && deep(0.0).tool_inside, "beyond the reach nothing pushes");
    assert!(deep(0.01).contacts > 0 && deep(0.01).tool_inside && deep(0.01).deepest_gap < -0.017);
    assert!(surface.contains(&Vector3::new(0.05, 0.05, 0.049), &positions));
    assert!(!surface.contains(&Vector3::new(0.05, 0.05, 0.051), &positions));
    assert!(!surface.contains(&Vector3::new(-1.0, 0.05, 0.02), &positions));
}

/// A probe that is wholly below the skin after one fast step leaves the way it came, though another side is nearer.
#[test]
fn fast_tool_remembers_its_side() {
    let (surface, positions) = sheet(0.014);
    let tool = ToolShape::sphere(0.004).unwrap();
    let mut ws = DetectionWorkspace::new(&surface);
    for kind in KINDS {
        let mut set = ContactSet::default();
        let mut go = |z: f64, set: &mut ContactSet| {
            detect(&surface, &positions, &tool, &at(0.0513, 0.0487, z), &config(kind), &mut ws, set)
        };
        go(0.014 + 0.006, &mut set);
        let report = go(0.0065, &mut set);
        assert!(report.tool_inside && !set.contacts.is_empty());
        assert!(
            set.contacts.iter().all(|c| c.normal.z < 0.0 && (c.tissue_point.z - 0.014).abs() < 1e-9),
            "{:?}",
            set.contacts
        );
        // Without a history the nearest skin, here the lower one, is taken.
        set.clear();
        go(0.0065, &mut set);
        assert!(!set.contacts.is_empty() && set.contacts.iter().all(|c| c.normal.z > 0.0));
    }
}

/// The deepest gap of a sphere that slides over a bumpy surface changes by no more than the sphere moves (a distance has
/// slope 1), in penetration as well as apart.
#[test]
fn sliding_sphere_has_a_continuous_gap() {
    let (triangles, mut positions) = block(Vector3::new(0.1, 0.1, 0.05), [20, 20, 10]);
    for p in positions.iter_mut().filter(|p| p.z == TOP) {
        p.z += 0.0008 * ((p.x * 300.0).sin() + (p.y * 411.0).cos());
    }
    let surface = SurfaceGeometry::new(triangles, &positions).unwrap();
    let tool = ToolShape::sphere(0.006).unwrap();
    let mut ws = DetectionWorkspace::new(&surface);
    let mut set = ContactSet::default();
    // The bumps are 1.6 mm deep: a wide margin keeps the contact all the way.
    let config = DetectionConfig { margin: 5e-3, ..config(ContactKind::Faces) };
    for height in [0.0075, 0.0055, 0.0035] {
        let mut before: Option<f64> = None;
        let move_by = Vector3::new(1.0, 0.37, 0.0).normalize() * 2e-5;
        for k in 0..3000 {
            let p = Vector3::new(0.02, 0.03, TOP + height) + move_by * f64::from(k);
            let pose = Isometry3::translation(p.x, p.y, p.z);
            let report = detect(&surface, &positions, &tool, &pose, &config, &mut ws, &mut set);
            assert!(report.deepest_gap.is_finite(), "contact lost at {k}");
            if let Some(before) = before {
                let jump: f64 = report.deepest_gap - before;
                assert!(jump.abs() <= 2e-5 + 1e-12, "jump {jump} at step {k}, height {height}");
            }
            before = Some(report.deepest_gap);
        }
    }
}
