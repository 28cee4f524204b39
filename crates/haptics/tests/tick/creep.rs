//! Viscous tissue in the tick: how it holds against a touch, and how it goes on from snapshot to snapshot.

use nalgebra::Vector3;
use palpate_haptics::snapshot::HapticSnapshot;

use crate::sheet::{Ball, Bench, Sheet, middle, pose, stiff};

const RADIUS: f64 = 10e-3;
/// Compliance (m/N) of a step of 1/30 s, and β (s).
const C: f64 = 2e-3;
const BETA: f64 = 5e-3;
const STEP: f64 = 1.0 / 30.0;
const TICK: f64 = 1e-3;

/// Depth (m) at which only one node is touched.
const DEPTH: f64 = 1.8e-3;

/// Over the node in the middle, so deep that no other is touched.
fn over(depth: f64) -> Vector3<f64> {
    Vector3::new(0.0, 0.0, RADIUS - depth)
}

/// Uncoupled nodes at rest, which yield by C in a step, from a step that has the ball at this depth.
fn viscous(step: u64, ball: &Ball, depth: f64) -> HapticSnapshot {
    let mut snapshot = Sheet::springs(C).snapshot(step, ball, &pose(over(depth)));
    (snapshot.patch.viscosity, snapshot.dt) = (BETA, STEP);
    snapshot
}

/// Relaxation time (s) of a touch that is held.
const RELAXES: f64 = 3e-3;

/// Force of a spring in series with a spring and a damper side by side, by backward Euler, for the ways (m) of each
/// tick from 0. Together the springs are K, of which C = 1/(K (1 + β/h)).
fn three_elements(ways: &[f64]) -> Vec<f64> {
    let stiffness = 1.0 / (C * (1.0 + BETA / STEP));
    let creeps = BETA + RELAXES * (1.0 + BETA / STEP);
    let series = RELAXES / creeps;
    let (first, second) = (stiffness / series, stiffness / (1.0 - series));
    let damper = second * creeps / TICK;
    let mut inner = 0.0;
    let force = |way: &f64| {
        inner = (first * way + damper * inner) / (first + second + damper);
        first * (way - inner)
    };
    ways.iter().map(force).collect()
}

#[test]
fn a_touch_is_held_against_by_springs_with_a_damper_as_stiff_as_the_step_makes_them() {
    let ball = Ball::at_nodes(RADIUS);
    let snapshot = viscous(1, &ball, -1e-3);
    // 0.1 m/s for 5 ms, and a step at once, each with a rest.
    let (ramp, step): (Vec<f64>, Vec<f64>) = (1..60).map(|k| (1e-4 * f64::from(k.min(5)), 5e-4)).unzip();
    for ways in [ramp, step] {
        let mut bench = Bench::new(&ball, 10e-3, stiff);
        (0..5).for_each(|_| _ = bench.at(&snapshot, over(0.0)));
        let mut largest = 0.0_f64;
        for (k, (way, expected)) in ways.iter().zip(three_elements(&ways)).enumerate() {
            let force = bench.at(&snapshot, over(*way)).contact_wrench.force.z;
            // The coupling gives way by 0.1 um per newton, which the law makes 0.6.
            assert!((force - expected).abs() < 3e-3 * expected + 1e-9, "tick {k}: {force} N, {expected} N");
            largest = largest.max(force);
        }
        // No motion makes more than so many times the force that a step of the tissue would answer with.
        let bound = 1.0 + 1.0 / (RELAXES * (1.0 / BETA + 1.0 / STEP));
        assert!(largest < bound * 5e-4 / C, "{largest} N");
    }
    // Held for a step of backward Euler it has yielded by C: that is what C is.
    let mut once = Bench::new(&ball, 0.0, |config| {
        stiff(config);
        config.period = STEP;
        (config.limits.gap, config.limits.stale_after) = (1.0, 1e3);
    });
    let sample = |depth| palpate_haptics::device::DeviceSample::at_rest(0.0, pose(over(depth)));
    let time = |k| palpate_haptics::device::TickTime::regular(k, STEP);
    once.tick.tick(&mut once.state, &snapshot, &sample(0.0), time(0), &mut once.ws);
    let record = once.tick.tick(&mut once.state, &snapshot, &sample(5e-4), time(1), &mut once.ws);
    let force = record.contact_wrench.force.z;
    assert!((force - 5e-4 / C).abs() < 2e-3 * force, "{force} N");
}

