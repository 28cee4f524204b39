//! Geometry, poses and log lines as the well-known `foxglove.*` messages.
//!
//! Frames: `world` is the root; `tool` and `device` move in it.

use foxglove::messages::{
    Color, CylinderPrimitive, FrameTransform, FrameTransforms, Log, PackedElementField, Point3, PointCloud, Pose,
    PoseInFrame, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Timestamp, TriangleListPrimitive, Vector3,
    packed_element_field::NumericType,
};

use crate::geometry::{BodyGeometry, ToolShape};
use crate::record::{LogRecord, TickRecord};

const WORLD: &str = "world";
const TOOL: &str = "tool";
const DEVICE: &str = "device";
const TOOL_COLOR: [f64; 4] = [0.6, 0.63, 0.68, 1.0];

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

fn pose(position: [f64; 3], orientation: [f64; 4]) -> Pose {
    Pose { position: Some(vector(position)), orientation: Some(quaternion(orientation)) }
}

fn identity() -> Pose {
    pose([0.0; 3], [0.0, 0.0, 0.0, 1.0])
}

fn color([r, g, b, a]: [f64; 4]) -> Color {
    Color { r, g, b, a }
}

pub(crate) fn frame_transforms(tick: &TickRecord, unix_ns: u64) -> FrameTransforms {
    let frame = |child: &str, position, orientation| FrameTransform {
        timestamp: Some(timestamp(unix_ns)),
        parent_frame_id: WORLD.into(),
        child_frame_id: child.into(),
        translation: Some(vector(position)),
        rotation: Some(quaternion(orientation)),
    };
    FrameTransforms {
        transforms: vec![
            frame(TOOL, tick.tool_position, tick.tool_orientation),
            frame(DEVICE, tick.device_position, tick.device_orientation),
        ],
    }
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

pub(crate) fn tool_shape(shape: &ToolShape, unix_ns: u64) -> SceneUpdate {
    let mut entity = SceneEntity {
        timestamp: Some(timestamp(unix_ns)),
        frame_id: TOOL.into(),
        id: TOOL.into(),
        frame_locked: true,
        ..SceneEntity::default()
    };
    match shape {
        ToolShape::Sphere { radius } => entity.spheres.push(sphere([0.0; 3], *radius)),
        ToolShape::Capsule { a, b, radius } => {
            entity.spheres.extend([sphere(*a, *radius), sphere(*b, *radius)]);
            entity.cylinders.push(cylinder(*a, *b, *radius));
        }
        ToolShape::Mesh { vertices, triangles } => entity.triangles.push(TriangleListPrimitive {
            pose: Some(identity()),
            points: vertices.iter().map(|&[x, y, z]| Point3 { x, y, z }).collect(),
            color: Some(color(TOOL_COLOR)),
            colors: Vec::new(),
            indices: triangles.iter().flatten().copied().collect(),
        }),
    }
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}

fn sphere(center: [f64; 3], radius: f64) -> SpherePrimitive {
    SpherePrimitive {
        pose: Some(pose(center, [0.0, 0.0, 0.0, 1.0])),
        size: Some(vector([2.0 * radius; 3])),
        color: Some(color(TOOL_COLOR)),
    }
}

/// A cylinder between two points; the message's axis is z.
fn cylinder(a: [f64; 3], b: [f64; 3], radius: f64) -> CylinderPrimitive {
    let axis: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    CylinderPrimitive {
        pose: Some(pose(std::array::from_fn(|k| 0.5 * (a[k] + b[k])), rotation_from_z(axis, length))),
        size: Some(vector([2.0 * radius, 2.0 * radius, length])),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(color(TOOL_COLOR)),
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

/// The messages of the deforming bodies: built once, their points overwritten at each writing.
pub(crate) struct TissueMessages {
    pub(crate) surface: SceneUpdate,
    pub(crate) nodes: PointCloud,
    /// Per body: the nodes on its surface, by index into all nodes.
    surface_nodes: Vec<Vec<usize>>,
    rest_positions: Vec<[f64; 3]>,
}

impl TissueMessages {
    pub(crate) fn new(bodies: &[BodyGeometry]) -> Self {
        let mut entities = Vec::new();
        let mut surface_nodes = Vec::new();
        let mut rest_positions: Vec<[f64; 3]> = Vec::new();
        for body in bodies {
            let (nodes, indices) = compact_surface(body);
            entities.push(SceneEntity {
                frame_id: WORLD.into(),
                id: body.name.clone(),
                triangles: vec![TriangleListPrimitive {
                    pose: Some(identity()),
                    points: vec![Point3::default(); nodes.len()],
                    color: Some(color(body.color)),
                    colors: Vec::new(),
                    indices,
                }],
                ..SceneEntity::default()
            });
            surface_nodes.push(nodes.iter().map(|node| node + rest_positions.len()).collect());
            rest_positions.extend_from_slice(&body.rest_positions);
        }
        let field = |(k, name): (u32, &str)| PackedElementField {
            name: name.into(),
            offset: 4 * k,
            r#type: NumericType::Float32 as i32,
        };
        let nodes = PointCloud {
            frame_id: WORLD.into(),
            pose: Some(identity()),
            point_stride: 16,
            fields: [(0, "x"), (1, "y"), (2, "z"), (3, "displacement")].map(field).to_vec(),
            ..PointCloud::default()
        };
        Self { surface: SceneUpdate { deletions: Vec::new(), entities }, nodes, surface_nodes, rest_positions }
    }

    /// Takes over the positions of all nodes (m), `x, y, z` of each; missing ones stay as they were.
    pub(crate) fn update(&mut self, positions: &[f64], unix_ns: u64) {
        let (positions, _) = positions.as_chunks::<3>();
        for (entity, nodes) in self.surface.entities.iter_mut().zip(&self.surface_nodes) {
            entity.timestamp = Some(timestamp(unix_ns));
            let points = entity.triangles.iter_mut().flat_map(|primitive| &mut primitive.points);
            for (point, &node) in points.zip(nodes) {
                if let Some(&[x, y, z]) = positions.get(node) {
                    *point = Point3 { x, y, z };
                }
            }
        }
        let mut data = Vec::with_capacity(16 * self.rest_positions.len());
        for (position, rest) in positions.iter().zip(&self.rest_positions) {
            let squares: f64 = position.iter().zip(rest).map(|(now, then)| (now - then) * (now - then)).sum();
            for value in position.iter().chain([&squares.sqrt()]) {
                data.extend_from_slice(&(*value as f32).to_le_bytes());
            }
        }
        self.nodes.timestamp = Some(timestamp(unix_ns));
        self.nodes.data = data.into();
    }
}

/// The nodes that triangles use, in order of first use, and the triangles by position in that list.
fn compact_surface(body: &BodyGeometry) -> (Vec<usize>, Vec<u32>) {
    const UNUSED: u32 = u32::MAX;
    let mut place = vec![UNUSED; body.rest_positions.len()];
    let mut nodes = Vec::new();
    let mut indices = Vec::with_capacity(3 * body.triangles.len());
    for &node in body.triangles.iter().flatten() {
        let place = &mut place[node as usize];
        if *place == UNUSED {
            *place = nodes.len() as u32;
            nodes.push(node as usize);
        }
        indices.push(*place);
    }
    (nodes, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// q v q* for a unit quaternion, by v + 2 w (r x v) + 2 r x (r x v).
    fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let t = cross([x, y, z], v);
        let u = cross([x, y, z], t);
        std::array::from_fn(|k| v[k] + 2.0 * (w * t[k] + u[k]))
    }

    #[test]
    fn capsules_point_along_their_segment() {
        for axis in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [3.0, 0.0, 0.0], [0.0, -2.0, 0.0], [1.0, -2.0, -0.5]] {
            let length = axis.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
            let turned = rotate(rotation_from_z(axis, length), [0.0, 0.0, length]);
            for k in 0..3 {
                assert!((turned[k] - axis[k]).abs() < 1e-12, "{axis:?} became {turned:?}");
            }
        }
    }

    #[test]
    fn a_surface_keeps_only_its_own_nodes() {
        let rest = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [5.0; 3]];
        let body = BodyGeometry::new("body", rest, vec![[4, 1, 2], [2, 1, 3]]);
        assert_eq!(compact_surface(&body), (vec![4, 1, 2, 3], vec![0, 1, 2, 2, 1, 3]));
    }

    #[test]
    fn times_beyond_the_message_stay_at_its_end() {
        assert_eq!(timestamp(1_500_000_001), Timestamp::new(1, 500_000_001));
        assert_eq!(timestamp(u64::MAX).sec(), u32::MAX);
    }
}
