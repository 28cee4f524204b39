//! How a simulation is set up.

use std::ffi::{CStr, c_char};
use std::mem::offset_of;
use std::path::PathBuf;

use palpate::drivers::place::{Direction, PlaceConfig};
use palpate::run::{MOST_THREADS, RunOptions};
use palpate::session::PortConfig;

use crate::layout::Layout;
use crate::status::{Status, fail};

/// How a simulation is set up. Set everything to zero, then struct_size, then what you want to change: zero means "as
/// the scene says", and where the scene says nothing, its default.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// sizeof(palpate_options).
    pub struct_size: u32,
    /// Worker threads of the step, at most 1024; 0: all cores. A driver that needs a core for itself leaves one free.
    pub threads: u32,
    /// Rate at which the driver will call palpate_tick (Hz), 100 to 8000. The time between two ticks is measured; the
    /// rate tunes the coupling between device and tool.
    pub rate: f64,
    /// Largest force of the device (N). No larger one is ever sent.
    pub max_force: f64,
    /// Largest torque of the device (N m). Without one here and in the scene no torque is sent.
    pub max_torque: f64,
    /// Largest stiffness that the device renders in a loop at 1 kHz (N/m).
    pub max_stiffness: f64,
    /// Largest damping that the device renders in a loop at 1 kHz (N s/m).
    pub max_damping: f64,
    /// Largest change of force (N/s).
    pub force_slew: f64,
    /// Largest change of torque (N m/s).
    pub torque_slew: f64,
    /// Time from no force to full force after a start and after every interruption (s).
    pub fade_in: f64,
    /// Age of the tissue's latest step at which the force begins to fade (s).
    pub stale_after: f64,
    /// Age at which the force is zero (s), above stale_after.
    pub stale_zero: f64,
    /// Time between two ticks that counts as an interruption (s).
    pub gap: f64,
    /// Where the origin of the device's frame lies in the world (m), -1000 to 1000. Refused where no axes are given.
    pub origin: [f64; 3],
    /// Which way the device's x, y and z point in the world: 1, 2, 3 for x, y, z and -1, -2, -3 for the opposite. A
    /// right-handed frame. All zero: origin and axes are the scene's.
    pub axes: [i32; 3],
    /// Always 0.
    pub reserved: u32,
    /// Trace to write (MCAP), UTF-8; NULL: none. Where it cannot be made, palpate_open_port fails.
    pub trace: *const c_char,
    /// Largest power that is given to the hand (W).
    pub max_power: f64,
    /// Energy that a contact may give out beyond what it took in (J).
    pub energy_allowance: f64,
    /// PALPATE_OPTION_... or 0. A bit that this library does not know is refused: it may be there for safety.
    pub switches: u32,
    /// Always 0.
    pub reserved_switches: u32,
    /// Apparent mass of the device where it is held (kg). It and the four after it describe the device, from which the
    /// coupling follows (DEVICE above); the damping that keeps a contact passive is bounded by the mass, too.
    pub device_mass: f64,
    /// Viscous damping of the device itself (N s/m), with nobody holding it.
    pub device_damping: f64,
    /// Coulomb friction of the device itself (N).
    pub device_friction: f64,
    /// Smallest change of position that the device measures (m).
    pub device_resolution: f64,
    /// Ticks from the return of palpate_tick to the effect of its force, at most 15. For none at all set
    /// PALPATE_OPTION_NO_DELAY.
    pub device_delay_ticks: u32,
    /// Always 0.
    pub reserved_delay: u32,
    /// Speed above which a motion of the device is no hand's (m/s); by default 5.
    pub jump_speed: f64,
    /// Length of such a motion, in one tick or several, at which the pose is taken to have jumped (m); by default 0.02.
    pub jump_distance: f64,
}

/// The passivity layer keeps its account but does not act on the force.
pub const PALPATE_OPTION_OBSERVE_ENERGY_ONLY: u32 = 1 << 0;

/// The force of a tick acts within it, whatever the scene says of the device's delay.
pub const PALPATE_OPTION_NO_DELAY: u32 = 1 << 1;

/// Every switch.
const SWITCHES: u32 = PALPATE_OPTION_OBSERVE_ENERGY_ONLY | PALPATE_OPTION_NO_DELAY;

// SAFETY: repr(C), numbers and a pointer that is only looked at where its text is wanted; LEAST is the offset of a field.
unsafe impl Layout for Options {
    const LEAST: usize = offset_of!(Self, max_force);

    fn absent() -> Self {
        Self {
            struct_size: 0,
            threads: 0,
            rate: 0.0,
            max_force: 0.0,
            max_torque: 0.0,
            max_stiffness: 0.0,
            max_damping: 0.0,
            force_slew: 0.0,
            torque_slew: 0.0,
            fade_in: 0.0,
            stale_after: 0.0,
            stale_zero: 0.0,
            gap: 0.0,
            origin: [0.0; 3],
            axes: [0; 3],
            reserved: 0,
            trace: std::ptr::null(),
            max_power: 0.0,
            energy_allowance: 0.0,
            switches: 0,
            reserved_switches: 0,
            device_mass: 0.0,
            device_damping: 0.0,
            device_friction: 0.0,
            device_resolution: 0.0,
            device_delay_ticks: 0,
            reserved_delay: 0,
            jump_speed: 0.0,
            jump_distance: 0.0,
        }
    }
}

