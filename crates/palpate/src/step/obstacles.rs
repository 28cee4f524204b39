//! The tool at fixed bodies: rows for the tick, in which nothing yields but the coupling between device and tool.
//!
//! Such a row has no part of the tissue, and `W` is zero for it: at step rate, where the tool is wherever it is told, its
//! force has no bound. The tick adds the compliance of the coupling, `c`, and finds `λ = -δ / c`.
//!
//! The rows are those of the tool's pose at the end of the step, and frozen until the next. So they are made for all that
//! the tool may reach until two more steps have passed, as a patch is: a wall that is met between two steps stops it.

use nalgebra::Vector3;
use palpate_collision::ToolPose;
use palpate_collision::detection::DetectionConfig;
use palpate_collision::solid_contact::{Placed, SolidContact, meet};
use palpate_collision::tool::Jaw;
use palpate_constraints::law::Law;
use palpate_constraints::rows::{ContactRows, Counterpart, RigidSide, ToolMotion, Twist, append_solid_rows};

use super::bodies::identity;
use super::patch::travel;
use super::{StepInput, StepReport};
use crate::world::{Far, Near, World};

/// Rows of the tool at fixed bodies, and memory for them.
pub(super) struct ObstacleStage {
    /// Contacts that fit.
    room: usize,
    contacts: Vec<SolidContact>,
    pub(super) rows: ContactRows,
    /// Law, identity and jaw of each block.
    blocks: Vec<(Law, u64, Option<Jaw>)>,
}

impl ObstacleStage {
    pub(super) fn new(world: &World) -> Self {
        let room = world.obstacle_capacity();
        Self {
            room,
            contacts: Vec::with_capacity(room),
            rows: ContactRows::with_capacity(room),
            blocks: Vec::with_capacity(room),
        }
    }

    /// Law and identity of block `k`, as the tick knows contacts.
    pub(super) fn block(&self, k: usize) -> Option<(Law, u64)> {
        self.blocks.get(k).map(|&(law, feature, _)| (law, feature))
    }

    /// The jaw of the tool that block `k` is of.
    pub(super) fn jaw(&self, k: usize) -> Option<Jaw> {
        self.blocks.get(k)?.2
    }

    /// Finds what is near the tool. `before` is its pose in the step before.
    pub(super) fn find(
        &mut self,
        world: &World,
        input: &StepInput<'_>,
        before: Option<&ToolPose>,
        report: &mut StepReport,
    ) {
        self.rows.clear();
        self.blocks.clear();
        let bodies = world.bodies();
        let motion =
            before.map_or_else(ToolMotion::none, |before| ToolMotion::of_tool(world.tool(), before, &input.tool));
        // It neither moves nor yields, and of its side of a row nothing reaches the tick.
        let still = RigidSide { body: 0, centre: Vector3::zeros(), free: Twist::default() };
        let reach = travel(world.tool(), before, &input.tool);
        for (k, pair) in bodies.obstacles.iter().enumerate() {
            let (Near::Fixed(number), Far::Tool(part)) = (pair.near, pair.far) else { continue };
            let (Some(body), Some(solid)) = (bodies.fixed.get(number), world.tool_solid(part)) else { continue };
            let place = world.tool().part_pose(part, &input.tool);
            let jaw = world.tool().parts().get(part).and_then(|part| part.jaw);
            let counterpart =
                Counterpart::Tool { reference: input.tool.frame.translation.vector, motion: motion.of(jaw) };
            let config = DetectionConfig {
                margin: pair.detection.margin + reach,
                max_contacts: pair.detection.max_contacts.min(self.room),
                ..pair.detection
            };
            let seen = meet(
                Placed { solid: &body.solid, pose: &body.pose },
                Placed { solid, pose: &place },
                &config,
                &mut self.contacts,
            );
            let friction = pair.law.rows() > 1;
            let made = append_solid_rows(&self.contacts, &still, &counterpart, world.dt(), friction, &mut self.rows);
            report.bodies.dropped += (seen.dropped + made.dropped) as u32;
            report.bodies.non_finite += u32::from(seen.non_finite);
            let fresh = self.rows.blocks.iter().skip(self.blocks.len());
            let features = fresh.filter_map(|block| self.contacts.get(block.contact as usize)).map(|c| c.feature);
            // Rigid bodies that the tool touches have the numbers of their pairs.
            self.blocks.extend(features.map(|feature| (pair.law, identity(feature, bodies.pairs.len() + k), jaw)));
        }
    }
}
