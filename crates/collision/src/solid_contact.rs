//! Contacts between two solids.
//!
//! The skeleton of each solid (points and segments with a radius: the centre of a sphere, the axis of a capsule, corners
//! and edges of a hull, corners of a mesh) is held against the signed distance of the other: corners against faces both
//! ways, and edges of convex solids against each other along their common perpendicular where that lies between the
//! normals of both. Edges of meshes are left to their corners.

use nalgebra::{Isometry3, Vector3};

use crate::broad_phase::is_usable;
use crate::detection::DetectionConfig;
use crate::solid::Solid;
use crate::triangle::closest_segments;

/// A potential contact of a solid with another, the counterpart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidContact {
    /// Identifies the pair of features, so that forces can be matched between steps; bits 52 to 60 are zero.
    pub feature: u64,
    /// Unit vector from the counterpart towards the solid.
    pub normal: Vector3<f64>,
    /// The solid's point in the world frame \[m\].
    pub point: Vector3<f64>,
    /// Gap along the normal \[m\]; negative where they overlap.
    pub gap: f64,
}

/// What one meeting found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeetReport {
    /// Contacts handed out.
    pub contacts: usize,
    /// Contacts that gave way to a deeper one at the same place.
    pub merged: usize,
    /// Contacts that the capacity had no room for, the shallowest.
    pub dropped: usize,
    /// A pose that is not finite, or beyond 1e6 m.
    pub non_finite: bool,
}

/// A solid at its place.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    /// Its shape.
    pub solid: &'a Solid,
    /// From the shape's frame to the world.
    pub pose: &'a Isometry3<f64>,
}

/// A segment of a skeleton in the world frame.
struct Segment {
    ends: [Vector3<f64>; 2],
    radius: f64,
    /// Normals of the two faces that meet in an edge; none for the axis of a capsule.
    wedge: Option<[Vector3<f64>; 2]>,
}

/// Which features met, in the three high bits of an identifier: numbers that no feature of a skin has.
const POINT: u64 = 3 << 61;
const POINT_OF_COUNTERPART: u64 = 4 << 61;
const EDGES: u64 = 5 << 61;

/// Bits in which each of two edges is numbered.
const EDGE_BITS: u32 = 26;

impl Placed<'_> {
    fn is_usable(&self) -> bool {
        is_usable(&self.pose.translation.vector) && self.pose.rotation.coords.iter().all(|x| x.is_finite())
    }

    /// Calls `visit` with the number, place and radius of each point of the skeleton.
    fn points(&self, mut visit: impl FnMut(u64, Vector3<f64>, f64)) {
        let corners: &[Vector3<f64>] = match self.solid {
            Solid::HalfSpace(_) => return,
            Solid::Mesh(mesh) => mesh.vertices(),
            Solid::Convex(shape) => match (shape.axis(self.pose), shape.hull()) {
                (Some([a, b]), _) => {
                    visit(0, a, shape.inner_radius());
                    if a != b {
                        visit(1, b, shape.inner_radius());
                    }
                    return;
                }
                (None, Some(hull)) => hull.vertices(),
                (None, None) => return,
            },
        };
        for (k, v) in corners.iter().enumerate() {
            visit(k as u64, self.pose.transform_point(&(*v).into()).coords, 0.0);
        }
    }

    /// Number of segments of the skeleton that meet those of others.
    fn segment_count(&self) -> usize {
        match self.solid {
            Solid::Convex(shape) => match (shape.hull(), shape.axis(self.pose)) {
                (Some(hull), _) => hull.edges().len(),
                (None, Some([a, b])) => usize::from(a != b),
                (None, None) => 0,
            },
            _ => 0,
        }
    }

    fn segment(&self, k: usize) -> Option<Segment> {
        let Solid::Convex(shape) = self.solid else { return None };
        let Some(hull) = shape.hull() else {
            return shape.axis(self.pose).map(|ends| Segment { ends, radius: shape.inner_radius(), wedge: None });
        };
        let edge = hull.edges().get(k)?;
        let ends = edge.vertices.map(|v| self.pose.transform_point(&hull.vertices()[v as usize].into()).coords);
        let wedge = edge.faces.map(|f| self.pose.rotation * hull.normals()[f as usize]);
        Some(Segment { ends, radius: 0.0, wedge: Some(wedge) })
    }

    /// True for a ball: its centre alone tells everything.
    fn is_ball(&self) -> bool {
        matches!(self.solid, Solid::Convex(shape) if shape.axis(self.pose).is_some_and(|[a, b]| a == b))
    }
}

