//! Detection: from a surface and a solid to contacts.
//!
//! Convex solids are found as a tool is ([`detect`]). A half-space and a mesh meet the surface at its
//! nodes, with the solid's signed distance as gap and its gradient as normal: exact for a plane, whose deepest point
//! against a triangle is a corner of it; a mesh whose spikes are finer than the surface can pass between nodes.

use nalgebra::{Isometry3, Vector3};

use crate::broad_phase::{SurfaceGeometry, is_usable};
use crate::contact::{Contact, ContactSet, FeatureKind, feature_id};
use crate::detection::{DetectionConfig, DetectionReport, DetectionWorkspace, detect, keep_deepest};
use crate::features::Feature;
use crate::solid::Solid;
use crate::tree::Aabb;

/// Finds the contacts between a refitted surface and a solid at a pose, as [`detect`] does for a tool. For solids that
/// are not convex `config.kind` and `config.reach` say nothing.
pub fn detect_solid(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    solid: &Solid,
    pose: &Isometry3<f64>,
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
) -> DetectionReport {
    if let Solid::Convex(shape) = solid {
        return detect(surface, positions, shape, pose, config, ws, out);
    }
    out.contacts.clear();
    let mut report = DetectionReport { non_finite: surface.non_finite(), ..DetectionReport::NONE };
    if !is_usable(&pose.translation.vector) || !pose.rotation.coords.iter().all(|x| x.is_finite()) {
        report.non_finite += 1;
        return report;
    }
    ws.features.clear();
    let range = Vector3::repeat(config.margin);
    let bounds = solid.bounding_box(pose).map(|b| Aabb { low: b.low - range, high: b.high + range });
    for &node in surface.nodes() {
        let Some(x) = positions.get(node as usize).copied().filter(is_usable) else { continue };
        if bounds.is_some_and(|b| b.distance_squared(&x) > 0.0) {
            continue;
        }
        report.candidates += 1;
        let near = solid.signed_distance(pose, &x);
        // Also false where the distance is not a number.
        let within = near.distance <= config.margin && near.normal != Vector3::zeros();
        if !within {
            continue;
        }
        if ws.features.len() == ws.features.capacity() {
            report.dropped += 1;
            continue;
        }
        let contact = Contact {
            feature: feature_id(FeatureKind::Vertex, node, 0),
            nodes: [node; 3],
            weights: [1.0, 0.0, 0.0],
            normal: near.normal,
            tissue_point: x,
            tool_point: near.point,
            gap: near.distance,
        };
        ws.features.push(Feature {
            contact,
            skin: surface.vertex_normal(node),
            side: -1.0,
            submerged: false,
            held: false,
        });
    }
    keep_deepest(&mut ws.features, &mut ws.ranks, config, &mut out.contacts, &mut report);
    report
}
