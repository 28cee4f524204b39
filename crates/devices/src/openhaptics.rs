//! 3D Systems' devices (Touch, Phantom) through OpenHaptics' HDAPI.
//!
//! HDAPI has a servo thread of its own, at 1 kHz, in which alone a device is read and driven. A callback there exchanges
//! whole values with the tick: the newest sample one way, the newest wrench the other, wait-free on both sides. The
//! motors so get a force at most one servo period after the tick wrote it. Where no wrench has come for
//! [`LARGEST_SILENCE`] servo periods, the callback sends none.
//!
//! Functions and constants are those of `hd.h` of OpenHaptics 3: millimetres, y up, matrices by columns; here they are
//! turned into metres. The library guards force, velocity and motor temperature itself, and stops forces beyond.

// The vendor's functions, and a callback that they make.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char, c_double, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::ptr;
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceError, DeviceSample, DeviceSpec, HapticDevice, TickTime};
use palpate_haptics::exchange::{Reader, Writer, latest};
use palpate_haptics::wrench::{Twist, Wrench};

use crate::error::DriverError;
use crate::library::{Origin, VendorLibrary};
use crate::{Driver, DriverConfig, Opened};

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

const VENDOR: &str = "OpenHaptics";

const ORIGIN: Origin = Origin {
    vendor: VENDOR,
    names: if cfg!(windows) { &["hd.dll"] } else { &["libHD.so", "libHD.so.3.4", "libHD.so.3"] },
    remedy: "`device.library` in the scene or --hd",
};

type Handle = c_uint;

const INVALID_HANDLE: Handle = 0xFFFF_FFFF;
const FORCE_OUTPUT: c_uint = 0x4000;
const CURRENT_BUTTONS: c_uint = 0x2000;
const CURRENT_VELOCITY: c_uint = 0x2051;
const CURRENT_TRANSFORM: c_uint = 0x2052;
const CURRENT_ANGULAR_VELOCITY: c_uint = 0x2053;
const DEVICE_MODEL_TYPE: c_uint = 0x2501;
const NOMINAL_MAX_FORCE: c_uint = 0x2603;
const CURRENT_FORCE: c_uint = 0x2700;
const COMM_ERROR: c_uint = 0x0302;
const TIMER_ERROR: c_uint = 0x0304;
const CALLBACK_CONTINUE: c_uint = 1;
const DEFAULT_PRIORITY: c_ushort = u16::MAX / 2;

/// Millimetres of the library in metres.
const MILLIMETRE: f64 = 1e-3;

/// `HDErrorInfo`.
#[repr(C)]
#[derive(Clone, Copy)]
struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: Handle,
}

type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

/// Declares the functions that are used, each once.
macro_rules! functions {
    ($($field:ident = $symbol:literal: fn($($argument:ty),*) $(-> $answer:ty)?;)*) => {
        #[derive(Clone, Copy)]
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $answer)?,)*
        }

        impl Functions {
            fn of(library: &VendorLibrary) -> Result<Self, DriverError> {
                // SAFETY: the signatures are those of `hd.h`; the library is kept beside the functions.
                Ok(unsafe { Self { $($field: library.function($symbol)?,)* } })
            }
        }
    };
}

functions! {
    init = "hdInitDevice": fn(*const c_char) -> Handle;
    disable_device = "hdDisableDevice": fn(Handle);
    make_current = "hdMakeCurrentDevice": fn(Handle);
    begin_frame = "hdBeginFrame": fn(Handle);
    end_frame = "hdEndFrame": fn(Handle);
    error = "hdGetError": fn() -> ErrorInfo;
    error_text = "hdGetErrorString": fn(c_uint) -> *const c_char;
    enable = "hdEnable": fn(c_uint);
    disable = "hdDisable": fn(c_uint);
    get_integers = "hdGetIntegerv": fn(c_uint, *mut c_int);
    get_doubles = "hdGetDoublev": fn(c_uint, *mut c_double);
    get_string = "hdGetString": fn(c_uint) -> *const c_char;
    set_doubles = "hdSetDoublev": fn(c_uint, *const c_double);
    start_scheduler = "hdStartScheduler": fn();
    stop_scheduler = "hdStopScheduler": fn();
    schedule = "hdScheduleAsynchronous": fn(Callback, *mut c_void, c_ushort) -> c_ulong;
    unschedule = "hdUnschedule": fn(c_ulong);
}

