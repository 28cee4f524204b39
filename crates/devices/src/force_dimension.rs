//! Force Dimension's devices (omega, delta, sigma, lambda), and the Falcon, through the vendor's DHD library.
//!
//! Functions and constants are those of `dhdc.h` of the SDK 3.7 to 3.17: metres, newtons, the number of the device as
//! last argument, a negative answer for an error, and positive ones that are none: `DHD_TIMEGUARD`, and
//! `DHD_MOTOR_SATURATED`, which is told as a limit that acts. A gripper is read by the gap between its fingers, which
//! left-handed devices give the same sign, and is driven by the force along it.
//! The library is called on the tick thread: a call is one exchange over USB, which is what paces it. Gravity compensation
//! and the velocity threshold that brakes the device stay as the device is configured. The firmware's watchdog is set: a
//! device that no force reaches for 30 ms switches its forces off by itself, whatever becomes of the program.

// The vendor's functions.
#![allow(unsafe_code)]

use std::ffi::{c_char, c_double, c_int, c_uchar, c_uint};
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, Freedoms, HapticDevice, TickTime};
use palpate_haptics::record::TickFlags;
use palpate_haptics::wrench::{Twist, Wrench};

use crate::error::DriverError;
use crate::library::{Origin, VendorLibrary, text_of, vendor_functions};
use crate::{Driver, DriverConfig, Opened};

/// Line in the register of drivers.
pub const DRIVER: Driver = Driver {
    name: "force_dimension",
    summary: "omega, delta, sigma, lambda and Falcon, through Force Dimension's DHD library",
    real_time: true,
    own_frame: true,
    keys: &["library", "gripper_range"],
    open,
    probe,
};

const VENDOR: &str = "Force Dimension";

const ORIGIN: Origin = Origin {
    vendor: VENDOR,
    names: if cfg!(windows) {
        &["dhd64.dll", "drd64.dll"]
    } else if cfg!(target_os = "macos") {
        &["libdhd.dylib", "libdrd.dylib"]
    } else {
        // DRD contains DHD, and is what some installations have alone.
        &["libdhd.so.3", "libdhd.so", "libdrd.so.3", "libdrd.so"]
    },
    remedy: "`device.library` in the scene or --dhd",
};

/// Answer to a command that the motors cannot give all of.
const MOTOR_SATURATED: c_int = 2;

/// `dhd_errors` of `dhdc.h`: the ones that mean that the device is gone, and the one that means that it is slow.
const ERROR_COM: c_int = 2;
const ERROR_NO_DEVICE: c_int = 5;
const ERROR_TIMEOUT: c_int = 7;
const ERROR_NOT_READY: c_int = 12;

/// Silence after which the firmware switches the forces off, in its unit: 30 ms, of 32 that there can be. Slower ticks than
/// 100 Hz have no room.
const WATCHDOG: c_uchar = 240;
const WATCHDOG_UNIT: Duration = Duration::from_micros(125);

/// Whose limits a device has whose type is not known.
const WEAKEST: &str = "touch";

/// Opening of the gripper that counts as open (m), where the scene does not state its range, and the largest force between its
/// fingers (N): what the data sheets of omega.7 and sigma.7 state for grasping, 25 mm and 8 N.
const GRIPPER_RANGE: f64 = 25e-3;
const GRIPPER_FORCE: f64 = 8.0;

vendor_functions! {
    /// Functions of `dhdc.h`.
    device_count = "dhdGetDeviceCount": fn() -> c_int;
    open = "dhdOpen": fn() -> c_int;
    close = "dhdClose": fn(c_char) -> c_int;
    last_error = "dhdErrorGetLast": fn() -> c_int;
    error_text = "dhdErrorGetStr": fn(c_int) -> *const c_char;
    system_type = "dhdGetSystemType": fn(c_char) -> c_int;
    system_name = "dhdGetSystemName": fn(c_char) -> *const c_char;
    has_wrist = "dhdHasWrist": fn(c_char) -> bool;
    has_active_wrist = "dhdHasActiveWrist": fn(c_char) -> bool;
    has_gripper = "dhdHasGripper": fn(c_char) -> bool;
    enable_force = "dhdEnableForce": fn(c_uchar, c_char) -> c_int;
    set_watchdog = "dhdSetWatchdog": fn(c_uchar, c_char) -> c_int;
    pose = "dhdGetPositionAndOrientationFrame":
        fn(*mut c_double, *mut c_double, *mut c_double, *mut [[c_double; 3]; 3], c_char) -> c_int;
    velocity = "dhdGetLinearVelocity": fn(*mut c_double, *mut c_double, *mut c_double, c_char) -> c_int;
    angular_velocity = "dhdGetAngularVelocityRad": fn(*mut c_double, *mut c_double, *mut c_double, c_char) -> c_int;
    gripper_gap = "dhdGetGripperGap": fn(*mut c_double, c_char) -> c_int;
    buttons = "dhdGetButtonMask": fn(c_char) -> c_uint;
    set_wrench = "dhdSetForceAndTorqueAndGripperForce":
        fn(c_double, c_double, c_double, c_double, c_double, c_double, c_double, c_char) -> c_int;
}

