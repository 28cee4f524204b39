//! What the hand wants to do: a path of entries joined by minimum-jerk motions.
//!
//! From entry i to entry i+1, over the duration D with τ = (t − tᵢ)/D,
//! ```text
//! x_d(t) = xᵢ + (xᵢ₊₁ − xᵢ) (10 τ³ − 15 τ⁴ + 6 τ⁵)          m
//! ẋ_d(t) = (xᵢ₊₁ − xᵢ) (30 τ² − 60 τ³ + 30 τ⁴) / D           m/s, peak 15/8 of the mean
//! ```
//! [Flash and Hogan, J. Neuroscience 5 (1985) 1688]: speed and acceleration are zero at each entry. After the last
//! entry the hand stays there. The orientation turns about one axis from entry to entry, the shorter way round, and with
//! the gripper by the same law.

use nalgebra::{UnitQuaternion, Vector3};
use palpate_collision::Turn;
use serde::{Deserialize, Serialize};

use crate::SetupError;

/// Highest peak speed that a script may ask for \[m/s\]; a fast human reach is below 5 m/s.
pub const MAX_HAND_SPEED: f64 = 10.0;

/// One entry of a script: where the hand is at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptKey {
    /// Time since the start \[s\].
    pub time: f64,
    /// Position of the device's end effector in the world \[m\].
    pub position: [f64; 3],
    /// Whether the hand lets go of the device from here to the next entry (`false`).
    #[serde(default)]
    pub release: bool,
    /// Orientation of the device's end effector in the world; where it is left out, that of the entry before, and of the
    /// first none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Turn>,
    /// How far the gripper is open, 0 closed to 1 open; where it is left out, as at the entry before, and at the first open.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gripper: Option<f64>,
}

impl ScriptKey {
    /// At `position` \[m\] at `time` \[s\], held, turned and open as at the entry before.
    #[must_use]
    pub fn at(time: f64, position: [f64; 3]) -> Self {
        Self { time, position, ..Self::default() }
    }
}

/// Where the script wants the hand at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intent {
    /// x_d \[m\].
    pub position: Vector3<f64>,
    /// ẋ_d \[m/s\].
    pub velocity: Vector3<f64>,
    /// Orientation.
    pub rotation: UnitQuaternion<f64>,
    /// Angular velocity \[rad/s\], in world axes.
    pub angular_velocity: Vector3<f64>,
    /// How far the gripper is open, 0 closed to 1 open.
    pub gripper: f64,
    /// Whether the hand holds the device.
    pub grip: bool,
}

/// A validated script.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<ScriptKey>", into = "Vec<ScriptKey>")]
pub struct HandScript {
    keys: Vec<ScriptKey>,
    /// Orientation and gripper of each, those of entries that leave them out too.
    turned: Vec<(UnitQuaternion<f64>, f64)>,
}

impl HandScript {
    /// A script of these entries.
    ///
    /// # Errors
    /// No entries; numbers that are not finite; the first entry not at 0 s; times that do not increase; a motion
    /// faster than [`MAX_HAND_SPEED`]; a rotation without a direction; a gripper outside 0 to 1. Each names the entry.
    pub fn new(keys: Vec<ScriptKey>) -> Result<Self, SetupError> {
        validate(&keys)?;
        let mut last = (UnitQuaternion::identity(), 1.0);
        let mut turned = Vec::with_capacity(keys.len());
        for (entry, key) in keys.iter().enumerate() {
            if let Some(turn) = &key.rotation {
                last.0 = turn.rotation().ok_or(SetupError::ScriptRotation { entry })?;
            }
            if let Some(value) = key.gripper {
                if !(0.0..=1.0).contains(&value) {
                    return Err(SetupError::ScriptGripper { entry, value });
                }
                last.1 = value;
            }
            turned.push(last);
        }
        Ok(Self { keys, turned })
    }

    /// The hand stays at `position` \[m\].
    #[must_use]
    pub fn at(position: Vector3<f64>) -> Self {
        let keys = vec![ScriptKey::at(0.0, position.into())];
        Self { keys, turned: vec![(UnitQuaternion::identity(), 1.0)] }
    }

    /// Moves to `position` \[m\] in `duration` seconds: a press or a slide.
    ///
    /// # Errors
    /// As [`HandScript::new`].
    pub fn move_to(self, position: Vector3<f64>, duration: f64) -> Result<Self, SetupError> {
        self.push(position, duration)
    }

    /// Stays for `duration` seconds.
    ///
    /// # Errors
    /// As [`HandScript::new`].
    pub fn hold(self, duration: f64) -> Result<Self, SetupError> {
        let position = self.end();
        self.push(position, duration)
    }

    /// Goes by `offset` \[m\] and back, in `duration` seconds.
    ///
    /// # Errors
    /// As [`HandScript::new`].
    pub fn tap(self, offset: Vector3<f64>, duration: f64) -> Result<Self, SetupError> {
        self.stroke(offset, duration, 1)
    }

