//! Steps as fast as ticks: what each of them knows reaches the hand.

use nalgebra::Vector3;

use crate::sheet::{Ball, Bench, Sheet, middle, pose, stiff};

const RADIUS: f64 = 10e-3;
/// Compliance of a node (m/N).
const C: f64 = 2e-3;
const TICK: f64 = 1e-3;

/// Depth (m) at which only one node is touched.
const DEPTH: f64 = 1.8e-3;

/// Over the node in the middle.
fn over(depth: f64) -> Vector3<f64> {
    Vector3::new(0.0, 0.0, RADIUS - depth)
}

#[test]
fn snapshots_as_often_as_ticks_are_followed() {
    let ball = Ball::at_nodes(RADIUS);
    // A third of a step of a tick's length: over before the next tick.
    for hand_over in [TICK / 3.0, 0.0] {
        let mut bench = Bench::new(&ball, hand_over, stiff);
        let mut last = 0.0;
        for k in 0..200_u64 {
            // The ball stays 1.8 mm deep; the sheet sinks by a millimetre in 50 ms, and rests.
            let sunk = 1e-3 * (k as f64 / 50.0).min(1.0);
            let mut snapshot =
                Sheet { lift: Vector3::z() * -sunk, ..Sheet::springs(C) }.snapshot(k + 1, &ball, &pose(over(DEPTH)));
            snapshot.dt = TICK;
            let n = middle(&snapshot);
            // As a step leaves it, in touch with the ball.
            snapshot.patch.q_free_mut()[n] = Vector3::z() * -DEPTH;
            snapshot.patch.force_mut()[n] = Vector3::z() * (-(DEPTH - sunk) / C);
            snapshot.patch.relieve();
            last = bench.at(&snapshot, over(DEPTH)).contact_wrench.force.z;
            let expected = (DEPTH - sunk) / C;
            assert!((last - expected).abs() < 0.02 * expected, "tick {k}, {hand_over} s: {last} N, {expected} N");
        }
        assert!((last - (DEPTH - 1e-3) / C).abs() < 0.01 * last);
    }
}
