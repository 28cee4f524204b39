//! Gap, normal and support of one tissue feature against one tool.
//!
//! Let `x` be a tissue point, `s` the outward normal of the skin there, `d(x)` the signed distance to the tool and
//! `n = ∇d` its unit gradient, which points from the tool to the tissue. Near the skin `gap = d(x)` with normal `n`.
//!
//! A triangle has two faces for a distance: once the tool has passed below the skin, `n` points out of the body and
//! a force along it would pull the tool through. Two nearby states need nearby answers there, so the rule bends `n`
//! instead of switching it. With `k = -n · s` (1 where the tool pushes straight into the tissue, -1 where it pulls):
//!
//! * `k >= 1/2`: the normal is `n`, the gap `d(x)`.
//! * below, `n` without its outward part is blended with `-s`: by the share `w m`, where `m` rises from 0 at `k = 1/2`
//!   to 1 at `k <= 0`, and `w` rises from 0 at the tool's outline, seen along `s`, to 1 within it. The gap is measured
//!   to the tool's tangent plane with that normal, `(x - support(n)) · n`. Other ways out of the tool (`-s` itself, across
//!   its outline, across the axis of a capsule, through the faces of a hull) are bent likewise, and the greatest gap,
//!   the shortest way, counts.
//!
//! So `normal · (-s) >= 0` always. The gap is continuous in `x` and in the tool's place, agrees with `d` where `k = 1/2`
//! and with no contact at the outline, and never grows while the tool goes deeper. Below the tool's middle it is the
//! depth of the tool's lowest point: the tool leaves through the side it came from, never sideways through a hole.
//! Features with `k < 0` outside the outline are not touched by the tool at all. Rows hold a normal still during a step:
//! for a bent one they are the derivative of the gap to that plane, for all others of the gap itself.
//!
//! A hull also touches with its own corners (the skin's normal is then the normal) and edges (the common perpendicular).

use nalgebra::{Isometry3, Vector3};

use crate::contact::{FeatureKind, feature_id};
use crate::hull::ConvexHull;
use crate::shape::ToolShape;
use crate::triangle::{TrianglePoint, barycentric, closest_on_triangle, closest_to_segment, overlap};

/// Cosine between `-s` and the nearest way out below which the skin decides the direction: 60 degrees. A node on the
/// corner of a box has a normal 55 degrees from each face, and must still be pushed straight by a tool on one of them.
const TRUSTED: f64 = 0.5;

/// Gap and normal of a tissue point against a tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Unit vector from the tool towards the tissue.
    pub normal: Vector3<f64>,
    /// Gap along it \[m\].
    pub gap: f64,
    /// Least cosine between the skin's normal and the side from which the tool came for this to be a touch: -1 for any
    /// side, -1/2 for all but the opposite one, 1/2 for the same side.
    pub side: f64,
    /// The tool lies below the skin here by more than its own inner radius, or altogether.
    pub submerged: bool,
}

/// The gap of a tissue point `x` \[m\] with outward skin normal `skin`; none where the tool neither faces nor covers it.
///
/// A zero `skin` (normals that cancel) leaves the distance as it is.
pub fn touch(tool: &ToolShape, pose: &Isometry3<f64>, x: &Vector3<f64>, skin: &Vector3<f64>) -> Option<Touch> {
    let near = tool.signed_distance(pose, x);
    if !near.distance.is_finite() || !near.normal.iter().all(|n| n.is_finite()) {
        return None;
    }
    let on_axis = near.normal == Vector3::zeros();
    let k = if skin.norm_squared() < 0.5 { 1.0 } else { -near.normal.dot(skin) };
    let straight = Touch { normal: near.normal, gap: near.distance, side: -1.0, submerged: false };
    if k >= TRUSTED {
        return (!on_axis).then_some(straight);
    }
    let outline = tool.outline(pose, x, skin);
    if outline.distance >= 0.0 {
        return (k >= 0.0 && !on_axis).then_some(straight);
    }
    let covered = (-2.0 * outline.distance / tool.inner_radius()).min(1.0);
    let mut best: Option<Touch> = None;
    let mut leave = |way: Vector3<f64>| {
        let Some(normal) = bend(&way, skin, covered) else { return };
        let gap = (x - tool.support(pose, &normal)).dot(&normal);
        if best.is_none_or(|b| gap > b.gap) && gap.is_finite() {
            let submerged = k < -0.5 || gap < -tool.inner_radius();
            best = Some(Touch { normal, gap, side: if k < 0.0 { 0.5 } else { -0.5 }, submerged });
        }
    };
    for way in [-skin, near.normal, outline.normal] {
        leave(way);
    }
    tool.exits(pose, skin, leave);
    best
}

