//! The tick: what a driver calls in its own thread.

use std::cell::UnsafeCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

use palpate::session::{PhaseReader, Port as SessionPort, raise_priority};
use palpate::tick::TickFlags;

use crate::input::Input;
use crate::layout::{self, Layout};
use crate::output::{Output, PALPATE_TICK_NEW_STEP, PALPATE_TICK_REFUSED};
use crate::status::{Status, fail, guarded};

/// The driver's end of a simulation.
pub struct Port {
    busy: AtomicBool,
    /// A tick has panicked: the state is not to be trusted any more.
    broken: AtomicBool,
    phase: PhaseReader,
    port: UnsafeCell<SessionPort>,
}

impl Port {
    pub(crate) fn new(port: SessionPort) -> Self {
        let (busy, broken, phase) = (AtomicBool::new(false), AtomicBool::new(false), port.phase_reader());
        Self { busy, broken, phase, port: UnsafeCell::new(port) }
    }

    /// Takes the port for one tick, or answers that another thread has it.
    fn tick(&self, input: Result<Input, Status>) -> (Output, Status) {
        if self.busy.swap(true, Ordering::Acquire) {
            // What the simulation does is no secret of the thread that has the port.
            return (Output { phase: self.phase.phase() as u32, ..Output::absent() }, Status::ErrorBusy);
        }
        let _free = Free(&self.busy);
        if self.broken.load(Ordering::Relaxed) {
            return (Output::absent(), Status::ErrorInternal);
        }
        // SAFETY: `busy` lets one thread in at a time, and Acquire and Release order what they do.
        let port = unsafe { &mut *self.port.get() };
        let outcome = catch_unwind(AssertUnwindSafe(|| answer(port, input)));
        outcome.unwrap_or_else(|_| {
            self.broken.store(true, Ordering::Relaxed);
            (Output::absent(), Status::ErrorInternal)
        })
    }
}

struct Free<'a>(&'a AtomicBool);

impl Drop for Free<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

fn answer(port: &mut SessionPort, input: Result<Input, Status>) -> (Output, Status) {
    // Without an input there is no pose: the force is cut, and comes back as a ramp.
    let no_pose = Input { position: [f64::NAN; 3], ..Input::absent() };
    let report = port.tick(&input.unwrap_or(no_pose).sample());
    let contact = port.place().wrench_in_device(&report.record.contact_wrench);
    let mut output = Output::new(&report, &contact);
    let quiet = output.flags & !PALPATE_TICK_NEW_STEP == 0;
    match input {
        Err(status) => {
            output.flags |= PALPATE_TICK_REFUSED;
            (output, status)
        }
        Ok(_) if report.record.flags.contains(TickFlags::BAD_POSE) => (output, Status::ErrorInput),
        Ok(_) => (output, if quiet { Status::Ok } else { Status::Notice }),
    }
}

/// One tick: from what the device measured to the force for its motors.
///
/// Call it from one thread of the driver, at 100 Hz to 8 kHz. It allocates nothing, waits for nothing, and asks the
/// system for the time alone. `output` is filled whatever happens, as far as its struct_size reaches; after an error its
/// force and torque are zero.
///
/// # Safety
/// `port` is NULL or was opened and not closed; `input` and `output` are NULL or structs whose struct_size is right.
#[unsafe(no_mangle)]
#[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
pub unsafe extern "C" fn palpate_tick(port: *const Port, input: *const Input, output: *mut Output) -> Status {
    // A force that cannot arrive must not be taken for sent.
    // SAFETY: as the caller promises.
    let input = unsafe { layout::room(output).and_then(|()| layout::read(input)) }.and_then(Input::checked);
    // SAFETY: as the caller promises.
    let (answer, status) = match unsafe { port.as_ref() } {
        None => (Output::absent(), Status::ErrorNull),
        Some(port) => port.tick(input),
    };
    // SAFETY: as the caller promises.
    match unsafe { layout::write(output, &answer) } {
        Ok(()) => status,
        Err(refused) => refused,
    }
}

/// Frees a port, whether its simulation still lives or not. NULL is allowed.
///
/// # Safety
/// `port` is NULL or was opened and not closed, and no thread ticks with it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_close_port(port: *mut Port) -> Status {
    guarded(|| {
        if !port.is_null() {
            // SAFETY: it was made by Box::into_raw, and nobody uses it any more.
            drop(unsafe { Box::from_raw(port) });
        }
        Status::Ok
    })
}

/// Asks for a real-time priority for the calling thread, which is to tick. PALPATE_STATUS_NOTICE where the system does
/// not grant it; palpate_last_error tells the remedy.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_raise_priority() -> Status {
    guarded(|| {
        if raise_priority() {
            return Status::Ok;
        }
        fail(
            Status::Notice,
            "the system grants no real-time priority; give it with `setcap cap_sys_nice+ep <program>` or a line \
             `@group - rtprio 80` in /etc/security/limits.conf",
        )
    })
}
