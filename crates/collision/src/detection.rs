//! Detection: from a surface and a tool to contacts.
//!
//! A box around the tool, widened by the margin and the reach, selects triangles; their nodes ([`ContactKind::Nodes`])
//! or their deepest points ([`ContactKind::Faces`]) become features with a gap and a normal
//! ([`narrow_phase`](crate::narrow_phase)); features on the wrong side are rejected; points that carried a force stay
//! ([`held`](crate::held)); what is left is sorted by depth, near-duplicates are merged, and the deepest are kept.
//!
//! **Sides.** The far skin of a thin organ and the near skin that a tool has passed look alike: the distance to both
//! points out of the body. Detection therefore remembers the outward normal `u` of the skin through which the tool came
//! ([`ContactSet::side`]): the skin nearest to the tool's innermost probe. While that probe is outside, the memory
//! follows, except to the opposite side of a tool that still touches; inside, only as far as the skin turns by less
//! than 60 degrees a step. A feature that lies behind the tool needs `skin · u > 1/2`, and the tool's core to lie in
//! the body (or to have come through it): a flap above a tool in a cavity is not skin that the tool has passed. A
//! feature beside the tool that the skin decides about needs `skin · u > -1/2`
//! ([`Touch::side`](crate::narrow_phase::Touch)). While the tool is submerged, skin with `skin · u < 0` is rejected
//! altogether, since the tool may have come out of the far side. A tool that appears inside the body takes the nearest
//! skin; [`DetectionReport::tool_inside`] tells set-up to refuse it.

use nalgebra::{Isometry3, Vector3};

use crate::broad_phase::{SurfaceGeometry, is_usable};
use crate::contact::{ContactSet, side_of};
use crate::features::{Collector, Feature, Meeting};
use crate::held::stand_in;
use crate::narrow_phase::HullInWorld;
use crate::shape::ToolShape;
use crate::tool::{PART_BITS, PlacedPart, Tool, ToolPose};
use crate::tree::Aabb;

mod config;
mod keep;
mod report;
mod visited;

pub use config::{ContactKind, DetectionConfig, DetectionConfigError};
pub(crate) use keep::{Rank, keep_deepest, keep_deepest_of, keep_faced};
pub use report::DetectionReport;
use visited::Visited;

/// Scratch memory of detection, sized for one surface at set-up.
#[derive(Clone, Debug)]
pub struct DetectionWorkspace {
    pub(crate) features: Vec<Feature>,
    pub(crate) ranks: Vec<Rank>,
    nodes: Visited,
    edges: Visited,
    hull: HullInWorld,
}

impl DetectionWorkspace {
    /// Memory for one surface and any tool: about 0.9 KB a triangle.
    ///
    /// The first detection with a hull and the first with a larger `max_contacts` than before may allocate; none after.
    pub fn new(surface: &SurfaceGeometry) -> Self {
        let room = 4 * surface.triangles().len() + 1024;
        Self {
            features: Vec::with_capacity(room),
            ranks: Vec::with_capacity(room),
            nodes: Visited::new(surface.body_nodes()),
            edges: Visited::new(surface.edges().len()),
            hull: HullInWorld::default(),
        }
    }
}

/// Finds the contacts between a refitted surface and a shape at a pose.
///
/// `positions` are the body's nodes \[m\] that the surface was refitted to. `out` enters with what the step before left
/// (the side from which the tool came, and held points) and leaves with the new contacts, ascending by feature.
/// Non-finite numbers give no contact and are counted.
pub fn detect(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &ToolShape,
    pose: &Isometry3<f64>,
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
) -> DetectionReport {
    let part = std::iter::once(PlacedPart::alone(tool, pose));
    detect_parts(surface, positions, part, &ToolPose::from(pose), config, ws, out)
}

/// As [`detect`], with a tool of several parts: the union of what each of them touches. At most `max_contacts` of all.
pub fn detect_tool(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &Tool,
    pose: &ToolPose,
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
) -> DetectionReport {
    detect_parts(surface, positions, tool.placed(*pose), pose, config, ws, out)
}

fn detect_parts<'a>(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    parts: impl Iterator<Item = PlacedPart<'a>>,
    pose: &ToolPose,
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
) -> DetectionReport {
    let mut report = DetectionReport { non_finite: surface.non_finite(), ..DetectionReport::NONE };
    ws.features.clear();
    if is_usable(&pose.frame.translation.vector) && pose.is_finite() {
        for (k, part) in parts.enumerate() {
            let meeting = Meeting { surface, positions, tool: part.shape, pose: &part.pose };
            detect_part(&meeting, (k, part.tag), config, ws, out, &mut report);
        }
    } else {
        report.non_finite += 1;
    }
    out.contacts.clear();
    if !ws.features.is_empty() {
        keep_deepest(&mut ws.features, &mut ws.ranks, config, &mut out.contacts, &mut report);
    }
    report
}

