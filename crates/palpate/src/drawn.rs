//! Tool, fixed and rigid bodies as a trace tells viewers to draw them.

use nalgebra::{Isometry3, Vector3};
use palpate_collision::Solid;
use palpate_collision::shape::ToolShape;
use palpate_collision::tool::{Hinge, Jaw, Part, Tool};
use palpate_constraints::frame::ContactFrame;
use palpate_trace as trace;
use palpate_trace::SolidGeometry;

use crate::world::World;

/// Side (m) of the square that a half-space is drawn as.
const DRAWN_PLANE: f64 = 1.0;

/// Fixed and rigid bodies as viewers draw them.
pub(crate) fn solids(world: &World) -> Vec<SolidGeometry> {
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

/// The tool as viewers draw it.
pub(crate) fn tool(tool: &Tool) -> Option<trace::ToolShape> {
    if let Some(shape) = tool.shape() {
        return tool_shape(shape);
    }
    let part = |part: &Part| {
        Some(trace::ToolPart {
            shape: tool_shape(&part.shape)?,
            pose: (part.place.translation.vector.into(), part.place.rotation.coords.into()),
            jaw: part.jaw.map(|jaw| match jaw {
                Jaw::First => trace::ToolJaw::First,
                Jaw::Second => trace::ToolJaw::Second,
            }),
        })
    };
    let hinge = |hinge: &Hinge| {
        let axis = hinge.axis.into_inner().into();
        trace::ToolHinge { pivot: hinge.pivot.into(), axis }
    };
    let parts = tool.parts().iter().map(part).collect::<Option<_>>()?;
    Some(trace::ToolShape::Compound { parts, hinge: tool.hinge().map(hinge) })
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
