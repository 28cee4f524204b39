//! The callback in which a device is read and driven, on the library's servo thread.

use std::ffi::{c_uint, c_void};
use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use palpate_haptics::device::DeviceSample;
use palpate_haptics::exchange::{Reader, Writer};
use palpate_haptics::wrench::Twist;

use super::LARGEST_SILENCE;
use super::functions::{
    CALLBACK_CONTINUE, CURRENT_ANGULAR_VELOCITY, CURRENT_BUTTONS, CURRENT_FORCE, CURRENT_TRANSFORM, CURRENT_VELOCITY,
    Functions, Handle,
};

/// Millimetres of the library in metres.
const MILLIMETRE: f64 = 1e-3;

/// What the servo thread measured.
#[derive(Clone, Copy)]
pub(super) struct Measured {
    pub(super) sample: DeviceSample,
    /// Error of the library; 0: none.
    pub(super) error: c_uint,
    /// Number of the wrench that was sent in the same period.
    pub(super) number: u64,
    pub(super) at: Instant,
}

/// A wrench with its number, so that the servo thread knows a new one.
#[derive(Clone, Copy, Default)]
pub(super) struct Wanted {
    pub(super) force: Vector3<f64>,
    pub(super) number: u64,
}

/// What the callback works with.
pub(super) struct Servo {
    pub(super) functions: Functions,
    pub(super) handle: Handle,
    pub(super) samples: Writer<Measured>,
    pub(super) wanted: Reader<Wanted>,
    pub(super) number: u64,
    pub(super) silence: u32,
}

/// The servo thread's work of one period.
///
/// # Safety
/// `data` is the address of a [`Servo`] that nobody else uses while the callback is scheduled.
pub(super) unsafe extern "C" fn serve(data: *mut c_void) -> c_uint {
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
        let (error, number) = (f.take_error(), self.number);
        self.samples.send(Measured { sample, error, number, at: Instant::now() });
    }
}

/// A pose of the library: a matrix of four by four, by columns, in millimetres.
fn pose(m: &[f64; 16]) -> Isometry3<f64> {
    let matrix = Matrix3::from_fn(|i, j| m[4 * j + i]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    Isometry3::from_parts(Translation3::new(m[12] * MILLIMETRE, m[13] * MILLIMETRE, m[14] * MILLIMETRE), rotation)
}
