//! Steps that stall, poses that jump and clocks that run backwards, while the tool presses a patch of tissue: the force
//! stays finite and within its limits, changes no faster than its slew, and goes to zero where it must.

use crate::sheet::{Ball, Sheet, at, pose};
use nalgebra::Vector3;
use palpate_haptics::device::{DeviceSpec, TickTime};
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::{PatchTickConfig, Tick, TickConfig, TickState, TickWorkspace};

const RADIUS: f64 = 5e-3;
const MAX_FORCE: f64 = 3.0;
/// Defaults of the limits (N/s, s).
const SLEW: f64 = 2000.0;
const STALE_AFTER: f64 = 0.2;
const STALE_ZERO: f64 = 0.5;

/// A tick with the default limits on a device of 3 N, and the step that it takes snapshots from.
struct Rig {
    tick: Tick,
    state: TickState,
    ws: TickWorkspace,
    ball: Ball,
    snapshot: HapticSnapshot,
    index: u64,
    sent: Vector3<f64>,
}

impl Rig {
    fn new() -> Self {
        Self::at(1e-3)
    }

    /// With a tick every `period` (s).
    fn at(period: f64) -> Self {
        let spec = DeviceSpec { max_force: MAX_FORCE, ..DeviceSpec::virtual_device(0.0) };
        let ball = Ball::at_nodes(RADIUS);
        let (tool, detection) = (ball.shape.clone().into(), ball.detection);
        let patch =
            PatchTickConfig { tool, detection, max_nodes: 40, max_bodies: 0, hand_over: PatchTickConfig::HAND_OVER };
        let config = TickConfig { period, ..TickConfig::for_device(&spec) };
        let tick = Tick::new(&config, &spec).and_then(|tick| tick.on_patches(patch)).unwrap();
        let (state, ws) = (tick.state(40), tick.workspace(40));
        let snapshot = HapticSnapshot::with_patch(40, 40);
        Self { tick, state, ws, ball, snapshot, index: 0, sent: Vector3::zeros() }
    }

    fn step(&mut self) {
        self.step_at(pressed());
    }

    fn step_at(&mut self, tool: Vector3<f64>) {
        let (number, place) = (self.snapshot.step + 1, pose(tool));
        Sheet { friction: 0.3, ..Sheet::springs(1e-3) }.fill(&mut self.snapshot, number, &self.ball, &place);
    }

    /// A tick, and what must hold in every one.
    fn tick(&mut self, position: Vector3<f64>, dt: f64) -> TickRecord {
        let time = TickTime { index: self.index, time: self.index as f64 * 1e-3, dt, host_lead: None };
        self.index += 1;
        let record = self.tick.tick(&mut self.state, &self.snapshot, &at(position), time, &mut self.ws);
        let force = record.wrench.force;
        assert!(record.wrench.is_finite() && record.contact_wrench.is_finite() && force.norm() <= MAX_FORCE + 1e-12);
        let allowed = if dt > 0.0 && dt < 0.05 { SLEW * dt } else { SLEW * 1e-3 };
        let ended = record.flags.contains(TickFlags::BAD_POSE) || record.flags.contains(TickFlags::NON_FINITE);
        assert!((force - self.sent).norm() <= allowed * (1.0 + 1e-9) || ended, "{} N in a tick", force - self.sent);
        self.sent = force;
        record
    }

    /// Presses for a second with steps at 30 Hz; the force at its end.
    fn press(&mut self) -> f64 {
        for k in 0..990 {
            if k % 33 == 0 {
                self.step();
            }
            self.tick(pressed(), 1e-3);
        }
        self.sent.norm()
    }
}

fn pressed() -> Vector3<f64> {
    Vector3::z() * (RADIUS - 1e-3)
}

#[test]
fn a_step_that_stalls_fades_the_force_out_and_its_return_fades_it_in() {
    for (stall, lost) in [(0.1, false), (1.0, true), (10.0, true)] {
        let mut rig = Rig::new();
        let full = rig.press();
        assert!(full > 0.3, "{full} N");
        // The snapshot in use is 33 ms old by now.
        for k in 0..(stall * 1e3) as u32 {
            let record = rig.tick(pressed(), 1e-3);
            let age = record.snapshot_age;
            let share = ((STALE_ZERO - age) / (STALE_ZERO - STALE_AFTER)).clamp(0.0, 1.0);
            assert!((record.wrench.force.norm() - share * full).abs() < 1e-3 * full, "stalled for {k} ms, age {age}");
            assert_eq!(record.flags.contains(TickFlags::STALE), age > STALE_AFTER, "{age}");
        }
        assert_eq!(rig.sent == Vector3::zeros(), lost, "stalled for {stall} s");
        rig.step();
        let back = rig.tick(pressed(), 1e-3).wrench.force.norm();
        assert!(if lost { back < 0.01 * full } else { (back - full).abs() < 1e-3 * full }, "{back} of {full}");
        assert!((rig.press() - full).abs() < 1e-3 * full, "it is what it was");
    }
}

