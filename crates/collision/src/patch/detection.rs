//! Detection between a tool and a patch of skin.

use nalgebra::{Isometry3, Vector3};

use super::SkinPatch;
use crate::contact::Contact;
use crate::detection::{ContactKind, DetectionConfig, Rank, keep_deepest_of, keep_faced};
use crate::features::{Collector, Feature, Meeting};
use crate::narrow_phase::HullInWorld;
use crate::shape::ToolShape;
use crate::tool::{PlacedPart, Tool, ToolPose};

/// Memory for detection on patches, and its contacts.
#[derive(Clone, Debug)]
pub struct PatchDetection {
    features: Vec<Feature>,
    ranks: Vec<Rank>,
    contacts: Vec<Contact>,
    max_contacts: usize,
    hull: HullInWorld,
}

impl PatchDetection {
    /// Memory for patches of up to `max_nodes` nodes, this tool, and up to `max_contacts` contacts.
    #[must_use]
    pub fn new(max_nodes: usize, max_contacts: usize, tool: &ToolShape) -> Self {
        Self::with_parts(max_nodes, max_contacts, std::iter::once(tool))
    }

    /// The same for a tool of several parts.
    #[must_use]
    pub fn for_tool(max_nodes: usize, max_contacts: usize, tool: &Tool) -> Self {
        Self::with_parts(max_nodes, max_contacts, tool.parts().iter().map(|part| &part.shape))
    }

    fn with_parts<'a>(max_nodes: usize, max_contacts: usize, parts: impl Iterator<Item = &'a ToolShape>) -> Self {
        let mut hull = HullInWorld::default();
        parts.filter_map(ToolShape::hull).for_each(|shape| hull.place(shape, &Isometry3::identity()));
        // A triangle gives a capsule three points; a hull's corners and edges may give more, and the collector bounds them.
        let (room, contacts) = (8 * max_nodes + 64, Vec::with_capacity(max_contacts));
        Self { features: Vec::with_capacity(room), ranks: Vec::with_capacity(room), contacts, max_contacts, hull }
    }

    /// Contacts of the last detection, ascending by feature. Their nodes are numbers within the patch.
    #[must_use]
    pub fn contacts(&self) -> &[Contact] {
        &self.contacts
    }

    /// Finds the contacts between the patch, its nodes at `positions` \[m\], and the tool at a pose. Returns how many
    /// contacts found no room: those are the shallowest. Work is bounded by the patch and the tool; nothing is allocated.
    /// The side from which the tool came is that of the detection that the patch was gathered with.
    pub fn detect(
        &mut self,
        patch: &SkinPatch,
        positions: &[Vector3<f64>],
        tool: &ToolShape,
        pose: &Isometry3<f64>,
        config: &DetectionConfig,
    ) -> usize {
        self.detect_parts(patch, positions, std::iter::once(PlacedPart::alone(tool, pose)), config)
    }

    /// The same for a tool of several parts.
    pub fn detect_tool(
        &mut self,
        patch: &SkinPatch,
        positions: &[Vector3<f64>],
        tool: &Tool,
        pose: &ToolPose,
        config: &DetectionConfig,
    ) -> usize {
        self.detect_parts(patch, positions, tool.placed(*pose), config)
    }

    fn detect_parts<'a>(
        &mut self,
        patch: &SkinPatch,
        positions: &[Vector3<f64>],
        parts: impl Iterator<Item = PlacedPart<'a>>,
        config: &DetectionConfig,
    ) -> usize {
        self.features.clear();
        self.contacts.clear();
        let mut crowded = 0;
        for (k, part) in parts.enumerate() {
            let meeting = Meeting { surface: patch, positions, tool: part.shape, pose: &part.pose };
            let side = if k == 0 { patch.side } else { patch.other_sides.get(k - 1).copied().flatten() };
            crowded += self.detect_part(&meeting, part.tag, side, config);
        }
        // The memory of the contacts is what there is: a larger wish must not make it grow.
        let room = config.max_contacts.min(self.max_contacts);
        let config = DetectionConfig { max_contacts: room, ..*config };
        crowded + keep_deepest_of(&mut self.features, &mut self.ranks, &config, &mut self.contacts).dropped
    }

    /// Appends the features of one part, and returns how many found no room.
    fn detect_part(
        &mut self,
        meeting: &Meeting<SkinPatch>,
        tag: u64,
        side: Option<Vector3<f64>>,
        config: &DetectionConfig,
    ) -> usize {
        let Meeting { surface: patch, positions, tool, pose } = *meeting;
        let start = self.features.len();
        let mut found = Collector::new(&mut self.features, config.margin, tag);
        let nodes = 0..patch.names.len() as u32;
        let triangles = 0..patch.triangles.len() as u32;
        match (config.kind, tool.axis(pose), tool.hull()) {
            (ContactKind::Faces, Some(axis), _) => triangles.for_each(|t| meeting.face(t, &axis, &mut found)),
            (ContactKind::Faces, None, Some(hull)) => {
                self.hull.place(hull, pose);
                nodes.for_each(|node| meeting.node(node, &mut found));
                triangles.for_each(|t| meeting.hull_corners(t, hull, &self.hull, &mut found));
                let range = config.margin.max(config.reach);
                (0..patch.edges.len() as u32).for_each(|e| meeting.hull_edges(e, hull, &self.hull, range, &mut found));
            }
            _ => nodes.for_each(|node| meeting.node(node, &mut found)),
        }
        let crowded = found.dropped;
        if let Some(side) = &side {
            keep_faced(&mut self.features, start, side, |x| patch.is_below(&tool.core(pose, x), positions));
        }
        crowded
    }
}
