//! Ticks on a patch of tissue against closed forms: normals, friction that holds its place, hand-over.

use crate::sheet::{Ball, Bench, MIDDLE, SPACING, STIFFNESS, Sheet, at, pose};
use nalgebra::Vector3;
use palpate_haptics::device::DeviceSample;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::snapshot::HapticSnapshot;

const RADIUS: f64 = 5e-3;
const C: f64 = 1e-3;

/// A place over the middle node at which the ball dents it by `depth`, moved along the sheet.
fn over(depth: f64, along: Vector3<f64>) -> Vector3<f64> {
    Vector3::z() * (RADIUS - depth) + along
}

/// Force on a ball at the record's tool pose by the middle node, a spring without friction: the node lies on the ball, on the
/// line from its centre through the node's place without contact.
fn spring_force(record: &TickRecord) -> Vector3<f64> {
    let centre = record.tool_pose.translation.vector;
    let depth = RADIUS - centre.norm();
    if depth > 0.0 { centre.normalize() * (depth / C) } else { Vector3::zeros() }
}

#[test]
fn the_force_follows_the_skin_while_the_ball_slides_over_a_node() {
    // Frozen rows would keep the normal of their step: here it turns by 50 degrees within one snapshot.
    let ball = Ball::at_nodes(RADIUS);
    let snapshot = Sheet::springs(C).snapshot(1, &ball, &pose(over(1e-3, Vector3::zeros())));
    let mut bench = Bench::new(&ball, 0.0, |_| {});
    // Low enough to stay in touch, near enough to the middle to touch no other node.
    let mut turned = 0.0_f64;
    for k in 0..500 {
        let along = Vector3::x() * (-1.9e-3 + 3.8e-3 * f64::from(k) / 500.0);
        let record = bench.at(&snapshot, over(1.2e-3, along));
        if k < 50 {
            continue; // the coupling finds its stretch
        }
        let (force, expected) = (record.contact_wrench.force, spring_force(&record));
        // The normal follows with a lag of three ticks, of a path of 8 µm each, over a radius of 5 mm.
        assert!((force - expected).norm() < 5e-3 * expected.norm(), "{k}: {force} {expected}");
        turned = turned.max(force.angle(&Vector3::z()).abs());
        assert!(record.flags.contains(TickFlags::LOCAL) && record.active == 1);
    }
    assert!(turned > 0.4, "{turned}");
}

#[test]
fn a_contact_that_begins_between_two_steps_is_felt_at_once() {
    let ball = Ball::at_nodes(RADIUS);
    // Seen from 6 mm above the skin, beyond the margin of contact: a step has no row for it.
    let snapshot = Sheet::springs(C).snapshot(1, &ball, &pose(over(-6e-3, Vector3::zeros())));
    assert!(snapshot.contacts() == 0 && !snapshot.patch.is_empty());
    let mut bench = Bench::new(&ball, 10e-3, |_| {});
    for k in 0..400 {
        let depth = -6e-3 + 2e-5 * f64::from(k);
        let record = bench.at(&snapshot, over(depth, Vector3::zeros()));
        if depth < 0.0 {
            assert_eq!(record.contact_wrench.force, Vector3::zeros(), "{k}");
        } else if depth > 0.0 {
            assert!(record.active == 1, "{k}");
            let expected = spring_force(&record);
            assert!((record.contact_wrench.force - expected).norm() < 1e-6, "{k}: {expected}");
        }
    }
}