/// Replaces `out` by the contacts of `body` with `counterpart` whose gap is within `config.margin`: the deepest
/// `config.max_contacts`, ascending by feature. Allocates nothing where `out` has that capacity.
pub fn meet(
    body: Placed<'_>,
    counterpart: Placed<'_>,
    config: &DetectionConfig,
    out: &mut Vec<SolidContact>,
) -> MeetReport {
    out.clear();
    let mut report = MeetReport::default();
    if !body.is_usable() || !counterpart.is_usable() {
        report.non_finite = true;
        return report;
    }
    if apart(&body, &counterpart, config.margin) {
        return report;
    }
    let mut offer = |contact: SolidContact| keep(contact, config, out, &mut report);
    if !counterpart.is_ball() || body.is_ball() {
        body.points(|k, x, radius| {
            let near = counterpart.solid.signed_distance(counterpart.pose, &x);
            let normal = some_way(near.normal);
            offer(SolidContact { feature: POINT | k, normal, point: x - normal * radius, gap: near.distance - radius });
        });
    }
    if !body.is_ball() {
        counterpart.points(|k, x, radius| {
            let near = body.solid.signed_distance(body.pose, &x);
            let (normal, gap) = (-some_way(near.normal), near.distance - radius);
            offer(SolidContact { feature: POINT_OF_COUNTERPART | k, normal, point: near.point, gap });
        });
    }
    // Along the perpendicular of edges beside one another solids may seem to overlap far deeper than they do: the way out
    // is then through a face or other edges. Twice its depth leaves room for several ways at once.
    let mut greatest = f64::NEG_INFINITY;
    each_crossing(&body, &counterpart, |_, contact, _| greatest = greatest.max(contact.gap));
    if greatest > f64::NEG_INFINITY {
        greatest = greatest.max(face_separation(&body, &counterpart));
    }
    each_crossing(&body, &counterpart, |number, contact, length| {
        if contact.gap >= (2.0 * greatest).min(0.5 * greatest) - 1e-9 * length {
            offer(SolidContact { feature: EDGES | number, ..contact });
        }
    });
    out.sort_unstable_by_key(|c| c.feature);
    report.contacts = out.len();
    report
}

/// On an axis or in a centre no way out is nearest, and any will do.
fn some_way(normal: Vector3<f64>) -> Vector3<f64> {
    if normal == Vector3::zeros() { Vector3::z() } else { normal }
}

/// True where the boxes of two bounded solids are farther apart than the margin.
fn apart(a: &Placed<'_>, b: &Placed<'_>, margin: f64) -> bool {
    match (a.solid.bounding_box(a.pose), b.solid.bounding_box(b.pose)) {
        (Some(a), Some(b)) => (0..3).any(|k| a.low[k] > b.high[k] + margin || b.low[k] > a.high[k] + margin),
        _ => false,
    }
}

/// The greatest separation of two convex solids along the normal of any of their faces \[m\], negative where they overlap
/// along all; minus infinity where neither has faces.
fn face_separation(a: &Placed<'_>, b: &Placed<'_>) -> f64 {
    let along = |faced: &Placed<'_>, other: &Placed<'_>| {
        let Solid::Convex(shape) = faced.solid else { return f64::NEG_INFINITY };
        let Some(hull) = shape.hull() else { return f64::NEG_INFINITY };
        let triangles = hull.normals().iter().zip(hull.triangles());
        let separation = triangles.map(|(normal, triangle)| {
            let normal = faced.pose.rotation * normal;
            let origin = faced.pose.transform_point(&hull.vertices()[triangle[0] as usize].into()).coords;
            let mut least = f64::INFINITY;
            other.points(|_, x, radius| least = least.min((x - origin).dot(&normal) - radius));
            least
        });
        separation.fold(f64::NEG_INFINITY, f64::max)
    };
    along(a, b).max(along(b, a))
}

