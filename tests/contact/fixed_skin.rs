//! A tool on skin whose nodes are all fixed: bone, or an organ's wall of attachment. Nothing there gives way, so the
//! force is that of the coupling between device and tool, in closed form.

#![allow(clippy::print_stdout)] // measured numbers

use palpate::haptics::coupling::CouplingConfig;
use palpate::haptics::device::DeviceSpec;
use palpate::haptics::script::ScriptKey;
use palpate::run::{Length, RunOptions};
use palpate::scene::NodeSelection;

use crate::block::{RADIUS, SKIN, record, world};

#[test]
fn fixed_skin_holds_the_tool_with_the_force_of_the_coupling_and_rubs_with_friction() {
    let depth = 0.001;
    let height = SKIN + RADIUS;
    let world = world(|scene| {
        // Free nodes remain at half height; the ball touches only the upper wall.
        scene.bodies[0].fixed.push(NodeSelection::NodeSet("z_max".into()));
        scene.device.kind = "scripted".into();
        let key = |time, x, z| ScriptKey { time, position: [x, 0.04, z], ..ScriptKey::default() };
        scene.hand.path = vec![
            key(0.0, 0.033, height + 0.003),
            key(0.4, 0.033, height - depth),
            key(0.8, 0.033, height - depth),
            key(1.4, 0.045, height - depth),
        ];
    });
    let options =
        RunOptions { length: Length::Seconds(1.4), lockstep: true, threads: Some(1), ..RunOptions::default() };
    let (_, recorder) = record(&world, &options);
    let at = |time: f64| {
        let tick = recorder.ticks.iter().find(|t| t.record.time >= time - 1e-9).expect("a tick at that time");
        tick.record.wrench.force
    };

    let spring = CouplingConfig::for_device(&DeviceSpec::virtual_device(0.0)).translation.stiffness;
    let held = at(0.79);
    println!("held: {held:?} N; coupling {spring} N/m over {depth} m");
    // The tick's residual of 1e-6 is far below; what is left is the damper's decay over 0.4 s, below a thousandth.
    assert!((held.z - spring * depth).abs() < 1e-3 * spring * depth, "{held:?} N against {} N", spring * depth);
    assert!(held.xy().norm() < 1e-3 * held.z, "a press without slip has no side force");

    let sliding = at(1.39);
    println!("sliding: {sliding:?} N");
    assert!((-sliding.x / sliding.z - 0.3).abs() < 1e-3, "friction 0.3 against the motion: {sliding:?}");

    // The tissue below feels nothing.
    let moved = recorder.steps.iter().map(|s| s.force.norm()).fold(0.0, f64::max);
    assert_eq!(moved, 0.0, "fixed skin passes no force into the tissue's problem");
    assert!(recorder.steps.iter().any(|s| s.rows.rigid > 0));
}
