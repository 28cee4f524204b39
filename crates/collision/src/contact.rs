//! A contact between a tool and a point of a tissue surface, and the contacts of one tool at one step.

use nalgebra::Vector3;

use crate::held::HeldPoint;
use crate::tool::MAX_PARTS;

/// A potential contact: a material point of the tissue, the direction in which the tool pushes it, and their gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Identifies the surface feature (vertex, edge or triangle) so that forces can be matched between steps.
    pub feature: u64,
    /// Mesh nodes that carry the tissue point.
    pub nodes: [u32; 3],
    /// Barycentric weights of the nodes; they sum to 1. A contact at a node has weights `[1, 0, 0]`.
    pub weights: [f64; 3],
    /// Unit vector from the tool towards the tissue: the direction in which the tool pushes the tissue.
    pub normal: Vector3<f64>,
    /// The tissue point in the world frame \[m\].
    pub tissue_point: Vector3<f64>,
    /// The tool's point opposite to it in the world frame \[m\]: `tissue_point - gap normal`.
    ///
    /// It lies on the tool's surface, or on its tangent plane where the tool is so deep that the normal is taken
    /// from the skin (see [`narrow_phase`](crate::narrow_phase)).
    pub tool_point: Vector3<f64>,
    /// `(tissue_point - tool_point) · normal` \[m\]; negative where the tool is inside the tissue.
    pub gap: f64,
}

/// The contacts of one tool with one surface, and the memory that detection needs from step to step.
///
/// State: to repeat a run from the middle, save it with the rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContactSet {
    /// Contacts of the latest detection, ascending by feature.
    pub contacts: Vec<Contact>,
    /// Outward normal of the skin through which the tool came; `None` before the first detection.
    pub side: Option<Vector3<f64>>,
    /// The same of the tool's further parts, the second one first; empty for a tool of one shape.
    pub other_sides: Vec<Option<Vector3<f64>>>,
    /// Points that carried a force in the step before ([`hold`](Self::hold)).
    pub held: Vec<HeldPoint>,
}

impl ContactSet {
    /// An empty set with memory for `capacity` contacts ([`DetectionConfig::max_contacts`]).
    ///
    /// [`DetectionConfig::max_contacts`]: crate::detection::DetectionConfig::max_contacts
    pub fn with_capacity(capacity: usize) -> Self {
        let (contacts, held) = (Vec::with_capacity(capacity), Vec::with_capacity(capacity));
        Self { contacts, side: None, other_sides: Vec::with_capacity(MAX_PARTS), held }
    }

    /// Forgets the contacts, the held points and the side from which the tool came; keeps the memory.
    pub fn clear(&mut self) {
        self.contacts.clear();
        self.held.clear();
        self.side = None;
        self.other_sides.clear();
    }
}

/// The memory of the side from which a part of the tool came.
pub(crate) fn side_of<'a>(
    part: usize,
    first: &'a mut Option<Vector3<f64>>,
    others: &'a mut Vec<Option<Vector3<f64>>>,
) -> &'a mut Option<Vector3<f64>> {
    let Some(other) = part.checked_sub(1) else { return first };
    if others.len() <= other {
        others.resize(other + 1, None);
    }
    &mut others[other]
}

/// Largest tool feature (vertex or edge of a hull) that fits into a feature identifier.
pub(crate) const MAX_TOOL_FEATURES: usize = (1 << 22) - 1;

/// What kind of tissue feature an identifier names; the three high bits of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeatureKind {
    /// A surface vertex (mesh node).
    Vertex,
    /// A surface edge ([`SurfaceGeometry::triangle_edges`](crate::SurfaceGeometry::triangle_edges)).
    Edge,
    /// The inside of a surface triangle.
    Triangle,
}

/// Identifier of a contact: the tissue feature, and the tool's feature where one tissue feature can hold several.
///
/// Layout: 3 bits of kind, 2 of the tool's jaw and 5 of its part ([`crate::tool`]; 0 of a tool of one shape), 22 of the
/// part's feature (0 where it has none), 32 of tissue feature.
pub fn feature_id(kind: FeatureKind, tissue: u32, tool: u32) -> u64 {
    let kind = match kind {
        FeatureKind::Vertex => 0u64,
        FeatureKind::Edge => 1,
        FeatureKind::Triangle => 2,
    };
    kind << 61 | (u64::from(tool) & MAX_TOOL_FEATURES as u64) << 32 | u64::from(tissue)
}

/// The kind of tissue feature in an identifier, if it is one of ours.
pub fn feature_kind(feature: u64) -> Option<FeatureKind> {
    match feature >> 61 {
        0 => Some(FeatureKind::Vertex),
        1 => Some(FeatureKind::Edge),
        2 => Some(FeatureKind::Triangle),
        _ => None,
    }
}