impl Functions {
    /// What the vendor says about the last error of this thread.
    fn reason(&self) -> (c_int, String) {
        // SAFETY: no arguments; the text is the library's and is read at once.
        let (code, text) = unsafe {
            let code = (self.last_error)();
            (code, (self.error_text)(code))
        };
        // SAFETY: as above; NULL is looked for.
        (code, unsafe { text_of(text) }.unwrap_or_else(|| format!("error {code}")))
    }

    /// The error of a call that has failed in mid-run.
    fn error(&self) -> DeviceError {
        // SAFETY: no arguments.
        match unsafe { (self.last_error)() } {
            ERROR_COM | ERROR_NO_DEVICE | ERROR_NOT_READY => DeviceError::Disconnected,
            ERROR_TIMEOUT => DeviceError::Timeout,
            code => DeviceError::Driver(code),
        }
    }
}

/// An open device.
struct ForceDimension {
    functions: Functions,
    /// Keeps the functions loaded.
    _library: VendorLibrary,
    id: c_char,
    spec: DeviceSpec,
    note: Option<String>,
    /// Opening that counts as open (m).
    gripper_range: f64,
    /// Force between the fingers for the next command (N); positive opens, as the gap grows.
    gripper_force: f64,
    /// Whether that is less than was asked for.
    gripper_cut: bool,
    /// Whether the motors did not give all of the last command.
    saturated: bool,
    open: bool,
    /// When the last command was sent, where the firmware keeps watch.
    sent: Option<Instant>,
}

fn open(config: &DriverConfig) -> Opened {
    let library = VendorLibrary::open(&ORIGIN, config.library.as_deref())?;
    let functions = Functions::of(&library)?;
    // SAFETY: no arguments.
    let id = unsafe { (functions.open)() };
    if id < 0 {
        return Err(DriverError::NoDevice { vendor: VENDOR, reason: functions.reason().1 });
    }
    // A number of a device fits in the vendor's own type for it.
    let id = id as c_char;
    let (spec, mut note) = spec(&functions, id);
    // SAFETY: the device is open.
    let watched = unsafe { (functions.set_watchdog)(WATCHDOG, id) } >= 0;
    if !watched {
        let unwatched = format!(
            "{VENDOR}'s device `{}` has no watchdog: what it does where the program dies is up to its firmware",
            spec.name
        );
        note = Some(note.map_or(unwatched.clone(), |note| format!("{note}; {unwatched}")));
    }
    let sent = watched.then(Instant::now);
    let range = config.gripper_range.filter(|range| range.is_finite() && *range > 0.0).unwrap_or(GRIPPER_RANGE);
    let device = ForceDimension {
        functions,
        _library: library,
        id,
        spec,
        note,
        gripper_range: range,
        gripper_force: 0.0,
        gripper_cut: false,
        saturated: false,
        open: true,
        sent,
    };
    // SAFETY: the device is open.
    if unsafe { (functions.enable_force)(1, id) } < 0 {
        let reason = format!("forces cannot be enabled: {}", functions.reason().1);
        return Err(DriverError::NoDevice { vendor: VENDOR, reason });
    }
    Ok(Box::new(device))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let library = VendorLibrary::open(&ORIGIN, config.library.as_deref())?;
    let functions = Functions::of(&library)?;
    // SAFETY: no arguments.
    match unsafe { (functions.device_count)() } {
        count if count > 0 => Ok(format!("{count} connected")),
        0 => Err(DriverError::NoDevice { vendor: VENDOR, reason: "none is connected".into() }),
        _ => Err(DriverError::NoDevice { vendor: VENDOR, reason: functions.reason().1 }),
    }
}

/// The row of CHAI3D's table for a type of `dhdc.h`; left-handed devices have numbers of their own. None of them sends
/// torques by the delta's row, for that is the one of three freedoms.
fn preset(kind: c_int) -> Option<&'static str> {
    Some(match kind {
        33 => "omega.3",
        34 | 36 => "omega.6",
        35 | 37 => "omega.7",
        63 | 64 => "delta.3",
        104..=107 => "sigma.7",
        108 | 109 => "lambda.7",
        60 => "falcon",
        _ => return None,
    })
}

