//! One tick's answer against closed forms.

use crate::rig::{Bench, PERIOD, Wall, at, patient, snapshot_of, strong_spec};
use nalgebra::{Isometry3, Vector3};
use palpate_constraints::law::Signorini;
use palpate_haptics::coupling::Spring;
use palpate_haptics::device::{DeviceSample, TickTime};
use palpate_haptics::record::TickFlags;
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};
use palpate_haptics::tick::{TickConfig, TickState, TickWorkspace};

#[test]
fn a_pressed_spring_wall_answers_with_its_springs_in_series() {
    // First touch: F = d/(W + c), with the damper; at rest F = d/(W + 1/K), without.
    for w in [0.0, 1.0 / 5000.0, 1.0 / 200.0] {
        let depth = 2e-3;
        let mut bench = Bench::strong();
        let snapshot = snapshot_of(1, &[Wall::floor(w)], &Isometry3::identity());
        let c = bench.tick.coupling().compliance();
        let stiffness = TickConfig::for_device(&strong_spec()).coupling.translation.stiffness;
        let first = bench.tick(&snapshot, &at(Vector3::z() * -depth));
        let expected = Vector3::z() * depth / (w + c);
        assert!((first.contact_wrench.force - expected).norm() < 1e-9, "{} != {expected}", first.contact_wrench.force);
        let rest = bench.warm_up(&snapshot, &at(Vector3::z() * -depth));
        let expected = Vector3::z() * depth / (w + 1.0 / stiffness);
        // β = 0.74 to the power of 400 is nothing; the rest is the solver's tolerance of 1e-6.
        assert!((rest.wrench.force - expected).norm() < 2e-6 * expected.norm());
        // The tool stands where the wall's spring has yielded.
        assert!((rest.tool_pose.translation.z + w * expected.z).abs() < 1e-8);
    }
}

#[test]
fn free_space_is_free_and_contact_ends_without_pulling() {
    let mut bench = Bench::strong();
    let snapshot = snapshot_of(1, &[Wall::floor(1e-3)], &Isometry3::identity());
    bench.warm_up(&snapshot, &at(Vector3::z() * -1e-3));
    for i in 0..200 {
        let height = 1e-3 * f64::from(i) / 100.0;
        let record = bench.tick(&snapshot, &at(Vector3::z() * height));
        assert!(record.contact_wrench.force.z >= 0.0);
        if record.active == 0 {
            assert_eq!(record.contact_wrench.force, Vector3::zeros());
        }
    }
    let free = bench.tick(&snapshot, &at(Vector3::z() * 2e-3));
    assert_eq!((free.wrench.force, free.active, free.contacts), (Vector3::zeros(), 0, 1));
    // The stretch has decayed: the tool is at the device.
    assert!((free.tool_pose.translation.z - 2e-3).abs() < 1e-12);
}

#[test]
fn the_hand_feels_the_coupling_and_the_coupling_the_contact() {
    // Third law across the tool: −(K e + B (e − e₋)/T) on the hand is the contact force on the tool, each tick.
    let mut bench = Bench::strong();
    let Spring { stiffness, damping } = TickConfig::for_device(&strong_spec()).coupling.translation;
    let walls = [Wall::floor(1e-3).with_friction(0.4), Wall { normal: Vector3::x(), ..Wall::floor(2e-3) }];
    let snapshot = snapshot_of(1, &walls, &Isometry3::identity());
    let mut before = Vector3::zeros();
    for i in 0..1000 {
        let t = f64::from(i) * PERIOD;
        let device = Vector3::new(-1e-3 * (20.0 * t).sin(), 2e-3 * (11.0 * t).sin(), -1e-3 * (7.0 * t).sin());
        let record = bench.tick(&snapshot, &at(device));
        let stretch = device - record.tool_pose.translation.vector;
        let on_hand = -(stretch * stiffness + (stretch - before) * (damping / PERIOD));
        // Differences of millimetres times B/T = 2000 N/m: rounding of 1e-15.
        assert!((on_hand - record.contact_wrench.force).norm() < 1e-12, "tick {i}");
        before = stretch;
    }
}