#[test]
fn without_any_snapshot_there_is_no_force_for_as_long_as_it_takes() {
    let mut rig = Rig::new();
    for _ in 0..5000 {
        let record = rig.tick(pressed(), 1e-3);
        assert!(record.flags.contains(TickFlags::NO_SNAPSHOT) && record.wrench.force == Vector3::zeros());
    }
    assert!(rig.press() > 0.3, "and the first one that comes serves");
}

#[test]
fn a_pose_that_jumps_by_a_tenth_of_a_metre_in_a_tick_sends_no_wild_force() {
    let jumps = [Vector3::x(), -Vector3::x(), Vector3::z(), -Vector3::z(), Vector3::new(0.6, 0.0, -0.8)];
    for jump in jumps.map(|direction| direction * 0.1) {
        for stays in [1, 5, 200] {
            let mut rig = Rig::new();
            let full = rig.press();
            for _ in 0..stays {
                let record = rig.tick(pressed() + jump, 1e-3);
                assert!(record.flags.contains(TickFlags::BEYOND_PATCH), "{jump}");
            }
            if jump.z >= 0.0 && stays == 200 {
                assert_eq!(rig.sent, Vector3::zeros(), "it is off the skin");
            }
            for _ in 0..400 {
                rig.tick(pressed(), 1e-3);
            }
            let back = rig.press();
            // Friction may have dragged the skin along: its share of the force is not what it was.
            assert!((back - full).abs() < 0.35 * full, "{jump}, {stays} ticks: {back} of {full}");
        }
    }
}

#[test]
fn a_tool_that_jumped_gives_no_force_until_it_is_out_or_back() {
    // To the side, where the skin is pressed as deep: the contact that is found there is not one that the hand made.
    let beside = pressed() + Vector3::new(22e-3, 0.0, 0.0);
    let mut rig = Rig::new();
    let full = rig.press();
    for k in 0..600 {
        if k % 33 == 0 {
            rig.step_at(beside);
        }
        let record = rig.tick(beside, 1e-3);
        assert!(record.flags.contains(TickFlags::JUMPED), "tick {k}");
        assert!(k < 2 || record.wrench.force == Vector3::zeros(), "tick {k}: {}", record.wrench.force);
    }
    // Back where it was: a ramp.
    let back = rig.tick(pressed(), 1e-3);
    assert!(!back.flags.contains(TickFlags::JUMPED) && back.flags.contains(TickFlags::FADE_IN));
    assert!(back.wrench.force.norm() < 0.02 * full, "{} of {full} N", back.wrench.force.norm());

    // Jumped again, and lifted out by a hand: it is free there, and the next press is felt.
    let mut rig = Rig::new();
    rig.press();
    (0..200).for_each(|_| _ = rig.tick(beside, 1e-3));
    let lift = |k: u32| beside + Vector3::z() * 1e-4 * f64::from(k.min(100));
    for k in 0..200 {
        if k % 33 == 0 {
            rig.step_at(lift(k));
        }
        rig.tick(lift(k), 1e-3);
    }
    assert!(!rig.tick(lift(100), 1e-3).flags.contains(TickFlags::JUMPED));
    for k in 0..=100 {
        let z = lift(100).z;
        let share = f64::from(k) / 100.0;
        rig.tick(Vector3::new(beside.x * (1.0 - share), 0.0, z), 1e-3);
    }
    for k in 0..=100 {
        rig.tick(pressed() + Vector3::z() * (1e-2 - 1e-4 * f64::from(k)), 1e-3);
    }
    assert!((rig.press() - full).abs() < 0.35 * full);
}

#[test]
fn a_motion_that_a_hand_can_make_is_no_jump() {
    // 3 m/s for 0.1 m, and an encoder that slips by 19 mm in one tick.
    let mut rig = Rig::new();
    rig.press();
    for k in 0..33 {
        let record = rig.tick(pressed() + Vector3::x() * 3e-3 * f64::from(k), 1e-3);
        assert!(!record.flags.contains(TickFlags::JUMPED), "tick {k}");
    }
    let mut rig = Rig::new();
    rig.press();
    assert!(!rig.tick(pressed() + Vector3::x() * 19e-3, 1e-3).flags.contains(TickFlags::JUMPED));
    // 20 m/s, over several ticks.
    let mut rig = Rig::new();
    rig.press();
    let jumped: Vec<bool> = (0..10)
        .map(|k| rig.tick(pressed() + Vector3::x() * 7e-3 * f64::from(k), 1e-3).flags.contains(TickFlags::JUMPED))
        .collect();
    assert_eq!(jumped.iter().position(|jumped| *jumped), Some(3), "after 21 mm: {jumped:?}");
}

