//! A small scene behind the C interface, called as a driver would.

#![allow(dead_code)] // each test uses a part

use std::ffi::{CStr, CString};
use std::ptr;
use std::time::{Duration, Instant};

use palpate_capi::*;

/// A ball of 8 mm above a block of 40 mm; its skin is touched at a height of 48 mm.
pub const SCENE: &str = r#"
    name = "press"
    [[body]]
    name = "block"
    block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [3, 3, 3] }
    material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
    fixed = [{ below = { axis = "z", at = 0.0 } }]
    [[tool]]
    name = "ball"
    shape = { kind = "sphere", radius = 0.008 }
    [contact]
    at = "faces"
    [device]
    kind = "port"
    origin = [0.02, 0.02, 0.06]
"#;

/// Height of the device's origin above the centre of a ball that touches the skin (m).
pub const TOUCH: f64 = 0.012;

pub fn options() -> Options {
    // SAFETY: numbers and a NULL pointer.
    let mut options: Options = unsafe { std::mem::zeroed() };
    options.struct_size = size_of::<Options>() as u32;
    options.threads = 1;
    options
}

pub fn input(time_ns: u64, position: [f64; 3]) -> Input {
    Input {
        struct_size: size_of::<Input>() as u32,
        fields: 0,
        time_ns,
        position,
        orientation: [1.0, 0.0, 0.0, 0.0],
        velocity: [0.0; 3],
        angular_velocity: [0.0; 3],
        buttons: 0,
        reserved: 0,
        gripper: 1.0,
    }
}

/// An output full of numbers that no tick answers.
pub fn stale_output() -> Output {
    Output {
        struct_size: size_of::<Output>() as u32,
        flags: 0,
        tick: 99,
        force: [99.0; 3],
        torque: [99.0; 3],
        contact_force: [99.0; 3],
        tool_position: [99.0; 3],
        tool_orientation: [99.0; 4],
        gap: 99.0,
        gain: 99.0,
        step_age: 99.0,
        dt: 99.0,
        work: 99.0,
        contacts: 99,
        phase: 99,
        energy: 99.0,
        contact_torque: [99.0; 3],
        gripper_effort: 99.0,
        gripper_torque: 99.0,
        tool_opening: 99.0,
    }
}

pub fn last_error() -> String {
    // SAFETY: a text of this thread, closed by a zero, that nobody writes now.
    unsafe { CStr::from_ptr(palpate_last_error()) }.to_string_lossy().into_owned()
}

pub fn create(scene: &str, options: &Options) -> (Status, *mut Simulation) {
    let text = CString::new(scene).unwrap();
    let mut simulation = ptr::dangling_mut();
    // SAFETY: texts and structs of this function.
    let status = unsafe { palpate_create_from_string(text.as_ptr(), ptr::null(), options, &raw mut simulation) };
    (status, simulation)
}

pub fn open_port(simulation: *const Simulation) -> (Status, *mut Port) {
    let mut port = ptr::dangling_mut();
    // SAFETY: a simulation of the caller, a pointer of this function.
    let status = unsafe { palpate_open_port(simulation, &raw mut port) };
    (status, port)
}

pub fn is_silent(output: &Output) -> bool {
    output.force == [0.0; 3] && output.torque == [0.0; 3]
}

pub fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A simulation with its port and a clock of the device.
pub struct Rig {
    pub simulation: *mut Simulation,
    pub port: *mut Port,
    pub begin: Instant,
}

impl Rig {
    pub fn new(options: &Options) -> Self {
        Self::of(SCENE, options)
    }

    pub fn of(scene: &str, options: &Options) -> Self {
        let (status, simulation) = create(scene, options);
        assert_eq!(status, Status::Ok, "{}", last_error());
        let (status, port) = open_port(simulation);
        assert_eq!(status, Status::Ok, "{}", last_error());
        Self { simulation, port, begin: Instant::now() }
    }

    pub fn started(options: &Options) -> Self {
        let rig = Self::new(options);
        assert_eq!(rig.start(), Status::Ok, "{}", last_error());
        rig
    }

    pub fn start(&self) -> Status {
        // SAFETY: a simulation that lives as long as the rig; so below.
        unsafe { palpate_start(self.simulation) }
    }

    pub fn pause(&self) -> Status {
        // SAFETY: as in `start`.
        unsafe { palpate_pause(self.simulation) }
    }

    pub fn resume(&self) -> Status {
        // SAFETY: as in `start`.
        unsafe { palpate_resume(self.simulation) }
    }

    pub fn stop(&self) -> Status {
        // SAFETY: as in `start`.
        unsafe { palpate_stop(self.simulation) }
    }

    pub fn statistics(&self) -> Statistics {
        // SAFETY: plain numbers.
        let mut statistics: Statistics = unsafe { std::mem::zeroed() };
        statistics.struct_size = size_of::<Statistics>() as u32;
        // SAFETY: as in `start`; a struct of this function.
        assert_eq!(unsafe { palpate_statistics(self.simulation, &raw mut statistics) }, Status::Ok);
        statistics
    }

    /// The device's clock (ns).
    pub fn now(&self) -> u64 {
        self.begin.elapsed().as_nanos() as u64 + 1
    }

    /// A tick with this input.
    pub fn tick(&self, input: &Input) -> (Status, Output) {
        let mut output = stale_output();
        // SAFETY: a port that lives as long as the rig, structs of this function.
        let status = unsafe { palpate_tick(self.port, input, &raw mut output) };
        (status, output)
    }

    /// A tick at this moment, with the ball `depth` metres below the height at which it touches.
    pub fn tick_at(&self, depth: f64) -> (Status, Output) {
        self.tick(&input(self.now(), [0.0, 0.0, -TOUCH - depth]))
    }

    /// Ticks once a millisecond at this depth until `done`, for ten seconds at most.
    pub fn tick_until(&self, depth: f64, what: &str, mut done: impl FnMut(&Output) -> bool) -> Output {
        let begin = Instant::now();
        loop {
            let (_, output) = self.tick_at(depth);
            if done(&output) {
                return output;
            }
            assert!(begin.elapsed() < Duration::from_secs(10), "never came: {what}; last {output:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Presses until the whole force is there.
    pub fn press(&self, depth: f64) -> Output {
        self.tick_until(depth, "a force", |o| o.gain == 1.0 && o.force[2] > 0.02)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        // SAFETY: nobody uses them after the rig.
        unsafe {
            palpate_close_port(self.port);
            palpate_destroy(self.simulation);
        }
    }
}