/// Calls `visit` with each pair of segments that has a common perpendicular: its number, the contact without a feature, and
/// the length of the body's segment.
fn each_crossing(body: &Placed<'_>, counterpart: &Placed<'_>, mut visit: impl FnMut(u64, SolidContact, f64)) {
    for i in 0..body.segment_count() {
        let Some(a) = body.segment(i) else { continue };
        for j in 0..counterpart.segment_count() {
            if let Some(contact) = counterpart.segment(j).and_then(|b| edges(&a, &b)) {
                visit((i as u64) << EDGE_BITS | j as u64, contact, (a.ends[1] - a.ends[0]).norm());
            }
        }
    }
}

/// The contact of two segments along their common perpendicular, where it lies within both.
fn edges(a: &Segment, b: &Segment) -> Option<SolidContact> {
    let (s, t) = closest_segments(&a.ends[0], &a.ends[1], &b.ends[0], &b.ends[1]);
    // At an end it is a corner, which is held already.
    let inner = |x: f64| x > 0.0 && x < 1.0;
    if !inner(s) || !inner(t) {
        return None;
    }
    let (along, across) = (a.ends[1] - a.ends[0], b.ends[1] - b.ends[0]);
    let (x, y) = (a.ends[0] + along * s, b.ends[0] + across * t);
    let mut normal = along.cross(&across).try_normalize(1e-3 * along.norm() * across.norm())?;
    let outward = match (a.wedge, b.wedge) {
        (_, Some([n, m])) => n + m,
        (Some([n, m]), None) => -(n + m),
        (None, None) => x - y,
    };
    if normal.dot(&outward) < 0.0 {
        normal = -normal;
    }
    if !within(b.wedge, &normal) || !within(a.wedge, &-normal) {
        return None;
    }
    let gap = (x - y).dot(&normal) - a.radius - b.radius;
    Some(SolidContact { feature: 0, normal, point: x - normal * a.radius, gap })
}

/// Whether a direction lies between the normals of the two faces of an edge, with a slack of a thousandth.
fn within(wedge: Option<[Vector3<f64>; 2]>, direction: &Vector3<f64>) -> bool {
    let Some([n, m]) = wedge else { return true };
    let turn = n.cross(&m);
    let slack = -1e-3 * turn.norm_squared();
    n.cross(direction).dot(&turn) >= slack && direction.cross(&m).dot(&turn) >= slack
}

/// Keeps a contact within the margin: in place of a shallower one at the same place, or of the shallowest where there
/// is no room.
fn keep(contact: SolidContact, config: &DetectionConfig, out: &mut Vec<SolidContact>, report: &mut MeetReport) {
    let finite = contact.point.iter().chain(contact.normal.iter()).all(|x| x.is_finite());
    if !finite || contact.gap.is_nan() || contact.gap > config.margin {
        return;
    }
    let near = config.merge_distance * config.merge_distance;
    let aligned = config.merge_angle.min(std::f64::consts::PI).cos();
    let twin = out.iter_mut().find(|kept| {
        (kept.point - contact.point).norm_squared() <= near && kept.normal.dot(&contact.normal) >= aligned
    });
    if let Some(twin) = twin {
        report.merged += 1;
        if contact.gap < twin.gap {
            *twin = contact;
        }
    } else if out.len() < config.max_contacts {
        out.push(contact);
    } else {
        report.dropped += 1;
        let shallowest = out.iter_mut().reduce(|a, b| if b.gap > a.gap { b } else { a });
        if let Some(shallowest) = shallowest.filter(|s| contact.gap < s.gap) {
            *shallowest = contact;
        }
    }
}