/// Appends the features of one part. `out` still holds the contacts of the detection before.
fn detect_part(
    meeting: &Meeting<SurfaceGeometry>,
    (number, tag): (usize, u64),
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
    report: &mut DetectionReport,
) {
    let Meeting { surface, tool, pose, .. } = *meeting;
    let is_own = |feature: u64| feature & PART_BITS == tag;
    let touching = out.contacts.iter().any(|c| is_own(c.feature));
    ws.nodes.begin(surface.body_nodes());
    ws.edges.begin(surface.edges().len());
    let side = side_of(number, &mut out.side, &mut out.other_sides);
    let came = follow_side(meeting, touching, side);
    report.tool_inside |= came.inside;

    // Features of triangles near the part.
    let (low, high) = tool.bounding_box(pose);
    let range = config.margin.max(config.reach);
    let bounds = Aabb { low: low - Vector3::repeat(range), high: high + Vector3::repeat(range) };
    let start = ws.features.len();
    let mut found = Collector::new(&mut ws.features, config.margin, tag);
    let (nodes, edges) = (&mut ws.nodes, &mut ws.edges);
    match (config.kind, tool.axis(pose), tool.hull()) {
        (ContactKind::Faces, Some(axis), _) => {
            found.holding = true;
            out.held.iter().filter(|point| is_own(point.feature)).for_each(|point| meeting.held(point, &mut found));
            found.holding = false;
            surface.query(&bounds, |t| meeting.face(t, &axis, &mut found));
        }
        (ContactKind::Faces, None, Some(hull)) => {
            ws.hull.place(hull, pose);
            surface.query(&bounds, |t| {
                nodes.first_visits(surface.triangles()[t as usize], |node| meeting.node(node, &mut found));
                meeting.hull_corners(t, hull, &ws.hull, &mut found);
                edges.first_visits(surface.triangle_edges()[t as usize], |edge| {
                    meeting.hull_edges(edge, hull, &ws.hull, range, &mut found);
                });
            });
        }
        _ => surface.query(&bounds, |t| {
            nodes.first_visits(surface.triangles()[t as usize], |node| meeting.node(node, &mut found));
        }),
    }
    report.candidates += found.candidates;
    report.dropped += found.dropped;

    reject_wrong_side(meeting, &mut ws.features, start, &came, *side, report);
    report.merged += stand_in(&mut ws.features, start, tool.inner_radius());
}

/// Where a tool lies relative to the skin through which it came.
struct Came {
    /// The whole tool lies below the skin.
    inside: bool,
    /// It has come out of the far side of something thin.
    through: bool,
}

/// Updates the outward normal of the skin through which the tool came. `touching`: the step before had contacts.
fn follow_side(meeting: &Meeting<SurfaceGeometry>, touching: bool, side: &mut Option<Vector3<f64>>) -> Came {
    let Meeting { surface, positions, tool, pose } = *meeting;
    let mut innermost: Option<(f64, Vector3<f64>)> = None;
    let mut all_below = true;
    for probe in tool.probes(pose) {
        let Some(near) = surface.nearest(&probe.centre, positions) else { continue };
        all_below &= near.signed_distance < -probe.radius;
        if innermost.is_none_or(|(least, _)| near.signed_distance < least) && near.normal != Vector3::zeros() {
            innermost = Some((near.signed_distance, near.normal));
        }
    }
    let Some((depth, normal)) = innermost else { return Came { inside: false, through: false } };
    let turn = side.map_or(1.0, |before| before.dot(&normal));
    // Inside, another side may be nearer than the one it came through; outside, it may be beyond the far skin.
    let through = depth >= 0.0 && touching && turn < -0.5;
    if !through && (depth >= 0.0 || turn > 0.5) {
        *side = Some(normal);
    }
    side.get_or_insert(normal);
    // The sign of the nearest point can err at sharp edges, so a rare and costly answer is checked.
    let inside = all_below && surface.contains(&tool.bounding_sphere(pose).0, positions);
    Came { inside, through }
}

/// Drops features that do not face the side the tool came from, and those that the tool has not passed.
fn reject_wrong_side(
    meeting: &Meeting<SurfaceGeometry>,
    features: &mut Vec<Feature>,
    start: usize,
    came: &Came,
    side: Option<Vector3<f64>>,
    report: &mut DetectionReport,
) {
    let Some(side) = side else { return };
    report.wrong_side += keep_faced(features, start, &side, |x| {
        let core = meeting.tool.core(meeting.pose, x);
        came.through || meeting.surface.nearest(&core, meeting.positions).is_some_and(|near| near.signed_distance < 0.0)
    });
}
