//! Geometry, poses and log lines as the well-known `foxglove.*` messages.
//!
//! Frames: `world` is the root; `tool`, `device` and rigid bodies move in it, the jaws of a tool in that of the tool.

use foxglove::messages::{
    Color, CylinderPrimitive, FrameTransform, FrameTransforms, Log, Point3, Pose, PoseInFrame, Quaternion, SceneEntity,
    SceneUpdate, SpherePrimitive, Timestamp, TriangleListPrimitive, Vector3,
};

use crate::geometry::{SolidGeometry, ToolHinge, ToolShape};
use crate::record::{LogRecord, RigidRecord, TickRecord};
use crate::tool_message::jaw_transforms;

pub(crate) const WORLD: &str = "world";
pub(crate) const TOOL: &str = "tool";
const DEVICE: &str = "device";
pub(crate) const TOOL_COLOR: [f64; 4] = [0.6, 0.63, 0.68, 1.0];
const RIGID_COLOR: [f64; 4] = [0.35, 0.47, 0.62, 1.0];
const FIXED_COLOR: [f64; 4] = [0.45, 0.45, 0.43, 1.0];

/// Seconds beyond 2106 do not fit the message and stay at its end.
pub(crate) fn timestamp(unix_ns: u64) -> Timestamp {
    let nanoseconds = (unix_ns % 1_000_000_000) as u32;
    let seconds = u32::try_from(unix_ns / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new_checked(seconds, nanoseconds).unwrap_or(Timestamp::MAX)
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

pub(crate) fn pose(position: [f64; 3], orientation: [f64; 4]) -> Pose {
    Pose { position: Some(vector(position)), orientation: Some(quaternion(orientation)) }
}

pub(crate) fn identity() -> Pose {
    pose([0.0; 3], [0.0, 0.0, 0.0, 1.0])
}

pub(crate) fn color([r, g, b, a]: [f64; 4]) -> Color {
    Color { r, g, b, a }
}

pub(crate) fn frame(child: &str, position: [f64; 3], orientation: [f64; 4], unix_ns: u64) -> FrameTransform {
    FrameTransform {
        timestamp: Some(timestamp(unix_ns)),
        parent_frame_id: WORLD.into(),
        child_frame_id: child.into(),
        translation: Some(vector(position)),
        rotation: Some(quaternion(orientation)),
    }
}

pub(crate) fn frame_transforms(tick: &TickRecord, hinge: Option<&ToolHinge>, unix_ns: u64) -> FrameTransforms {
    let mut transforms = vec![
        frame(TOOL, tick.tool_position, tick.tool_orientation, unix_ns),
        frame(DEVICE, tick.device_position, tick.device_orientation, unix_ns),
    ];
    if let Some(hinge) = hinge {
        transforms.extend(jaw_transforms(hinge, tick.tool_opening, unix_ns));
    }
    FrameTransforms { transforms }
}

pub(crate) fn rigid_transform(name: &str, body: &RigidRecord, unix_ns: u64) -> FrameTransforms {
    FrameTransforms { transforms: vec![frame(name, body.position, body.orientation, unix_ns)] }
}

pub(crate) fn tool_pose(tick: &TickRecord, unix_ns: u64) -> PoseInFrame {
    PoseInFrame {
        timestamp: Some(timestamp(unix_ns)),
        frame_id: WORLD.into(),
        pose: Some(pose(tick.tool_position, tick.tool_orientation)),
    }
}

pub(crate) fn log(record: &LogRecord, unix_ns: u64) -> Log {
    Log {
        timestamp: Some(timestamp(unix_ns)),
        level: record.level as i32,
        message: record.message().to_owned(),
        name: record.source().to_owned(),
        ..Log::default()
    }
}

/// Fixed bodies at their place in the world, rigid ones in frames of their own.
pub(crate) fn body_shapes(solids: &[SolidGeometry], unix_ns: u64) -> SceneUpdate {
    let entities = solids.iter().map(|solid| {
        let (frame, place, color) = match solid.moves {
            true => (solid.name.as_str(), identity(), RIGID_COLOR),
            false => (WORLD, pose(solid.pose.0, solid.pose.1), FIXED_COLOR),
        };
        entity(&solid.name, frame, &solid.shape, &place, color, unix_ns)
    });
    SceneUpdate { deletions: Vec::new(), entities: entities.collect() }
}

/// A shape that lies at `place` of a frame.
pub(crate) fn entity(
    id: &str,
    frame: &str,
    shape: &ToolShape,
    place: &Pose,
    fill: [f64; 4],
    unix_ns: u64,
) -> SceneEntity {
    let mut entity = SceneEntity {
        timestamp: Some(timestamp(unix_ns)),
        frame_id: frame.into(),
        id: id.into(),
        frame_locked: true,
        ..SceneEntity::default()
    };
    add(&mut entity, shape, place, fill);
    entity
}

/// Adds a shape that lies at `place` of the entity's frame.
fn add(entity: &mut SceneEntity, shape: &ToolShape, place: &Pose, fill: [f64; 4]) {
    match shape {
        ToolShape::Sphere { radius } => entity.spheres.push(sphere([0.0; 3], *radius, place, fill)),
        ToolShape::Capsule { a, b, radius } => {
            entity.spheres.extend([sphere(*a, *radius, place, fill), sphere(*b, *radius, place, fill)]);
            entity.cylinders.push(cylinder(*a, *b, *radius, place, fill));
        }
        ToolShape::Mesh { vertices, triangles } => entity.triangles.push(TriangleListPrimitive {
            pose: Some(*place),
            points: vertices.iter().map(|&[x, y, z]| Point3 { x, y, z }).collect(),
            color: Some(color(fill)),
            colors: Vec::new(),
            indices: triangles.iter().flatten().copied().collect(),
        }),
        ToolShape::Compound { parts, .. } => {
            parts.iter().for_each(|part| add(entity, &part.shape, &within(place, part.pose.0, part.pose.1), fill));
        }
    }
}

/// The pose in the frame of `place` of what lies at a pose within it.
fn within(place: &Pose, position: [f64; 3], orientation: [f64; 4]) -> Pose {
    let (origin, turn) = (place.position.unwrap_or_default(), place.orientation.unwrap_or_default());
    let turn = [turn.x, turn.y, turn.z, turn.w];
    let [x, y, z] = rotated(turn, position);
    pose([origin.x + x, origin.y + y, origin.z + z], product(turn, orientation))
}

/// `q v q*` for a unit quaternion, by `v + 2 w (r x v) + 2 r x (r x v)`.
pub(crate) fn rotated([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let t = cross([x, y, z], v);
    let u = cross([x, y, z], t);
    std::array::from_fn(|k| v[k] + 2.0 * (w * t[k] + u[k]))
}

/// The rotation `b`, then `a`.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let [ax, ay, az, aw] = a;
    let [bx, by, bz, bw] = b;
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

fn sphere(center: [f64; 3], radius: f64, place: &Pose, fill: [f64; 4]) -> SpherePrimitive {
    SpherePrimitive {
        pose: Some(within(place, center, [0.0, 0.0, 0.0, 1.0])),
        size: Some(vector([2.0 * radius; 3])),
        color: Some(color(fill)),
    }
}

/// A cylinder between two points; the message's axis is z.
fn cylinder(a: [f64; 3], b: [f64; 3], radius: f64, place: &Pose, fill: [f64; 4]) -> CylinderPrimitive {
    let axis: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    CylinderPrimitive {
        pose: Some(within(place, std::array::from_fn(|k| 0.5 * (a[k] + b[k])), rotation_from_z(axis, length))),
        size: Some(vector([2.0 * radius, 2.0 * radius, length])),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(color(fill)),
    }
}

/// Shortest rotation `[x, y, z, w]` that takes +z to `axis`: the unit vector half way between the two, doubled.
fn rotation_from_z(axis: [f64; 3], length: f64) -> [f64; 4] {
    if length.is_nan() || length <= 0.0 {
        return [0.0, 0.0, 0.0, 1.0];
    }
    let [x, y, z] = axis.map(|k| k / length);
    // q = (z_axis x u, 1 + z_axis . u); it vanishes for u = -z, where any half turn about a horizontal axis will do.
    let norm = (x * x + y * y + (1.0 + z) * (1.0 + z)).sqrt();
    if norm < 1e-9 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    [-y / norm, x / norm, 0.0, (1.0 + z) / norm]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capsules_point_along_their_segment() {
        for axis in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [3.0, 0.0, 0.0], [0.0, -2.0, 0.0], [1.0, -2.0, -0.5]] {
            let length = axis.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
            let turned = rotated(rotation_from_z(axis, length), [0.0, 0.0, length]);
            for k in 0..3 {
                assert!((turned[k] - axis[k]).abs() < 1e-12, "{axis:?} became {turned:?}");
            }
        }
    }

    #[test]
    fn a_rotation_of_a_rotation_is_their_product() {
        let (a, b) = ([0.5, 0.5, 0.5, 0.5], [0.6, 0.0, 0.0, 0.8]);
        let v = [0.3, -0.2, 0.7];
        let (once, twice) = (rotated(product(a, b), v), rotated(a, rotated(b, v)));
        assert!((0..3).all(|k| (once[k] - twice[k]).abs() < 1e-15), "{once:?} {twice:?}");
        let place = within(&pose([1.0, 2.0, 3.0], a), v, b);
        let p = place.position.unwrap();
        let expected = rotated(a, v);
        assert_eq!([p.x, p.y, p.z], [1.0 + expected[0], 2.0 + expected[1], 3.0 + expected[2]]);
    }

    #[test]
    fn times_beyond_the_message_stay_at_its_end() {
        assert_eq!(timestamp(1_500_000_001), Timestamp::new(1, 500_000_001));
        assert_eq!(timestamp(u64::MAX).sec(), u32::MAX);
    }
}