impl Functions {
    /// The newest error of this thread; 0 where there is none. The others are taken off the library's stack.
    fn take_error(&self) -> c_uint {
        // SAFETY: no arguments.
        let first = unsafe { (self.error)() }.code;
        let mut left = if first == 0 { 0 } else { 16 };
        // SAFETY: as above.
        while left > 0 && unsafe { (self.error)() }.code != 0 {
            left -= 1;
        }
        first
    }

    fn reason(&self, code: c_uint) -> String {
        // SAFETY: any code may be asked for.
        let text = unsafe { (self.error_text)(code) };
        // SAFETY: a text of the library, closed by a zero, or NULL.
        unsafe { text_of(text) }.unwrap_or_else(|| format!("error {code:#06x}"))
    }
}

/// A text of the library.
///
/// # Safety
/// `text` is NULL or closed by a zero.
unsafe fn text_of(text: *const c_char) -> Option<String> {
    // SAFETY: as the caller promises.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

/// What the servo thread measured.
#[derive(Clone, Copy)]
struct Measured {
    sample: DeviceSample,
    /// Error of the library; 0: none.
    error: c_uint,
    at: Instant,
}

/// A wrench with its number, so that the servo thread knows a new one.
#[derive(Clone, Copy, Default)]
struct Wanted {
    force: Vector3<f64>,
    number: u64,
}

/// What the callback works with.
struct Servo {
    functions: Functions,
    handle: Handle,
    samples: Writer<Measured>,
    wanted: Reader<Wanted>,
    number: u64,
    silence: u32,
}

/// The servo thread's work of one period.
///
/// # Safety
/// `data` is the address of a [`Servo`] that nobody else uses while the callback is scheduled.
unsafe extern "C" fn serve(data: *mut c_void) -> c_uint {
    // SAFETY: as the scheduler was given it.
    let servo = unsafe { &mut *data.cast::<Servo>() };
    servo.period();
    CALLBACK_CONTINUE
}

impl Servo {
    fn period(&mut self) {
        let f = self.functions;
        let mut transform = [0.0; 16];
        let [mut v, mut w] = [[0.0; 3]; 2];
        let mut buttons = 0;
        let wanted = *self.wanted.latest();
        self.silence = if wanted.number == self.number { self.silence.saturating_add(1) } else { 0 };
        self.number = wanted.number;
        let force: [f64; 3] = if self.silence > LARGEST_SILENCE { [0.0; 3] } else { wanted.force.into() };
        // SAFETY: on the servo thread, between begin and end of a frame, with an initialised device; each array has the
        // length that the parameter asks for.
        unsafe {
            (f.begin_frame)(self.handle);
            (f.get_doubles)(CURRENT_TRANSFORM, transform.as_mut_ptr());
            (f.get_doubles)(CURRENT_VELOCITY, v.as_mut_ptr());
            (f.get_doubles)(CURRENT_ANGULAR_VELOCITY, w.as_mut_ptr());
            (f.get_integers)(CURRENT_BUTTONS, &raw mut buttons);
            (f.set_doubles)(CURRENT_FORCE, force.as_ptr());
            (f.end_frame)(self.handle);
        }
        let sample = DeviceSample {
            velocity: Twist { linear: Vector3::from(v) * MILLIMETRE, angular: w.into() },
            buttons: buttons as u32,
            ..DeviceSample::at_rest(0.0, pose(&transform))
        };
        self.samples.send(Measured { sample, error: f.take_error(), at: Instant::now() });
    }
}

/// A pose of the library: a matrix of four by four, by columns, in millimetres.
fn pose(m: &[f64; 16]) -> Isometry3<f64> {
    let matrix = Matrix3::from_fn(|i, j| m[4 * j + i]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    Isometry3::from_parts(Translation3::new(m[12] * MILLIMETRE, m[13] * MILLIMETRE, m[14] * MILLIMETRE), rotation)
}

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
    let nothing = Measured { sample: DeviceSample::at_rest(0.0, Isometry3::identity()), error: 0, at: Instant::now() };
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
