//! Ten thousand ticks with contacts that come and go, on frozen rows and on patches of tissue, for a run under
//! RealtimeSanitizer.
//!
//! `Tick::tick` and its two companions are marked `nonblocking` under `cfg(rtsan)`; the sanitizer then stops the
//! program at the first allocation, lock or system call inside them and prints the stack:
//! ```text
//! RUSTC_BOOTSTRAP=1 RUSTFLAGS="-Zsanitizer=realtime --cfg rtsan" cargo run --release -p palpate-haptics \
//!     --example rtsan_tick --target x86_64-unknown-linux-gnu --target-dir target/rtsan
//! ```
//! With `-- provoke` it allocates in such a function first, which must stop the program: the sanitizer is there.
#![cfg_attr(rtsan, feature(sanitize))]
#![allow(clippy::print_stdout)]

use std::error::Error;

use nalgebra::{Isometry3, Vector3};
use palpate_constraints::law::Coulomb;
use palpate_haptics::device::{HapticDevice, TickTime, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::exchange::latest;
use palpate_haptics::hand::Hand;
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig};
use sheet::{Ball, Sheet, pose};

#[path = "../tests/sheet/mod.rs"]
mod sheet;

const CONTACTS: usize = 12;
const PERIOD: f64 = 1e-3;

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
    let ball = Ball::at_faces(5e-3);
    let (tool, detection, hand_over) = (ball.shape.clone().into(), ball.detection, PatchTickConfig::HAND_OVER);
    let on_patches = PatchTickConfig { tool, detection, max_nodes: 40, max_bodies: 0, hand_over };
    run("frozen rows", None, fill)?;
    // Steps make patches with what memory they like; the tick takes copies.
    let patches: Vec<_> = (0..6)
        .map(|k| {
            let sheet = Sheet {
                friction: 0.3,
                coupling: 0.3,
                lift: Vector3::z() * 2e-4 * f64::from(k),
                ..Sheet::springs(1e-3)
            };
            sheet.snapshot(1, &ball, &pose(Vector3::new(2e-3 * f64::from(k), 0.0, 5e-3)))
        })
        .collect();
    run("patches", Some(on_patches), |snapshot, step| {
        snapshot.copy_from(&patches[(step % 6) as usize]);
        snapshot.step = step;
    })
}

/// Ticks on the snapshots that `step` makes.
fn run(
    what: &str,
    on_patches: Option<PatchTickConfig>,
    mut step: impl FnMut(&mut HapticSnapshot, u64),
) -> Result<(), Box<dyn Error>> {
    // Over the sheet the ball's centre is at 5 mm when it touches.
    let height = if on_patches.is_some() { 7e-3 } else { 2e-3 };
    let nodes = on_patches.as_ref().map_or(0, |config| config.max_nodes);
    let script = HandScript::at(Vector3::z() * height).stroke(Vector3::new(4e-3, 0.0, -6e-3), 1.0, 10)?;
    let mut device = VirtualDevice::new(VirtualDeviceConfig::default(), Hand::preset("fingertip")?, script)?;
    let mut tick = Tick::new(&TickConfig::for_device(device.spec()), device.spec())?;
    if let Some(config) = on_patches {
        tick = tick.on_patches(config)?;
    }
    let (mut state, mut ws) = (tick.state(40), tick.workspace(40));
    let (mut writer, mut reader) = latest(&HapticSnapshot::with_patch(40, nodes));

    let (mut pressed, mut most) = (0, 0);
    for index in 0..10_000 {
        if index % 33 == 1 {
            step(writer.value_mut(), index / 33 + 1);
            writer.publish();
        }
        let time = TickTime::regular(index, PERIOD);
        let record = run_tick(&tick, &mut state, &mut ws, &mut reader, &mut device, time);
        pressed += u32::from(record.active > 0);
        most = most.max(record.active);
    }
    println!("10000 ticks on {what}, {pressed} with contact, at most {most} contacts carrying force");
    Ok(())
}
