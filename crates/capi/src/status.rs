//! Status codes, and the message of the last error of a thread.

use std::cell::RefCell;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a function answers. Negative: an error; positive: information; 0: all is well.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// Done, and the flags of the output say something: the force fades, is limited, or there is none yet. Of
    /// palpate_change and palpate_stop: palpate_last_error has something to tell.
    Notice = 1,
    /// A pointer is NULL.
    ErrorNull = -1,
    /// The struct_size of a struct is too small for what every version of it holds.
    ErrorStructSize = -2,
    /// A number is out of its range, a text is not UTF-8, or a bit or a reserved field is set that this library does not
    /// know.
    ErrorArgument = -3,
    /// The scene cannot be read, or is wrong.
    ErrorScene = -4,
    /// The scene cannot be set up: the body cannot be simulated, the trace not written, threads not started.
    ErrorSetUp = -5,
    /// The simulation is not in a phase in which the function may be called.
    ErrorPhase = -6,
    /// Another thread is inside palpate_tick with the same port. No force.
    ErrorBusy = -7,
    /// The pose, velocity or gripper of the input is not finite, not a rotation, or beyond 1 km or 1e6 m/s. No force.
    ErrorInput = -8,
    /// A mistake inside the library. The port answers no force from then on.
    ErrorInternal = -9,
}

impl Status {
    const fn text(self) -> &'static CStr {
        match self {
            Self::Ok => c"done",
            Self::Notice => c"done; the flags of the output say more",
            Self::ErrorNull => c"a pointer is NULL",
            Self::ErrorStructSize => c"struct_size is too small: set it to sizeof the struct",
            Self::ErrorArgument => {
                c"a number is out of its range, a text is not UTF-8, or a bit is set that is not known"
            }
            Self::ErrorScene => c"the scene cannot be read, or is wrong",
            Self::ErrorSetUp => c"the scene cannot be set up",
            Self::ErrorPhase => c"not allowed in the present phase of the simulation",
            Self::ErrorBusy => c"another thread is inside palpate_tick with this port",
            Self::ErrorInput => {
                c"the pose, velocity or gripper of the input is not finite, not a rotation, or beyond 1 km or 1e6 m/s"
            }
            Self::ErrorInternal => c"a mistake inside the library; please report it",
        }
    }

    const ALL: [Self; 11] = [
        Self::Ok,
        Self::Notice,
        Self::ErrorNull,
        Self::ErrorStructSize,
        Self::ErrorArgument,
        Self::ErrorScene,
        Self::ErrorSetUp,
        Self::ErrorPhase,
        Self::ErrorBusy,
        Self::ErrorInput,
        Self::ErrorInternal,
    ];
}

/// Longest message that is kept, with its closing zero (bytes); a longer one is cut.
const LONGEST: usize = 2048;

thread_local! {
    static LAST: RefCell<[u8; LONGEST]> = const { RefCell::new([0; LONGEST]) };
}

/// Keeps a message for [`palpate_last_error`] and answers the status.
pub(crate) fn fail(status: Status, message: &str) -> Status {
    // A thread that is ending has no message any more.
    let _ = LAST.try_with(|last| {
        let mut buffer = last.borrow_mut();
        let mut length = message.len().min(LONGEST - 1);
        while !message.is_char_boundary(length) {
            length -= 1;
        }
        let mut bytes = message.bytes();
        for slot in &mut buffer[..length] {
            // A zero would end the text early.
            *slot = bytes.next().filter(|&b| b != 0).unwrap_or(b' ');
        }
        buffer[length] = 0;
    });
    status
}

/// The status with its own text as message.
pub(crate) fn fail_plainly(status: Status) -> Status {
    fail(status, &status.text().to_string_lossy())
}

/// Runs `body` and turns a panic into a status.
pub(crate) fn guarded(body: impl FnOnce() -> Status) -> Status {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|_| fail_plainly(Status::ErrorInternal))
}

/// Version of the library, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => c"",
    };
    VERSION.as_ptr()
}

/// What a status means, as a sentence. Never NULL; any number may be given.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_status_text(status: i32) -> *const c_char {
    let known = Status::ALL.into_iter().find(|&s| s as i32 == status);
    known.map_or(c"unknown status", Status::text).as_ptr()
}

/// Why the last call in this thread failed, with place and remedy. Never NULL; empty before the first failure. Valid
/// until the next call that fails in this thread. palpate_tick does not write it: its status and flags say all.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_last_error() -> *const c_char {
    LAST.try_with(|last| last.as_ptr().cast::<c_char>().cast_const()).unwrap_or(c"".as_ptr())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last() -> String {
        // SAFETY: the function answers a text of this thread, closed by a zero, that nobody writes now.
        unsafe { CStr::from_ptr(palpate_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn a_message_is_cut_at_a_character_and_replaces_the_one_before() {
        assert_eq!(last(), "");
        let long: String = "µ".repeat(LONGEST);
        assert_eq!(fail(Status::ErrorScene, &long), Status::ErrorScene);
        assert_eq!(last(), "µ".repeat((LONGEST - 1) / 2));
        fail(Status::ErrorScene, "short\0er");
        assert_eq!(last(), "short er");
    }

    #[test]
    fn a_panic_is_a_status() {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| ()));
        let status = guarded(|| panic!("as a test"));
        std::panic::set_hook(hook);
        assert_eq!(status, Status::ErrorInternal);
        assert!(last().contains("mistake inside the library"));
    }

    #[test]
    fn every_status_has_a_text_and_others_are_unknown() {
        let text = |status: i32| {
            // SAFETY: the function answers a text that lives as long as the program.
            unsafe { CStr::from_ptr(palpate_status_text(status)) }.to_str().unwrap()
        };
        for (k, status) in Status::ALL.into_iter().enumerate() {
            assert_ne!(text(status as i32), "unknown status");
            assert!(Status::ALL[..k].iter().all(|&other| text(other as i32) != text(status as i32)));
        }
        assert_eq!(text(77), "unknown status");
    }
}
