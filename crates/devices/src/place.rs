//! Where a device stands in the world: its own frame against the world's.
//!
//! ```text
//! x_world = R x_device + p          m        R: columns are the device's axes in the world
//! f_device = Rᵀ f_world             N
//! ```
//! Lengths are not scaled, so neither is stiffness: what the hand feels is what the scene says.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::SetupError;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::record::TickFlags;
use palpate_haptics::tick::MAX_COORDINATE;
use palpate_haptics::wrench::{Twist, Wrench};
use serde::{Deserialize, Serialize};

/// Origin and axes of a device's frame, as a scene describes them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlaceConfig {
    /// Where the origin of the device's frame lies in the world (m).
    pub origin: [f64; 3],
    /// Which way the device's x, y and z point in the world; a right-handed frame.
    pub axes: [Direction; 3],
}

impl Default for PlaceConfig {
    fn default() -> Self {
        Self { origin: [0.0; 3], axes: [Direction::X, Direction::Y, Direction::Z] }
    }
}

/// A direction along an axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Direction {
    /// Along x.
    #[serde(rename = "x")]
    X,
    /// Along y.
    #[serde(rename = "y")]
    Y,
    /// Along z.
    #[serde(rename = "z")]
    Z,
    /// Against x.
    #[serde(rename = "-x")]
    MinusX,
    /// Against y.
    #[serde(rename = "-y")]
    MinusY,
    /// Against z.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Direction {
    fn vector(self) -> Vector3<f64> {
        match self {
            Self::X => Vector3::x(),
            Self::Y => Vector3::y(),
            Self::Z => Vector3::z(),
            Self::MinusX => -Vector3::x(),
            Self::MinusY => -Vector3::y(),
            Self::MinusZ => -Vector3::z(),
        }
    }
}

/// A checked place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pose: Isometry3<f64>,
}

impl Place {
    /// The place that a scene describes.
    ///
    /// # Errors
    /// An origin beyond [`MAX_COORDINATE`], where no pose would be one, axes that are not three different ones or not right-handed.
    pub fn new(config: &PlaceConfig) -> Result<Self, SetupError> {
        if let Some(value) = config.origin.into_iter().find(|x| x.is_nan() || x.abs() > MAX_COORDINATE) {
            let range = "-1000 to 1000, beyond which no pose is believed";
            return Err(SetupError::OutOfRange { what: "device origin (m)", value, range });
        }
        let axes = Matrix3::from_columns(&config.axes.map(Direction::vector));
        let value = axes.determinant();
        if value != 1.0 {
            let range = "1: three different axes, the third the cross product of the first two";
            return Err(SetupError::OutOfRange { what: "determinant of the device axes", value, range });
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Ok(Self { pose: Isometry3::from_parts(Translation3::from(config.origin), rotation) })
    }

    /// The device's frame in the world.
    #[must_use]
    pub fn pose(&self) -> &Isometry3<f64> {
        &self.pose
    }

    /// What the device measured, in the world.
    #[must_use]
    pub fn sample(&self, sample: &DeviceSample) -> DeviceSample {
        let rotation = &self.pose.rotation;
        DeviceSample {
            pose: self.pose * sample.pose,
            velocity: Twist { linear: rotation * sample.velocity.linear, angular: rotation * sample.velocity.angular },
            ..*sample
        }
    }

    /// A pose of the world in the device's frame.
    #[must_use]
    pub fn pose_in_device(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        self.pose.inv_mul(pose)
    }

    /// A wrench in world axes, in the device's.
    #[must_use]
    pub fn wrench_in_device(&self, wrench: &Wrench) -> Wrench {
        let back = self.pose.rotation.inverse();
        Wrench { force: back * wrench.force, torque: back * wrench.torque }
    }
}

/// A device that speaks its own frame, seen from the world.
pub struct Placed {
    device: Box<dyn HapticDevice>,
    place: Place,
}

impl Placed {
    /// `device` at this place.
    #[must_use]
    pub fn new(device: Box<dyn HapticDevice>, place: Place) -> Self {
        Self { device, place }
    }
}

impl HapticDevice for Placed {
    fn spec(&self) -> &DeviceSpec {
        self.device.spec()
    }

    fn note(&self) -> Option<&str> {
        self.device.note()
    }

    fn warning(&self) -> Option<&str> {
        self.device.warning()
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        self.device.read(tick).map(|sample| self.place.sample(&sample))
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        self.device.write(self.place.wrench_in_device(&wrench))
    }

    fn write_gripper(&mut self, effort: f64) {
        self.device.write_gripper(effort);
    }

    fn limited(&self) -> TickFlags {
        self.device.limited()
    }

    fn close(&mut self) {
        self.device.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_frame_keeps_lengths_and_power() {
        use Direction::{MinusX, Y, Z};
        let config = PlaceConfig { origin: [0.1, 0.2, 0.3], axes: [Y, MinusX, Z] };
        let place = Place::new(&config).unwrap();
        let pose = Isometry3::translation(0.01, 0.02, 0.03);
        let mut sample = DeviceSample::at_rest(0.0, pose);
        sample.velocity.linear = Vector3::new(0.3, -0.2, 0.1);
        let world = place.sample(&sample);
        // The device's x is the world's y, its y the world's -x.
        let expected = Vector3::new(0.1 - 0.02, 0.2 + 0.01, 0.3 + 0.03);
        assert!((world.pose.translation.vector - expected).norm() < 1e-15);
        assert!((place.pose_in_device(&world.pose).translation.vector - pose.translation.vector).norm() < 1e-15);
        let wrench = Wrench::from_force(Vector3::new(1.0, 2.0, 3.0));
        let felt = place.wrench_in_device(&wrench);
        let power = |w: &Wrench, s: &DeviceSample| w.force.dot(&s.velocity.linear);
        assert!((power(&wrench, &world) - power(&felt, &sample)).abs() < 1e-15);
        assert!((felt.force - Vector3::new(2.0, -1.0, 3.0)).norm() < 1e-15);
    }

    #[test]
    fn mirrored_and_degenerate_frames_are_refused() {
        use Direction::{X, Y, Z};
        for axes in [[Y, X, Z], [X, X, Z]] {
            assert!(Place::new(&PlaceConfig { axes, ..PlaceConfig::default() }).is_err(), "{axes:?}");
        }
        assert!(Place::new(&PlaceConfig { origin: [f64::NAN, 0.0, 0.0], ..PlaceConfig::default() }).is_err());
    }
}
