//! A state that was reset is a new one: no force, sum or pose of before is in what follows.

use crate::sheet::{Ball, Bench, Sheet, pose};
use nalgebra::{Isometry3, Vector3};
use palpate_collision::tool::Hinge;
use palpate_haptics::device::{DeviceError, DeviceSample, TickTime};
use palpate_haptics::gripper::GripConfig;
use palpate_haptics::record::TickRecord;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::PatchTickConfig;

const RADIUS: f64 = 5e-3;

/// Slides over the sheet while the gripper opens and closes.
fn sample(k: u64) -> DeviceSample {
    let time = k as f64 * 1e-3;
    let place = Vector3::new(0.02 * time, 0.0, RADIUS - 1e-3 * (9.0 * time).sin().abs());
    DeviceSample { gripper: 0.5 + 0.4 * (30.0 * time).cos(), ..DeviceSample::at_rest(time, pose(place)) }
}

/// Two hundred ticks from number 0 on, some of which fail.
fn follow(bench: &mut Bench, ball: &Ball, first: u64) -> Vec<TickRecord> {
    let sheet = Sheet { friction: 0.3, coupling: 0.4, ..Sheet::springs(1e-3) };
    let mut snapshot = HapticSnapshot::with_patch(ball.detection.max_contacts, 40);
    bench.index = 0;
    let mut records = Vec::new();
    for k in 0..200 {
        let mut given = sample(first + k);
        if k % 33 == 2 {
            sheet.fill(&mut snapshot, 1 + k / 33, ball, &given.pose);
        }
        // The first tick has no pose, as that of a driver whose device does not measure yet.
        match k {
            0 => given.pose = Isometry3::translation(f64::NAN, 0.0, 0.0),
            1 => {
                let time = TickTime::regular(1, 1e-3);
                records.push(bench.tick.idle(&mut bench.state, &snapshot, time, DeviceError::Timeout));
                bench.index = 2;
                continue;
            }
            _ => {}
        }
        records.push(bench.tick(&snapshot, &given));
    }
    records
}

#[test]
fn what_follows_a_reset_is_what_a_new_state_gives_to_the_bit() {
    let ball = Ball::at_faces(RADIUS);
    let bench = || {
        let mut bench = Bench::new(&ball, PatchTickConfig::HAND_OVER, |_| ());
        let hinge = Hinge { pivot: Vector3::zeros(), axis: Vector3::x_axis(), closed: 0.0, open: 0.6 };
        bench.tick = bench.tick.with_gripper(&GripConfig::default(), hinge).unwrap();
        bench
    };
    let (mut used, mut new) = (bench(), bench());
    let before = follow(&mut used, &ball, 700);
    let last = before.last().unwrap();
    assert!(last.wrench.force.norm() > 0.0 && last.energy.translation != 0.0 && last.gripper.device != 1.0);
    used.state.reset();
    let (again, first) = (follow(&mut used, &ball, 0), follow(&mut new, &ball, 0));
    assert!(first.iter().any(|record| record.active > 0 && record.wrench.force.norm() > 0.05));
    for (k, (a, b)) in again.iter().zip(&first).enumerate() {
        // Text tells every bit, and NaN from NaN.
        assert_eq!(format!("{a:?}"), format!("{b:?}"), "tick {k}");
    }
}
