//! A million ticks with contacts that come and go on frozen rows, and a million on patches of tissue with bodies at the tool and a
//! gripper, for a run under RealtimeSanitizer. On both the faults of a schedule: snapshots that stall, that are poisoned or not
//! valid, poses, velocities and grippers that are no numbers, jumps, gaps, late ticks, a device that does not answer.
//!
//! `Tick::tick` and its two companions are marked `nonblocking` under `cfg(rtsan)`; the sanitizer then stops the
//! program at the first allocation, lock or system call inside them and prints the stack:
//! ```text
//! RUSTC_BOOTSTRAP=1 RUSTFLAGS="-Zsanitizer=realtime --cfg rtsan" cargo run --profile sanitized -p palpate-haptics \
//!     --example rtsan_tick --target x86_64-unknown-linux-gnu --target-dir target/rtsan
//! ```
//! With `-- provoke` it allocates in such a function first, which must stop the program: the sanitizer is there.
#![cfg_attr(rtsan, feature(sanitize))]
#![allow(clippy::print_stdout)]

use std::error::Error;

use faulty::{BODIES, Faulty, Seen, with_bodies};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::DetectionConfig;
use palpate_constraints::law::Coulomb;
use palpate_haptics::device::{HapticDevice, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::exchange::latest;
use palpate_haptics::gripper::GripConfig;
use palpate_haptics::hand::Hand;
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig};
use sheet::{Ball, Sheet, pose};

#[path = "../tests/faulty/mod.rs"]
mod faulty;
#[path = "../tests/sheet/mod.rs"]
mod sheet;

const CONTACTS: usize = 12;
const NODES: usize = 16;
const TICKS: u64 = 1_000_000;

/// A bed of coupled springs under the tool; the number of contacts changes from step to step.
fn fill(snapshot: &mut HapticSnapshot, step: u64) {
    snapshot.clear();
    for i in 0..(step % (CONTACTS as u64 + 1)) {
        let x = 1e-3 * i as f64;
        let rows = [[0.0, 0.0, 1.0, 0.0, -x, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, x]];
        let (law, delta_free) = (Coulomb { friction: 0.3 }.into(), [2e-5 * i as f64, 0.0, 0.0]);
        let contact =
            SnapshotContact { law, feature: i, tool_rows: &rows, delta_free: &delta_free, lambda: &[0.01, 0.0, 0.0] };
        snapshot.push(&contact);
    }
    let rows = snapshot.rows();
    for (k, w) in snapshot.compliance_mut().iter_mut().enumerate() {
        *w = 1e-3 * (-0.7 * (k / rows).abs_diff(k % rows) as f64).exp();
    }
    (snapshot.step, snapshot.valid, snapshot.tool_pose) = (step, true, Isometry3::identity());
}

#[cfg_attr(rtsan, sanitize(realtime = "nonblocking"))]
fn provoke() -> Vec<u8> {
    std::hint::black_box(vec![1; 100])
}

fn main() -> Result<(), Box<dyn Error>> {
    if std::env::args().any(|argument| argument == "provoke") {
        println!("an allocation of {} bytes went unseen", provoke().len());
    }
    let ball = Ball::at_nodes(5e-3);
    // Fewer contacts than the ball meets: the room runs out now and then.
    let detection = DetectionConfig { max_contacts: 3, ..ball.detection };
    let (tool, hand_over) = (ball.shape.clone().into(), PatchTickConfig::HAND_OVER);
    let on_patches = PatchTickConfig { tool, detection, max_nodes: NODES, max_bodies: BODIES, hand_over };
    run("frozen rows", None, |snapshot, step| {
        fill(snapshot, step);
        snapshot.valid = step % 40 != 13;
        if step % 40 == 7 {
            snapshot.compliance_mut().fill(f64::NAN);
        }
    })?;
    // Steps make patches with what memory they like; the tick takes copies.
    let patches: Vec<_> = (0..24_u32)
        .map(|k| {
            let sheet = Sheet {
                friction: 0.3,
                coupling: 0.3,
                lift: Vector3::z() * 2e-4 * f64::from(k % 4),
                max_nodes: NODES,
                ..Sheet::springs(1e-3)
            };
            let along = Vector3::new(4e-3 * f64::from(k % 3), 3e-3 * f64::from(k % 2), 5e-3);
            let mut snapshot = with_bodies(&sheet.snapshot(1, &ball, &pose(along)), 40, NODES, u64::from(k % 3));
            match k {
                7 => snapshot.patch.compliance_mut().fill(f64::NAN),
                13 => snapshot.valid = false,
                17 => snapshot.patch.valid = false,
                _ => {}
            }
            snapshot
        })
        .collect();
    let seen = run("patches", Some(on_patches), |snapshot, step| {
        let which = if step % 40 < 24 { step % 40 } else { step % 6 };
        snapshot.copy_from(&patches[which as usize]);
        snapshot.step = step;
    })?;
    match seen.missing()[..] {
        [] => Ok(()),
        ref missing => Err(format!("never happened: {missing:?}").into()),
    }
}

/// Ticks on the snapshots that `step` makes.
fn run(
    what: &str,
    on_patches: Option<PatchTickConfig>,
    mut step: impl FnMut(&mut HapticSnapshot, u64),
) -> Result<Seen, Box<dyn Error>> {
    // Over the sheet the ball's centre is at 5 mm when it touches.
    let height = if on_patches.is_some() { 9e-3 } else { 2e-3 };
    let nodes = on_patches.as_ref().map_or(0, |config| config.max_nodes);
    let script = HandScript::at(Vector3::z() * height).stroke(Vector3::new(6e-3, 2e-3, -7e-3), 1.0, 1000)?;
    let inner = VirtualDevice::new(VirtualDeviceConfig::default(), Hand::preset("fingertip")?, script)?;
    let mut device = Faulty::new(inner);
    let config = TickConfig { tolerance: 1e-3, ..TickConfig::for_device(device.spec()) };
    let mut tick = Tick::new(&config, device.spec())?.with_gripper(&GripConfig::default(), faulty::hinge())?;
    if let Some(config) = on_patches {
        tick = tick.on_patches(config)?;
    }
    let (mut state, mut ws) = (tick.state(40), tick.workspace(40));
    let (mut writer, mut reader) = latest(&HapticSnapshot::with_bodies(40, nodes, BODIES));

    let (mut pressed, mut most, mut seen) = (0, 0, Seen::default());
    for index in 0..TICKS {
        if let Some(number) = faulty::step(index) {
            step(writer.value_mut(), number);
            writer.publish();
        }
        let record = run_tick(&tick, &mut state, &mut ws, &mut reader, &mut device, faulty::time(index));
        pressed += u32::from(record.active > 0);
        most = most.max(record.active);
        seen.add(record.flags);
    }
    println!("{TICKS} ticks on {what}, {pressed} with contact, at most {most} contacts carrying force; {seen:?}");
    Ok(seen)
}
