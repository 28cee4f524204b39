//! What a trace says before anything happens: scene, device, rates, and the shapes that viewers draw.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use palpate_collision::shape::ToolShape;
use palpate_collision::solid::Solid;
use palpate_constraints::frame::ContactFrame;
use palpate_haptics::device::DeviceSpec;
use palpate_trace as trace;
use palpate_trace::{Attachment, BodyGeometry, SolidGeometry, TraceConfig};

use super::{DEVICE_RECORD, LOCKSTEP, SCENE};
use crate::run::RunOptions;
use crate::world::World;

pub(super) fn config(world: &World, options: &RunOptions, device: &DeviceSpec) -> TraceConfig {
    let scene = world.description();
    let base = if options.lockstep { TraceConfig::default() } else { TraceConfig::real_time() };
    let length = options.length.seconds(world.dt());
    let engine = BTreeMap::from([
        ("version".to_string(), env!("CARGO_PKG_VERSION").to_string()),
        ("scene".into(), scene.name.clone()),
        ("embedded".into(), world.scene().is_embedded().to_string()),
        ("folder".into(), world.scene().folder().display().to_string()),
        ("mode".into(), if options.lockstep { LOCKSTEP } else { "real time" }.into()),
        ("seconds".into(), format!("{length:?}")),
        ("step_rate_hz".into(), format!("{:?}", scene.rates.step)),
        ("factor_rate_hz".into(), format!("{:?}", scene.rates.factor)),
        ("tick_rate_hz".into(), format!("{:?}", scene.rates.tick)),
        // What hardware says of itself is not in the scene. Numbers and names can be written as TOML.
        (DEVICE_RECORD.into(), toml::to_string(device).unwrap_or_default()),
    ]);
    let scene_file =
        Attachment { name: SCENE.into(), media_type: "application/toml".into(), data: world.scene().text().into() };
    let rest = world.mesh().nodes.iter().map(|x| [x.x, x.y, x.z]).collect();
    TraceConfig {
        engine,
        attachments: vec![scene_file],
        bodies: vec![BodyGeometry::new(scene.bodies[0].name.clone(), rest, world.surface().triangles.clone())],
        solids: solids(world),
        tool: tool_shape(world.tool()),
        ..base
    }
}

/// Side (m) of the square that a half-space is drawn as.
const DRAWN_PLANE: f64 = 1.0;

/// Fixed and rigid bodies as viewers draw them.
fn solids(world: &World) -> Vec<SolidGeometry> {
    let geometry = |name: &str, solid: &Solid, pose: &Isometry3<f64>, moves| {
        let vertices = |all: &[Vector3<f64>]| all.iter().map(|v| [v.x, v.y, v.z]).collect();
        let shape = match solid {
            Solid::Convex(shape) => tool_shape(shape)?,
            Solid::Mesh(mesh) => {
                trace::ToolShape::Mesh { vertices: vertices(mesh.vertices()), triangles: mesh.triangles().to_vec() }
            }
            Solid::HalfSpace(normal) => {
                let [t, s] = ContactFrame::new(*normal).tangents.map(|t| t * (0.5 * DRAWN_PLANE));
                let corners = [-t - s, t - s, t + s, s - t];
                trace::ToolShape::Mesh { vertices: vertices(&corners), triangles: vec![[0, 1, 2], [0, 2, 3]] }
            }
        };
        let pose = (pose.translation.vector.into(), pose.rotation.coords.into());
        Some(SolidGeometry { name: name.into(), shape, pose, moves })
    };
    let bodies = world.bodies();
    let fixed = bodies.fixed.iter().map(|body| geometry(&body.name, &body.solid, &body.pose, false));
    let rigid = bodies.rigid.iter().map(|body| geometry(&body.name, &body.solid, &body.shape_pose(&body.start), true));
    fixed.chain(rigid).flatten().collect()
}

fn tool_shape(tool: &ToolShape) -> Option<trace::ToolShape> {
    if let Some(hull) = tool.hull() {
        let vertices = hull.vertices().iter().map(|v| [v.x, v.y, v.z]).collect();
        return Some(trace::ToolShape::Mesh { vertices, triangles: hull.triangles().to_vec() });
    }
    let radius = tool.inner_radius();
    match tool.axis(&Isometry3::identity()) {
        Some([a, b]) if a != b => Some(trace::ToolShape::Capsule { a: a.into(), b: b.into(), radius }),
        _ => Some(trace::ToolShape::Sphere { radius }),
    }
}
