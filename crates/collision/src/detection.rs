//! Detection: from a surface and a tool to contacts.
//!
//! A box around the tool, widened by the margin and the reach, selects triangles; their nodes ([`ContactKind::Nodes`])
//! or their deepest points ([`ContactKind::Faces`]) become features with a gap and a normal ([`narrow_phase`](crate::narrow_phase)); features
//! on the wrong side are rejected; points that carried a force stay ([`held`](crate::held)); what is left is sorted by depth, near-duplicates are merged, and the deepest are kept.
//!
//! **Sides.** The far skin of a thin organ and the near skin that a tool has passed look alike: the distance to both
//! points out of the body. Detection therefore remembers the outward normal `u` of the skin through which the tool came
//! ([`ContactSet::side`]): the skin nearest to the tool's innermost probe. While that probe is outside, the memory
//! follows, except to the opposite side of a tool that still touches; inside, only as far as the skin turns by less
//! than 60 degrees a step. A feature that lies
//! behind the tool needs `skin · u > 1/2`, and the tool's core to lie in the body (or to have come through it): a flap
//! above a tool in a cavity is not skin that the tool has passed. A feature beside the tool that the skin decides about
//! needs `skin · u > -1/2` ([`Touch::side`](crate::narrow_phase::Touch)). While the tool is submerged, skin with `skin · u < 0` is rejected
//! altogether, since the tool may have come out of the far side. A tool that appears inside the body takes the
//! nearest skin; [`DetectionReport::tool_inside`] tells set-up to refuse it.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::broad_phase::{SurfaceGeometry, is_usable};
use crate::contact::{Contact, ContactSet};
use crate::features::{Collector, Feature, Meeting, by_depth};
use crate::held::stand_in;
use crate::narrow_phase::HullInWorld;
use crate::shape::ToolShape;
use crate::tree::Aabb;

/// Where contacts are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactKind {
    /// At the nodes of the surface. On a coarse mesh the closest to the converged force, but a tool smaller than an
    /// element can pass between nodes.
    Nodes,
    /// At the deepest points of triangles. No tool passes; on a coarse mesh too stiff.
    #[default]
    Faces,
}

/// How contacts are found. Lengths in m, angles in rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectionConfig {
    /// Nodes or faces (default faces).
    pub kind: ContactKind,
    /// Contacts with a gap up to this become rows (default 2 mm): what the tool can approach in one step.
    pub margin: f64,
    /// How far the whole tool may lie below the skin and still be pushed out (default 10 mm).
    pub reach: f64,
    /// Contacts closer together than this \[m\] merge into the deepest (default 0: identical points only). Points that
    /// carried a force in the step before do not take part: they stay beside a deeper one.
    pub merge_distance: f64,
    /// Contacts whose normals differ by more than this \[rad\] never merge (default 0.2).
    pub merge_angle: f64,
    /// Most contacts kept, the deepest first (default 64).
    pub max_contacts: usize,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self {
            kind: ContactKind::Faces,
            margin: 2e-3,
            reach: 1e-2,
            merge_distance: 0.0,
            merge_angle: 0.2,
            max_contacts: 64,
        }
    }
}

/// A detection parameter out of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("detection: {name} = {value} must be {bound}")]
pub struct DetectionConfigError {
    /// The parameter.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// What it must be.
    pub bound: &'static str,
}

impl DetectionConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), DetectionConfigError> {
        for (name, value) in [
            ("margin", self.margin),
            ("reach", self.reach),
            ("merge_distance", self.merge_distance),
            ("merge_angle", self.merge_angle),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(DetectionConfigError { name, value, bound: "at least zero and finite" });
            }
        }
        if self.max_contacts == 0 {
            return Err(DetectionConfigError { name: "max_contacts", value: 0.0, bound: "at least 1" });
        }
        Ok(())
    }
}