/// A way out of the tool, bent towards `-skin` where it leads along the skin or out of the body.
///
/// None for a way of length zero (the nearest way out on an axis).
fn bend(way: &Vector3<f64>, skin: &Vector3<f64>, covered: f64) -> Option<Vector3<f64>> {
    if way.norm_squared() < 0.5 {
        return None;
    }
    let k = -way.dot(skin);
    if k >= TRUSTED {
        return Some(*way);
    }
    let share = covered * ((TRUSTED - k) / TRUSTED).min(1.0);
    let sideways = if k >= 0.0 { *way } else { (way + skin * k).try_normalize(1e-9).unwrap_or(-skin) };
    (sideways * (1.0 - share) - skin * share).try_normalize(1e-9)
}

/// Calls `visit` with the points of a triangle at which a sphere or capsule with this axis touches it, each with the
/// number of the tool's feature: 0 for the closest point, 1 and 2 for the two ends of a capsule that lies on the face.
///
/// One closest point cannot hold a capsule on a face: it would rock through. Where the axis is within 30 degrees of the
/// face, both ends of the part above the triangle touch as well.
pub fn samples(axis: &[Vector3<f64>; 2], corners: &[Vector3<f64>; 3], mut visit: impl FnMut(TrianglePoint, u32)) {
    let [p, q] = axis;
    if p == q {
        return visit(on_boundary(closest_on_triangle(p, corners).weights, false), 0);
    }
    visit(on_boundary(closest_to_segment(p, q, corners).weights, false), 0);
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    if (q - p).dot(&normal).abs() > 0.5 * (q - p).norm() * normal.norm() {
        return;
    }
    let Some((from, to)) = overlap(p, q, corners) else { return };
    for (t, end) in [(from, 1), (to, 2)] {
        let Some(weights) = barycentric(&(p + (q - p) * t), corners) else { continue };
        let at_end = t <= 0.0 || t >= 1.0;
        visit(on_boundary(weights, !at_end), if at_end { end } else { 0 });
    }
}

