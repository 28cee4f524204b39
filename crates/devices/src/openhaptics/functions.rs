//! HDAPI's functions, constants and types, as `hd.h` of OpenHaptics 3 has them.

use std::ffi::{c_char, c_double, c_int, c_uint, c_ulong, c_ushort, c_void};

use crate::error::DriverError;
use crate::library::{VendorLibrary, text_of, vendor_functions};

pub(super) type Handle = c_uint;

pub(super) const INVALID_HANDLE: Handle = 0xFFFF_FFFF;
pub(super) const FORCE_OUTPUT: c_uint = 0x4000;
pub(super) const CURRENT_BUTTONS: c_uint = 0x2000;
pub(super) const CURRENT_VELOCITY: c_uint = 0x2051;
pub(super) const CURRENT_TRANSFORM: c_uint = 0x2052;
pub(super) const CURRENT_ANGULAR_VELOCITY: c_uint = 0x2053;
pub(super) const DEVICE_MODEL_TYPE: c_uint = 0x2501;
pub(super) const NOMINAL_MAX_FORCE: c_uint = 0x2603;
pub(super) const CURRENT_FORCE: c_uint = 0x2700;
pub(super) const COMM_ERROR: c_uint = 0x0302;
pub(super) const TIMER_ERROR: c_uint = 0x0304;
pub(super) const CALLBACK_CONTINUE: c_uint = 1;
pub(super) const DEFAULT_PRIORITY: c_ushort = u16::MAX / 2;

/// `HDErrorInfo`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(super) struct ErrorInfo {
    code: c_uint,
    _internal: c_int,
    _device: Handle,
}

pub(super) type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

vendor_functions! {
    /// Functions of `hd.h`.
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
    pub(super) fn take_error(&self) -> c_uint {
        // SAFETY: no arguments.
        let first = unsafe { (self.error)() }.code;
        let mut left = if first == 0 { 0 } else { 16 };
        // SAFETY: as above.
        while left > 0 && unsafe { (self.error)() }.code != 0 {
            left -= 1;
        }
        first
    }

    pub(super) fn reason(&self, code: c_uint) -> String {
        // SAFETY: any code may be asked for.
        let text = unsafe { (self.error_text)(code) };
        // SAFETY: a text of the library, closed by a zero, or NULL.
        unsafe { text_of(text) }.unwrap_or_else(|| format!("error {code:#06x}"))
    }
}
