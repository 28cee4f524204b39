//! A device that does again what another one did: the poses of a recorded trace, whatever force it gets.
//!
//! At the recorded times the recorded numbers come back to the bit; between two of them position, velocity and gripper are
//! joined by straight lines and orientation along the shortest arc. A time before the first pose gets the first, one
//! after the last gets the last, at rest. Where the recorded device had not answered, this one does not either, nor where a
//! damaged trace has lost what it did. Poses of a trace are in the world, and are not placed again.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::wrench::{Twist, Wrench};
use palpate_trace::{TickFlags, TickRecord, Trace, TraceError};

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
    /// What the trace has lost.
    warning: Option<String>,
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
            warning: None,
        })
    }

    /// The same from what is left of a trace, and what `damage` there is. Between ticks that do not follow each other in a
    /// damaged trace it does not answer: nobody knows where the device was.
    fn of(trace: &Trace, damage: Option<&TraceError>) -> Option<Self> {
        let device = Self::new(&trace.ticks)?;
        let Some(damage) = damage else { return Some(device) };
        let mut moments = Vec::with_capacity(device.moments.len());
        for (k, moment) in device.moments.iter().enumerate() {
            moments.push(*moment);
            if trace.ticks.get(k + 1).is_some_and(|next| next.tick > trace.ticks[k].tick + 1) {
                moments.push(Moment { time_ns: moment.time_ns + 1, answered: false, ..*moment });
            }
        }
        let (left, silent) = (trace.ticks.len(), moments.len() > trace.ticks.len());
        let gaps = if silent { ", and does not answer where some are lost" } else { "" };
        let warning = Some(format!("{damage}; the device does again the {left} poses that are left{gaps}"));
        Some(Self { moments, warning, ..device })
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

/// The device of the trace that is named, whole or damaged.
fn recorded(config: &DriverConfig) -> Result<ReplayDevice, DriverError> {
    let path = config.trace.as_ref().ok_or(DriverError::NoTrace)?;
    let (trace, damage) = Trace::recover(path)?;
    match (ReplayDevice::of(&trace, damage.as_ref()), damage) {
        (Some(device), _) => Ok(device),
        (None, Some(damage)) => Err(damage.into()),
        (None, None) => Err(DriverError::EmptyTrace { path: path.clone() }),
    }
}

fn open(config: &DriverConfig) -> Opened {
    Ok(Box::new(recorded(config)?))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let ReplayDevice { moments, warning, .. } = recorded(config)?;
    let poses = moments.iter().filter(|moment| moment.answered).count();
    let last = moments.last().map_or(0, |moment| moment.time_ns);
    let damage = warning.map(|warning| format!("; {warning}")).unwrap_or_default();
    Ok(format!("{poses} poses, {:.2} s{damage}", last as f64 * 1e-9))
}

impl HapticDevice for ReplayDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
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
    fn where_a_damaged_trace_has_lost_what_the_device_did_it_does_not_answer() {
        let sound = |index: u64| TickRecord { tick: index, ..tick(1_000_000 * index, 0.1, TickFlags::default()) };
        let trace = Trace { ticks: [3, 4, 7, 8].map(sound).into(), ..Trace::default() };
        let whole = |time| position(&mut ReplayDevice::of(&trace, None).unwrap(), time);
        assert_eq!(whole(5e-3), Ok(0.1), "records that were dropped are bridged");
        let damage = TraceError::Undescribed { path: "torn.mcap".into() };
        let mut device = ReplayDevice::of(&trace, Some(&damage)).unwrap();
        let told = device.warning().unwrap();
        assert!(
            told.starts_with("torn.mcap: ") && told.contains("4 poses") && told.contains("does not answer"),
            "{told}"
        );
        let answers = [0.0, 3e-3, 4e-3, 4.5e-3, 6e-3, 7e-3, 7.5e-3].map(|time| position(&mut device, time).is_ok());
        assert_eq!(answers, [true, true, true, false, false, true, true]);
    }

    #[test]
    fn a_trace_that_is_not_there_is_told() {
        assert!(matches!(open(&DriverConfig::default()).err(), Some(DriverError::NoTrace)));
        let config = DriverConfig { trace: Some("no/such.mcap".into()), ..DriverConfig::default() };
        assert!(open(&config).err().unwrap().to_string().contains("no/such.mcap"));
    }
}
