//! A device that does again what another one did: the poses of a recorded trace, whatever force it gets.
//!
//! At the recorded times the recorded numbers come back to the bit; between two of them position, velocity and gripper are
//! joined by straight lines and orientation along the shortest arc. A time before the first pose gets the first, one
//! after the last gets the last, at rest. Where the recorded device had not answered, this one does not either. Poses of a
//! trace are in the world, and are not placed again.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::wrench::{Twist, Wrench};
use palpate_trace::{TickFlags, TickRecord, Trace};

use crate::error::DriverError;
use crate::{Driver, DriverConfig, Opened};

/// Line in the register of drivers.
pub const DRIVER: Driver = Driver {
    name: "replay",
    summary: "the device poses of a recorded trace",
    real_time: false,
    own_frame: false,
    keys: &["trace"],
    open,
    probe,
};

/// One recorded moment.
#[derive(Clone, Copy, Debug)]
struct Moment {
    time_ns: u64,
    pose: Isometry3<f64>,
    velocity: Twist,
    gripper: f64,
    answered: bool,
}

impl Moment {
    fn of(record: &TickRecord) -> Self {
        let [x, y, z, w] = record.device_orientation;
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        let bad = record.flags.contains(TickFlags::DEVICE_MISSING) || record.flags.contains(TickFlags::BAD_POSE);
        Self {
            time_ns: record.time_ns,
            pose: Isometry3::from_parts(Translation3::from(record.device_position), rotation),
            velocity: Twist { linear: record.device_velocity.into(), angular: record.device_angular_velocity.into() },
            gripper: record.device_gripper,
            answered: !bad,
        }
    }
}

/// The recorded device.
#[derive(Debug)]
pub struct ReplayDevice {
    spec: DeviceSpec,
    moments: Vec<Moment>,
    /// The latest moment that is not after the latest tick.
    at: usize,
    open: bool,
}

impl ReplayDevice {
    /// A device that repeats these ticks. The last one's velocity is not repeated: the device stays.
    #[must_use]
    pub fn new(ticks: &[TickRecord]) -> Option<Self> {
        let moments: Vec<Moment> = ticks.iter().map(Moment::of).collect();
        moments.iter().any(|moment| moment.answered).then(|| Self {
            spec: DeviceSpec { name: "replay".into(), ..DeviceSpec::virtual_device(0.0) },
            moments,
            at: 0,
            open: true,
        })
    }

    /// Where it was at `time` (s).
    fn sample(&mut self, time: f64) -> Result<DeviceSample, DeviceError> {
        // Saturates: a time before the start is the start. The nearest nanosecond, as the trace was written.
        let now = (time * 1e9).round() as u64;
        if self.moments.get(self.at).is_some_and(|moment| moment.time_ns > now) {
            self.at = 0;
        }
        while self.moments.get(self.at + 1).is_some_and(|next| next.time_ns <= now) {
            self.at += 1;
        }
        let moment = self.moments.get(self.at).ok_or(DeviceError::Closed)?;
        if !moment.answered {
            return Err(DeviceError::Timeout);
        }
        let next = self.moments.get(self.at + 1).filter(|next| next.answered);
        let (pose, velocity, gripper) = match next {
            _ if now <= moment.time_ns => (moment.pose, moment.velocity, moment.gripper),
            None => (moment.pose, Twist::default(), moment.gripper),
            Some(next) => {
                let span = (next.time_ns - moment.time_ns) as f64;
                between(moment, next, (now - moment.time_ns) as f64 / span)
            }
        };
        Ok(DeviceSample { velocity, gripper, ..DeviceSample::at_rest(time, pose) })
    }
}

/// Pose, velocity and gripper at the share `s` of the way from `a` to `b`.
fn between(a: &Moment, b: &Moment, s: f64) -> (Isometry3<f64>, Twist, f64) {
    let line = |x: &Vector3<f64>, y: &Vector3<f64>| x + (y - x) * s;
    let position = line(&a.pose.translation.vector, &b.pose.translation.vector);
    // Two opposite orientations have no shortest arc between them.
    let rotation = a.pose.rotation.try_slerp(&b.pose.rotation, s, 1e-9).unwrap_or(a.pose.rotation);
    let velocity = Twist {
        linear: line(&a.velocity.linear, &b.velocity.linear),
        angular: line(&a.velocity.angular, &b.velocity.angular),
    };
    let gripper = a.gripper + (b.gripper - a.gripper) * s;
    (Isometry3::from_parts(Translation3::from(position), rotation), velocity, gripper)
}

