//! Life cycle of a simulation: create, open a port, start, pause, stop, destroy.

use std::ffi::c_char;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use palpate::run::RunOptions;
use palpate::scene::{Scene, SceneError};
use palpate::session::{Phase, PortConfigError, Session};
use palpate::world::{ChangeError, ChangeRequest, World};

use crate::layout::{self, Layout};
use crate::options::{Options, text};
use crate::port::Port;
use crate::statistics::Statistics;
use crate::status::{Status, fail, fail_plainly, guarded};

/// A scene made ready, with the threads that simulate it.
pub struct Simulation {
    world: Arc<World>,
    options: RunOptions,
    /// Never locked by a tick.
    session: Mutex<Option<Session>>,
}

impl Simulation {
    fn session(&self) -> MutexGuard<'_, Option<Session>> {
        // A panic in here has left a session that can still be stopped.
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reads a scene file, or the bundled scene of this name where no such file exists ("block", "liver"), and makes its
/// body ready. Takes as long as the scene needs for a mesh from an image: seconds.
///
/// `options` may be NULL. `*out` is NULL after an error.
///
/// # Safety
/// `scene` is NULL or a text closed by a zero; `options` NULL or a struct whose struct_size is right; `out` NULL or
/// writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_create_from_file(
    scene: *const c_char,
    options: *const Options,
    out: *mut *mut Simulation,
) -> Status {
    guarded(|| {
        // SAFETY: as the caller promises.
        unsafe { create(options, out, || Ok(Scene::open(text(scene)?))) }
    })
}

/// The same from the text of a scene (TOML). Files that it names are looked for in `folder`; NULL: the working folder.
///
/// # Safety
/// As palpate_create_from_file, for `scene` and `folder`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_create_from_string(
    scene: *const c_char,
    folder: *const c_char,
    options: *const Options,
    out: *mut *mut Simulation,
) -> Status {
    guarded(|| {
        // SAFETY: as the caller promises.
        unsafe {
            create(options, out, || {
                let folder = if folder.is_null() { "" } else { text(folder)? };
                Ok(Scene::from_toml(text(scene)?, Path::new(folder)))
            })
        }
    })
}

/// # Safety
/// `options` is NULL or a struct whose size is right, `out` NULL or writable.
unsafe fn create(
    options: *const Options,
    out: *mut *mut Simulation,
    scene: impl FnOnce() -> Result<Result<Scene, SceneError>, Status>,
) -> Status {
    if out.is_null() {
        return fail(Status::ErrorNull, "out is NULL");
    }
    // SAFETY: not NULL, and writable as the caller promises.
    unsafe { out.write(std::ptr::null_mut()) };
    let created = || -> Result<Simulation, Status> {
        let options = match options.is_null() {
            true => Options::absent(),
            // SAFETY: as the caller promises.
            false => unsafe { layout::read(options) }.map_err(fail_plainly)?,
        };
        let refused = |e: SceneError| fail(Status::ErrorScene, &full_text(&e));
        let mut scene = scene()?.map_err(refused)?;
        options.port()?.apply(&mut scene).map_err(|e| match e {
            PortConfigError::Option { .. } => fail(Status::ErrorArgument, &e.to_string()),
            PortConfigError::Scene(e) => refused(e),
        })?;
        // SAFETY: the caller's options hold a text or NULL.
        let options = unsafe { options.run() }?;
        let world = Arc::new(scene.build().map_err(refused)?);
        Ok(Simulation { world, options, session: Mutex::new(None) })
    };
    match created() {
        Ok(simulation) => {
            // SAFETY: as above.
            unsafe { out.write(Box::into_raw(Box::new(simulation))) };
            Status::Ok
        }
        Err(status) => status,
    }
}

/// The error, its place and its remedy on lines of their own.
fn full_text(error: &SceneError) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(next) = cause {
        text = format!("{text}\n  {next}");
        cause = next.source();
    }
    text
}

/// Opens the port through which a driver ticks, with the body settled at rest; there is one at a time. After
/// palpate_stop another one can be opened, and the scene begins anew.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `out` NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_open_port(simulation: *const Simulation, out: *mut *mut Port) -> Status {
    guarded(|| {
        if out.is_null() {
            return fail(Status::ErrorNull, "out is NULL");
        }
        // SAFETY: not NULL, and writable as the caller promises.
        unsafe { out.write(std::ptr::null_mut()) };
        // SAFETY: as the caller promises.
        let Some(simulation) = (unsafe { simulation.as_ref() }) else { return fail_plainly(Status::ErrorNull) };
        let mut current = simulation.session();
        if current.as_ref().is_some_and(|s| s.phase() == Phase::Ready || s.phase().is_live()) {
            return fail(Status::ErrorPhase, "the simulation has a port already: stop it before you open another");
        }
        *current = None;
        match Session::open(Arc::clone(&simulation.world), &simulation.options) {
            Ok((session, port)) => {
                *current = Some(session);
                // SAFETY: as above.
                unsafe { out.write(Box::into_raw(Box::new(Port::new(port)))) };
                Status::Ok
            }
            Err(error) => fail(Status::ErrorSetUp, &error.to_string()),
        }
    })
}