#[test]
fn sliding_friction_is_on_the_cone_and_against_the_motion_for_every_heading() {
    let friction = 0.3;
    for heading in 0..64 {
        let angle = std::f64::consts::TAU * f64::from(heading) / 64.0;
        let direction = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let mut bench = Bench::strong();
        let snapshot = snapshot_of(1, &[Wall::floor(1e-3).with_friction(friction)], &Isometry3::identity());
        bench.warm_up(&snapshot, &at(Vector3::z() * -1e-3));
        let mut record = None;
        for i in 0..300 {
            let slide = direction * (1e-4 * f64::from(i));
            record = Some(bench.tick(&snapshot, &at(slide - Vector3::z() * 1e-3)));
        }
        let force = record.unwrap().wrench.force;
        let expected = (Vector3::z() - direction * friction) * force.z;
        // The sweeps stop at a relative residual of 1e-6, of the gap of 30 mm that has been slid.
        assert!((force - expected).norm() < 1e-4 * force.z, "heading {heading}: {force}");
        assert!(force.xy().norm() <= friction * force.z * (1.0 + 1e-12), "outside the cone");
        assert!((force.z - 1e-3 / (1e-3 + 1.0 / 700.0)).abs() < 1e-4 * force.z);
    }
}

#[test]
fn a_tool_that_has_not_slid_is_held_by_friction() {
    let mut bench = Bench::strong();
    let snapshot = snapshot_of(1, &[Wall::floor(1e-3).with_friction(0.5)], &Isometry3::identity());
    bench.warm_up(&snapshot, &at(Vector3::z() * -1e-3));
    let aside = Vector3::new(2e-4, 0.0, -1e-3);
    let record = bench.warm_up(&snapshot, &at(aside));
    let stiffness = TickConfig::for_device(&strong_spec()).coupling.translation.stiffness;
    let expected = -aside / (1e-3 + 1.0 / stiffness);
    assert!((record.wrench.force - expected).norm() < 1e-5 * expected.norm());
}

#[test]
fn a_lever_turned_into_a_wall_is_held_by_force_and_torque() {
    // Contact at r = 0.1 m along x from the tool's origin; the device turns about y by a, which lowers it by r sin a.
    let (r, w) = (0.1, 1e-3);
    let spec = strong_spec();
    let mut config = patient(&spec);
    let rotation = Spring { stiffness: 2.0, damping: 0.01 };
    for coupled in [None, Some(rotation)] {
        config.coupling.rotation = coupled;
        let mut bench = Bench::new(&config, &spec);
        let mut snapshot = HapticSnapshot::new(4);
        snapshot.clear();
        let row = [[0.0, 0.0, 1.0, 0.0, -r, 0.0]];
        let law = Signorini.into();
        let contact = SnapshotContact { law, feature: 1, tool_rows: &row, delta_free: &[0.0], lambda: &[0.0] };
        assert!(snapshot.push(&contact));
        snapshot.compliance_mut().copy_from_slice(&[w]);
        (snapshot.step, snapshot.valid) = (1, true);
        let angle = 0.02;
        let pose = Isometry3::rotation(Vector3::y() * angle);
        let record = bench.warm_up(&snapshot, &DeviceSample::at_rest(0.0, pose));
        let turning = coupled.map_or(0.0, |spring: Spring| r * r / spring.stiffness);
        let force = r * angle / (w + 1.0 / config.coupling.translation.stiffness + turning);
        assert!((record.wrench.force - Vector3::z() * force).norm() < 1e-5 * force, "{}", record.wrench.force);
        assert!((record.wrench.torque - Vector3::y() * (-r * force)).norm() < 1e-5 * r * force);
        if coupled.is_none() {
            assert!(record.tool_pose.rotation.angle_to(&pose.rotation) < 1e-15);
        }
    }
}

#[test]
fn contacts_that_share_a_body_share_the_load() {
    // Two contacts on one body whose compliance couples them: F_i = d (W_11 − W_12)/(…) by the 2x2 inverse.
    let mut bench = Bench::strong();
    let c = bench.tick.coupling().compliance();
    let mut snapshot = snapshot_of(1, &[Wall::floor(1e-3), Wall::floor(2e-3)], &Isometry3::identity());
    snapshot.compliance_mut().copy_from_slice(&[1e-3, 4e-4, 4e-4, 2e-3]);
    let depth = 1e-3;
    let record = bench.tick(&snapshot, &at(Vector3::z() * -depth));
    let (a, b, d) = (1e-3 + c, 4e-4 + c, 2e-3 + c);
    let sum = depth * (a + d - 2.0 * b) / (a * d - b * b);
    assert!((record.contact_wrench.force.z - sum).abs() < 1e-5 * sum, "{} != {sum}", record.contact_wrench.force.z);
    assert_eq!(record.active, 2);
}

