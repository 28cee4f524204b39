//! The fixed and rigid bodies of a scene, and which bodies can touch.

use std::fmt;

use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};
use palpate_collision::contact::ContactSet;
use palpate_collision::detect_solid;
use palpate_collision::detection::{DetectionConfig, DetectionWorkspace};
use palpate_collision::solid::Solid;
use palpate_collision::solid_contact::{Placed, meet};
use palpate_fem::closed_surface::ClosedSurface;
use palpate_rigid::{Moments, RigidModel, RigidState};

use super::World;
use crate::scene::{Scene, SceneError, SceneFile, SolidShape};

/// A body that never moves.
#[derive(Clone, Debug)]
pub struct FixedBody {
    /// Name in reports.
    pub name: String,
    /// Shape, in its own frame.
    pub solid: Solid,
    /// From that frame to the world.
    pub pose: Isometry3<f64>,
    friction: f64,
    max_contacts: usize,
}

/// A body with six degrees of freedom.
#[derive(Clone, Debug)]
pub struct RigidBody {
    /// Name in reports.
    pub name: String,
    /// Shape, in its own frame.
    pub solid: Solid,
    /// Mass and inertia.
    pub model: RigidModel,
    /// Centre of mass in the frame of the shape (m).
    pub centre: Vector3<f64>,
    /// How it begins.
    pub start: RigidState,
    friction: f64,
    max_contacts: usize,
}

impl RigidBody {
    /// Pose of its shape: from the frame of the shape to the world.
    pub fn shape_pose(&self, state: &RigidState) -> Isometry3<f64> {
        state.pose * Translation3::from(-self.centre)
    }
}

/// The body that the normals of a pair point to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Near {
    /// The soft body.
    Soft,
    /// A rigid body, by number.
    Rigid(usize),
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
    /// Coefficient of Coulomb friction between them; 0 leaves one row a contact.
    pub friction: f64,
    /// How their contacts are found.
    pub detection: DetectionConfig,
}

/// The bodies of a scene besides the soft one, and the pairs that can touch.
#[derive(Clone, Debug, Default)]
pub struct Bodies {
    /// Fixed bodies.
    pub fixed: Vec<FixedBody>,
    /// Rigid bodies.
    pub rigid: Vec<RigidBody>,
    /// The pairs.
    pub pairs: Vec<Pair>,
}

impl Bodies {
    /// Reads shapes and finds masses and pairs.
    pub(super) fn new(scene: &Scene, detection: &DetectionConfig) -> Result<Self, SceneError> {
        let description = scene.description();
        let contact = &description.contact;
        let mut bodies = Self::default();
        for (k, body) in description.fixed_bodies.iter().enumerate() {
            bodies.fixed.push(FixedBody {
                name: body.name.clone(),
                solid: solid(scene, &format!("fixed_body.{k}.shape"), &body.shape)?,
                pose: pose(&body.position, &body.rotation),
                friction: body.friction.unwrap_or(contact.friction),
                max_contacts: body.max_contacts.unwrap_or(contact.max_contacts),
            });
        }
        for (k, body) in description.rigid_bodies.iter().enumerate() {
            let path = format!("rigid_body.{k}.shape");
            let solid = solid(scene, &path, &body.shape)?;
            let refuse = |message: String| scene.at(&path, message, "give a closed shape with a volume");
            let moments = moments(&solid).filter(|m| m.volume > 0.0 && m.volume.is_finite());
            let moments = moments.ok_or_else(|| refuse("the shape encloses no volume".into()))?;
            let inertia = match body.inertia {
                Some(moments) => Matrix3::from_diagonal(&moments.into()),
                None => moments.inertia * (body.mass / moments.volume),
            };
            let model = RigidModel::new(body.mass, inertia).map_err(|e| refuse(e.to_string()))?;
            let start = pose(&body.position, &body.rotation) * Translation3::from(moments.centroid);
            bodies.rigid.push(RigidBody {
                name: body.name.clone(),
                solid,
                centre: moments.centroid,
                start: RigidState::new(&model, start, body.velocity.into(), body.angular_velocity.into()),
                model,
                friction: body.friction.unwrap_or(contact.friction),
                max_contacts: body.max_contacts.unwrap_or(contact.max_contacts),
            });
        }
        bodies.pairs = bodies.find_pairs(detection, contact.friction, description.tools[0].shape.parts().len());
        Ok(bodies)
    }

