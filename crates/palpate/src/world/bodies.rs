//! The fixed and rigid bodies of a scene.

use std::fmt;

use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};
use palpate_collision::detection::DetectionConfig;
use palpate_collision::solid::Solid;
use palpate_fem::closed_surface::ClosedSurface;
use palpate_rigid::{Moments, RigidModel, RigidState};

use super::pairs::{Pair, obstacles, pairs};
use crate::counted::counted;
use crate::scene::{ContactDescription, Scene, SceneError, SceneFile, SolidShape};

/// Pairs of bodies that a contact's name can tell apart: what features leave free of its 64 bits.
pub(crate) const MOST_PAIRS: usize = 512;

/// A body that never moves.
#[derive(Clone, Debug)]
pub struct FixedBody {
    /// Name in reports.
    pub name: String,
    /// Shape, in its own frame.
    pub solid: Solid,
    /// From that frame to the world.
    pub pose: Isometry3<f64>,
    /// How others touch it: `[contact]` with its own friction and number of contacts.
    pub(super) contact: ContactDescription,
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
    /// How others touch it: `[contact]` with its own friction and number of contacts.
    pub(super) contact: ContactDescription,
}

impl RigidBody {
    /// Pose of its shape: from the frame of the shape to the world.
    pub fn shape_pose(&self, state: &RigidState) -> Isometry3<f64> {
        state.pose * Translation3::from(-self.centre)
    }
}

/// The bodies of a scene besides the soft one, and the pairs that can touch.
#[derive(Clone, Debug, Default)]
pub struct Bodies {
    /// Fixed bodies.
    pub fixed: Vec<FixedBody>,
    /// Rigid bodies.
    pub rigid: Vec<RigidBody>,
    /// The pairs whose forces the step finds.
    pub pairs: Vec<Pair>,
    /// Each fixed body with the tool. Nothing yields there but the coupling between device and tool, so these contacts are
    /// the tick's alone.
    pub obstacles: Vec<Pair>,
}

impl Bodies {
    /// Reads shapes and finds masses and pairs.
    pub(super) fn new(scene: &Scene, detection: &DetectionConfig) -> Result<Self, SceneError> {
        let description = scene.description();
        let contact = &description.contact;
        let of_body = |friction: Option<f64>, most: Option<usize>| ContactDescription {
            friction: friction.unwrap_or(contact.friction),
            max_contacts: most.unwrap_or(contact.max_contacts),
            ..*contact
        };
        let mut bodies = Self::default();
        for (k, body) in description.fixed_bodies.iter().enumerate() {
            bodies.fixed.push(FixedBody {
                name: body.name.clone(),
                solid: solid(scene, &format!("fixed_body.{k}.shape"), &body.shape)?,
                pose: pose(&body.position, &body.rotation),
                contact: of_body(body.friction, body.max_contacts),
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
                contact: of_body(body.friction, body.max_contacts),
            });
        }
        let parts = description.tools[0].shape.parts().len();
        bodies.pairs = pairs(&bodies, parts, contact, detection);
        bodies.obstacles = obstacles(&bodies, parts, contact, detection);
        let pairs = bodies.pairs.len() + bodies.obstacles.len();
        if pairs > MOST_PAIRS {
            let message = format!("{pairs} pairs of bodies and parts of the tool can touch, more than {MOST_PAIRS}");
            return Err(scene.at("rigid_body", message, "leave bodies out, or join fixed ones into one mesh"));
        }
        Ok(bodies)
    }

    /// True where the scene has none.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Most contacts of all pairs together.
    pub fn contact_capacity(&self) -> usize {
        self.pairs.iter().map(|pair| pair.detection.max_contacts).sum()
    }

    /// Most contacts of the tool with all fixed bodies together: as many as `max_contacts` of `[contact]`.
    pub fn obstacle_capacity(&self, of_tool: usize) -> usize {
        self.obstacles.iter().map(|pair| pair.detection.max_contacts).sum::<usize>().min(of_tool)
    }
}

impl fmt::Display for Bodies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let contacts = |contact: &ContactDescription| {
            let most = counted(contact.max_contacts, "contact", "contacts");
            format!("{}, at most {most} with another body", contact.law_in_words())
        };
        for body in &self.fixed {
            let [x, y, z]: [f64; 3] = body.pose.translation.vector.into();
            let of_contact = contacts(&body.contact);
            writeln!(f, "fixed body {}: {} at [{x}, {y}, {z}] m, {of_contact}", body.name, kind(&body.solid))?;
        }
        for body in &self.rigid {
            let [x, y, z]: [f64; 3] = body.start.pose.translation.vector.into();
            let moments = body.model.inertia().symmetric_eigenvalues();
            let of_contact = contacts(&body.contact);
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
    scene.check_file(&format!("{path}.file"), &path_of_file)?;
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

#[cfg(test)]
mod tests {
    use std::fmt::Write;
    use std::path::Path;

    use super::*;

    const BLOCK: &str = r#"
        name = "many"
        gravity = [0, 0, 0]
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.03, 0.03, 0.03], cells = [2, 2, 2] }
        material = { law = "neo_hookean", young = 1e4, poisson = 0.4 }
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.01 }
        [hand]
        path = [{ time = 0.0, position = [0.0, 0.0, 0.1] }]
    "#;

    /// `n` balls touch the tissue, the tool and one another: n (n + 3) / 2 pairs, which the names of contacts tell apart.
    #[test]
    fn as_many_bodies_are_taken_as_contacts_can_be_told_apart() {
        let build = |n: usize| {
            let mut text = BLOCK.to_string();
            for k in 0..n {
                let x = 1.0 + 0.1 * k as f64;
                let ball = r#"shape = { kind = "sphere", radius = 0.01 }"#;
                writeln!(text, "[[rigid_body]]\nname = \"b{k}\"\n{ball}\nmass = 0.1\nposition = [{x}, 0, 0]").unwrap();
            }
            Scene::from_toml(&text, Path::new("")).unwrap().build()
        };
        assert_eq!(build(30).unwrap_or_else(|e| panic!("{e}")).bodies().pairs.len(), 495);
        let told = build(31).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(told.contains("527 pairs") && told.contains("more than 512"), "{told}");
    }
}