fn open(config: &DriverConfig) -> Opened {
    let path = config.trace.as_ref().ok_or(DriverError::NoTrace)?;
    let trace = Trace::load(path)?;
    let device = ReplayDevice::new(&trace.ticks).ok_or_else(|| DriverError::EmptyTrace { path: path.clone() })?;
    Ok(Box::new(device))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let path = config.trace.as_ref().ok_or(DriverError::NoTrace)?;
    let trace = Trace::load(path)?;
    let last = trace.ticks.last().map_or(0, |tick| tick.time_ns);
    Ok(format!("{} poses, {:.2} s", trace.ticks.len(), last as f64 * 1e-9))
}

impl HapticDevice for ReplayDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if self.open { self.sample(tick.time) } else { Err(DeviceError::Closed) }
    }

    fn write(&mut self, _wrench: Wrench) -> Result<(), DeviceError> {
        if self.open { Ok(()) } else { Err(DeviceError::Closed) }
    }

    fn close(&mut self) {
        self.open = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(time_ns: u64, x: f64, flags: TickFlags) -> TickRecord {
        TickRecord {
            time_ns,
            device_position: [x, 0.0, 0.0],
            device_orientation: [0.0, 0.0, 0.0, 1.0],
            device_velocity: [1.0, 0.0, 0.0],
            flags,
            ..TickRecord::default()
        }
    }

    fn position(device: &mut ReplayDevice, time: f64) -> Result<f64, DeviceError> {
        device.read(TickTime { index: 0, time, dt: 1e-3, host_lead: None }).map(|s| s.pose.translation.x)
    }

    #[test]
    fn recorded_times_give_the_recorded_bits_and_others_lie_between() {
        let sound = TickFlags::default();
        let ticks = [tick(1_000_000, 0.1, sound), tick(2_000_000, 0.3, sound), tick(4_000_000, 0.7, sound)];
        let mut device = ReplayDevice::new(&ticks).unwrap();
        assert_eq!(position(&mut device, 0.0), Ok(0.1), "before the first");
        assert_eq!(position(&mut device, 1e-3), Ok(0.1));
        assert_eq!(position(&mut device, 2e-3), Ok(0.3));
        assert!((position(&mut device, 3e-3).unwrap() - 0.5).abs() < 1e-15);
        assert_eq!(position(&mut device, 9.0), Ok(0.7), "after the last");
        let last = device.read(TickTime { index: 0, time: 9.0, dt: 1e-3, host_lead: None }).unwrap();
        assert_eq!(last.velocity, Twist::default(), "and at rest");
        assert!((position(&mut device, 1.5e-3).unwrap() - 0.2).abs() < 1e-15, "again from the start");
    }

    #[test]
    fn a_device_that_was_missing_is_missing_again() {
        let (sound, missing) = (TickFlags::default(), TickFlags::DEVICE_MISSING);
        let ticks = [tick(0, 0.1, sound), tick(1_000_000, 0.1, missing), tick(2_000_000, 0.2, sound)];
        let mut device = ReplayDevice::new(&ticks).unwrap();
        assert_eq!(position(&mut device, 0.5e-3), Ok(0.1), "nothing lies between it and what was not there");
        assert_eq!(position(&mut device, 1.5e-3), Err(DeviceError::Timeout));
        assert_eq!(position(&mut device, 2e-3), Ok(0.2));
        device.close();
        assert_eq!(position(&mut device, 2e-3), Err(DeviceError::Closed));
        assert!(ReplayDevice::new(&ticks[1..2]).is_none());
    }

    #[test]
    fn a_trace_that_is_not_there_is_told() {
        assert!(matches!(open(&DriverConfig::default()).err(), Some(DriverError::NoTrace)));
        let config = DriverConfig { trace: Some("no/such.mcap".into()), ..DriverConfig::default() };
        assert!(open(&config).err().unwrap().to_string().contains("no/such.mcap"));
    }
}
