//! The tool as viewers see it: its shapes, and frames of its jaws.

use foxglove::messages::{FrameTransform, SceneUpdate};

use crate::geometry::{ToolHinge, ToolJaw, ToolPart, ToolShape};
use crate::scene_message::{TOOL, TOOL_COLOR, entity, frame, identity, pose, rotated};

/// The hinge of a tool that has one.
pub(crate) fn hinge_of(tool: Option<&ToolShape>) -> Option<ToolHinge> {
    match tool {
        Some(ToolShape::Compound { hinge, .. }) => *hinge,
        _ => None,
    }
}

fn jaw_frame(jaw: ToolJaw) -> &'static str {
    match jaw {
        ToolJaw::First => "tool/jaw 1",
        ToolJaw::Second => "tool/jaw 2",
    }
}

/// A jaw in the frame of the tool: turned about the hinge by half the opening (rad), one way or the other.
fn jaw_transform(jaw: ToolJaw, hinge: &ToolHinge, opening: f64, unix_ns: u64) -> FrameTransform {
    let way = if jaw == ToolJaw::First { 1.0 } else { -1.0 };
    let (sine, cosine) = (way * 0.25 * opening).sin_cos();
    let [ax, ay, az] = hinge.axis.map(|a| a * sine);
    let turn = [ax, ay, az, cosine];
    let moved = rotated(turn, hinge.pivot);
    let shift = std::array::from_fn(|k| hinge.pivot[k] - moved[k]);
    FrameTransform { parent_frame_id: TOOL.into(), ..frame(jaw_frame(jaw), shift, turn, unix_ns) }
}

/// Both jaws in the frame of the tool at an opening (rad).
pub(crate) fn jaw_transforms(hinge: &ToolHinge, opening: f64, unix_ns: u64) -> [FrameTransform; 2] {
    [ToolJaw::First, ToolJaw::Second].map(|jaw| jaw_transform(jaw, hinge, opening, unix_ns))
}

pub(crate) fn tool_shape(shape: &ToolShape, unix_ns: u64) -> SceneUpdate {
    let entities = match shape {
        ToolShape::Compound { parts, .. } => {
            let part = |(k, part): (usize, &ToolPart)| {
                let frame = part.jaw.map_or(TOOL, jaw_frame);
                let place = pose(part.pose.0, part.pose.1);
                entity(&format!("{TOOL} {k}"), frame, &part.shape, &place, TOOL_COLOR, unix_ns)
            };
            parts.iter().enumerate().map(part).collect()
        }
        shape => vec![entity(TOOL, TOOL, shape, &identity(), TOOL_COLOR, unix_ns)],
    };
    SceneUpdate { deletions: Vec::new(), entities }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jaws_turn_about_the_pivot_by_half_the_opening_each() {
        let hinge = ToolHinge { pivot: [0.1, 0.0, 0.2], axis: [0.0, 0.0, 1.0] };
        let at = |transform: &FrameTransform, x: [f64; 3]| {
            let (r, t) = (transform.rotation.unwrap(), transform.translation.unwrap());
            let [px, py, pz] = rotated([r.x, r.y, r.z, r.w], x);
            [px + t.x, py + t.y, pz + t.z]
        };
        for (transform, way) in jaw_transforms(&hinge, 0.8, 0).iter().zip([1.0, -1.0]) {
            assert_eq!(transform.parent_frame_id, "tool");
            let (sine, cosine) = (way * 0.4f64).sin_cos();
            let moved = at(transform, [0.15, 0.0, 0.3]);
            let expected = [0.1 + 0.05 * cosine, 0.05 * sine, 0.3];
            assert!((0..3).all(|k| (moved[k] - expected[k]).abs() < 1e-15), "{moved:?} {expected:?}");
        }
    }

    #[test]
    fn each_part_is_an_entity_in_the_frame_that_it_moves_with() {
        let ball =
            |jaw| ToolPart { shape: ToolShape::Sphere { radius: 0.01 }, pose: ([0.0; 3], [0.0, 0.0, 0.0, 1.0]), jaw };
        let parts = vec![ball(None), ball(Some(ToolJaw::First)), ball(Some(ToolJaw::Second))];
        let update = tool_shape(&ToolShape::Compound { parts, hinge: None }, 0);
        let frames: Vec<_> = update.entities.iter().map(|e| (e.id.as_str(), e.frame_id.as_str())).collect();
        assert_eq!(frames, [("tool 0", "tool"), ("tool 1", "tool/jaw 1"), ("tool 2", "tool/jaw 2")]);
        assert!(update.entities.iter().all(|e| e.spheres.len() == 1));
    }
}
