//! Which bodies can touch, and by what law.

use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::contact::ContactSet;
use palpate_collision::detect_solid;
use palpate_collision::detection::{DetectionConfig, DetectionWorkspace};
use palpate_collision::solid_contact::{Placed, meet};
use palpate_constraints::law::Law;

use super::World;
use super::bodies::Bodies;
use crate::scene::{ContactDescription, SceneError};

/// The body that the normals of a pair point to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Near {
    /// The soft body.
    Soft,
    /// A rigid body, by number.
    Rigid(usize),
    /// A fixed body, by number.
    Fixed(usize),
}

/// The body that they point away from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Far {
    /// A part of the tool, by number.
    Tool(usize),
    /// A fixed body, by number.
    Fixed(usize),
    /// A rigid body, by number.
    Rigid(usize),
}

/// Two bodies that can touch, besides soft body and tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// One of them.
    pub near: Near,
    /// The other.
    pub far: Far,
    /// The scene's law with the friction of these two.
    pub law: Law,
    /// How their contacts are found.
    pub detection: DetectionConfig,
}

impl Pair {
    fn new(near: Near, far: Far, contact: &ContactDescription, detection: &DetectionConfig) -> Self {
        let detection = DetectionConfig { max_contacts: contact.max_contacts, ..*detection };
        Self { near, far, law: contact.contact_law(), detection }
    }
}

/// How two bodies touch: with the geometric mean of their friction, at no more places than either allows.
fn both(a: &ContactDescription, b: &ContactDescription) -> ContactDescription {
    ContactDescription {
        friction: (a.friction * b.friction).sqrt(),
        max_contacts: a.max_contacts.min(b.max_contacts),
        ..*a
    }
}

/// All pairs whose forces the step finds, in a stated order: each rigid body with the parts of the tool, the soft body with each fixed
/// and each rigid one, then each rigid body with the fixed ones and with the rigid ones after it.
pub(super) fn pairs(
    bodies: &Bodies,
    tool_parts: usize,
    of_tool: &ContactDescription,
    detection: &DetectionConfig,
) -> Vec<Pair> {
    let pair = |near, far, contact: &ContactDescription| Pair::new(near, far, contact, detection);
    let mut pairs = Vec::new();
    for (k, body) in bodies.rigid.iter().enumerate() {
        for part in 0..tool_parts {
            pairs.push(pair(Near::Rigid(k), Far::Tool(part), &both(&body.contact, of_tool)));
        }
    }
    for (k, body) in bodies.fixed.iter().enumerate() {
        pairs.push(pair(Near::Soft, Far::Fixed(k), &body.contact));
    }
    for (k, body) in bodies.rigid.iter().enumerate() {
        pairs.push(pair(Near::Soft, Far::Rigid(k), &body.contact));
    }
    for (k, body) in bodies.rigid.iter().enumerate() {
        for (j, fixed) in bodies.fixed.iter().enumerate() {
            pairs.push(pair(Near::Rigid(k), Far::Fixed(j), &both(&body.contact, &fixed.contact)));
        }
        for (j, other) in bodies.rigid.iter().enumerate().skip(k + 1) {
            pairs.push(pair(Near::Rigid(k), Far::Rigid(j), &both(&body.contact, &other.contact)));
        }
    }
    pairs
}

/// Each fixed body with the parts of the tool.
pub(super) fn obstacles(
    bodies: &Bodies,
    tool_parts: usize,
    of_tool: &ContactDescription,
    detection: &DetectionConfig,
) -> Vec<Pair> {
    let with = |(k, contact), part| Pair::new(Near::Fixed(k), Far::Tool(part), &both(contact, of_tool), detection);
    let fixed = bodies.fixed.iter().enumerate().map(|(k, body)| (k, &body.contact));
    fixed.flat_map(|body| (0..tool_parts).map(move |part| with(body, part))).collect()
}

/// Refuses bodies that begin inside one another by more than the margin: the first step would throw them apart. `skin` is
/// refitted to where the soft body begins. Where a real hand begins is its own affair.
pub(super) fn apart(world: &World, skin: &SurfaceGeometry) -> Result<(), SceneError> {
    let bodies = world.bodies();
    let mut ws = DetectionWorkspace::new(skin);
    let tool = world.first_tool();
    let of_rigid = |k: usize| bodies.rigid.get(k).map(|b| (b.name.as_str(), &b.solid, b.shape_pose(&b.start)));
    let of_fixed = |k: usize| bodies.fixed.get(k).map(|b| (b.name.as_str(), &b.solid, b.pose));
    let led = !world.description().hand.path.is_empty();
    for pair in bodies.pairs.iter().chain(&bodies.obstacles).filter(|pair| led || !matches!(pair.far, Far::Tool(_))) {
        let (far, key) = match pair.far {
            Far::Tool(part) => {
                let name = world.description().tools[0].name.as_str();
                let place = world.tool().part_pose(part, &tool);
                (world.tool_solid(part).map(|solid| (name, solid, place)), "hand.path.0".into())
            }
            Far::Fixed(k) => (of_fixed(k), format!("fixed_body.{k}")),
            Far::Rigid(k) => (of_rigid(k), format!("rigid_body.{k}")),
        };
        let Some((far_name, far, far_pose)) = far else { continue };
        let mut remedy = "move them apart; contact begins at the margin";
        let near = match pair.near {
            Near::Soft => None,
            Near::Rigid(k) => of_rigid(k),
            Near::Fixed(k) => of_fixed(k),
        };
        let (near_name, gap) = match near {
            None => {
                if world.settled().is_some() {
                    remedy = "the body settles without contact: move them apart, or set settle = false for the body";
                }
                let mut found = ContactSet::with_capacity(pair.detection.max_contacts);
                let q = &world.start().q;
                let seen = detect_solid(skin, q, far, &far_pose, &pair.detection, &mut ws, &mut found);
                (world.description().bodies[0].name.as_str(), seen.deepest_gap)
            }
            Some((name, near, near_pose)) => {
                let mut found = Vec::with_capacity(pair.detection.max_contacts);
                let near = Placed { solid: near, pose: &near_pose };
                meet(near, Placed { solid: far, pose: &far_pose }, &pair.detection, &mut found);
                (name, found.iter().map(|c| c.gap).fold(f64::INFINITY, f64::min))
            }
        };
        if gap < -pair.detection.margin {
            let message = format!("`{near_name}` and `{far_name}` overlap by {:.4} m before the first step", -gap);
            return Err(world.scene().at(&key, message, remedy));
        }
    }
    Ok(())
}
