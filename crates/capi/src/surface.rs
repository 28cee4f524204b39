//! The bodies for a screen: copies of the latest step, into memory of the caller.

use std::mem::{offset_of, size_of};

use palpate::session::{Session, Shape, Skins};

use crate::layout::{self, Layout};
use crate::simulation::{Simulation, with_session};
use crate::status::{Status, fail, fail_plainly, guarded};

/// The bodies of a simulation at a step. Set struct_size before the call; the library fills in the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// sizeof(palpate_surface).
    pub struct_size: u32,
    /// Events and changes by palpate_change that had happened: with each of them the triangles change, and nothing else
    /// changes them.
    pub events: u32,
    /// Steps so far.
    pub steps: u64,
    /// Time of the end of the latest (s).
    pub time: f64,
    /// Nodes of the soft body, those inside it too. Does not change.
    pub nodes: u64,
    /// Triangles of its surface.
    pub triangles: u64,
    /// Rigid bodies, in the order of the scene. Does not change.
    pub rigid_bodies: u64,
}

// SAFETY: repr(C), plain numbers; LEAST is the end of a field.
unsafe impl Layout for Surface {
    const LEAST: usize = offset_of!(Self, rigid_bodies) + size_of::<u64>();

    fn absent() -> Self {
        Self { struct_size: 0, events: 0, steps: 0, time: 0.0, nodes: 0, triangles: 0, rigid_bodies: 0 }
    }
}

impl Surface {
    fn new(skins: &Skins, shape: &Shape) -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            events: shape.phase as u32,
            steps: shape.steps,
            time: shape.time,
            nodes: shape.positions.len() as u64,
            triangles: skins.of(shape.phase).map_or(0, |skin| skin.len() as u64),
            rigid_bodies: shape.rigid.len() as u64,
        }
    }
}

/// Writes numbers into memory of the caller, as far as it was said to reach.
///
/// # Safety
/// `to` is NULL or has room for `room` numbers, aligned as one, that are nobody else's.
unsafe fn copy_out<T: Copy>(numbers: impl ExactSizeIterator<Item = T>, to: *mut T, room: u64, what: &str) -> Status {
    if to.is_null() {
        return fail_plainly(Status::ErrorNull);
    }
    let needed = numbers.len();
    if room < needed as u64 {
        return fail(Status::ErrorArgument, &format!("there is room for {room} {what}, but there are {needed}"));
    }
    for (k, number) in numbers.enumerate() {
        // SAFETY: k is below `room`; written without a reference to memory that may not be initialised.
        unsafe { to.add(k).write(number) };
    }
    Status::Ok
}

/// # Safety
/// `simulation` is NULL or was created and not destroyed; `out` NULL or a struct whose struct_size is right.
unsafe fn with_shape(simulation: *const Simulation, out: *mut Surface, copy: impl FnOnce(&Shape) -> Status) -> Status {
    let answer = |session: &mut Session| {
        let skins = session.skins();
        let shape = session.shape();
        let status = copy(shape);
        if status != Status::Ok || out.is_null() {
            return status;
        }
        // SAFETY: as the caller promises.
        unsafe { layout::write(out, &Surface::new(&skins, shape)) }.map_or_else(fail_plainly, |()| status)
    };
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, answer) }
}

/// How many nodes, triangles and rigid bodies there are, and at which step they are. Of a simulation that has a port.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `out` NULL or a struct whose struct_size is right.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_surface_counts(simulation: *const Simulation, out: *mut Surface) -> Status {
    if out.is_null() {
        return guarded(|| fail_plainly(Status::ErrorNull));
    }
    // SAFETY: as the caller promises.
    unsafe { with_shape(simulation, out, |_| Status::Ok) }
}

/// Copies where the nodes of the soft body are after the latest step: x, y, z of each, in the world (m). `room` is the
/// number of nodes that `positions` has room for, at least palpate_surface.nodes. Neither a tick nor a step waits for it.
/// `out` may be NULL; it tells which step this is, and where its events are not those that the triangles were copied
/// for, to copy them anew.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `positions` has room for 3 `room` numbers; `out` NULL or a
/// struct whose struct_size is right.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_surface_positions(
    simulation: *const Simulation,
    positions: *mut f64,
    room: u64,
    out: *mut Surface,
) -> Status {
    let copy = |shape: &Shape| {
        let nodes = shape.positions.iter().map(|x| [x.x, x.y, x.z]);
        // SAFETY: three numbers lie as an array of three; the rest as the caller promises.
        unsafe { copy_out(nodes, positions.cast::<[f64; 3]>(), room, "nodes") }
    };
    // SAFETY: as the caller promises.
    unsafe { with_shape(simulation, out, copy) }
}

/// Copies the triangles of the soft body's surface after this number of events, changes by palpate_change among them:
/// three nodes each, counted from 0, counter-clockwise from outside. Of a simulation that has a port. `room` is the
/// number of triangles that `triangles` has room for, at least palpate_surface.triangles.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `triangles` has room for 3 `room` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_surface_triangles(
    simulation: *const Simulation,
    events: u32,
    triangles: *mut u32,
    room: u64,
) -> Status {
    let copy = |session: &mut Session| {
        let skins = session.skins();
        let Some(skin) = skins.of(events as usize) else {
            let most = skins.phases() - 1;
            return fail(Status::ErrorArgument, &format!("{events} events, but there are {most}"));
        };
        // SAFETY: three numbers lie as an array of three; the rest as the caller promises.
        unsafe { copy_out(skin.iter().copied(), triangles.cast::<[u32; 3]>(), room, "triangles") }
    };
    // SAFETY: as the caller promises.
    unsafe { with_session(simulation, copy) }
}

/// Copies where the rigid bodies are after the latest step, in the world: seven numbers each, the origin x, y, z of its
/// shape (m) and a quaternion w, x, y, z. `room` is the number of bodies that `poses` has room for.
///
/// # Safety
/// `simulation` is NULL or was created and not destroyed; `poses` has room for 7 `room` numbers; `out` NULL or a struct
/// whose struct_size is right.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_rigid_poses(
    simulation: *const Simulation,
    poses: *mut f64,
    room: u64,
    out: *mut Surface,
) -> Status {
    let copy = |shape: &Shape| {
        let bodies = shape.rigid.iter().map(|&([px, py, pz], [x, y, z, w])| [px, py, pz, w, x, y, z]);
        // SAFETY: seven numbers lie as an array of seven; the rest as the caller promises.
        unsafe { copy_out(bodies, poses.cast::<[f64; 7]>(), room, "bodies") }
    };
    // SAFETY: as the caller promises.
    unsafe { with_shape(simulation, out, copy) }
}
