//! Loaded points of faces, held from step to step.
//!
//! The closest point of a triangle moves as the triangle tilts, by the tool's radius times the angle: pushed at one
//! point it sinks there, and the next closest point lies on the other side of where the force belongs. With one row a
//! triangle, made anew at each step, the points jump from side to side and the force never rests.
//!
//! That a triangle stays out of a round tool is a row for each of its points: a semi-infinite programme. The exchange
//! method (Hettich & Kortanek, SIAM Review 35, 1993) solves it with few rows: those that carried a force stay, the
//! deepest point of each triangle joins, those without a force go. Dropping such a row leaves the optimum as it is and a
//! violated one raises it, so no set of rows comes back. Points on two sides of the true one enclose it: the next closest
//! point lies between them.
//!
//! A held point is a material point: it keeps its nodes, weights and feature, and so its force for a warm start. One that
//! is as near and as deep as a new closest point stands for it; at rest the rows are the same from step to step.

use nalgebra::Vector3;

use crate::contact::{Contact, ContactSet};
use crate::features::{Feature, by_depth, retain_from};

/// A tissue point that carried a force in the step before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldPoint {
    /// Its feature, which it keeps.
    pub feature: u64,
    /// Mesh nodes that carry it.
    pub nodes: [u32; 3],
    /// Barycentric weights of the nodes; they sum to 1.
    pub weights: [f64; 3],
}

impl ContactSet {
    /// Holds the contacts at `loaded` (their places in [`contacts`](Self::contacts)) and lets all others go.
    ///
    /// Call it once the forces are known, with those that push. At faces of a sphere or capsule the next detection keeps
    /// held points as contacts; elsewhere it has no use for them. A place beyond the contacts is passed over.
    pub fn hold(&mut self, loaded: impl IntoIterator<Item = usize>) {
        let Self { contacts, held, .. } = self;
        let points = loaded.into_iter().filter_map(|k| contacts.get(k));
        held.clear();
        held.extend(points.map(|c| HeldPoint { feature: c.feature, nodes: c.nodes, weights: c.weights }));
    }
}

/// Distance within which a held point may stand for a new one, over the tool's radius: a chord so long has a sag of 1e-5
/// radii, far below what a step moves.
const NEAR: f64 = 0.005;

/// Least cosine between the normals of a held point and one that it stands for: not the two sides of a thin fold.
const ALIGNED: f64 = 0.98;

/// From one identifier of a point on the same tissue feature to the next: tool features are 0, 1 and 2.
const NEXT_ON_FEATURE: u64 = 3 << 32;

/// Drops new points for which a held one stands, and gives the others identifiers that no held one has.
///
/// `radius` \[m\] of the tool's part, whose features begin at `start`. Returns how many were dropped. Held points come
/// first afterwards.
pub(crate) fn stand_in(features: &mut Vec<Feature>, start: usize, radius: f64) -> usize {
    let own = &mut features[start..];
    if !own.iter().any(|f| f.held) {
        return 0;
    }
    own.sort_unstable_by(|a, b| {
        (b.held.cmp(&a.held)).then(a.contact.feature.cmp(&b.contact.feature)).then(by_depth(a, b))
    });
    let first_new = own.partition_point(|f| f.held);
    let (held, new) = own.split_at_mut(first_new);
    let near = NEAR * radius;
    let sag = near * near / (2.0 * radius);
    let stands_for = |h: &Contact, c: &Contact| {
        let apart: Vector3<f64> = h.tissue_point - c.tissue_point;
        h.gap <= c.gap + sag && apart.norm_squared() <= near * near && h.normal.dot(&c.normal) >= ALIGNED
    };
    for f in new {
        if held.iter().any(|h| stands_for(&h.contact, &f.contact)) {
            // No feature comes in with such a gap.
            f.contact.gap = f64::NAN;
        }
        while held.iter().any(|h| h.contact.feature == f.contact.feature) {
            f.contact.feature += NEXT_ON_FEATURE;
        }
    }
    let before = features.len();
    retain_from(features, start, |f| !f.contact.gap.is_nan());
    before - features.len()
}
