//! Contacts of fixed bodies in a tick: a wall under pressed tissue and a wall at the tool, in closed form.

use crate::sheet::{Ball, Bench, MIDDLE, STIFFNESS, Sheet};
use nalgebra::{Isometry3, Matrix3, Vector3};
use palpate_constraints::law::{Coulomb, Signorini};
use palpate_haptics::body_contact::{BodyContact, BodyContacts, ToolPart};
use palpate_haptics::record::TickFlags;
use palpate_haptics::snapshot::HapticSnapshot;

const RADIUS: f64 = 5e-3;
/// Compliance of the sheet's nodes, of the tissue at the wall, and of one per force at the other (m/N).
const C: f64 = 2e-3;
const WALL: f64 = 2e-3;
const BETWEEN: f64 = 1e-3;
/// Gap at the wall (m).
const GAP: f64 = 2e-4;

/// A wall whose normal is z upwards.
fn wall(feature: u64, gap: f64, tool: Option<ToolPart>) -> BodyContact {
    let free = Vector3::new(gap, 0.0, 0.0);
    let up = Matrix3::from_columns(&[Vector3::z(), Vector3::x(), Vector3::y()]);
    BodyContact {
        feature,
        law: Signorini.into(),
        frame: up,
        tool,
        gap,
        free,
        drift: Vector3::zeros(),
        flow: Vector3::zeros(),
        force: Vector3::zeros(),
    }
}

fn over(depth: f64) -> Vector3<f64> {
    Vector3::z() * (RADIUS - depth)
}

/// The sheet seen from a ball at `at`, with these contacts: those without the tool yield as above.
fn snapshot(step: u64, ball: &Ball, at: Vector3<f64>, bodies: &[BodyContact]) -> HapticSnapshot {
    let plain = Sheet::springs(C).snapshot(step, ball, &Isometry3::translation(at.x, at.y, at.z));
    let mut snapshot = HapticSnapshot::with_bodies(ball.detection.max_contacts, 40, 4);
    snapshot.clear();
    (snapshot.step, snapshot.dt, snapshot.valid, snapshot.tool_pose) = (step, plain.dt, true, plain.tool_pose);
    let patch = &mut snapshot.patch;
    assert!(patch.skin_mut().copy_from(plain.patch.skin()));
    for body in bodies {
        assert!(patch.bodies.push(*body, body.tool.is_none()));
    }
    patch.q_free_mut().copy_from_slice(plain.patch.q_free());
    patch.force_mut().fill(Vector3::zeros());
    let (n, skin) = (patch.degrees_of_freedom(), plain.patch.degrees_of_freedom());
    let middle = patch.skin().number_of(MIDDLE).expect("it is under the ball");
    let yielding = patch.bodies.yielding();
    let first = n - skin;
    let c = patch.compliance_mut();
    c.fill(0.0);
    for (k, column) in plain.patch.compliance().chunks_exact(skin).enumerate() {
        c[(first + k) * n + first..(first + k + 1) * n].copy_from_slice(column);
    }
    let z = first + 3 * middle + 2;
    for k in 0..yielding {
        (0..3).for_each(|i| c[(3 * k + i) * n + 3 * k + i] = WALL);
        (c[3 * k * n + z], c[z * n + 3 * k]) = (BETWEEN, BETWEEN);
    }
    patch.relieve();
    (patch.valid, patch.law) = (true, Signorini.into());
    snapshot
}

/// Force of the ball at this depth: of the node's spring, and from the touch on of the node held by the wall too.
fn expected(depth: f64) -> f64 {
    let alone = depth.max(0.0) / C;
    if BETWEEN * alone <= GAP { alone } else { (depth - BETWEEN * GAP / WALL) / (C - BETWEEN * BETWEEN / WALL) }
}

#[test]
fn tissue_that_meets_a_wall_between_two_steps_gets_stiffer_at_once_and_lets_go_again() {
    let ball = Ball::at_nodes(RADIUS);
    let snapshot = snapshot(1, &ball, over(0.0), &[wall(1 << 52, GAP, None)]);
    let mut bench = Bench::new(&ball, 10e-3, |config| (config.tolerance, config.sweeps) = (1e-10, 200));
    let (mut met, mut free) = (false, false);
    for k in 0..400 {
        let device = 1.6e-3 * (1.0 - (f64::from(k) / 200.0 - 1.0).abs());
        let record = bench.at(&snapshot, over(device));
        let depth = RADIUS - record.tool_pose.translation.z;
        let (force, wanted) = (record.contact_wrench.force, expected(depth));
        // Contacts are found a tick before the forces: 8 µm of the way a tick.
        assert!((force - Vector3::z() * wanted).norm() < 2e-3 * wanted.max(0.1), "{k}: {force} {wanted}");
        assert_eq!(record.contacts, u32::from(record.gap.is_finite()), "the wall is none of the tool's contacts");
        met |= BETWEEN * force.z > 2.0 * GAP && wanted > 1.1 * depth / C;
        free |= k > 300 && record.active == 1 && BETWEEN * force.z < GAP;
    }
    assert!(met && free);
}

