//! Does the driver speak DHD as it is documented, and say what is wrong when it cannot?

#![cfg(unix)] // shared libraries by their Unix names
#![allow(unsafe_code, unreachable_pub)] // the test moves the hand of a C library; the stand-in is shared

mod stand_in;

use std::time::Duration;

use nalgebra::Vector3;
use palpate_devices::{DriverConfig, DriverError, driver};
use palpate_haptics::device::{DeviceError, DeviceSpec, HapticDevice};
use palpate_haptics::record::TickFlags;
use palpate_haptics::wrench::Wrench;
use stand_in::{StandIn, other_library, tick};

const NAME: &str = "force_dimension";

fn open(config: &DriverConfig) -> Result<Box<dyn HapticDevice>, DriverError> {
    (driver(NAME).unwrap().open)(config)
}

#[test]
fn a_wall_of_500_newtons_per_metre_holds_the_hand_where_both_springs_balance() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    assert_eq!((device.spec().name.as_str(), device.spec().max_force), ("stand-in omega", 12.0));
    library.hand(0.0, 0.0, -0.01);
    let mut height = 0.0;
    for k in 0..3000 {
        let sample = device.read(tick(k)).unwrap();
        height = sample.pose.translation.z;
        let force = Vector3::new(0.0, 0.0, (-500.0 * height).max(0.0));
        device.write(Wrench::from_force(force)).unwrap();
    }
    // 350 (-0.01 - x) = 500 x
    assert!((height + 350.0 * 0.01 / 850.0).abs() < 1e-9, "{height} m");
    assert!((library.force()[2] + 500.0 * height).abs() < 1e-6);
}

/// A driver that has been silent for longer than the firmware waits finds the forces switched off, and switches them on.
#[test]
fn the_firmware_keeps_watch_and_forces_come_back_after_a_silence() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    assert_eq!((library.get("stand_in_watchdog"), device.note()), (240, None), "30 ms in units of 125 us");
    std::thread::sleep(Duration::from_millis(35));
    library.set("stand_in_bite", 1);
    assert_eq!(library.get("stand_in_enabled"), 0);
    device.write(Wrench::from_force(Vector3::z())).unwrap();
    assert_eq!(library.get("stand_in_enabled"), 1);
    drop(device);

    library.set("stand_in_has_watchdog", 0);
    let device = open(&library.config()).unwrap();
    assert!(device.note().is_some_and(|note| note.contains("has no watchdog")), "{:?}", device.note());
}

#[test]
fn pose_velocity_switches_and_torque_are_those_of_the_library() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    library.set("stand_in_type", 104);
    let mut device = open(&library.config()).unwrap();
    assert_eq!((device.spec().max_torque, device.spec().freedoms.drives_torque), (0.2, true));
    library.hand(0.03, 0.02, 0.01);
    let torque = Vector3::new(0.01, 0.02, 0.03);
    device.write(Wrench { force: Vector3::zeros(), torque }).unwrap();
    device.write(Wrench { force: Vector3::zeros(), torque }).unwrap();
    let sample = device.read(tick(5)).unwrap();
    assert_eq!((sample.time, sample.buttons), (tick(5).time, 5));
    // Its x axis points along y: the first column of the frame.
    assert!((sample.pose.rotation * Vector3::x() - Vector3::y()).norm() < 1e-15);
    let p = sample.pose.translation.vector;
    assert!(p.x > 0.0 && (p / p.x - Vector3::new(1.0, 2.0 / 3.0, 1.0 / 3.0)).norm() < 1e-12, "{p}");
    assert!(sample.velocity.linear.x > 0.0 && sample.velocity.angular == Vector3::new(0.5, 0.0, 0.0));
    assert_eq!(library.force()[3..], [0.01, 0.02, 0.03]);

    // 10 of 25 mm open. A work of 0.05 J over 25 mm is 2 N; what the fingers cannot bear is cut, and told.
    assert!((sample.gripper - 0.4).abs() < 1e-15, "{}", sample.gripper);
    for (effort, force, cut) in [
        (0.05, 2000, false),
        (-0.01, -400, false),
        (0.2, 8000, false),
        (9.0, 8000, true),
        (-9.0, -8000, true),
        (f64::INFINITY, 8000, true),
        (f64::NAN, 0, true),
        (0.0, 0, false),
    ] {
        device.write_gripper(effort);
        device.write(Wrench::zero()).unwrap();
        assert_eq!(library.get("stand_in_gripper"), force, "{effort} J");
        assert_eq!(device.limited().contains(TickFlags::TORQUE_LIMITED), cut, "{effort} J");
    }
    device.close();
    assert_eq!(library.get("stand_in_gripper"), 0);

    // The same gap and work on a gripper that opens by 50 mm.
    let mut wide = open(&DriverConfig { gripper_range: Some(50e-3), ..library.config() }).unwrap();
    assert!((wide.read(tick(6)).unwrap().gripper - 0.2).abs() < 1e-15);
    wide.write_gripper(0.05);
    wide.write(Wrench::zero()).unwrap();
    assert_eq!(library.get("stand_in_gripper"), 1000);
    // A device without a gripper has nothing to cut.
    library.set("stand_in_type", 33);
    let mut bare = open(&library.config()).unwrap();
    bare.write_gripper(9.0);
    bare.write(Wrench::zero()).unwrap();
    assert_eq!((library.get("stand_in_gripper"), bare.limited()), (0, TickFlags::default()));
}

