//! The bundled organ in several sizes and stiffness ratios, and how it moves before a step.

use miette::{Result, miette};
use nalgebra::{Isometry3, Rotation3, Vector3};
use palpate::collision::shape::ToolShape;
use palpate::constraints::compliance::ComplianceMethod;
use palpate::constraints::frame::ContactFrame;
use palpate::fem::material::Material;
use palpate::prelude::*;
use palpate::step::{GivenContact, StepStatus};

/// Steps of a motion: the oldest factor is that of its begin.
pub(crate) const STEPS: usize = 30;

/// Contacts of the measured step.
const CONTACTS: usize = 10;

/// Twist of the whole organ from end to end, reached in [`STEPS`] steps (rad).
const TWIST: f64 = 1.0;

/// How deep the ball goes in [`STEPS`] steps (m), and its radius.
const DEPTH: f64 = 0.025;
const BALL: f64 = 0.02;

/// Gap of each contact if nothing touched (m).
const GAP: f64 = -1e-3;

/// What the organ does in the steps before the measured one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Motion {
    /// Nothing.
    Still,
    /// It is twisted about its longest axis.
    Twisting,
    /// A ball presses into it.
    Pressed,
}

impl Motion {
    pub(crate) const ALL: [Self; 3] = [Self::Still, Self::Twisting, Self::Pressed];

    /// In words.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Twisting => "twisting",
            Self::Pressed => "pressed deep",
        }
    }
}

/// The scene of the organ with cells of this size (m); its lesion as stiff as the rest, or `ratio` times stiffer.
pub(crate) fn organ(cell: f64, ratio: f64) -> Result<Scene> {
    let mut scene = Scene::bundled("liver").map_err(|e| miette!("{e}"))?;
    scene.use_cell(cell).map_err(|e| miette!("{e}"))?;
    let mut trouble = None;
    scene
        .edit(|description| {
            let body = &mut description.bodies[0];
            body.regions.retain(|name, _| name == "lesion");
            for tissue in body.regions.values_mut() {
                match Material::from_young_poisson("neo_hookean", 6e3 * ratio, 0.45) {
                    Some(law) => tissue.law = law,
                    None => trouble = Some(miette!("there is no neo-Hookean law")),
                }
            }
            match ToolShape::sphere(BALL) {
                Ok(ball) => description.tools[0].shape = ball.into(),
                Err(e) => trouble = Some(miette!("{e}")),
            }
            description.hand.path.iter_mut().for_each(|key| key.position[1] -= BALL);
        })
        .map_err(|e| miette!("{e}"))?;
    trouble.map_or(Ok(scene), Err)
}

/// The organ by a method of compliance, with what else `change` says.
pub(crate) fn world(
    organ: &Scene,
    compliance: ComplianceMethod,
    change: impl FnOnce(&mut SceneDescription),
) -> Result<World> {
    let mut scene = organ.clone();
    scene
        .edit(|description| {
            description.bodies[0].compliance = compliance;
            change(description);
        })
        .map_err(|e| miette!("{e}"))?;
    scene.build().map_err(|e| miette!("{e}"))
}

/// Positions (m) before each of [`STEPS`] + 1 steps; the last is the measured one. `None` where a step failed.
pub(crate) fn positions(world: &World, motion: Motion) -> Option<Vec<Vec<Vector3<f64>>>> {
    let rest = &world.mesh().nodes;
    match motion {
        Motion::Still => Some(vec![rest.clone(); STEPS + 1]),
        Motion::Twisting => {
            let (low, high) =
                rest.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x.x), b.max(x.x)));
            let centre = rest.iter().sum::<Vector3<f64>>() / rest.len() as f64;
            let twisted = |k: usize| {
                let all = TWIST * k as f64 / STEPS as f64;
                let place = |x: &Vector3<f64>| {
                    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), all * (x.x - low) / (high - low));
                    centre + turn * (x - centre)
                };
                rest.iter().map(place).collect()
            };
            Some((0..=STEPS).map(twisted).collect())
        }
        Motion::Pressed => {
            let mut simulation = Simulation::new(world).ok()?;
            let first = world.first_pose().translation.vector;
            // The ball waits above the nearest skin: it touches within the first steps.
            let skin = nearest_skin(world, &first);
            let towards = (skin - first).normalize();
            let start = skin - towards * BALL;
            let mut all = vec![simulation.positions().to_vec()];
            for k in 1..=STEPS {
                let at = start + towards * (DEPTH * k as f64 / STEPS as f64);
                if simulation.step(&Isometry3::from(at)).status != StepStatus::Advanced {
                    return None;
                }
                all.push(simulation.positions().to_vec());
            }
            Some(all)
        }
    }
}

fn nearest_skin(world: &World, to: &Vector3<f64>) -> Vector3<f64> {
    let nodes = &world.mesh().nodes;
    let skin = world.surface().triangles.iter().flatten().map(|&n| nodes[n as usize]);
    skin.min_by(|a, b| (a - to).norm().total_cmp(&(b - to).norm())).unwrap_or(*to)
}

/// [`CONTACTS`] contacts of the free skin nearest to where the hand begins, at positions `q`.
pub(crate) fn contacts(world: &World, q: &[Vector3<f64>]) -> Vec<GivenContact> {
    let mut normals = vec![Vector3::zeros(); q.len()];
    for t in &world.surface().triangles {
        let [a, b, c] = t.map(|n| q[n as usize]);
        t.iter().for_each(|&n| normals[n as usize] += (b - a).cross(&(c - a)));
    }
    let hand = world.first_pose().translation.vector;
    let rest = &world.mesh().nodes;
    let node = |free: u32| world.model().node_of_free()[free as usize] as usize;
    let mut skin = world.free_skin();
    skin.sort_by(|&a, &b| (rest[node(a)] - hand).norm().total_cmp(&(rest[node(b)] - hand).norm()));
    skin.truncate(CONTACTS);
    let contact = |free: u32| {
        // From the tool to the tissue: into the skin.
        let frame = ContactFrame::new(-normals[node(free)].normalize());
        GivenContact { node: free, frame, delta_free: [GAP, 0.2 * GAP, 0.0] }
    };
    skin.into_iter().map(contact).collect()
}