/// The record of the open device: CHAI3D's figures for its type, and what there is to say of it. A type that is not known
/// gets the figures of the weakest device of the table, which a scene's own `record` replaces.
fn spec(functions: &Functions, id: c_char) -> (DeviceSpec, Option<String>) {
    // SAFETY: the device is open, and the text is read at once.
    let (kind, name, senses, drives, gripper) = unsafe {
        (
            (functions.system_type)(id),
            text_of((functions.system_name)(id)).unwrap_or_else(|| VENDOR.into()),
            (functions.has_wrist)(id),
            (functions.has_active_wrist)(id),
            (functions.has_gripper)(id),
        )
    };
    let preset = preset(kind);
    // Every name is in the table.
    let known = DeviceSpec::preset(preset.unwrap_or(WEAKEST)).unwrap_or_else(|_| DeviceSpec::virtual_device(0.0));
    let note = preset.is_none().then(|| {
        format!(
            "{VENDOR}'s device `{name}` is of type {kind}, which is not known: it has the limits of `{WEAKEST}` \
             ({} N, {} N/m), unless the scene gives it a `device.record` or a `device.preset`",
            known.max_force, known.max_stiffness
        )
    });
    let freedoms = Freedoms {
        senses_rotation: senses,
        drives_torque: drives && known.max_torque > 0.0,
        gripper,
        ..known.freedoms
    };
    (DeviceSpec { name, freedoms, ..known }, note)
}

impl HapticDevice for ForceDimension {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        let f = &self.functions;
        let [mut p, mut v, mut w] = [[0.0; 3]; 3];
        let mut frame = [[0.0; 3]; 3];
        let mut gap = self.gripper_range;
        // SAFETY: the device is open; each pointer is to a number, or three by three of them, of this function.
        let answers = unsafe {
            [
                (f.pose)(&raw mut p[0], &raw mut p[1], &raw mut p[2], &raw mut frame, self.id),
                (f.velocity)(&raw mut v[0], &raw mut v[1], &raw mut v[2], self.id),
                if self.spec.freedoms.senses_rotation {
                    (f.angular_velocity)(&raw mut w[0], &raw mut w[1], &raw mut w[2], self.id)
                } else {
                    0
                },
                if self.spec.freedoms.gripper { (f.gripper_gap)(&raw mut gap, self.id) } else { 0 },
            ]
        };
        if answers.iter().any(|&answer| answer < 0) {
            return Err(f.error());
        }
        // Rows of C are the rows of the matrix.
        let matrix = Matrix3::from_fn(|i, j| frame[i][j]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        Ok(DeviceSample {
            time: tick.time,
            pose: Isometry3::from_parts(Translation3::from(p), rotation),
            velocity: Twist { linear: v.into(), angular: w.into() },
            // SAFETY: the device is open.
            buttons: unsafe { (f.buttons)(self.id) },
            gripper: gap / self.gripper_range,
        })
    }

    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if !self.open {
            return Err(DeviceError::Closed);
        }
        let (f, t) = (wrench.force, wrench.torque);
        let grip = self.gripper_force;
        // SAFETY: the device is open.
        let answer = unsafe { (self.functions.set_wrench)(f.x, f.y, f.z, t.x, t.y, t.z, grip, self.id) };
        if answer < 0 {
            return Err(self.functions.error());
        }
        self.saturated = answer == MOTOR_SATURATED;
        if let Some(sent) = &mut self.sent {
            let now = Instant::now();
            // After a silence the firmware has switched the forces off, and does not say so.
            if now.duration_since(std::mem::replace(sent, now)) >= WATCHDOG_UNIT * u32::from(WATCHDOG) {
                // SAFETY: the device is open; where this fails it is gone, which the next command tells.
                unsafe { (self.functions.enable_force)(1, self.id) };
            }
        }
        Ok(())
    }

    fn write_gripper(&mut self, effort: f64) {
        let wanted = effort / self.gripper_range;
        let force = if wanted.is_nan() { 0.0 } else { wanted.clamp(-GRIPPER_FORCE, GRIPPER_FORCE) };
        // Without a gripper there is nothing to cut.
        let gripper = self.spec.freedoms.gripper;
        (self.gripper_force, self.gripper_cut) = if gripper { (force, force != wanted) } else { (0.0, false) };
    }

    fn limited(&self) -> TickFlags {
        let mut flags = TickFlags::default();
        flags.set_if(self.saturated, TickFlags::FORCE_LIMITED);
        flags.set_if(self.gripper_cut, TickFlags::TORQUE_LIMITED);
        flags
    }

    fn close(&mut self) {
        if std::mem::take(&mut self.open) {
            // SAFETY: the device was open until now. One that has gone answers errors, which nobody needs.
            unsafe {
                (self.functions.set_wrench)(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self.id);
                (self.functions.enable_force)(0, self.id);
                (self.functions.close)(self.id);
            }
        }
    }
}

impl Drop for ForceDimension {
    fn drop(&mut self) {
        self.close();
    }
}