#[test]
fn friction_holds_its_place_over_ticks_and_snapshots() {
    let ball = Ball::at_nodes(RADIUS);
    let sheet = Sheet { friction: 0.8, ..Sheet::springs(C) };
    for (tolerance, sweeps) in [(1e-9, 200), (1e-3, 30)] {
        let mut bench = Bench::new(&ball, 10e-3, |config| (config.tolerance, config.sweeps) = (tolerance, sweeps));
        let first = sheet.snapshot(1, &ball, &pose(over(1e-3, Vector3::zeros())));
        bench.rest(&first, over(1e-3, Vector3::zeros()));
        let aside = Vector3::new(2e-4, -1e-4, 0.0);
        let rest = bench.rest(&first, over(1e-3, aside));
        let held = rest.contact_wrench.force;
        // The node sticks to the ball's point: both have gone aside by as much as the coupling has let them.
        let stiffness = 1.0 / (C + 1.0 / STIFFNESS);
        assert!((held.xy() + aside.xy() * stiffness).norm() < 2e-3 * held.xy().norm(), "{held}");
        let mut old = first;
        for step in 2..60 {
            // The patch is gathered around another place each time, so that its nodes change and change their order.
            let about = Vector3::new(3e-3 * f64::from(step % 3), -2e-3 * f64::from(step % 2), 0.0);
            let mut new = sheet.snapshot(u64::from(step as u32), &ball, &pose(over(1e-3, aside + about)));
            // The step has the tool where the ticks have it, and its friction holds the node at the same place.
            new.tool_pose = rest.tool_pose;
            let under = new.patch.q_free().iter().position(|q| q.xy().norm() < 1e-9).expect("the node under the ball");
            new.patch.force_mut()[under] = -held;
            new.patch.q_free_mut()[under] -= held * C;
            new.patch.relieve();
            let jump = bench.swap(&old, &new, over(1e-3, aside)).force_jump;
            assert!(jump < 10.0 * tolerance, "{jump} N");
            for _ in 0..32 {
                let force = bench.at(&new, over(1e-3, aside)).contact_wrench.force;
                assert!((force - held).norm() < 5.0 * tolerance * held.norm(), "step {step}: {force} {held}");
            }
            old = new;
        }
    }
}

#[test]
fn sliding_friction_lies_on_the_cone_against_the_motion() {
    let friction = 0.3;
    let ball = Ball::at_nodes(RADIUS);
    let sheet = Sheet { friction, ..Sheet::springs(C) };
    for heading in 0..16 {
        let angle = std::f64::consts::TAU * f64::from(heading) / 16.0;
        let direction = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let mut bench = Bench::new(&ball, 10e-3, |_| {});
        let snapshot = sheet.snapshot(1, &ball, &pose(over(1e-3, Vector3::zeros())));
        bench.rest(&snapshot, over(1e-3, -direction * 1e-3));
        let mut slid = 0;
        for k in 0..200 {
            let record = bench.at(&snapshot, over(1e-3, direction * (-1e-3 + 1e-5 * f64::from(k))));
            let force = record.contact_wrench.force;
            // The node's place is that of its spring; the normal is the ball's there.
            let centre = record.tool_pose.translation.vector;
            let normal = (centre + force * C).normalize();
            let (along, across) = (force.dot(&normal), force - normal * force.dot(&normal));
            assert!(across.norm() <= friction * along * (1.0 + 1e-2), "{k}: outside the cone");
            if k > 120 {
                slid += 1;
                assert!((across.norm() - friction * along).abs() < 1e-2 * along, "{k}: it slides");
                assert!(across.normalize().dot(&direction) < -0.95, "{k}: against the motion");
            }
        }
        assert!(slid > 50);
    }
}

#[test]
fn a_new_snapshot_comes_in_over_the_stated_time_and_without_a_jump() {
    let ball = Ball::at_nodes(RADIUS);
    let place = over(1e-3, Vector3::zeros());
    let old = Sheet::springs(C).snapshot(1, &ball, &pose(place));
    // The tissue has risen, or has become stiffer.
    let risen = Sheet { lift: Vector3::z() * 4e-4, ..Sheet::springs(C) };
    for sheet in [risen, Sheet::springs(0.5 * C)] {
        let new = sheet.snapshot(2, &ball, &pose(place));
        let mut bench = Bench::new(&ball, 0.0, |_| {});
        bench.rest(&old, place);
        let at_once = bench.swap(&old, &new, place).force_jump;
        let after = bench.rest(&new, place).contact_wrench.force;

        let mut bench = Bench::new(&ball, 10e-3, |_| {});
        let before = bench.rest(&old, place).contact_wrench.force;
        let first = bench.swap(&old, &new, place);
        assert!(at_once > 0.1, "{at_once} N");
        assert!(first.force_jump < 1e-6 * at_once, "{} N", first.force_jump);
        assert!((first.contact_wrench.force - before).norm() < 1e-6);
        let mut last = before.z;
        for k in 1..=40 {
            let force = bench.at(&new, place).contact_wrench.force.z;
            // A tenth of the way a tick; and the coupling's damper is stiffer than the coupling while the tool moves.
            assert!((force - last).abs() < 0.2 * (after.z - before.z), "{k}: {force} after {last}");
            last = force;
        }
        let settled = bench.rest(&new, place).contact_wrench.force;
        assert!((settled - after).norm() < 1e-6 * after.norm(), "{settled} {after}");
    }
}