#[test]
fn new_snapshots_keep_the_force_where_a_wall_comes_to_be_known_and_is_forgotten() {
    let ball = Ball::at_nodes(RADIUS);
    let device = over(1.5e-3);
    let with = |step, walls: &[BodyContact]| snapshot(step, &ball, over(0.0), walls);
    let (a, b, c) = (with(1, &[wall(7 << 52, GAP, None)]), with(2, &[wall(7 << 52, GAP, None)]), with(3, &[]));
    let mut bench = Bench::new(&ball, 10e-3, |config| (config.tolerance, config.sweeps) = (1e-10, 200));
    let held = bench.rest(&a, device).contact_wrench.force;
    let same = bench.swap(&a, &b, device);
    assert!(same.force_jump < 1e-6 * held.norm(), "{} N at the same wall", same.force_jump);
    // Without the wall the force falls to the node's own, over the time of the hand-over.
    let gone = bench.swap(&b, &c, device);
    assert!(gone.force_jump < 0.02 * held.norm(), "{} N of {held}", gone.force_jump);
    let alone = bench.rest(&c, device).contact_wrench.force;
    assert!(alone.z < 0.9 * held.z, "{alone} {held}");
    // One that is new begins where its step has it.
    let again = bench.swap(&c, &with(4, &[wall(7 << 52, GAP, None)]), device);
    assert!(again.force_jump < 1e-6 * held.norm(), "{} N at a new wall", again.force_jump);
}

#[test]
fn a_wall_at_the_tool_holds_it_by_the_coupling_with_friction_up_to_the_cone() {
    let ball = Ball::at_nodes(RADIUS);
    let friction = 0.5;
    let down = Matrix3::from_columns(&[-Vector3::z(), Vector3::x(), -Vector3::y()]);
    let at_tool = ToolPart { lever: -Vector3::z() * RADIUS, opens: Vector3::zeros() };
    let law = Coulomb { friction }.into();
    // 6 mm above the skin, which stays out of reach.
    let start = over(-6e-3);
    let floor = BodyContact { law, frame: down, ..wall(9 << 52, 1e-3, Some(at_tool)) };
    let snapshot = snapshot(1, &ball, start, &[floor]);
    let mut bench = Bench::new(&ball, 10e-3, |config| (config.tolerance, config.sweeps) = (1e-10, 200));
    assert_eq!(bench.rest(&snapshot, start - Vector3::z() * 0.9e-3).active, 0);
    let held = bench.rest(&snapshot, start - Vector3::z() * 1.5e-3);
    let normal = STIFFNESS * 0.5e-3;
    assert!((held.contact_wrench.force - Vector3::z() * normal).norm() < 1e-6 * normal);
    assert!(held.flags.contains(TickFlags::LOCAL) && (held.contacts, held.active) == (1, 1));
    let aside = |x: f64| start + Vector3::new(x, 0.0, -1.5e-3);
    // Slowly: the coupling's damper would add to the friction that it takes.
    (1..100).for_each(|k| _ = bench.at(&snapshot, aside(1e-6 * f64::from(k))));
    let sticks = bench.rest(&snapshot, aside(1e-4)).contact_wrench.force;
    assert!((sticks.x + STIFFNESS * 1e-4).abs() < 1e-6 * normal, "{sticks}");
    let moving = (1..=300).map(|k| bench.at(&snapshot, aside(1e-4 + 3e-6 * f64::from(k)))).last();
    let slides = moving.expect("ticks").contact_wrench.force;
    assert!((slides.x + friction * normal).abs() < 1e-3 * normal, "{slides}");
}

#[test]
fn what_finds_no_room_is_counted_and_copies_keep_order_and_room() {
    let mut bodies = BodyContacts::new(2);
    let part = ToolPart { lever: Vector3::zeros(), opens: Vector3::zeros() };
    assert!(bodies.push(wall(1, 0.0, None), true) && bodies.push(wall(2, 0.0, Some(part)), false));
    assert!(!bodies.push(wall(3, 0.0, None), true), "it comes too late and finds no room");
    assert_eq!((bodies.all().len(), bodies.yielding(), bodies.dropped()), (2, 1, 1));
    let copy = bodies.clone();
    assert_eq!((copy.room(), &copy), (2, &bodies));
    let mut small = BodyContacts::new(1);
    assert!(!small.copy_from(&bodies) && small.all().is_empty());
}
