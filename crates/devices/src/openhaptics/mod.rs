//! 3D Systems' devices (Touch, Phantom) through OpenHaptics' HDAPI.
//!
//! HDAPI has a servo thread of its own, at 1 kHz, in which alone a device is read and driven. A callback there exchanges
//! whole values with the tick: the newest sample one way, the newest wrench the other, wait-free on both sides. The
//! motors so get a force at most one servo period after the tick wrote it. Where no wrench has come for
//! [`LARGEST_SILENCE`] servo periods, the callback sends none. A device is closed when its servo thread has sent the zero
//! force, or has not called for [`LAST_WORD`].
//!
//! Functions and constants are those of `hd.h` of OpenHaptics 3: millimetres, y up, matrices by columns; here they are
//! turned into metres. The library guards force, velocity and motor temperature itself, and stops forces beyond.

// The vendor's functions, and a callback that they make.
#![allow(unsafe_code)]

mod functions;
mod servo;

use std::ffi::c_ulong;
use std::ptr;
use std::time::{Duration, Instant};

use nalgebra::Isometry3;
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::wrench::Wrench;

use crate::error::DriverError;
use crate::library::{Origin, VendorLibrary, text_of};
use crate::{Driver, DriverConfig, Opened};
use functions::{
    COMM_ERROR, DEFAULT_PRIORITY, DEVICE_MODEL_TYPE, FORCE_OUTPUT, Functions, Handle, INVALID_HANDLE,
    NOMINAL_MAX_FORCE, TIMER_ERROR,
};
use servo::{Measured, Servo, Wanted, serve};

/// Line in the register of drivers.
pub const DRIVER: Driver = Driver {
    name: "openhaptics",
    summary: "Touch and Phantom, through OpenHaptics' HDAPI",
    real_time: true,
    own_frame: true,
    keys: &["library"],
    open,
    probe,
};

/// Servo periods without a new wrench after which the motors get none: the program has stopped ticking.
pub const LARGEST_SILENCE: u32 = 50;

/// Age of a sample beyond which the servo thread counts as stuck (s).
const OLDEST_SAMPLE: f64 = 0.05;

/// Time that the servo thread has for its first sample.
const FIRST_SAMPLE: Duration = Duration::from_secs(2);

/// Longest wait for the servo thread to take the force off at the end.
pub const LAST_WORD: Duration = Duration::from_millis(100);

const VENDOR: &str = "OpenHaptics";

const ORIGIN: Origin = Origin {
    vendor: VENDOR,
    names: if cfg!(windows) { &["hd.dll"] } else { &["libHD.so", "libHD.so.3.4", "libHD.so.3"] },
    remedy: "`device.library` in the scene or --hd",
};

/// An open device.
struct OpenHaptics {
    functions: Functions,
    /// Keeps the functions loaded.
    _library: VendorLibrary,
    handle: Handle,
    spec: DeviceSpec,
    samples: Reader<Measured>,
    wanted: Writer<Wanted>,
    written: u64,
    /// The callback's data, made by `Box::into_raw`, and its handle; `None` once closed.
    scheduled: Option<(*mut Servo, c_ulong)>,
}

// SAFETY: the pointer is used by the servo thread alone while the callback is scheduled, and by whoever closes the device
// afterwards; functions of the library may be called from any thread.
unsafe impl Send for OpenHaptics {}

fn open(config: &DriverConfig) -> Opened {
    let library = VendorLibrary::open(&ORIGIN, config.library.as_deref())?;
    let functions = Functions::of(&library)?;
    let (handle, spec) = initialise(&functions)?;
    let sample = DeviceSample::at_rest(0.0, Isometry3::identity());
    let nothing = Measured { sample, error: 0, number: 0, at: Instant::now() };
    let (sample_writer, samples) = latest(&nothing);
    let (wanted, wanted_reader) = latest(&Wanted::default());
    let servo =
        Servo { functions, handle, samples: sample_writer, wanted: wanted_reader, number: 0, silence: LARGEST_SILENCE };
    let servo = Box::into_raw(Box::new(servo));
    // SAFETY: the device is initialised and current; `servo` lives until the callback is unscheduled.
    let scheduled = unsafe {
        (functions.enable)(FORCE_OUTPUT);
        let scheduled = (functions.schedule)(serve, servo.cast(), DEFAULT_PRIORITY);
        (functions.start_scheduler)();
        scheduled
    };
    let mut device = OpenHaptics {
        functions,
        _library: library,
        handle,
        spec,
        samples,
        wanted,
        written: 0,
        scheduled: Some((servo, scheduled)),
    };
    device.wait_for_sample()?;
    Ok(Box::new(device))
}