impl Options {
    /// Refuses what would be left aside in silence.
    fn check(&self) -> Result<(), Status> {
        let refused = |message: String| Err(fail(Status::ErrorArgument, &message));
        let unknown = self.switches & !SWITCHES;
        if unknown != 0 {
            return refused(format!(
                "switches: this library does not know {unknown:#x}; use a newer one, or leave it out"
            ));
        }
        if [self.reserved, self.reserved_switches, self.reserved_delay] != [0; 3] {
            return refused("reserved: not 0; set the whole struct to zero before you fill it in".into());
        }
        if self.axes == [0; 3] && self.origin != [0.0; 3] {
            return refused(
                "origin: counts only with axes; give axes = 1, 2, 3 for a device that stands as the world".into(),
            );
        }
        if self.has(PALPATE_OPTION_NO_DELAY) && self.device_delay_ticks != 0 {
            return refused(format!(
                "device_delay_ticks: {} with PALPATE_OPTION_NO_DELAY; give one of them",
                self.device_delay_ticks
            ));
        }
        if self.threads as usize > MOST_THREADS {
            return refused(format!("threads: {} is above {MOST_THREADS}; give 0 for all cores", self.threads));
        }
        Ok(())
    }

    fn has(&self, switch: u32) -> bool {
        self.switches & switch != 0
    }

    /// What the scene is changed by. A number that is not finite or negative is refused where it is checked.
    pub(crate) fn port(&self) -> Result<PortConfig, Status> {
        self.check()?;
        let given = |value: f64| (value != 0.0).then_some(value);
        let place = match self.axes {
            [0, 0, 0] => None,
            axes => {
                let mut directions = [Direction::X; 3];
                for (direction, &axis) in directions.iter_mut().zip(&axes) {
                    *direction = direction_of(axis)?;
                }
                Some(PlaceConfig { origin: self.origin, axes: directions })
            }
        };
        let delay = match self.device_delay_ticks {
            0 => self.has(PALPATE_OPTION_NO_DELAY).then_some(0),
            ticks => Some(ticks as usize),
        };
        Ok(PortConfig {
            rate: given(self.rate),
            max_force: given(self.max_force),
            max_torque: given(self.max_torque),
            max_power: given(self.max_power),
            energy_allowance: given(self.energy_allowance),
            passivity: self.has(PALPATE_OPTION_OBSERVE_ENERGY_ONLY).then_some(false),
            max_stiffness: given(self.max_stiffness),
            max_damping: given(self.max_damping),
            force_slew: given(self.force_slew),
            torque_slew: given(self.torque_slew),
            fade_in: given(self.fade_in),
            stale_after: given(self.stale_after),
            stale_zero: given(self.stale_zero),
            gap: given(self.gap),
            jump_speed: given(self.jump_speed),
            jump_distance: given(self.jump_distance),
            device_mass: given(self.device_mass),
            device_damping: given(self.device_damping),
            device_friction: given(self.device_friction),
            device_resolution: given(self.device_resolution),
            device_delay_ticks: delay,
            place,
        })
    }

    /// What the threads are started with.
    ///
    /// # Safety
    /// `trace` is NULL or a text that is closed by a zero.
    pub(crate) unsafe fn run(&self) -> Result<RunOptions, Status> {
        let threads = (self.threads > 0).then_some(self.threads as usize);
        // SAFETY: as the caller promises.
        let trace = unsafe { text(self.trace) };
        let trace = if self.trace.is_null() { None } else { Some(PathBuf::from(trace?)) };
        if trace.as_ref().is_some_and(|path| path.as_os_str().is_empty()) {
            return Err(fail(Status::ErrorArgument, "trace: a file without a name; give NULL for no trace"));
        }
        Ok(RunOptions { threads, trace, ..RunOptions::default() })
    }
}

fn direction_of(axis: i32) -> Result<Direction, Status> {
    match axis {
        1 => Ok(Direction::X),
        2 => Ok(Direction::Y),
        3 => Ok(Direction::Z),
        -1 => Ok(Direction::MinusX),
        -2 => Ok(Direction::MinusY),
        -3 => Ok(Direction::MinusZ),
        other => Err(fail(
            Status::ErrorArgument,
            &format!("axes: {other} is no axis; give 1, 2 or 3 for x, y or z of the world, negative for the opposite"),
        )),
    }
}

/// A text of the caller.
///
/// # Safety
/// `text` is NULL or points to bytes that end with a zero and that nobody writes while the result is used.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Result<&'a str, Status> {
    if text.is_null() {
        return Err(fail(Status::ErrorNull, "a text is NULL"));
    }
    // SAFETY: as the caller promises.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|e| fail(Status::ErrorArgument, &format!("a text is not UTF-8: {e}")))
}