/// What one detection did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectionReport {
    /// Features whose gap was computed.
    pub candidates: usize,
    /// Contacts handed out.
    pub contacts: usize,
    /// Features within the margin that were rejected because they face away from the side the tool came from.
    pub wrong_side: usize,
    /// Duplicates and near-duplicates that gave way to a deeper contact or to a held one.
    pub merged: usize,
    /// Contacts within the margin that the capacity had no room for; shallower than all that were kept.
    pub dropped: usize,
    /// Triangles left out because a coordinate is not finite or beyond 1e6 m, plus 1 if the pose is.
    pub non_finite: usize,
    /// Least gap \[m\]; infinite without contacts.
    pub deepest_gap: f64,
    /// The whole tool lies below the skin. At set-up: refuse. In a run: a fast tool has passed through; it is pushed out
    /// as long as the reach allows.
    pub tool_inside: bool,
}

impl DetectionReport {
    /// Of a detection that found nothing.
    pub const NONE: Self = Self {
        candidates: 0,
        contacts: 0,
        wrong_side: 0,
        merged: 0,
        dropped: 0,
        non_finite: 0,
        deepest_gap: f64::INFINITY,
        tool_inside: false,
    };
}

/// Scratch memory of detection, sized for one surface at set-up.
#[derive(Clone, Debug)]
pub struct DetectionWorkspace {
    pub(crate) features: Vec<Feature>,
    nodes: Visited,
    edges: Visited,
    hull: HullInWorld,
}

impl DetectionWorkspace {
    /// Memory for one surface and any tool: about 0.8 KB a triangle.
    ///
    /// The first detection with a hull and the first with a larger `max_contacts` than before may allocate; none after.
    pub fn new(surface: &SurfaceGeometry) -> Self {
        Self {
            features: Vec::with_capacity(4 * surface.triangles().len() + 1024),
            nodes: Visited::new(surface.body_nodes()),
            edges: Visited::new(surface.edges().len()),
            hull: HullInWorld::default(),
        }
    }
}

/// Marks items that a pass has seen, without clearing between passes.
#[derive(Clone, Debug)]
struct Visited {
    pass_of: Vec<u32>,
    pass: u32,
}

impl Visited {
    fn new(items: usize) -> Self {
        Self { pass_of: vec![0; items], pass: 0 }
    }

    /// Starts a pass over `items` items.
    fn begin(&mut self, items: usize) {
        self.pass = self.pass.wrapping_add(1);
        if self.pass == 0 || self.pass_of.len() != items {
            self.pass_of.clear();
            self.pass_of.resize(items, 0);
            self.pass = 1;
        }
    }

    /// Calls `visit` with those of three items that this pass has not seen.
    fn first_visits(&mut self, items: [u32; 3], mut visit: impl FnMut(u32)) {
        for item in items {
            if self.pass_of.get_mut(item as usize).is_some_and(|at| std::mem::replace(at, self.pass) != self.pass) {
                visit(item);
            }
        }
    }
}