#[test]
fn contacts_at_faces_share_their_force_between_the_corners() {
    // Over the centroid of a triangle: three springs side by side, and the triangle stays level.
    let ball = Ball::at_faces(RADIUS);
    let centre = Vector3::new(2.0 / 3.0 * SPACING, 1.0 / 3.0 * SPACING, 0.0);
    let sheet = Sheet::springs(C);
    let place = over(5e-4, centre);
    let mut bench = Bench::new(&ball, 0.0, |_| {});
    let record = bench.rest(&sheet.snapshot(1, &ball, &pose(place)), place);
    let expected = 5e-4 / (C / 3.0 + 1.0 / STIFFNESS);
    assert!((record.contact_wrench.force - Vector3::z() * expected).norm() < 1e-6 * expected, "{record:?}");
    assert_eq!(sheet.node(MIDDLE), Vector3::zeros());
}

#[test]
fn skin_that_is_held_fixed_leaves_the_stiffness_of_the_coupling() {
    let ball = Ball::at_nodes(RADIUS);
    let place = over(1e-3, Vector3::zeros());
    let sheet = Sheet { movable: false, ..Sheet::springs(C) };
    let snapshot = sheet.snapshot(1, &ball, &pose(place));
    assert_eq!((snapshot.patch.degrees_of_freedom(), snapshot.patch.is_empty()), (0, false));
    let record = Bench::new(&ball, 0.0, |_| {}).rest(&snapshot, place);
    assert!((record.contact_wrench.force.z - 1e-3 * STIFFNESS).abs() < 1e-6, "{}", record.contact_wrench.force);
}

#[test]
fn more_contacts_than_there_is_room_for_keep_the_deepest_and_are_flagged() {
    let sheet = Sheet::springs(C);
    let place = Vector3::z() * (0.1 - 8e-3);
    let all = Ball::at_nodes(0.1);
    let snapshot = sheet.snapshot(1, &all, &pose(place));
    let full = Bench::new(&all, 0.0, |_| {}).rest(&snapshot, place);
    assert!(full.active > 9 && !full.flags.contains(TickFlags::TRUNCATED), "{}", full.active);
    let mut few = all.clone();
    few.detection.max_contacts = 5;
    let record = Bench::new(&few, 0.0, |_| {}).rest(&snapshot, place);
    assert_eq!((record.contacts, record.active), (5, 5));
    assert!(record.flags.contains(TickFlags::TRUNCATED));
    // The middle and its four neighbours: deeper than what was left out by the ball's curvature.
    let least = record.contact_wrench.force.z / full.contact_wrench.force.z;
    assert!(least > 0.2 && least < 1.0, "{least}");
}

#[test]
fn a_tool_that_leaves_the_patch_is_flagged_and_the_next_snapshot_has_it() {
    let ball = Ball::at_nodes(RADIUS);
    let mut bench = Bench::new(&ball, 10e-3, |_| {});
    let sheet = Sheet::springs(C);
    let snapshot = sheet.snapshot(1, &ball, &pose(over(0.0, Vector3::zeros())));
    let clearance = snapshot.patch.skin().clearance();
    assert!(clearance > 1e-3 && clearance < 0.012, "{clearance}");
    let near = bench.at(&snapshot, over(0.0, Vector3::x() * (clearance - 1e-4)));
    assert!(!near.flags.contains(TickFlags::BEYOND_PATCH));
    let far = over(1e-3, Vector3::x() * (2.0 * SPACING * (1.0 + clearance / SPACING).floor()));
    assert!(bench.at(&snapshot, far).flags.contains(TickFlags::BEYOND_PATCH));
    let new = sheet.snapshot(2, &ball, &pose(far));
    assert!(!bench.rest(&new, far).flags.contains(TickFlags::BEYOND_PATCH));
}