/// Initialises the default device, and answers its handle and its record.
fn initialise(functions: &Functions) -> Result<(Handle, DeviceSpec), DriverError> {
    // SAFETY: NULL is the default device.
    let handle = unsafe { (functions.init)(ptr::null()) };
    let error = functions.take_error();
    if handle == INVALID_HANDLE || error != 0 {
        return Err(DriverError::NoDevice { vendor: VENDOR, reason: functions.reason(error) });
    }
    let mut force = [0.0; 1];
    // SAFETY: the device is initialised; the parameter is one number, and the text is read at once.
    let name = unsafe {
        (functions.make_current)(handle);
        (functions.get_doubles)(NOMINAL_MAX_FORCE, force.as_mut_ptr());
        text_of((functions.get_string)(DEVICE_MODEL_TYPE))
    };
    functions.take_error();
    // Stiffness and damping of the softest of the family; a scene's own `preset` or `record` knows better.
    let known = DeviceSpec::preset("touch")?;
    let max_force = if force[0] > 0.0 && force[0].is_finite() { force[0] } else { known.max_force };
    Ok((handle, DeviceSpec { name: name.unwrap_or_else(|| VENDOR.into()), max_force, ..known }))
}

fn probe(config: &DriverConfig) -> Result<String, DriverError> {
    let library = VendorLibrary::open(&ORIGIN, config.library.as_deref())?;
    let functions = Functions::of(&library)?;
    let (handle, spec) = initialise(&functions)?;
    // SAFETY: the device is initialised, and nothing is scheduled.
    unsafe { (functions.disable_device)(handle) };
    Ok(spec.name)
}

impl OpenHaptics {
    /// Waits until the servo thread has measured once.
    fn wait_for_sample(&mut self) -> Result<(), DriverError> {
        let begin = Instant::now();
        while !self.samples.refresh() {
            if begin.elapsed() > FIRST_SAMPLE {
                let reason = "its servo thread does not call".to_owned();
                return Err(DriverError::NoDevice { vendor: VENDOR, reason });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// Waits until the servo thread has sent the force that was written last.
    fn wait_for_force(&mut self) {
        let begin = Instant::now();
        while self.samples.latest().number != self.written && begin.elapsed() < LAST_WORD {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl HapticDevice for OpenHaptics {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn read(&mut self, tick: TickTime) -> Result<DeviceSample, DeviceError> {
        if self.scheduled.is_none() {
            return Err(DeviceError::Closed);
        }
        let measured = *self.samples.latest();
        match measured.error {
            0 if measured.at.elapsed().as_secs_f64() > OLDEST_SAMPLE => Err(DeviceError::Timeout),
            0 => Ok(DeviceSample { time: tick.time, ..measured.sample }),
            COMM_ERROR | TIMER_ERROR => Err(DeviceError::Disconnected),
            code => Err(DeviceError::Driver(code as i32)),
        }
    }

    /// The devices that this drives have no motors for torque.
    fn write(&mut self, wrench: Wrench) -> Result<(), DeviceError> {
        if self.scheduled.is_none() {
            return Err(DeviceError::Closed);
        }
        self.written += 1;
        self.wanted.send(Wanted { force: wrench.force, number: self.written });
        Ok(())
    }

    fn close(&mut self) {
        // The motors may be driven on the servo thread alone, and would keep what they were asked for last.
        if self.write(Wrench::zero()).is_ok() {
            self.wait_for_force();
        }
        let Some((servo, scheduled)) = self.scheduled.take() else { return };
        let f = &self.functions;
        // SAFETY: the callback is taken off and the scheduler stopped, after which nobody uses its data.
        unsafe {
            (f.stop_scheduler)();
            (f.unschedule)(scheduled);
            (f.make_current)(self.handle);
            (f.disable)(FORCE_OUTPUT);
            (f.disable_device)(self.handle);
            drop(Box::from_raw(servo));
        }
    }
}

impl Drop for OpenHaptics {
    fn drop(&mut self) {
        self.close();
    }
}
