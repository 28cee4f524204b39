//! The tool at fixed bodies: nothing there gives way, so the force on the hand is that of the coupling between device and
//! tool, in closed form. Beside it tissue that the tool does not touch, or touches at the same time.

#![allow(clippy::print_stdout)] // measured numbers

use nalgebra::Vector3;
use palpate::haptics::coupling::CouplingConfig;
use palpate::haptics::device::DeviceSpec;
use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, RunOptions};
use palpate::scene::{FixedBodyDescription, SceneDescription, SolidShape, TickMethod};
use palpate::tick::TickReport;
use palpate::world::World;

use crate::block::{RADIUS, SKIN, record, world};

const FRICTION: f64 = 0.3;

/// Where the tool's centre is when it touches the floor of [`on_floor`] (m), and a place there beside the block.
const FLOOR: f64 = -0.01 + RADIUS;
const BESIDE: f64 = -0.05;

fn body(shape: SolidShape, position: [f64; 3], rotation: [f64; 3]) -> FixedBodyDescription {
    FixedBodyDescription { name: "wall".into(), shape, position, rotation, friction: None, max_contacts: None }
}

fn floor() -> FixedBodyDescription {
    body(SolidShape::Plane { normal: [0.0, 0.0, 1.0] }, [0.0, 0.0, -0.01], [0.0; 3])
}

/// A device that follows its path whatever the force, beside `wall`.
fn at(wall: FixedBodyDescription, path: &[(f64, [f64; 3])], change: impl FnOnce(&mut SceneDescription)) -> World {
    world(|scene| {
        scene.fixed_bodies = vec![wall];
        scene.contact.friction = FRICTION;
        scene.device.kind = "scripted".into();
        let key = |&(time, position)| ScriptKey { time, position, ..ScriptKey::default() };
        scene.hand.path = path.iter().map(key).collect();
        change(scene);
    })
}

fn ticks(world: &World, seconds: f64) -> Vec<TickReport> {
    let length = Length::Seconds(seconds);
    record(world, &RunOptions { length, lockstep: true, threads: Some(1), ..RunOptions::default() }).1.ticks
}

fn force(ticks: &[TickReport], time: f64) -> Vector3<f64> {
    let tick = ticks.iter().find(|t| t.record.time >= time - 1e-9).expect("a tick at that time");
    tick.record.wrench.force
}

/// Stiffness of the coupling (N/m).
fn spring() -> f64 {
    CouplingConfig::for_device(&DeviceSpec::virtual_device(0.0)).translation.stiffness
}

/// Down by `depth` from 3 mm above the floor, then aside by 12 mm.
fn press_and_slide(depth: f64) -> [(f64, [f64; 3]); 4] {
    [
        (0.0, [BESIDE, 0.04, FLOOR + 0.003]),
        (0.4, [BESIDE, 0.04, FLOOR - depth]),
        (0.8, [BESIDE, 0.04, FLOOR - depth]),
        (1.4, [BESIDE - 0.012, 0.04, FLOOR - depth]),
    ]
}

#[test]
fn a_plane_holds_the_tool_with_the_coupling_times_the_depth_and_rubs_with_friction() {
    for (method, depth) in [(TickMethod::Local, 0.001), (TickMethod::Frozen, 0.003)] {
        let world = at(floor(), &press_and_slide(depth), |scene| scene.tick.method = method);
        let ticks = ticks(&world, 1.4);
        let (held, sliding) = (force(&ticks, 0.79), force(&ticks, 1.39));
        println!("{method:?}: held {held:?} N of {} N, sliding {sliding:?} N", spring() * depth);
        // Left of the coupling's damper after 0.4 s: below a thousandth. The tick's residual is a millionth.
        assert!((held.z - spring() * depth).abs() < 1e-3 * spring() * depth, "{held:?}");
        assert!(held.xy().norm() < 1e-3 * held.z, "a press without slip has no side force: {held:?}");
        assert!((sliding.x / sliding.z - FRICTION).abs() < 1e-3, "friction against the motion: {sliding:?}");
        assert!(sliding.y.abs() < 1e-3 * sliding.z, "{sliding:?}");
    }
}

/// The side force of a tool that sticks is the coupling's too, and stays: it holds the place, from snapshot to snapshot.
#[test]
fn friction_holds_the_place_of_the_tool_until_the_side_force_passes_its_limit() {
    let (depth, aside) = (0.002, 0.3e-3);
    assert!(aside < FRICTION * depth);
    let path = [
        (0.0, [BESIDE, 0.04, FLOOR + 0.003]),
        (0.4, [BESIDE, 0.04, FLOOR - depth]),
        (0.7, [BESIDE, 0.04, FLOOR - depth]),
        (0.9, [BESIDE, 0.04 + aside, FLOOR - depth]),
        (2.0, [BESIDE, 0.04 + aside, FLOOR - depth]),
    ];
    // What the tolerance of a tick leaves adds up in a thousand ticks.
    let ticks = ticks(&at(floor(), &path, |scene| scene.solver.tick_tolerance = 1e-9), 2.0);
    for time in [1.2, 1.99] {
        let held = force(&ticks, time);
        println!("{time} s: {held:?} N; {} N aside would be its place", spring() * aside);
        // The coupling's damper is at rest; the tolerance of a thousand ticks is far below.
        assert!((held.y + spring() * aside).abs() < 1e-3 * spring() * aside, "{held:?}");
        assert!((held.z - spring() * depth).abs() < 1e-3 * spring() * depth, "{held:?}");
    }
}