/// # Safety
/// `simulation` is NULL or was created and not destroyed.
pub(crate) unsafe fn with_session(simulation: *const Simulation, body: impl FnOnce(&mut Session) -> Status) -> Status {
    guarded(|| {
        // SAFETY: as the caller promises.
        let Some(simulation) = (unsafe { simulation.as_ref() }) else { return fail_plainly(Status::ErrorNull) };
        match simulation.session().as_mut() {
            Some(session) => body(session),
            None => fail(Status::ErrorPhase, "the simulation has no port yet: call palpate_open_port first"),
        }
    })
}

fn in_phase(done: bool, remedy: &str) -> Status {
    if done { Status::Ok } else { fail(Status::ErrorPhase, remedy) }
}

/// Starts the threads of a simulation that has a port.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_start(simulation: *const Simulation) -> Status {
    let started = "the simulation has been started already; after palpate_stop, open a new port";
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, |session| in_phase(session.start(), started)) }
}

/// Halts the tissue; the force comes down to zero within the limits. The driver goes on ticking.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_pause(simulation: *const Simulation) -> Status {
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, |session| in_phase(session.pause(true), "the simulation does not run")) }
}

/// Lets the tissue go on after palpate_pause; the force comes back as a ramp.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_resume(simulation: *const Simulation) -> Status {
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, |session| in_phase(session.pause(false), "the simulation does not run")) }
}

/// Changes the body while it runs: nodes released or held, elements removed. `change` is TOML with the keys of an event
/// of a scene without `time`, such as "remove = { ball = { center = [0.02, 0.02, 0.04], radius = 0.005 } }" or
/// "hold = { node_set = \"x_min\" }". The scene's body must have room: `changes = 8` for eight changes in one run.
///
/// The changed body is made on the calling thread, in some ten milliseconds per thousand nodes, so do not call it from the
/// thread that ticks; the tissue goes on meanwhile, and its next step takes the change, or where the scene has events the
/// first step after the last of them. Other calls with the same simulation wait until it is made, ticks do not.
/// PALPATE_STATUS_NOTICE where it waits for an event, PALPATE_STATUS_ERROR_PHASE where nothing runs,
/// PALPATE_STATUS_ERROR_ARGUMENT where the change cannot be done; palpate_last_error says why.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `change` is NULL or a text closed by a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_change(simulation: *const Simulation, change: *const c_char) -> Status {
    let change = |session: &mut Session| {
        // SAFETY: as the caller promises.
        let request = unsafe { text(change) }.map(ChangeRequest::from_toml);
        match request.map(|request| request.and_then(|request| session.change(&request))) {
            Err(status) => status,
            Ok(Ok(_)) => session.changes_wait_until().map_or(Status::Ok, |time| {
                fail(Status::Notice, &format!("the change waits for the last [[event]] of the scene, at {time} s"))
            }),
            Ok(Err(error @ ChangeError::NotRunning)) => fail(Status::ErrorPhase, &error.to_string()),
            Ok(Err(error)) => fail(Status::ErrorArgument, &error.to_string()),
        }
    };
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, change) }
}

/// Ends the threads and the trace, and waits for them: at most the time of a step and 0.1 s. The driver may go on
/// ticking meanwhile and afterwards; the force comes down to zero within the limits. PALPATE_STATUS_NOTICE where the body
/// has failed or the trace is not whole; palpate_last_error tells.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_stop(simulation: *const Simulation) -> Status {
    let stop = |session: &mut Session| match session.stop() {
        None => Status::Ok,
        Some(Ok(outcome)) => {
            let trace = outcome.summary.trace.as_ref();
            let lost = trace.and_then(|t| t.error.as_ref().map(|e| format!("the trace {}: {e}", t.path.display())));
            let told: Vec<String> = outcome.summary.notes.into_iter().chain(lost).collect();
            // Not an error of this call, but the place to read it.
            if told.is_empty() { Status::Ok } else { fail(Status::Notice, &told.join("\n")) }
        }
        Some(Err(error)) => fail(Status::ErrorSetUp, &error.to_string()),
    };
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, stop) }
}

/// Counts, rates and tails so far, at most some 50 ms old. Any thread may ask at any time.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `out` NULL or a struct whose struct_size is right.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_statistics(simulation: *const Simulation, out: *mut Statistics) -> Status {
    let answer = |session: &mut Session| {
        let statistics = Statistics::new(&session.statistics(), session.phase());
        // SAFETY: as the caller promises.
        unsafe { layout::write(out, &statistics) }.map_or_else(fail_plainly, |()| Status::Ok)
    };
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, answer) }
}

/// Stops the simulation and frees it. Its port stays: its ticks send no force once the present one has come down, and
/// palpate_close_port frees it. NULL is allowed.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed, and no other thread uses it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_destroy(simulation: *mut Simulation) -> Status {
    guarded(|| {
        if !simulation.is_null() {
            // SAFETY: it was made by Box::into_raw, and nobody uses it any more.
            drop(unsafe { Box::from_raw(simulation) });
        }
        Status::Ok
    })
}
