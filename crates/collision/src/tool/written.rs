//! A tool as scene files write it: a shape, or parts with places, two of them jaws of a gripper.

use nalgebra::{Isometry3, Translation3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{Hinge, Jaw, MAX_PARTS, Part, Tool, ToolError};
use crate::shape::ToolShape;
use crate::turn::Turn;

/// What a scene file says of a tool's shape. The kinds of [`ToolShape`] are repeated, so that a mistake in one of them
/// is told as such.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ToolConfig {
    Sphere {
        radius: f64,
    },
    Capsule {
        half_length: f64,
        radius: f64,
    },
    Box {
        size: [f64; 3],
    },
    Convex {
        vertices: Vec<[f64; 3]>,
    },
    Compound {
        parts: Vec<PartConfig>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gripper: Option<HingeConfig>,
    },
}

/// A part in the tool's frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PartConfig {
    shape: ToolShape,
    #[serde(default)]
    position: [f64; 3],
    #[serde(default = "no_turn")]
    rotation: Turn,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    jaw: Option<u8>,
}

/// How the jaws open.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HingeConfig {
    pivot: [f64; 3],
    axis: [f64; 3],
    #[serde(default)]
    closed_degrees: f64,
    open_degrees: f64,
}

/// Largest opening (degrees): beyond it the jaws are no gripper.
const WIDEST: f64 = 180.0;

fn no_turn() -> Turn {
    Turn::NONE
}

impl TryFrom<ToolConfig> for Tool {
    type Error = String;

    fn try_from(config: ToolConfig) -> Result<Self, String> {
        let told = |e: crate::shape::ShapeError| e.to_string();
        let shape = match config {
            ToolConfig::Sphere { radius } => ToolShape::sphere(radius),
            ToolConfig::Capsule { half_length, radius } => ToolShape::capsule(half_length, radius),
            ToolConfig::Box { size } => ToolShape::cuboid(size.into()),
            ToolConfig::Convex { vertices } => {
                ToolShape::convex(&vertices.into_iter().map(Vector3::from).collect::<Vec<_>>())
            }
            ToolConfig::Compound { parts, gripper } => return compound(parts, gripper).map_err(|e| e.to_string()),
        };
        shape.map(Self::from).map_err(told)
    }
}

fn compound(parts: Vec<PartConfig>, gripper: Option<HingeConfig>) -> Result<Tool, ToolError> {
    if parts.len() > MAX_PARTS {
        return Err(ToolError::TooManyParts(parts.len()));
    }
    let hinge = gripper.map(hinge).transpose()?;
    let part = |(k, part): (usize, PartConfig)| {
        let jaw = match part.jaw {
            None => None,
            Some(1) => Some(Jaw::First),
            Some(2) => Some(Jaw::Second),
            Some(value) => return Err(ToolError::Jaw { part: k, value }),
        };
        let rotation = part.rotation.rotation();
        let rotation = rotation.ok_or_else(|| ToolError::Rotation { key: format!("parts[{k}].rotation") })?;
        let place = Isometry3::from_parts(Translation3::from(part.position), rotation);
        Ok(Part { shape: part.shape, place, jaw })
    };
    Tool::compound(parts.into_iter().enumerate().map(part).collect::<Result<_, _>>()?, hinge)
}

fn hinge(config: HingeConfig) -> Result<Hinge, ToolError> {
    let axis = Unit::try_new(Vector3::from(config.axis), f64::MIN_POSITIVE).filter(|a| a.iter().all(|x| x.is_finite()));
    let axis = axis.ok_or_else(|| ToolError::Rotation { key: "gripper.axis".into() })?;
    let refuse = |key, value, bound| Err(ToolError::Gripper { key, value, bound });
    let HingeConfig { pivot, closed_degrees, open_degrees, .. } = config;
    if let Some(value) = pivot.into_iter().find(|x| !x.is_finite()) {
        return refuse("pivot", value, "finite, in m");
    }
    for (key, value) in [("closed_degrees", closed_degrees), ("open_degrees", open_degrees)] {
        if !(-WIDEST..=WIDEST).contains(&value) {
            return refuse(key, value, "between -180 and 180");
        }
    }
    if open_degrees <= closed_degrees {
        return refuse(
            "open_degrees",
            open_degrees,
            "above closed_degrees; turn the axis round if the jaws open the other way",
        );
    }
    let (closed, open) = (closed_degrees.to_radians(), open_degrees.to_radians());
    Ok(Hinge { pivot: pivot.into(), axis, closed, open })
}

impl From<Tool> for ToolConfig {
    fn from(tool: Tool) -> Self {
        if let Some(shape) = tool.shape() {
            return shape.clone().into();
        }
        let part = |part: &Part| PartConfig {
            shape: part.shape.clone(),
            position: part.place.translation.vector.into(),
            rotation: part.place.rotation.into(),
            jaw: part.jaw.map(|jaw| if jaw == Jaw::First { 1 } else { 2 }),
        };
        let gripper = tool.hinge().map(|hinge| HingeConfig {
            pivot: hinge.pivot.into(),
            axis: hinge.axis.into_inner().into(),
            closed_degrees: hinge.closed.to_degrees(),
            open_degrees: hinge.open.to_degrees(),
        });
        Self::Compound { parts: tool.parts().iter().map(part).collect(), gripper }
    }
}

impl From<ToolShape> for ToolConfig {
    fn from(shape: ToolShape) -> Self {
        use crate::shape::ShapeConfig;
        match shape.into() {
            ShapeConfig::Sphere { radius } => Self::Sphere { radius },
            ShapeConfig::Capsule { half_length, radius } => Self::Capsule { half_length, radius },
            ShapeConfig::Box { size } => Self::Box { size },
            ShapeConfig::Convex { vertices } => Self::Convex { vertices },
        }
    }
}
