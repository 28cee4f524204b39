//! Surfaces that the tests share.
#![allow(dead_code, unreachable_pub)] // each test binary uses a part

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use palpate_collision::{
    ContactKind, ContactSet, DetectionConfig, DetectionReport, DetectionWorkspace, SurfaceGeometry,
};
use palpate_collision::{ToolShape, detect};

pub type Mesh = (Vec<[u32; 3]>, Vec<Vector3<f64>>);

/// The closed surface of a block `[0, size]` with `cells` squares along each axis, top at `z = size.z`.
pub fn block(size: Vector3<f64>, cells: [u32; 3]) -> Mesh {
    let mut ids: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for end in [0, cells[axis]] {
            for i in 0..cells[u] {
                for j in 0..cells[v] {
                    let corner = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[a, b]| {
                        let mut key = [0; 3];
                        key[axis] = end;
                        key[u] = a;
                        key[v] = b;
                        *ids.entry(key).or_insert_with(|| {
                            positions.push(Vector3::from_fn(|k, _| size[k] * f64::from(key[k]) / f64::from(cells[k])));
                            positions.len() as u32 - 1
                        })
                    });
                    let [a, b, c, d] = if end == 0 { [corner[0], corner[3], corner[2], corner[1]] } else { corner };
                    // Alternate diagonals, so that vertices differ in valence.
                    if (i + j) % 2 == 0 {
                        triangles.extend([[a, b, c], [a, c, d]]);
                    } else {
                        triangles.extend([[a, b, d], [b, c, d]]);
                    }
                }
            }
        }
    }
    (triangles, positions)
}

/// A block of 0.1 x 0.1 x 0.05 m with 5 mm squares.
pub fn standard_block() -> (SurfaceGeometry, Vec<Vector3<f64>>) {
    let (triangles, positions) = block(Vector3::new(0.1, 0.1, 0.05), [20, 20, 10]);
    (SurfaceGeometry::new(triangles, &positions).expect("a closed block"), positions)
}

pub fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

pub fn turned(p: Vector3<f64>, rotation: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(p), UnitQuaternion::from_scaled_axis(rotation))
}

/// A box-shaped hull about the origin with these half sizes.
pub fn box_hull(half: [f64; 3]) -> ToolShape {
    let vertices: Vec<_> =
        (0..8).map(|k| Vector3::from_fn(|i, _| if k >> i & 1 == 1 { half[i] } else { -half[i] })).collect();
    ToolShape::convex(&vertices).expect("a box")
}

pub fn config(kind: ContactKind) -> DetectionConfig {
    DetectionConfig { kind, max_contacts: 10_000, ..DetectionConfig::default() }
}

/// One detection without history.
pub fn detect_once(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &ToolShape,
    pose: &Isometry3<f64>,
    config: &DetectionConfig,
) -> (ContactSet, DetectionReport) {
    let mut out = ContactSet::default();
    let report = detect(surface, positions, tool, pose, config, &mut DetectionWorkspace::new(surface), &mut out);
    (out, report)
}