    /// All pairs in a stated order: each rigid body with the parts of the tool, the soft body with each fixed and each rigid one, then
    /// each rigid body with the fixed ones and with the rigid ones after it.
    fn find_pairs(&self, detection: &DetectionConfig, of_contact: f64, tool_parts: usize) -> Vec<Pair> {
        let pair = |near, far, friction, max_contacts| Pair {
            near,
            far,
            friction,
            detection: DetectionConfig { max_contacts, ..*detection },
        };
        let mean = |a: f64, b: f64| (a * b).sqrt();
        let mut pairs = Vec::new();
        for (k, body) in self.rigid.iter().enumerate() {
            let most = body.max_contacts.min(detection.max_contacts);
            for part in 0..tool_parts {
                pairs.push(pair(Near::Rigid(k), Far::Tool(part), mean(body.friction, of_contact), most));
            }
        }
        for (k, body) in self.fixed.iter().enumerate() {
            pairs.push(pair(Near::Soft, Far::Fixed(k), body.friction, body.max_contacts));
        }
        for (k, body) in self.rigid.iter().enumerate() {
            pairs.push(pair(Near::Soft, Far::Rigid(k), body.friction, body.max_contacts));
        }
        for (k, body) in self.rigid.iter().enumerate() {
            let with = |far, friction, most: usize| pair(Near::Rigid(k), far, friction, body.max_contacts.min(most));
            for (j, fixed) in self.fixed.iter().enumerate() {
                pairs.push(with(Far::Fixed(j), mean(body.friction, fixed.friction), fixed.max_contacts));
            }
            for (j, other) in self.rigid.iter().enumerate().skip(k + 1) {
                pairs.push(with(Far::Rigid(j), mean(body.friction, other.friction), other.max_contacts));
            }
        }
        pairs
    }

    /// True where the scene has none.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Most contacts of all pairs together.
    pub fn contact_capacity(&self) -> usize {
        self.pairs.iter().map(|pair| pair.detection.max_contacts).sum()
    }
}

impl fmt::Display for Bodies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let contacts =
            |friction: f64, most: usize| format!("friction {friction}, at most {most} contacts with another body");
        for body in &self.fixed {
            let [x, y, z]: [f64; 3] = body.pose.translation.vector.into();
            let of_contact = contacts(body.friction, body.max_contacts);
            writeln!(f, "fixed body {}: {} at [{x}, {y}, {z}] m, {of_contact}", body.name, kind(&body.solid))?;
        }
        for body in &self.rigid {
            let [x, y, z]: [f64; 3] = body.start.pose.translation.vector.into();
            let moments = body.model.inertia().symmetric_eigenvalues();
            let of_contact = contacts(body.friction, body.max_contacts);
            writeln!(
                f,
                "rigid body {}: {}, {} kg, moments of inertia {:.3e} {:.3e} {:.3e} kg m², centre of mass at \
                 [{x:.4}, {y:.4}, {z:.4}] m, {of_contact}",
                body.name,
                kind(&body.solid),
                body.model.mass(),
                moments.x,
                moments.y,
                moments.z,
            )?;
        }
        Ok(())
    }
}

fn kind(solid: &Solid) -> String {
    match solid {
        Solid::HalfSpace(n) => format!("half-space, normal [{:.4}, {:.4}, {:.4}]", n.x, n.y, n.z),
        Solid::Mesh(mesh) => format!("mesh of {} triangles", mesh.triangles().len()),
        Solid::Convex(shape) => match (shape.hull(), shape.axis(&Isometry3::identity())) {
            (Some(hull), _) => format!("hull of {} vertices", hull.vertices().len()),
            (None, Some([a, b])) if a != b => {
                format!("capsule, radius {} m, half length {} m", shape.inner_radius(), 0.5 * (b - a).norm())
            }
            _ => format!("sphere, radius {} m", shape.inner_radius()),
        },
    }
}