#[test]
fn snapshots_without_a_patch_and_ticks_without_a_tool_go_on_with_frozen_rows() {
    let ball = Ball::at_nodes(RADIUS);
    let place = over(1e-3, Vector3::zeros());
    let mut bench = Bench::new(&ball, 10e-3, |_| {});
    let full = Sheet::springs(C).snapshot(1, &ball, &pose(place));
    assert!(bench.rest(&full, place).active == 1);
    let mut bare = HapticSnapshot::new(4);
    bare.clear();
    (bare.step, bare.valid) = (2, true);
    let record = bench.at(&bare, place);
    assert!(!record.flags.contains(TickFlags::LOCAL) && record.contacts == 0);
    // And back again, from the step's forces, not from what was remembered.
    let again = Sheet::springs(C).snapshot(3, &ball, &pose(place));
    let record = bench.rest(&again, place);
    assert!(record.flags.contains(TickFlags::LOCAL));
    assert!((record.contact_wrench.force - spring_force(&record)).norm() < 1e-6);

    let mut copy = HapticSnapshot::with_patch(40, 40);
    assert!(copy.copy_from(&again) && copy == again);
    assert!(!HapticSnapshot::with_patch(40, 3).copy_from(&again), "it does not fit");
}

#[test]
fn a_bad_number_in_the_patch_or_the_pose_ends_the_force_and_it_recovers() {
    let ball = Ball::at_nodes(RADIUS);
    let place = over(1e-3, Vector3::zeros());
    let good = |step| Sheet { friction: 0.4, ..Sheet::springs(C) }.snapshot(step, &ball, &pose(place));
    let mut in_compliance = good(2);
    in_compliance.patch.compliance_mut().fill(f64::NAN);
    let mut in_shape = good(2);
    in_shape.patch.q_free_mut().fill(Vector3::repeat(f64::INFINITY));
    for bad in [in_compliance, in_shape] {
        let mut bench = Bench::new(&ball, 10e-3, |_| {});
        let full = bench.rest(&good(1), place).wrench.force;
        for _ in 0..3 {
            let record = bench.at(&bad, place);
            assert!(record.wrench.is_finite() && record.contact_wrench.is_finite());
            assert_eq!(record.contact_wrench.force, Vector3::zeros(), "{:?}", record.flags);
        }
        (0..400).for_each(|_| _ = bench.at(&good(3), place));
        let well = bench.at(&good(3), place).wrench.force;
        assert!((well - full).norm() < 1.0 && well.z > full.z, "{well} after {full}, which was fading in");
    }
    let mut bench = Bench::new(&ball, 10e-3, |_| {});
    bench.rest(&good(1), place);
    let nowhere = DeviceSample { pose: pose(Vector3::repeat(f64::NAN)), ..at(place) };
    let record = bench.tick(&good(1), &nowhere);
    assert!(record.flags.contains(TickFlags::BAD_POSE) && record.wrench.force == Vector3::zeros());
    assert!(bench.rest(&good(1), place).active == 1);
}

/// A step ends with the sheet sinking as fast as the ball presses: what sinks by itself takes no more force. The next step is
/// late, and the sheet waits for it.
#[test]
fn tissue_that_moves_on_with_the_ball_adds_no_force_until_its_step_is_over() {
    let (ball, h) = (Ball::at_nodes(RADIUS), 1.0 / 30.0);
    let mut snapshot = Sheet::springs(C).snapshot(1, &ball, &pose(over(1e-3, Vector3::zeros())));
    let still = Bench::new(&ball, 0.0, |_| {}).rest(&snapshot, over(1e-3, Vector3::zeros()));
    let sinks = Vector3::new(2e-3, 0.0, -4e-3);
    snapshot.patch.drift_mut().fill(sinks);
    let mut bench = Bench::new(&ball, 0.0, |_| {});
    for k in 0..60 {
        // The snapshot is of the tool in the tick before.
        let share = (f64::from(k) * 1e-3).min(h) / h + 1e-3 / h;
        let (with, record) = (sinks * share, bench.at(&snapshot, over(1e-3, sinks * share)));
        let tool = record.tool_pose.translation.vector - with;
        let expected = tool.normalize() * ((RADIUS - tool.norm()) / C);
        assert!((record.contact_wrench.force - expected).norm() < 1e-6, "tick {k}: {expected}");
        if k > 40 {
            // The coupling's damper has died down.
            assert!((record.contact_wrench.force - still.contact_wrench.force).norm() < 1e-6, "tick {k}");
        }
    }
}
