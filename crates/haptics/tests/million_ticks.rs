//! The real-time rule on patches of tissue, held by an allocator that counts, over a million ticks.
//!
//! An allocation is all that an allocator sees. Locks and system calls are caught by RealtimeSanitizer, over as many ticks on the
//! same schedule of faults: `examples/rtsan_tick.rs`.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

mod faulty;
mod sheet;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use faulty::{BODIES, Faulty, Seen, with_bodies};
use nalgebra::Vector3;
use palpate_collision::DetectionConfig;
use palpate_haptics::device::{HapticDevice, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::exchange::{every, latest};
use palpate_haptics::gripper::GripConfig;
use palpate_haptics::hand::Hand;
use palpate_haptics::record::TickRecord;
use palpate_haptics::run::run_tick;
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig};
use sheet::{Ball, Sheet, pose};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const TICKS: u64 = 1_000_000;

/// Nodes of the patches: few, since there are many ticks.
const NODES: usize = 16;

/// Contacts that the tick may have: the ball meets four nodes at once.
const CONTACTS: usize = 3;

/// Snapshots as steps make them: the sheet breathes, patches are gathered about several places, some are poisoned or bare.
fn variants(ball: &Ball) -> Vec<HapticSnapshot> {
    (0..24_u32)
        .map(|k| {
            let along = Vector3::new(4e-3 * f64::from(k % 3), 3e-3 * f64::from(k % 2), 5e-3);
            let sheet = Sheet {
                friction: if k % 5 == 0 { 0.0 } else { 0.4 },
                coupling: 0.3,
                lift: Vector3::z() * 2e-4 * f64::from(k % 4),
                max_nodes: NODES,
                ..Sheet::springs(2e-3)
            };
            let plain = sheet.snapshot(0, ball, &pose(along));
            // Bodies beside and in the tool's way, some of them.
            let mut snapshot = with_bodies(&plain, 40, NODES, u64::from(k % 3));
            match k {
                7 => snapshot.patch.compliance_mut().fill(f64::NAN),
                11 => snapshot.patch.q_free_mut().fill(Vector3::repeat(f64::INFINITY)),
                13 => snapshot.valid = false,
                17 => snapshot.patch.valid = false,
                _ => {}
            }
            snapshot
        })
        .collect()
}

#[test]
fn a_million_ticks_on_patches_with_faults_allocate_nothing() {
    // The counter counts, or the rest would prove nothing.
    assert_no_alloc(|| drop(std::hint::black_box(vec![0_u8; 64])));
    assert!(violation_count() >= 2, "an allocation and a release went unseen");
    reset_violation_count();

    let ball = Ball::at_nodes(5e-3);
    let variants = variants(&ball);
    let hand = Hand::preset("fingertip").unwrap();
    let script = HandScript::at(Vector3::z() * 9e-3).stroke(Vector3::new(6e-3, 2e-3, -7e-3), 1.0, 1000).unwrap();
    let inner = VirtualDevice::new(VirtualDeviceConfig::default(), hand, script).unwrap();
    let mut device = Faulty::new(inner);
    let patch = PatchTickConfig {
        tool: ball.shape.clone().into(),
        detection: DetectionConfig { max_contacts: CONTACTS, ..ball.detection },
        max_nodes: NODES,
        max_bodies: BODIES,
        hand_over: PatchTickConfig::HAND_OVER,
    };
    let config = TickConfig { tolerance: 1e-3, ..TickConfig::for_device(device.spec()) };
    let tick = Tick::new(&config, device.spec()).and_then(|tick| tick.on_patches(patch)).unwrap();
    let tick = tick.with_gripper(&GripConfig::default(), faulty::hinge()).unwrap();
    let (mut state, mut ws) = (tick.state(NODES), tick.workspace(NODES));
    let (mut writer, mut reader) = latest(&HapticSnapshot::with_bodies(40, NODES, BODIES));
    let (mut records, mut recorded) = every::<TickRecord>(64);

    let mut seen = Seen::default();
    let (mut pressed, mut previous, mut changed, mut squeezed) = (0_u32, 0, 0_u32, 0_u32);
    let mut before = Vector3::zeros();
    for index in 0..TICKS {
        if let Some(step) = faulty::step(index) {
            assert_no_alloc(|| {
                let snapshot = writer.value_mut();
                // Faults are rare: most of the time the same sound places take turns.
                let which = if step % 40 < 24 { step % 40 } else { step % 6 };
                assert!(snapshot.copy_from(&variants[which as usize]));
                snapshot.step = step;
                writer.publish();
            });
        }
        let time = faulty::time(index);
        assert_no_alloc(|| {
            let record = run_tick(&tick, &mut state, &mut ws, &mut reader, &mut device, time);
            records.send(record);
        });
        let record = recorded.receive().unwrap();
        assert!(record.wrench.is_finite() && record.wrench.force.norm() <= tick.limits().max_force() + 1e-12);
        // It changes by the slew at most, or ends at once where a number or the device is at fault.
        let change = (record.wrench.force - before).norm();
        assert!(
            change <= 2.0 + 1e-9 || record.wrench.force == Vector3::zeros() || time.dt != 1e-3,
            "{index}: {change} N"
        );
        before = record.wrench.force;
        seen.add(record.flags);
        assert!(record.gripper.torque.abs() <= 0.3 && record.gripper.opening.is_finite());
        squeezed += u32::from(record.gripper.torque != 0.0);
        pressed += u32::from(record.active > 0);
        changed += u32::from(record.active != previous);
        previous = record.active;
    }
    println!("{seen:?}; contact in {pressed} ticks, changes of their number in {changed}; jaws squeezed in {squeezed}");
    assert_eq!(violation_count(), 0, "the tick touched the allocator");
    assert!(pressed > 300_000 && changed > 5_000, "{pressed} {changed}");
    assert!(squeezed > 50_000, "the jaws felt nothing but in {squeezed} ticks");
    assert_eq!(seen.missing(), Vec::<&str>::new(), "{seen:?}");
}