/// The library answers that a motor is saturated beyond 12 N along x; it is no error, and it is told while it lasts.
#[test]
fn a_motor_that_is_saturated_is_told_as_a_limit_of_the_force() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    for (force, cut) in [(11.0, false), (13.0, true), (-13.0, true), (11.0, false)] {
        device.write(Wrench::from_force(Vector3::x() * force)).unwrap();
        assert_eq!(device.limited().contains(TickFlags::FORCE_LIMITED), cut, "{force} N");
    }
}

#[test]
fn each_type_of_the_library_has_its_row_of_the_table_and_one_that_is_not_known_says_so() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let rows = [
        (33, "omega.3"),
        (34, "omega.6"),
        (36, "omega.6"),
        (35, "omega.7"),
        (37, "omega.7"),
        (60, "falcon"),
        (63, "delta.3"),
        (64, "delta.3"),
        (104, "sigma.7"),
        (105, "sigma.7"),
        (108, "lambda.7"),
        (109, "lambda.7"),
    ];
    for (kind, row) in rows {
        library.set("stand_in_type", kind);
        let device = open(&library.config()).unwrap();
        let (spec, known) = (device.spec(), DeviceSpec::preset(row).unwrap());
        let limits = |spec: &DeviceSpec| (spec.max_force, spec.max_torque, spec.max_stiffness, spec.workspace_radius);
        assert_eq!((limits(spec), device.note()), (limits(&known), None), "{kind}");
        assert_eq!(spec.freedoms.gripper, [104, 108, 109].contains(&kind), "{kind}: as the library says");
    }
    library.set("stand_in_type", 110);
    let device = open(&library.config()).unwrap();
    assert_eq!((device.spec().max_force, device.spec().max_stiffness), (3.3, 400.0), "the weakest of the table");
    let note = device.note().unwrap();
    assert!(
        ["`stand-in omega`", "type 110", "3.3 N", "device.record"].iter().all(|word| note.contains(word)),
        "{note}"
    );
}

#[test]
fn a_device_that_is_unplugged_in_mid_run_is_an_error_of_each_tick_until_it_is_back() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    device.read(tick(0)).unwrap();
    library.set("stand_in_unplug", 1);
    assert_eq!(device.read(tick(1)), Err(DeviceError::Disconnected));
    assert_eq!(device.write(Wrench::zero()), Err(DeviceError::Disconnected));
    library.set("stand_in_unplug", 0);
    assert!(device.read(tick(2)).is_ok());
}

#[test]
fn closing_takes_the_force_off_once_and_ends_the_connection() {
    let Some(library) = StandIn::build("dhd", &[]) else { return };
    let mut device = open(&library.config()).unwrap();
    assert_eq!((library.get("stand_in_open"), library.get("stand_in_enabled")), (1, 1));
    device.write(Wrench::from_force(Vector3::new(1.0, 2.0, 3.0))).unwrap();
    assert_eq!(library.force()[..3], [1.0, 2.0, 3.0]);
    device.close();
    assert_eq!((library.get("stand_in_open"), library.get("stand_in_enabled"), library.force()), (0, 0, [0.0; 6]));
    assert_eq!(device.read(tick(1)), Err(DeviceError::Closed));
    assert_eq!(device.write(Wrench::zero()), Err(DeviceError::Closed));
    drop(device);
    assert_eq!(library.get("stand_in_open"), 0, "not closed twice");
    drop(open(&library.config()).unwrap());
    assert_eq!((library.get("stand_in_open"), library.get("stand_in_enabled")), (0, 0), "dropping closes");
}

#[test]
fn no_library_a_wrong_one_an_old_one_and_no_device_are_told_apart() {
    let missing = DriverConfig { library: Some("/no/such/libdhd.so".into()), ..DriverConfig::default() };
    let error = open(&missing).err().unwrap();
    assert!(matches!(error, DriverError::Library { .. }), "{error}");
    assert!(
        error.to_string().contains("/no/such/libdhd.so") && error.to_string().contains("device.library"),
        "{error}"
    );

    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("libdhd.so");
    std::fs::write(&text, "no library").unwrap();
    let error = open(&DriverConfig { library: Some(text), ..DriverConfig::default() }).err().unwrap();
    assert!(matches!(error, DriverError::Library { .. }), "{error}");

    let Some(old) = StandIn::build("dhd", &["-DWITHOUT_BUTTONS"]) else { return };
    let error = open(&old.config()).err().unwrap();
    assert!(matches!(error, DriverError::Symbol { symbol: "dhdGetButtonMask", .. }), "{error}");
    let other = DriverConfig { library: Some(other_library(folder.path())), ..DriverConfig::default() };
    let error = open(&other).err().unwrap().to_string();
    assert!(error.contains("libother.so") && error.contains("not a library of Force Dimension"), "{error}");

    let library = StandIn::build("dhd", &[]).unwrap();
    let probe = driver(NAME).unwrap().probe;
    assert_eq!(probe(&library.config()).unwrap(), "1 connected");
    library.set("stand_in_devices", 0);
    let error = open(&library.config()).err().unwrap();
    assert!(matches!(error, DriverError::NoDevice { .. }) && error.to_string().contains("no device found"), "{error}");
    assert!(probe(&library.config()).unwrap_err().to_string().contains("none is connected"));
}