#[test]
fn the_jump_at_a_new_snapshot_is_what_the_snapshot_changed() {
    let mut bench = Bench::strong();
    let device = at(Vector3::z() * -1e-3);
    let first = snapshot_of(1, &[Wall::floor(1e-3)], &Isometry3::identity());
    bench.warm_up(&first, &device);
    // The device moves on in the very tick of the swap: its part is not the snapshot's.
    let moved = at(Vector3::z() * -1.2e-3);
    let shift = 2e-4;
    for (step, offset) in [(2, 0.0), (3, shift)] {
        let old = snapshot_of(step - 1, &[Wall::floor(1e-3)], &Isometry3::identity());
        let new = snapshot_of(step, &[Wall { offset, ..Wall::floor(1e-3) }], &Isometry3::identity());
        bench.tick.weigh_outgoing(&mut bench.state, &old, &moved, &mut bench.ws);
        let record = bench.tick(&new, &moved);
        assert!(record.flags.contains(TickFlags::NEW_SNAPSHOT));
        let expected = offset / (1e-3 + bench.tick.coupling().compliance());
        assert!((record.force_jump - expected).abs() < 1e-5, "{} != {expected}", record.force_jump);
        assert_eq!(bench.tick(&new, &moved).force_jump, 0.0);
    }
}

#[test]
fn more_contacts_than_there_is_room_for_are_left_out_and_flagged() {
    let mut bench = Bench::strong();
    (bench.state, bench.ws) = (TickState::new(2), TickWorkspace::new(2));
    let walls = [Wall::floor(1e-3); 3];
    let snapshot = snapshot_of(1, &walls, &Isometry3::identity());
    let record = bench.tick(&snapshot, &at(Vector3::z() * -1e-3));
    assert!(record.flags.contains(TickFlags::TRUNCATED));
    assert_eq!(record.contacts, 2);
    let two = Bench::strong().tick(&snapshot_of(1, &walls[..2], &Isometry3::identity()), &at(Vector3::z() * -1e-3));
    assert_eq!(record.contact_wrench, two.contact_wrench);

    let mut small = HapticSnapshot::new(2);
    assert!(!small.copy_from(&snapshot));
    assert!(!small.valid && small.contacts() == 0);
    let mut equal = HapticSnapshot::new(8);
    assert!(equal.copy_from(&snapshot));
    assert_eq!(equal, snapshot);
}

#[test]
fn a_snapshot_refuses_what_does_not_fit_and_counts_it() {
    let mut snapshot = HapticSnapshot::new(1);
    snapshot.clear();
    let row = [[0.0; 6]];
    let law = Signorini.into();
    let contact = SnapshotContact { law, feature: 1, tool_rows: &row, delta_free: &[0.0], lambda: &[0.0] };
    assert!(!snapshot.push(&SnapshotContact { delta_free: &[], ..contact }));
    assert!(snapshot.push(&contact));
    assert!(!snapshot.push(&contact));
    assert_eq!((snapshot.contacts(), snapshot.rows(), snapshot.dropped), (1, 1, 2));
}

#[test]
fn set_up_refuses_numbers_out_of_range() {
    use palpate_haptics::tick::Tick;
    let spec = strong_spec();
    let good = TickConfig::for_device(&spec);
    assert!(Tick::new(&good, &spec).is_ok());
    let refused = |change: fn(&mut TickConfig)| {
        let mut config = good;
        change(&mut config);
        Tick::new(&config, &spec).unwrap_err().to_string()
    };
    assert!(refused(|c| c.period = 0.0).contains("tick period"));
    assert!(refused(|c| c.sweeps = 0).contains("tick sweeps"));
    assert!(refused(|c| c.tolerance = f64::NAN).contains("tick tolerance"));
    assert!(refused(|c| c.coupling.translation.stiffness = -1.0).contains("coupling stiffness"));
    assert!(refused(|c| c.limits.stale_zero = 0.1).contains("above stale_after"));
    assert!(refused(|c| c.limits.max_force = Some(0.0)).contains("max_force"));
    let time = TickTime::regular(3, PERIOD);
    assert_eq!((time.index, time.time, time.dt), (3, 3e-3, 1e-3));
}

#[test]
fn a_second_run_whose_steps_count_from_one_again_does_not_see_the_first() {
    let press = at(Vector3::z() * -1e-3);
    let (soft, stiff) = (Wall::floor(1e-2), Wall::floor(1e-4));
    let mut bench = Bench::strong();
    bench.warm_up(&snapshot_of(1, &[soft], &Isometry3::identity()), &press);
    bench.state.reset();
    let second = bench.tick(&snapshot_of(1, &[stiff], &Isometry3::identity()), &press);
    let fresh = Bench::strong().tick(&snapshot_of(1, &[stiff], &Isometry3::identity()), &press);
    assert_eq!(second.contact_wrench, fresh.contact_wrench);
    assert_eq!(second.wrench, fresh.wrench);
}
