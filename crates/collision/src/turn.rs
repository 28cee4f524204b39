//! A rotation as scene files write it.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A rotation: a quaternion `[w, x, y, z]`, of any length but zero, or `{ axis = [x, y, z], degrees = 90 }`, turned about
/// the axis by the right-hand rule.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a rotation is a quaternion [w, x, y, z] or { axis = [x, y, z], degrees = angle }")]
pub enum Turn {
    /// w, x, y, z.
    Quaternion([f64; 4]),
    /// An angle about an axis.
    AxisAngle(AxisAngle),
}

/// An angle about an axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisAngle {
    /// The axis, of any length but zero.
    pub axis: [f64; 3],
    /// The angle (degrees).
    pub degrees: f64,
}

impl Turn {
    /// No rotation.
    pub const NONE: Self = Self::Quaternion([1.0, 0.0, 0.0, 0.0]);

    /// `degrees` about `axis`.
    #[must_use]
    pub fn about(axis: Vector3<f64>, degrees: f64) -> Self {
        Self::AxisAngle(AxisAngle { axis: axis.into(), degrees })
    }

    /// The rotation; none where the quaternion or the axis has no length, or a number is not finite. A quaternion of
    /// length 1 keeps its bits.
    #[must_use]
    pub fn rotation(&self) -> Option<UnitQuaternion<f64>> {
        match *self {
            Self::Quaternion([w, x, y, z]) => {
                let q = Quaternion::new(w, x, y, z);
                let length = q.norm();
                if (length - 1.0).abs() <= f64::EPSILON {
                    return Some(Unit::new_unchecked(q));
                }
                (length.is_finite() && length > 0.0).then(|| UnitQuaternion::from_quaternion(q))
            }
            Self::AxisAngle(AxisAngle { axis, degrees }) => {
                let axis = Unit::try_new(Vector3::from(axis), f64::MIN_POSITIVE)?;
                let sound = degrees.is_finite() && axis.iter().all(|x| x.is_finite());
                sound.then(|| UnitQuaternion::from_axis_angle(&axis, degrees.to_radians()))
            }
        }
    }
}

impl From<UnitQuaternion<f64>> for Turn {
    fn from(q: UnitQuaternion<f64>) -> Self {
        Self::Quaternion([q.w, q.i, q.j, q.k])
    }
}