    /// Goes by `offset` \[m\] and back `count` times, each in `duration` seconds.
    ///
    /// # Errors
    /// As [`HandScript::new`].
    pub fn stroke(mut self, offset: Vector3<f64>, duration: f64, count: usize) -> Result<Self, SetupError> {
        let position = self.end();
        for _ in 0..count {
            self = self.push(position + offset, 0.5 * duration)?.push(position, 0.5 * duration)?;
        }
        Ok(self)
    }

    /// Lets go of the device for `duration` seconds, and takes it again where it is then.
    ///
    /// # Errors
    /// As [`HandScript::new`].
    pub fn let_go(mut self, duration: f64) -> Result<Self, SetupError> {
        if let Some(last) = self.keys.last_mut() {
            last.release = true;
        }
        self.hold(duration)
    }

    /// The entries.
    #[must_use]
    pub fn keys(&self) -> &[ScriptKey] {
        &self.keys
    }

    /// Time of the last entry \[s\].
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.keys.last().map_or(0.0, |key| key.time)
    }

    /// What the script asks for at `time` \[s\]; before 0 and after the end it stays at the ends. Allocates nothing.
    #[must_use]
    pub fn intent(&self, time: f64) -> Intent {
        let after = self.keys.partition_point(|key| key.time <= time);
        let at = |k: usize| Some((self.keys.get(k)?, self.turned.get(k)?));
        match (at(after.saturating_sub(1)), at(after)) {
            (Some(a), Some(b)) if after > 0 => between(a, b, time),
            (Some((a, turned)), _) => resting(a, turned),
            (None, _) => Intent { grip: false, ..resting(&ScriptKey::default(), &(UnitQuaternion::identity(), 1.0)) },
        }
    }

    fn end(&self) -> Vector3<f64> {
        self.keys.last().map_or_else(Vector3::zeros, |key| key.position.into())
    }

    fn push(mut self, position: Vector3<f64>, duration: f64) -> Result<Self, SetupError> {
        let time = self.duration() + duration;
        self.keys.push(ScriptKey::at(time, position.into()));
        Self::new(self.keys)
    }
}

impl TryFrom<Vec<ScriptKey>> for HandScript {
    type Error = SetupError;

    fn try_from(keys: Vec<ScriptKey>) -> Result<Self, SetupError> {
        Self::new(keys)
    }
}

impl From<HandScript> for Vec<ScriptKey> {
    fn from(script: HandScript) -> Self {
        script.keys
    }
}

/// An entry's orientation and gripper.
type Turned = (UnitQuaternion<f64>, f64);

fn resting(key: &ScriptKey, (rotation, gripper): &Turned) -> Intent {
    Intent {
        position: key.position.into(),
        velocity: Vector3::zeros(),
        rotation: *rotation,
        angular_velocity: Vector3::zeros(),
        gripper: *gripper,
        grip: !key.release,
    }
}

fn between((a, from): (&ScriptKey, &Turned), (b, to): (&ScriptKey, &Turned), time: f64) -> Intent {
    let (begin, end) = (Vector3::from(a.position), Vector3::from(b.position));
    let duration = b.time - a.time;
    let tau = ((time - a.time) / duration).clamp(0.0, 1.0);
    let (t2, t3) = (tau * tau, tau * tau * tau);
    let blend = t3 * (10.0 - 15.0 * tau + 6.0 * t2);
    let rate = 30.0 * t2 * (1.0 - 2.0 * tau + t2) / duration;
    let mut intent = resting(a, from);
    (intent.position, intent.velocity) = (begin + (end - begin) * blend, (end - begin) * rate);
    if from.0 != to.0 {
        // The rotation vector in world axes, the shorter way round; it is the axis of the whole way.
        let turn = (to.0 * from.0.inverse()).scaled_axis();
        intent.rotation = UnitQuaternion::from_scaled_axis(turn * blend) * from.0;
        intent.angular_velocity = turn * rate;
    }
    intent.gripper = from.1 + (to.1 - from.1) * blend;
    intent
}

fn validate(keys: &[ScriptKey]) -> Result<(), SetupError> {
    let first = keys.first().ok_or(SetupError::EmptyScript)?;
    for (entry, key) in keys.iter().enumerate() {
        let numbers = [("time", key.time), ("x", key.position[0]), ("y", key.position[1]), ("z", key.position[2])];
        if let Some((what, value)) = numbers.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(SetupError::ScriptNumber { entry, what, value });
        }
    }
    if first.time != 0.0 {
        let remedy = "the first entry must be at time 0";
        return Err(SetupError::ScriptGap { entry: 0, time: first.time, from: 0.0, remedy });
    }
    for (i, pair) in keys.windows(2).enumerate() {
        let [a, b] = pair else { continue };
        let entry = i + 1;
        if b.time <= a.time {
            return Err(SetupError::ScriptOrder { entry, time: b.time, previous: a.time });
        }
        let duration = b.time - a.time;
        let distance = (Vector3::from(b.position) - Vector3::from(a.position)).norm();
        let speed = 1.875 * distance / duration;
        if speed > MAX_HAND_SPEED {
            return Err(SetupError::ScriptSpeed { entry, speed, distance, duration, limit: MAX_HAND_SPEED });
        }
    }
    Ok(())
}