/// Refuses bodies that begin inside one another by more than the margin: the first step would throw them apart.
pub(super) fn apart(world: &World) -> Result<(), SceneError> {
    let bodies = world.bodies();
    let mut ws = DetectionWorkspace::new(world.geometry());
    let tool = world.first_tool();
    let of_rigid = |k: usize| bodies.rigid.get(k).map(|b| (b.name.as_str(), &b.solid, b.shape_pose(&b.start)));
    for pair in &bodies.pairs {
        let (far, key) = match pair.far {
            Far::Tool(part) => {
                let name = world.description().tools[0].name.as_str();
                let place = world.tool().part_pose(part, &tool);
                (world.tool_solid(part).map(|solid| (name, solid, place)), "hand.path.0".into())
            }
            Far::Fixed(k) => {
                let far = bodies.fixed.get(k).map(|b| (b.name.as_str(), &b.solid, b.pose));
                (far, format!("fixed_body.{k}"))
            }
            Far::Rigid(k) => (of_rigid(k), format!("rigid_body.{k}")),
        };
        let Some((far_name, far, far_pose)) = far else { continue };
        let (near_name, gap) = match pair.near {
            Near::Soft => {
                let mut found = ContactSet::with_capacity(pair.detection.max_contacts);
                let q = &world.mesh().nodes;
                let seen = detect_solid(world.geometry(), q, far, &far_pose, &pair.detection, &mut ws, &mut found);
                (world.description().bodies[0].name.as_str(), seen.deepest_gap)
            }
            Near::Rigid(k) => {
                let Some((name, near, near_pose)) = of_rigid(k) else { continue };
                let mut found = Vec::with_capacity(pair.detection.max_contacts);
                let near = Placed { solid: near, pose: &near_pose };
                meet(near, Placed { solid: far, pose: &far_pose }, &pair.detection, &mut found);
                (name, found.iter().map(|c| c.gap).fold(f64::INFINITY, f64::min))
            }
        };
        if gap < -pair.detection.margin {
            let message = format!("`{near_name}` and `{far_name}` overlap by {:.4} m before the first step", -gap);
            return Err(world.scene().at(&key, message, "move them apart; contact begins at the margin"));
        }
    }
    Ok(())
}

fn pose(position: &[f64; 3], rotation: &[f64; 3]) -> Isometry3<f64> {
    Isometry3::new((*position).into(), (*rotation).into())
}

/// The shape that a scene describes, read from its file where it is one.
fn solid(scene: &Scene, path: &str, shape: &SolidShape) -> Result<Solid, SceneError> {
    let refuse = |message: String| scene.at(path, message, "correct the shape");
    if let Some(solid) = shape.solid() {
        return solid.map_err(|e| refuse(e.to_string()));
    }
    let SolidShape::Mesh { file, scale } = shape else { return Err(refuse("an unknown shape".into())) };
    let SceneFile::Path(path_of_file) = scene.file(file) else {
        return Err(refuse(format!("`{file}` is not a closed surface")));
    };
    let surface = ClosedSurface::from_path(&path_of_file, *scale)?;
    Solid::mesh(surface.vertices().to_vec(), surface.triangles().to_vec()).map_err(|e| refuse(e.to_string()))
}

/// Moments of an evenly filled solid; none for a half-space.
fn moments(solid: &Solid) -> Option<Moments> {
    match solid {
        Solid::HalfSpace(_) => None,
        Solid::Mesh(mesh) => Some(Moments::of_surface(mesh.vertices(), mesh.triangles())),
        Solid::Convex(shape) => {
            if let Some(hull) = shape.hull() {
                return Some(Moments::of_surface(hull.vertices(), hull.triangles()));
            }
            let [a, b] = shape.axis(&Isometry3::identity())?;
            let radius = shape.inner_radius();
            Some(if a == b { Moments::of_sphere(radius) } else { Moments::of_capsule(0.5 * (b - a).norm(), radius) })
        }
    }
}