/// Every tick of a day, at 25 Hz: the tool presses for two seconds of each minute and is away for the rest. Counts are exact at
/// its end, times too, and the forces of the last minute are those of the first to the bit: nothing adds up.
#[test]
fn in_a_day_of_ticks_no_count_drifts_and_the_last_minute_is_the_first_to_the_bit() {
    const RATE: u64 = 25;
    const MINUTE: u64 = 60 * RATE;
    const DAY: u64 = 24 * 60 * MINUTE;
    let (mut rig, mut first, mut last, mut active) = (Rig::at(1.0 / RATE as f64), Vec::new(), Vec::new(), 0);
    rig.step();
    for index in 0..DAY {
        let (minute, k) = (index / MINUTE, index % MINUTE);
        rig.snapshot.step += u64::from(k % 5 == 0 && index > 0);
        // Down by a millimetre and up again within two seconds, from 9 mm above the skin.
        let way = (std::f64::consts::PI * k.min(2 * RATE) as f64 / RATE as f64).cos();
        let place = pressed() + Vector3::z() * (5e-3 * (1.0 + way));
        let time = TickTime { index, time: index as f64 / RATE as f64, dt: rig.tick.period(), host_lead: None };
        let record = rig.tick.tick(&mut rig.state, &rig.snapshot, &at(place), time, &mut rig.ws);
        active += u64::from(record.active > 0);
        match minute {
            0 => first.push(record),
            1439 => last.push(record),
            _ => assert!(record.wrench.force.norm() <= MAX_FORCE + 1e-12),
        }
    }
    let touched = first.iter().filter(|record| record.active > 0).count() as u64;
    assert!(touched > RATE / 4 && first.iter().any(|record| record.wrench.force.norm() > 0.1), "{touched} ticks");
    assert_eq!(active, 1440 * touched);
    assert_eq!(rig.snapshot.step, DAY / 5);
    for (k, (a, b)) in first.iter().zip(&last).enumerate() {
        let since = (DAY - MINUTE) as usize + k;
        assert_eq!((b.index, b.time), (since as u64, since as f64 / RATE as f64));
        assert_eq!(b.snapshot_step - a.snapshot_step, (DAY - MINUTE) / 5);
        // The force has come in by its ramp in the first seconds of the day.
        if k > RATE as usize {
            assert_eq!(
                (a.wrench, a.contact_wrench, a.tool_pose),
                (b.wrench, b.contact_wrench, b.tool_pose),
                "tick {k}"
            );
            assert_eq!((a.snapshot_age, a.gain, a.active), (b.snapshot_age, b.gain, b.active), "tick {k}");
        }
    }
}

/// The last two seconds of a day at 1 kHz by a measured clock against the first two: times are differences of large numbers by then.
#[test]
fn after_a_day_the_counts_are_exact_and_the_forces_are_those_of_the_first_seconds() {
    const DAY: u64 = 86_400_000;
    let run = |first: u64| {
        let mut rig = Rig::new();
        let (mut before, mut records) = (first as f64 * 1e-3 - 1e-3, Vec::new());
        for k in 0..2000 {
            if k % 33 == 0 {
                rig.step();
                rig.snapshot.step += first / 33;
            }
            let index = first + k;
            let time = TickTime { index, time: index as f64 * 1e-3, dt: index as f64 * 1e-3 - before, host_lead: None };
            before = time.time;
            let way = Vector3::z() * 1e-3 * (time_of(k) * 9.0).sin();
            records.push(rig.tick.tick(&mut rig.state, &rig.snapshot, &at(pressed() - way), time, &mut rig.ws));
        }
        records
    };
    let (young, old) = (run(0), run(DAY));
    assert!(young.last().unwrap().wrench.force.norm() > 0.1);
    for (k, (a, b)) in young.iter().zip(&old).enumerate() {
        assert_eq!((b.index, b.active), (DAY + k as u64, a.active));
        // The ramp ends in this tick or the next.
        let but_fading = |r: &TickRecord| r.flags.bits() & !TickFlags::FADE_IN.bits();
        assert_eq!(but_fading(a), but_fading(b), "tick {k}");
        assert!((b.time - 86_400.0 - time_of(k as u64)).abs() < 2e-11, "{}", b.time);
        // The difference of two times of a day has lost 1.5e-11 s of 1e-3 s, and a ramp of 300 of them as often.
        assert!((a.wrench.force - b.wrench.force).norm() < 1e-7 * (1.0 + a.wrench.force.norm()), "tick {k}");
        assert!((a.snapshot_age - b.snapshot_age).abs() < 1e-9);
        assert!((a.energy.translation - b.energy.translation).abs() < 1e-9, "tick {k}");
    }
}

fn time_of(tick: u64) -> f64 {
    tick as f64 * 1e-3
}

#[test]
fn a_clock_that_goes_backwards_or_stops_gives_a_ramp_and_no_more() {
    for dt in [-1e-3, -10.0, 0.0, f64::NAN, f64::NEG_INFINITY, f64::INFINITY] {
        let mut rig = Rig::new();
        let full = rig.press();
        for _ in 0..10 {
            let record = rig.tick(pressed(), dt);
            assert!(record.flags.contains(TickFlags::GAP), "{dt}");
            assert!(record.wrench.force.norm() <= full * (1.0 + 1e-9));
        }
        assert!(rig.press() > 0.99 * full, "{dt}: it goes on");
    }
}
