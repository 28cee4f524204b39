//! What a driver with a gripper gets, and what a screen sees.

#![allow(unsafe_code, unreachable_pub)] // calls through the C interface; the rig is shared

mod rig;

use std::mem::offset_of;
use std::ptr;

use palpate_capi::*;
use rig::{Rig, SCENE, input, last_error, options};

/// Two balls of 8 mm on a hinge, on both sides of a wall of 20 mm that is held at its foot.
const GRASPER: &str = r#"
    name = "grasp"
    [[body]]
    name = "wall"
    block = { min = [-0.01, -0.01, 0], max = [0.01, 0.01, 0.03], cells = [3, 3, 4] }
    material = { law = "neo_hookean", young = 2e4, poisson = 0.3 }
    rayleigh_stiffness = 0.01
    fixed = [{ below = { axis = "z", at = 0.0 } }]
    [[tool]]
    name = "grasper"
    [tool.shape]
    kind = "compound"
    parts = [
        { shape = { kind = "sphere", radius = 0.008 }, position = [0, 0, -0.04], jaw = 1 },
        { shape = { kind = "sphere", radius = 0.008 }, position = [0, 0, -0.04], jaw = 2 },
    ]
    gripper = { pivot = [0, 0, 0], axis = [0, -1, 0], open_degrees = 80 }
    [device]
    kind = "port"
    origin = [0, 0, 0.055]
"#;

fn surface(rig: &Rig) -> Surface {
    // SAFETY: plain numbers.
    let mut surface: Surface = unsafe { std::mem::zeroed() };
    surface.struct_size = size_of::<Surface>() as u32;
    // SAFETY: a simulation that lives as long as the rig; a struct of this function.
    assert_eq!(unsafe { palpate_surface_counts(rig.simulation, &raw mut surface) }, Status::Ok, "{}", last_error());
    surface
}

fn positions(rig: &Rig) -> (Surface, Vec<[f64; 3]>) {
    let mut surface = surface(rig);
    let mut all = vec![[f64::NAN; 3]; surface.nodes as usize];
    // SAFETY: as above; room for as many nodes as it says.
    let status =
        unsafe { palpate_surface_positions(rig.simulation, all.as_mut_ptr().cast(), surface.nodes, &raw mut surface) };
    assert_eq!(status, Status::Ok, "{}", last_error());
    (surface, all)
}

#[test]
fn a_gripper_that_closes_feels_what_it_squeezes_and_an_older_program_is_open() {
    let rig = Rig::of(GRASPER, &options());
    assert_eq!(rig.start(), Status::Ok, "{}", last_error());
    let begin = std::time::Instant::now();
    let tick = |gripper: f64, fields: u32, size: usize| {
        let given = Input { gripper, fields, struct_size: size as u32, ..input(rig.now(), [0.0; 3]) };
        rig.tick(&given)
    };
    let whole = size_of::<Input>();
    let until = |gripper: f64, done: &dyn Fn(&Output) -> bool| loop {
        let (_, output) = tick(gripper, PALPATE_INPUT_GRIPPER, whole);
        if done(&output) {
            return output;
        }
        assert!(begin.elapsed().as_secs() < 20, "never came: {output:?}");
        std::thread::sleep(std::time::Duration::from_millis(1));
    };
    let range = 80f64.to_radians();
    let open = until(0.95, &|o| o.flags & PALPATE_TICK_NO_STEP == 0 && o.gain == 1.0);
    assert_eq!((open.gripper_torque, open.gripper_effort, open.contacts), (0.0, 0.0, 0), "{open:?}");
    assert!((open.tool_opening - 0.95 * range).abs() < 1e-6, "{}", open.tool_opening);
    // The balls touch at an opening of 2 asin(18 / 40) = 53.5 degrees; 45 squeeze by some 2.7 mm a side.
    let closed = until(45.0 / 80.0, &|o| o.gripper_torque > 1e-3);
    assert!(closed.contacts >= 2 && closed.tool_opening > 45.0 / 80.0 * range, "{closed:?}");
    assert!((closed.gripper_effort - closed.gripper_torque * range).abs() < 1e-12);
    // A program that knows no gripper, by its flags or by the size of its struct, has an open one.
    for (fields, size) in [(0, whole), (PALPATE_INPUT_GRIPPER, offset_of!(Input, gripper))] {
        let (status, output) = tick(0.0, fields, size);
        assert!(status == Status::Ok || status == Status::Notice);
        assert!(output.tool_opening > 0.9 * range, "{output:?}");
    }
    let (status, output) = tick(f64::NAN, PALPATE_INPUT_GRIPPER, whole);
    assert_eq!((status, output.gripper_torque, output.gripper_effort), (Status::ErrorInput, 0.0, 0.0));
}