/// Finds the contacts between a refitted surface and a tool at a pose.
///
/// `positions` are the body's nodes \[m\] that the surface was refitted to. `out` enters with what the step before left
/// (the side from which the tool came, and held points) and leaves with the new contacts, ascending by feature. Non-finite numbers
/// give no contact and are counted.
pub fn detect(
    surface: &SurfaceGeometry,
    positions: &[Vector3<f64>],
    tool: &ToolShape,
    pose: &Isometry3<f64>,
    config: &DetectionConfig,
    ws: &mut DetectionWorkspace,
    out: &mut ContactSet,
) -> DetectionReport {
    let touching = !out.contacts.is_empty();
    out.contacts.clear();
    let mut report = DetectionReport { non_finite: surface.non_finite(), ..DetectionReport::NONE };
    if !is_usable(&pose.translation.vector) || !pose.rotation.coords.iter().all(|x| x.is_finite()) {
        report.non_finite += 1;
        return report;
    }
    ws.features.clear();
    ws.nodes.begin(surface.body_nodes());
    ws.edges.begin(surface.edges().len());
    let meeting = Meeting { surface, positions, tool, pose };
    let came = follow_side(&meeting, touching, &mut out.side);
    report.tool_inside = came.inside;

    // Features of triangles near the tool.
    let (low, high) = tool.bounding_box(pose);
    let range = config.margin.max(config.reach);
    let bounds = Aabb { low: low - Vector3::repeat(range), high: high + Vector3::repeat(range) };
    let mut found =
        Collector { features: &mut ws.features, margin: config.margin, candidates: 0, dropped: 0, holding: false };
    let (nodes, edges) = (&mut ws.nodes, &mut ws.edges);
    match (config.kind, tool.axis(pose), tool.hull()) {
        (ContactKind::Faces, Some(axis), _) => {
            found.holding = true;
            out.held.iter().for_each(|point| meeting.held(point, &mut found));
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
    report.candidates = found.candidates;
    report.dropped = found.dropped;

    reject_wrong_side(&meeting, &mut ws.features, &came, out.side, &mut report);
    report.merged = stand_in(&mut ws.features, tool.inner_radius());
    keep_deepest(&mut ws.features, config, &mut out.contacts, &mut report);
    report
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
    came: &Came,
    side: Option<Vector3<f64>>,
    report: &mut DetectionReport,
) {
    let Some(side) = side else { return };
    report.wrong_side = keep_faced(features, &side, |x| {
        let core = meeting.tool.core(meeting.pose, x);
        came.through || meeting.surface.nearest(&core, meeting.positions).is_some_and(|near| near.signed_distance < 0.0)
    });
}

/// Keeps the features on the side from which the tool came; `passed` says whether the tool's core for a point lies in the
/// body, and is asked only where that decides. Returns how many features went.
pub(crate) fn keep_faced(
    features: &mut Vec<Feature>,
    side: &Vector3<f64>,
    passed: impl Fn(&Vector3<f64>) -> bool,
) -> usize {
    let before = features.len();
    features.retain(|f| {
        let faces = f.side <= -1.0 || f.skin.dot(side) > f.side;
        faces && (f.side < 0.5 || passed(&f.contact.tissue_point))
    });
    if features.iter().any(|f| f.submerged) {
        features.retain(|f| f.skin.dot(side) >= 0.0);
    }
    before - features.len()
}

/// Merges near-duplicates into the deepest of them, held points apart, and keeps the deepest contacts, ascending by feature.
pub(crate) fn keep_deepest(
    features: &mut Vec<Feature>,
    config: &DetectionConfig,
    contacts: &mut Vec<Contact>,
    report: &mut DetectionReport,
) {
    let kept = keep_deepest_of(features, config, contacts);
    report.merged += kept.merged;
    report.dropped += kept.dropped;
    report.contacts = contacts.len();
    report.deepest_gap = kept.deepest_gap;
}

/// What became of features that were no contact of their own.
pub(crate) struct Kept {
    pub(crate) merged: usize,
    pub(crate) dropped: usize,
    /// Least gap \[m\]; infinite without contacts.
    pub(crate) deepest_gap: f64,
}

/// As [`keep_deepest`], without the report of a whole detection.
pub(crate) fn keep_deepest_of(
    features: &mut Vec<Feature>,
    config: &DetectionConfig,
    contacts: &mut Vec<Contact>,
) -> Kept {
    // Triangles that share a vertex or an edge find the same point: one feature, one contact.
    features.sort_unstable_by(|a, b| a.contact.feature.cmp(&b.contact.feature).then(by_depth(a, b)));
    let before = features.len();
    features.dedup_by_key(|f| f.contact.feature);
    let mut kept = Kept { merged: before - features.len(), dropped: 0, deepest_gap: f64::INFINITY };
    features.sort_unstable_by(by_depth);

    let near = config.merge_distance * config.merge_distance;
    let aligned = config.merge_angle.min(std::f64::consts::PI).cos();
    contacts.reserve(config.max_contacts.min(features.capacity()));
    for (visited, feature) in features.iter().enumerate() {
        if contacts.len() == config.max_contacts {
            kept.dropped = features.len() - visited;
            break;
        }
        let c = &feature.contact;
        let twin = |other: &Contact| {
            (other.tissue_point - c.tissue_point).norm_squared() <= near
                && other.normal.dot(&c.normal) >= aligned
                && !features.iter().any(|f| f.held && f.contact.feature == other.feature)
        };
        if !feature.held && contacts.iter().any(twin) {
            kept.merged += 1;
        } else {
            contacts.push(*c);
        }
    }
    kept.deepest_gap = contacts.first().map_or(f64::INFINITY, |c| c.gap);
    contacts.sort_unstable_by_key(|c| c.feature);
    kept
}