#[test]
fn no_snapshot_of_tissue_in_motion_makes_the_force_jump() {
    let ball = Ball::at_nodes(RADIUS);
    let speed = 0.02;
    let mut bench = Bench::new(&ball, 10e-3, stiff);
    let mut snapshot = viscous(1, &ball, -1e-3);
    let mut before = 0.0;
    let (mut largest, mut jump) = (0.0_f64, 0.0_f64);
    for k in 0..40_u64 {
        let depth = 1e-3 + speed * TICK * k as f64;
        let record = if k == 20 {
            // A step that has the node where it is, with another force, another stiffness, and on its way.
            let mut new = viscous(2, &ball, depth - speed * TICK);
            let n = middle(&new);
            new.patch.compliance_mut().iter_mut().for_each(|c| *c *= 0.9);
            new.patch.q_free_mut()[n] = Vector3::z() * -depth;
            new.patch.force_mut()[n] = Vector3::z() * -(0.9 * before);
            new.patch.relieve();
            new.patch.drift_mut()[n] = Vector3::z() * (-0.6 * speed * STEP);
            new.patch.flow_mut()[n] = Vector3::z() * (-0.05 * speed * STEP);
            let record = bench.swap(&snapshot, &new, over(depth));
            snapshot = new;
            jump = record.force_jump;
            record
        } else {
            bench.at(&snapshot, over(depth))
        };
        let force = record.contact_wrench.force.z;
        if k > 15 {
            largest = largest.max((force - before).abs());
        }
        before = force;
    }
    // A steady press makes 0.009 N a tick, a ninth more of it by the new stiffness: that is all. A tenth of 0.6 N is
    // handed over in 10 ms.
    assert!(jump < 0.12 * speed * TICK / (C * (1.0 + BETA / STEP)), "{jump} N of {before} N");
    assert!(largest < 0.025, "{largest} N in a tick, of {before} N");
}

#[test]
fn snapshots_as_often_as_ticks_are_followed() {
    let ball = Ball::at_nodes(RADIUS);
    for viscosity in [0.0, BETA] {
        // A third of a step of a tick's length: over before the next tick.
        let mut bench = Bench::new(&ball, TICK / 3.0, stiff);
        let mut last = 0.0;
        for k in 0..200_u64 {
            // The ball stays 1.8 mm deep; the sheet sinks by a millimetre in 50 ms, and rests.
            let sunk = 1e-3 * (k as f64 / 50.0).min(1.0);
            let mut snapshot =
                Sheet { lift: Vector3::z() * -sunk, ..Sheet::springs(C) }.snapshot(k + 1, &ball, &pose(over(DEPTH)));
            (snapshot.patch.viscosity, snapshot.dt) = (viscosity, TICK);
            let n = middle(&snapshot);
            // As a step leaves it, in touch with the ball.
            snapshot.patch.q_free_mut()[n] = Vector3::z() * -DEPTH;
            snapshot.patch.force_mut()[n] = Vector3::z() * (-(DEPTH - sunk) / C);
            snapshot.patch.relieve();
            last = bench.at(&snapshot, over(DEPTH)).contact_wrench.force.z;
            let expected = (DEPTH - sunk) / C;
            assert!((last - expected).abs() < 0.02 * expected, "tick {k}, beta {viscosity} s: {last} N, {expected} N");
        }
        assert!((last - (DEPTH - 1e-3) / C).abs() < 0.01 * last);
    }
}