/// Down at 0.6 m/s: between two steps the tool goes 2 cm, five times the margin of 4 mm at which contacts are found, and
/// it would be through a plate before the step knew of it.
#[test]
fn a_fast_tool_is_stopped_at_the_surface_between_two_steps() {
    let plate = body(SolidShape::Box { size: [0.1, 0.1, 0.01] }, [BESIDE, 0.04, -0.015], [0.0; 3]);
    let path = [
        (0.0, [BESIDE, 0.04, FLOOR + 0.05]),
        (0.16, [BESIDE, 0.04, FLOOR - 0.002]),
        (0.4, [BESIDE, 0.04, FLOOR - 0.002]),
    ];
    let ticks = ticks(&at(plate, &path, |scene| scene.limits.fade_in = 0.01), 0.4);
    let lowest = ticks.iter().map(|t| t.record.tool_pose.translation.z - FLOOR).fold(0.0, f64::min);
    println!("lowest point of the tool: {lowest:.1e} m, at the end {:?} N", force(&ticks, 0.39));
    // The tool stays out of the plate, but for the solver's tolerance; the device is 2 mm deep.
    assert!(lowest > -1e-6, "{lowest}");
    assert!((force(&ticks, 0.39).z - spring() * 0.002).abs() < 1e-3 * spring() * 0.002);
}

/// Every shape, with and without friction; a wall that stands upright beside soft skin that the tool presses too.
#[test]
fn a_box_a_ball_and_a_hull_hold_the_tool_like_a_plane() {
    let depth = 0.0015;
    let walls = [
        body(
            SolidShape::Box { size: [0.1, 0.02, 0.1] },
            [BESIDE, 0.04, -0.02],
            [std::f64::consts::FRAC_PI_2, 0.0, 0.0],
        ),
        body(SolidShape::Sphere { radius: 0.2 }, [BESIDE, 0.04, -0.21], [0.0; 3]),
        body(
            SolidShape::Capsule { half_length: 0.1, radius: 0.05 },
            [BESIDE, 0.04, -0.06],
            [std::f64::consts::FRAC_PI_2, 0.0, 0.0],
        ),
        body(
            SolidShape::Convex {
                vertices: vec![[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.15, 0.0], [0.0, 0.0, -0.1]],
            },
            [BESIDE, 0.04, -0.01],
            [0.0; 3],
        ),
    ];
    for wall in walls {
        let shape = format!("{:?}", wall.shape);
        let ticks = ticks(&at(wall, &press_and_slide(depth)[..3], |scene| scene.contact.friction = 0.0), 0.8);
        let held = force(&ticks, 0.79);
        println!("{shape}: {held:?} N of {} N", spring() * depth);
        assert!((held.z - spring() * depth).abs() < 1e-3 * spring() * depth, "{shape}: {held:?}");
        assert!(held.xy().norm() < 1e-3 * held.z, "{shape}: {held:?}");
    }
}

/// In a corner of floor-like skin and an upright wall the tool feels both: the wall by the coupling, the skin as without it.
#[test]
fn a_wall_beside_pressed_tissue_adds_its_own_force_and_leaves_the_rest() {
    let (depth, aside) = (0.004, 0.001);
    let (x, z) = (0.033, SKIN + RADIUS);
    // 6 mm above the skin, beyond the margin of 4 mm, where the ball's centre goes down to 8 mm above it.
    let centre = [x - RADIUS - 0.005, 0.037, SKIN + 0.006 + 0.015];
    let wall = body(SolidShape::Box { size: [0.01, 0.06, 0.03] }, centre, [0.0; 3]);
    let press = |wall: Option<FixedBodyDescription>, aside: f64| {
        let path = [
            (0.0, [x + 0.002, 0.037, z + 0.003]),
            (0.5, [x - aside, 0.037, z - depth]),
            (1.2, [x - aside, 0.037, z - depth]),
        ];
        let world = world(|scene| {
            scene.fixed_bodies = wall.into_iter().collect();
            (scene.contact.friction, scene.device.kind) = (0.0, "scripted".into());
            scene.hand.path =
                path.iter().map(|&(time, position)| ScriptKey { time, position, ..ScriptKey::default() }).collect();
        });
        let (outcome, recorder) = record(
            &world,
            &RunOptions { length: Length::Seconds(1.2), lockstep: true, threads: Some(1), ..RunOptions::default() },
        );
        (force(&recorder.ticks, 1.19), outcome.summary)
    };
    // Where the wall stops the tool, tissue pushes it as if it had been led there.
    let (alone, _) = press(None, 0.0);
    let (both, summary) = press(Some(wall), aside);
    println!("skin alone {alone:?} N, with the wall {both:?} N; {} steps frozen", summary.frozen_at_rigid);
    assert!(alone.z > 0.1 && summary.frozen_at_rigid == 0, "the patch has both");
    // The tissue's own side force stays on the tool: the wall's is the difference. Rows of the step and of the patch differ
    // by a percent at this depth (`hand_over.rs`).
    assert!((both.z - alone.z).abs() < 0.02 * alone.z, "{both:?} {alone:?}");
    let side = both.x - spring() * aside;
    assert!(side.abs() < 0.02 * spring() * aside, "{both:?} {alone:?}");
}
