//! The rig in motion: a device that arrives at the wall, is pressed against it, and comes to rest or does not.

use nalgebra::Vector3;

use super::{Rig, Wall};
use crate::SetupError;
use crate::device::{HapticDevice, TickTime, VirtualDevice};
use crate::script::HandScript;
use crate::wrench::Wrench;

/// Speed of arrival \[m/s\]: a tap.
const ARRIVAL: f64 = 0.05;

/// Force that presses the device onto the wall, in place of a hand's \[N\].
const PRESS: f64 = 0.5;

/// Force amplitude of a small disturbance as a share of [`PRESS`]: the device stays in the wall.
const DISTURBANCE: f64 = 0.25;

/// What moves no faster than this is at rest \[m/s\].
const QUIET: f64 = 1e-6;

/// What moves faster never comes back \[m/s\].
const RUNAWAY: f64 = 1e3;

/// A motion that falls by less than this share from one quarter of the time to the next does not end.
const FALL: f64 = 0.01;

impl Rig {
    /// Whether a device that a constant push of 0.5 N holds against the wall comes to rest, after a small disturbance of
    /// the balance and after an arrival with 0.05 m/s: its largest speed in the last quarter of `ticks` is below 1 µm/s, or
    /// at least 1 % below that of the quarter before. The hand wants to be where wall and push balance. Motion along x, the
    /// wall at x < 0.
    ///
    /// # Errors
    /// Mechanics or a hand that the device refuses.
    pub fn comes_to_rest(&self, wall: &Wall, ticks: u64) -> Result<bool, SetupError> {
        let balance = -PRESS / wall.stiffness;
        let nudge = DISTURBANCE * PRESS / (wall.stiffness * self.mechanics.mass).sqrt();
        Ok(self.rests(wall, ticks, balance, nudge)? && self.rests(wall, ticks, 0.0, ARRIVAL)?)
    }

    /// The same after one begin: at `place` \[m\], moving into the wall at `speed` \[m/s\].
    fn rests(&self, wall: &Wall, ticks: u64, place: f64, speed: f64) -> Result<bool, SetupError> {
        let script = HandScript::at(-Vector3::x() * (PRESS / wall.stiffness));
        let device = VirtualDevice::new(self.mechanics, self.hand, script)?;
        let mut device = device.at(Vector3::x() * place).with_velocity(-Vector3::x() * speed);
        let (mut before, mut peaks) = (-place, [0.0_f64; 4]);
        // The push is there from the beginning; the wall's force is late by the delay.
        let balanced = if place < 0.0 { PRESS } else { 0.0 };
        device.hold(Wrench::from_force(Vector3::x() * (balanced - PRESS)));
        for index in 0..ticks {
            let Ok(sample) = device.read(TickTime::regular(index, self.period)) else { return Ok(false) };
            let depth = -sample.pose.translation.vector.x;
            let force = wall.stiffness * depth + wall.damping * (depth - before) / self.period;
            before = depth;
            let force = if depth > 0.0 { force.max(0.0) } else { 0.0 };
            if device.write(Wrench::from_force(Vector3::x() * (force - PRESS))).is_err() {
                return Ok(false);
            }
            let speed = device.velocity().norm();
            // What is not a number is no rest either.
            if speed.is_nan() || speed > RUNAWAY {
                return Ok(false);
            }
            if let Some(peak) = peaks.get_mut((4 * index / ticks) as usize) {
                *peak = peak.max(speed);
            }
        }
        Ok(peaks[3] < QUIET || peaks[3] < (1.0 - FALL) * peaks[2])
    }
}
