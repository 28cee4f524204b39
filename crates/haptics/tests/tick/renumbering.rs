//! A cut numbers the skin's edges and triangles anew: does the tick go on elsewhere as if nothing had happened?

use crate::sheet::{Ball, Bench, Sheet, pose};
use nalgebra::Vector3;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::PatchTickConfig;

/// Of the ball (m).
const RADIUS: f64 = 15e-3;

/// Ticks between two steps, and the step whose snapshot has other numbers.
const STEP: u64 = 33;
const CUT: u64 = 10;

/// How a run numbers features from step [`CUT`] on.
#[derive(Clone, Copy, PartialEq)]
enum Numbers {
    Same,
    Other,
    /// Others, without saying so.
    OtherUntold,
}

/// A ball that is pressed into the sheet off its nodes, pushed aside within friction, and held: twenty steps, each of which looks at
/// where the tick has left the tool.
fn run(numbers: Numbers) -> Vec<TickRecord> {
    let ball = Ball::at_faces(RADIUS);
    let mut bench = Bench::new(&ball, PatchTickConfig::HAND_OVER, |_| ());
    let sheet = Sheet { friction: 0.8, coupling: 0.2, ..Sheet::springs(1e-3) };
    let mut snapshot = HapticSnapshot::with_patch(ball.detection.max_contacts, 40);
    let (mut records, mut tool) = (Vec::new(), pose(Vector3::z()));
    for k in 0..20 * STEP {
        let time = k as f64 * 1e-3;
        let aside = (time - 0.1).clamp(0.0, 0.1) * 8e-3;
        let place = Vector3::new(1.7e-3 + aside, 1.1e-3, RADIUS - 7e-3 * (time / 0.1).min(1.0));
        let swaps = k % STEP == 0;
        if swaps {
            let step = k / STEP;
            let sheet = Sheet { renumbered: numbers != Numbers::Same && step >= CUT, ..sheet };
            let before = snapshot.clone();
            sheet.fill(&mut snapshot, 1 + step, &ball, &tool);
            if numbers == Numbers::OtherUntold {
                snapshot.numbering = 0;
            }
            records.push(bench.swap(&before, &snapshot, place));
        } else {
            records.push(bench.at(&snapshot, place));
        }
        tool = records[records.len() - 1].tool_pose;
    }
    records
}

#[test]
fn forces_and_what_friction_holds_go_on_at_places_that_a_cut_leaves() {
    let (same, other, untold) = (run(Numbers::Same), run(Numbers::Other), run(Numbers::OtherUntold));
    let swap = (CUT * STEP) as usize;
    let at = &same[swap];
    assert!(at.flags.contains(TickFlags::NEW_SNAPSHOT) && at.active > 2, "{} of {} contacts", at.active, at.contacts);
    let force = at.contact_wrench.force;
    assert!(force.x < -0.05 && force.z > 0.3, "it presses and is pushed aside: {force}");
    let apart = |runs: &[TickRecord]| {
        let differences = same.iter().zip(runs).map(|(a, b)| (a.contact_wrench.force - b.contact_wrench.force).norm());
        differences.skip(swap).fold(0.0, f64::max)
    };
    let (told, not) = (apart(&other), apart(&untold));
    println!("of {:.3} N: {told:.1e} N apart, {not:.1e} N where features are taken for others", force.norm());
    // Contacts are swept in another order: to a relative 1e-9 in the tick of the cut, and to 3e-5 where the sweeps run out.
    let first = (at.contact_wrench.force - other[swap].contact_wrench.force).norm();
    assert!(first < 1e-8 * force.norm() && told < 1e-4 * force.norm(), "{first} N, {told} N");
    assert!(not > 100.0 * told, "{not} N: the numbers play no part here");
    assert!((other[swap].force_jump - at.force_jump).abs() < 1e-7, "{} N, {} N", other[swap].force_jump, at.force_jump);
    assert_eq!(
        same[..swap].len(),
        other.iter().zip(&same).take_while(|(a, b)| a == b).count(),
        "until then no bit differs"
    );
}
