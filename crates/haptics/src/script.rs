//! What the hand wants to do: a path of entries joined by minimum-jerk motions.
//!
//! From entry i to entry i+1, over the duration D with τ = (t − tᵢ)/D,
//! ```text
//! x_d(t) = xᵢ + (xᵢ₊₁ − xᵢ) (10 τ³ − 15 τ⁴ + 6 τ⁵)          m
//! ẋ_d(t) = (xᵢ₊₁ − xᵢ) (30 τ² − 60 τ³ + 30 τ⁴) / D           m/s, peak 15/8 of the mean
//! ```
//! [Flash and Hogan, J. Neuroscience 5 (1985) 1688]: speed and acceleration are zero at each entry. After the last
//! entry the hand stays there.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::SetupError;

/// Highest peak speed that a script may ask for \[m/s\]; a fast human reach is below 5 m/s.
pub const MAX_HAND_SPEED: f64 = 10.0;

/// One entry of a script: where the hand is at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptKey {
    /// Time since the start \[s\].
    pub time: f64,
    /// Position of the device's end effector in the world \[m\].
    pub position: [f64; 3],
    /// Whether the hand lets go of the device from here to the next entry (`false`).
    #[serde(default)]
    pub release: bool,
}

/// Where the script wants the hand at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intent {
    /// x_d \[m\].
    pub position: Vector3<f64>,
    /// ẋ_d \[m/s\].
    pub velocity: Vector3<f64>,
    /// Whether the hand holds the device.
    pub grip: bool,
}

/// A validated script.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<ScriptKey>", into = "Vec<ScriptKey>")]
pub struct HandScript {
    keys: Vec<ScriptKey>,
}

impl HandScript {
    /// A script of these entries.
    ///
    /// # Errors
    /// No entries; numbers that are not finite; the first entry not at 0 s; times that do not increase; a motion
    /// faster than [`MAX_HAND_SPEED`]. Each names the entry.
    pub fn new(keys: Vec<ScriptKey>) -> Result<Self, SetupError> {
        validate(&keys)?;
        Ok(Self { keys })
    }

    /// The hand stays at `position` \[m\].
    #[must_use]
    pub fn at(position: Vector3<f64>) -> Self {
        Self { keys: vec![ScriptKey { time: 0.0, position: position.into(), release: false }] }
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
        let begin = self.keys.get(after.saturating_sub(1));
        match (begin, self.keys.get(after)) {
            (Some(a), Some(b)) if after > 0 => between(a, b, time),
            (Some(a), _) => Intent { position: a.position.into(), velocity: Vector3::zeros(), grip: !a.release },
            (None, _) => Intent { position: Vector3::zeros(), velocity: Vector3::zeros(), grip: false },
        }
    }

    fn end(&self) -> Vector3<f64> {
        self.keys.last().map_or_else(Vector3::zeros, |key| key.position.into())
    }

    fn push(mut self, position: Vector3<f64>, duration: f64) -> Result<Self, SetupError> {
        let time = self.duration() + duration;
        self.keys.push(ScriptKey { time, position: position.into(), release: false });
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

fn between(a: &ScriptKey, b: &ScriptKey, time: f64) -> Intent {
    let (begin, end) = (Vector3::from(a.position), Vector3::from(b.position));
    let duration = b.time - a.time;
    let tau = ((time - a.time) / duration).clamp(0.0, 1.0);
    let (t2, t3) = (tau * tau, tau * tau * tau);
    let blend = t3 * (10.0 - 15.0 * tau + 6.0 * t2);
    let rate = 30.0 * t2 * (1.0 - 2.0 * tau + t2) / duration;
    Intent { position: begin + (end - begin) * blend, velocity: (end - begin) * rate, grip: !a.release }
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