#[test]
fn a_screen_copies_nodes_and_triangles_of_the_latest_step() {
    let rig = Rig::started(&options());
    let before = positions(&rig);
    assert_eq!((before.0.nodes, before.0.triangles, before.0.rigid_bodies), (64, 108, 0));
    let mut triangles = vec![[u32::MAX; 3]; 108];
    // SAFETY: a simulation that lives; room for as many triangles as it says.
    let copy = |events, to: *mut u32, room| unsafe { palpate_surface_triangles(rig.simulation, events, to, room) };
    assert_eq!(copy(0, triangles.as_mut_ptr().cast(), 108), Status::Ok);
    // Outward, closed, and the volume of the block.
    let x = |n: u32| before.1[n as usize];
    let volume: f64 = triangles.iter().map(|t| det(x(t[0]), x(t[1]), x(t[2])) / 6.0).sum();
    assert!((volume - 0.04f64.powi(3)).abs() < 1e-12, "{volume} m³");

    let pressed = rig.press(0.005);
    assert!(pressed.force[2] > 0.0);
    let steps = rig.statistics().steps;
    rig.tick_until(0.005, "five steps", |_| rig.statistics().steps > steps + 5);
    let after = positions(&rig);
    assert!(after.0.steps > before.0.steps && after.0.time > 0.0 && after.0.events == 0);
    let lowered = before.1.iter().zip(&after.1).map(|(a, b)| a[2] - b[2]).fold(0.0, f64::max);
    assert!((0.5e-3..6e-3).contains(&lowered), "{lowered} m");

    // Too little room, no room, an event that there is not.
    let mut few = vec![7.0; 3 * 63];
    // SAFETY: as above.
    let status = unsafe { palpate_surface_positions(rig.simulation, few.as_mut_ptr(), 63, ptr::null_mut()) };
    assert_eq!(status, Status::ErrorArgument);
    assert!(last_error().contains("63 nodes, but there are 64") && few.iter().all(|x| *x == 7.0), "{}", last_error());
    assert_eq!(copy(1, triangles.as_mut_ptr().cast(), 108), Status::ErrorArgument);
    assert_eq!(copy(0, ptr::null_mut(), 108), Status::ErrorNull);
    // SAFETY: NULL is allowed.
    assert_eq!(unsafe { palpate_surface_counts(rig.simulation, ptr::null_mut()) }, Status::ErrorNull);
}

#[test]
fn a_screen_sees_where_rigid_bodies_fall() {
    let ball = r#"
    [[rigid_body]]
    name = "falling"
    shape = { kind = "sphere", radius = 0.005 }
    mass = 0.01
    position = [0.1, 0.0, 0.5]
    "#;
    let rig = Rig::of(&format!("gravity = [0, 0, -9.81]\n{SCENE}{ball}"), &options());
    assert_eq!(rig.start(), Status::Ok);
    let mut pose = [f64::NAN; 7];
    let mut seen = surface(&rig);
    assert_eq!(seen.rigid_bodies, 1);
    rig.tick_until(-0.008, "a fall", |_| {
        // SAFETY: a simulation that lives; room for one body.
        let status = unsafe { palpate_rigid_poses(rig.simulation, pose.as_mut_ptr(), 1, &raw mut seen) };
        assert_eq!(status, Status::Ok, "{}", last_error());
        pose[2] < 0.49
    });
    assert_eq!((pose[0], pose[1], pose[3..].to_vec()), (0.1, 0.0, vec![1.0, 0.0, 0.0, 0.0]));
    // Free fall by backward Euler: g t² / 2 and half a step more.
    let h = 1.0 / 30.0;
    let t = seen.steps as f64 * h;
    assert!((0.5 - pose[2] - 4.905 * t * (t + h)).abs() < 1e-9, "{} m after {t} s", 0.5 - pose[2]);
}

fn det(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}
