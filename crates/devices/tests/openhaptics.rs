//! Does the driver work in HDAPI's servo thread as it must, and say what is wrong when it cannot?

#![cfg(unix)] // shared libraries by their Unix names
#![allow(unsafe_code, unreachable_pub)] // the test moves the hand of a C library; the stand-in is shared

mod stand_in;

use std::time::{Duration, Instant};

use nalgebra::Vector3;
use palpate_devices::{DriverConfig, DriverError, driver};
use palpate_haptics::device::{DeviceError, DeviceSample, HapticDevice};
use palpate_haptics::wrench::Wrench;
use stand_in::{StandIn, other_library, tick};

fn open(config: &DriverConfig) -> Result<Box<dyn HapticDevice>, DriverError> {
    (driver("openhaptics").unwrap().open)(config)
}

/// Reads once a millisecond until `done`, for ten seconds at most.
fn until(
    device: &mut dyn HapticDevice,
    what: &str,
    mut done: impl FnMut(&mut dyn HapticDevice, Result<DeviceSample, DeviceError>) -> bool,
) {
    let begin = Instant::now();
    for k in 0.. {
        let answer = device.read(tick(k));
        if done(device, answer) {
            return;
        }
        assert!(begin.elapsed() < Duration::from_secs(10), "never came: {what}; last {answer:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_wall_of_200_newtons_per_metre_holds_the_hand_where_both_springs_balance() {
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    assert_eq!((device.spec().name.as_str(), device.spec().max_force), ("stand-in Touch", 3.3));
    library.hand(0.0, 0.0, -0.01);
    // 350 (-0.01 - x) = 200 x, in metres: the library speaks millimetres.
    let balance = -350.0 * 0.01 / 550.0;
    let mut still = 0;
    until(device.as_mut(), "the balance", |device, answer| {
        let sample = answer.unwrap_or_else(|e| panic!("{e}"));
        let height = sample.pose.translation.z;
        device.write(Wrench::from_force(Vector3::new(0.0, 0.0, (-200.0 * height).max(0.0)))).unwrap();
        let there = (height - balance).abs() < 1e-7 && sample.velocity.linear.norm() < 1e-6;
        still = if there { still + 1 } else { 0 };
        still > 20
    });
    assert!((library.force()[2] + 200.0 * balance).abs() < 1e-4);
}

#[test]
fn frames_are_in_metres_and_the_matrix_is_read_by_columns() {
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    library.hand(0.03, 0.02, 0.01);
    until(device.as_mut(), "the hand's place", |device, answer| {
        let sample = answer.unwrap_or_else(|e| panic!("{e}"));
        device.write(Wrench::zero()).unwrap();
        assert_eq!((sample.buttons, sample.velocity.angular), (3, Vector3::new(0.5, 0.0, 0.0)));
        assert!((sample.pose.rotation * Vector3::x() - Vector3::y()).norm() < 1e-15);
        (sample.pose.translation.vector - Vector3::new(0.03, 0.02, 0.01)).norm() < 1e-6
    });
}

#[test]
fn a_program_that_stops_ticking_leaves_no_force_on_the_motors() {
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    device.write(Wrench::from_force(Vector3::new(0.5, 0.0, 0.0))).unwrap();
    until(device.as_mut(), "the force", |_, _| library.force()[0] == 0.5);
    // Nothing is written any more.
    until(device.as_mut(), "silence", |_, _| library.force()[0] == 0.0);
    device.write(Wrench::from_force(Vector3::new(0.25, 0.0, 0.0))).unwrap();
    until(device.as_mut(), "the force again", |_, _| library.force()[0] == 0.25);
}

#[test]
fn a_device_that_is_unplugged_or_a_servo_that_stalls_is_an_error_of_each_tick_until_it_is_back() {
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    library.set("stand_in_unplug", 1);
    until(device.as_mut(), "the error", |_, answer| answer == Err(DeviceError::Disconnected));
    library.set("stand_in_unplug", 0);
    until(device.as_mut(), "the device", |_, answer| answer.is_ok());
    library.set("stand_in_stall", 1);
    until(device.as_mut(), "the time-out", |_, answer| answer == Err(DeviceError::Timeout));
    library.set("stand_in_stall", 0);
    until(device.as_mut(), "the device", |_, answer| answer.is_ok());
}

#[test]
fn closing_ends_the_servo_thread_before_its_data_goes() {
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    assert_eq!((library.get("stand_in_open"), library.get("stand_in_enabled")), (1, 1));
    device.write(Wrench::from_force(Vector3::new(0.5, 0.0, 0.0))).unwrap();
    until(device.as_mut(), "the force", |_, _| library.force()[0] == 0.5);
    device.close();
    assert_eq!((library.get("stand_in_open"), library.get("stand_in_enabled")), (0, 0));
    assert_eq!(library.force()[..3], [0.0; 3], "the last that the motors are asked for is no force");
    let frames = library.frames();
    std::thread::sleep(Duration::from_millis(20));
    assert_eq!(library.frames(), frames);
    assert_eq!(device.read(tick(1)), Err(DeviceError::Closed));
    assert_eq!(device.write(Wrench::zero()), Err(DeviceError::Closed));
    drop(device);
    drop(open(&library.config()).unwrap());
    assert_eq!(library.get("stand_in_open"), 0, "dropping closes, and opening again works");
}

#[test]
fn no_library_a_wrong_one_and_no_device_are_told_apart() {
    let missing = DriverConfig { library: Some("/no/such/libHD.so".into()), ..DriverConfig::default() };
    let error = open(&missing).err().unwrap();
    assert!(matches!(error, DriverError::Library { .. }) && error.to_string().contains("libHD.so"), "{error}");
    let Some(library) = StandIn::build("hd", &[]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let other = DriverConfig { library: Some(other_library(folder.path())), ..DriverConfig::default() };
    let error = open(&other).err().unwrap();
    assert!(matches!(error, DriverError::Symbol { symbol: "hdInitDevice", .. }), "{error}");

    let probe = driver("openhaptics").unwrap().probe;
    assert_eq!(probe(&library.config()).unwrap(), "stand-in Touch");
    assert_eq!(library.get("stand_in_open"), 0, "looking leaves nothing open");
    library.set("stand_in_absent", 1);
    let error = open(&library.config()).err().unwrap();
    assert!(matches!(error, DriverError::NoDevice { .. }) && error.to_string().contains("device fault"), "{error}");
}