/// A point by its weights, without weights that are only rounding, so that triangles which share the point also share
/// its feature; `clipped` where it is known to lie on an edge.
fn on_boundary(mut weights: [f64; 3], clipped: bool) -> TrianglePoint {
    let least = if clipped { weights.iter().copied().fold(f64::INFINITY, f64::min) } else { f64::NEG_INFINITY };
    for w in &mut weights {
        if *w <= least || *w < 1e-9 {
            *w = 0.0;
        }
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    let zero = |k: usize| weights[k % 3] == 0.0;
    let vertex = (0..3).find(|&k| zero(k + 1) && zero(k + 2));
    let edge = (0..3).find(|&k| zero(k + 2));
    match (vertex, edge) {
        (Some(local), _) => TrianglePoint { weights, kind: FeatureKind::Vertex, local },
        (None, Some(local)) => TrianglePoint { weights, kind: FeatureKind::Edge, local },
        (None, None) => TrianglePoint { weights, kind: FeatureKind::Triangle, local: 0 },
    }
}

/// A hull's corners and face normals in the world frame, moved once per detection.
#[derive(Clone, Debug, Default)]
pub struct HullInWorld {
    vertices: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
    centre: Vector3<f64>,
    inner_radius: f64,
}

impl HullInWorld {
    /// Refills from the hull and its pose; allocates only where the hull is larger than any before.
    pub fn place(&mut self, hull: &ConvexHull, pose: &Isometry3<f64>) {
        self.vertices.clear();
        self.vertices.extend(hull.vertices().iter().map(|v| pose.rotation * v + pose.translation.vector));
        self.normals.clear();
        self.normals.extend(hull.normals().iter().map(|n| pose.rotation * n));
        self.centre = pose.rotation * hull.centre() + pose.translation.vector;
        self.inner_radius = hull.inner_radius();
    }

    /// A touch of a corner or edge. Where the hull's centre lies below the skin through `x`, it has passed it, or this is
    /// the far skin.
    fn touch_at(&self, x: &Vector3<f64>, skin: &Vector3<f64>, normal: Vector3<f64>, gap: f64) -> Touch {
        let passed = (self.centre - x).dot(skin) < 0.0;
        Touch { normal, gap, side: if passed { 0.5 } else { -1.0 }, submerged: passed || gap < -self.inner_radius }
    }

    /// Calls `visit` with each corner of the hull that stands on the triangle: its number, the point, and the touch.
    ///
    /// A corner stands on a plane where no neighbouring corner lies farther in the direction of the plane's back, but
    /// for a degree: other corners than the foremost say nothing that the foremost does not.
    pub fn corners_on_triangle(
        &self,
        hull: &ConvexHull,
        corners: &[Vector3<f64>; 3],
        mut visit: impl FnMut(u32, TrianglePoint, Vector3<f64>, Touch),
    ) {
        let cross = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let Some(skin) = cross.try_normalize(f64::MIN_POSITIVE) else { return };
        for (k, v) in self.vertices.iter().enumerate() {
            let Some(weights) = barycentric(v, corners) else { return };
            if weights.iter().any(|w| *w < -1e-9) {
                continue;
            }
            let foremost = hull.neighbours(k).iter().all(|&w| {
                let edge = self.vertices[w as usize] - v;
                -edge.dot(&skin) <= 0.0175 * edge.norm()
            });
            if foremost {
                let gap = (v - corners[0]).dot(&skin);
                visit(k as u32, on_boundary(weights, false), skin, self.touch_at(&corners[0], &skin, -skin, gap));
            }
        }
    }

    /// Calls `visit` with each edge of the hull that crosses the edge `a b` of the surface: its number, the place on the
    /// surface's edge in `[0, 1]`, and the touch along their common perpendicular.
    ///
    /// The perpendicular must lie between the normals of the hull's two faces and within 60 degrees of `-skin`.
    pub fn edges_on_edge(
        &self,
        hull: &ConvexHull,
        [a, b]: [Vector3<f64>; 2],
        skin: &Vector3<f64>,
        within: f64,
        mut visit: impl FnMut(u32, f64, Touch),
    ) {
        let tissue = b - a;
        // Seen along the skin's normal: tool * s - tissue * t = a - p, solved across `beside`.
        let beside = tissue.cross(skin);
        for (number, edge) in hull.edges().iter().enumerate() {
            let [p, q] = edge.vertices.map(|v| self.vertices[v as usize]);
            let tool = q - p;
            // They must cross seen along the skin: a crossing seen along their own perpendicular only lies beside the
            // hull's end, and claims a depth that the hull does not have.
            let s = (a - p).dot(&beside) / tool.dot(&beside);
            if !(0.0..=1.0).contains(&s) || ((a + b) - (p + q)).norm() > tissue.norm() + tool.norm() + 2.0 * within {
                continue;
            }
            let cross = tool.cross(&tissue);
            let place = |along: &Vector3<f64>| (a - p).cross(&tool).dot(along) / cross.dot(along);
            // Edges within a thousandth of parallel have no common perpendicular worth the name; corners hold them.
            let Some(mut normal) = cross.try_normalize(1e-3 * tool.norm() * tissue.norm()) else { continue };
            let [n, m] = edge.faces.map(|f| self.normals[f as usize]);
            if normal.dot(&(n + m)) < 0.0 {
                normal = -normal;
            }
            let wedge = n.cross(&m);
            let between = n.cross(&normal).dot(&wedge) >= 0.0 && normal.cross(&m).dot(&wedge) >= 0.0;
            if !between || -normal.dot(skin) < TRUSTED || !(0.0..=1.0).contains(&place(skin)) {
                continue;
            }
            // The feet of the perpendicular carry the contact.
            let foot = (a - p).cross(&tissue).dot(&cross) / cross.norm_squared();
            let t = place(&cross);
            if (0.0..=1.0).contains(&foot) && (0.0..=1.0).contains(&t) {
                visit(number as u32, t, self.touch_at(&a, skin, normal, (a - p).dot(&normal)));
            }
        }
    }
}

/// Identifier of a point of a surface triangle.
pub fn point_feature(triangle: u32, nodes: &[u32; 3], edges: &[u32; 3], point: &TrianglePoint, tool: u32) -> u64 {
    match point.kind {
        FeatureKind::Vertex => feature_id(FeatureKind::Vertex, nodes[point.local], tool),
        FeatureKind::Edge => feature_id(FeatureKind::Edge, edges[point.local], tool),
        FeatureKind::Triangle => feature_id(FeatureKind::Triangle, triangle, tool),
    }
}
