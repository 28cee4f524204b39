//! The port's energy: the account is exact, and what the device gives out stays below what it took in.
#![allow(clippy::print_stdout)] // what was measured, for `--nocapture`

use std::collections::VecDeque;

use crate::rig::{Bench, Loop, PERIOD, Wall, at, fill, snapshot_of, strong_spec};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceSample, DeviceSpec, TickTime, VirtualDevice, VirtualDeviceConfig};
use palpate_haptics::hand::Hand;
use palpate_haptics::passivity::PassivityConfig;
use palpate_haptics::record::{TickFlags, TickRecord};
use palpate_haptics::script::HandScript;
use palpate_haptics::snapshot::HapticSnapshot;
use palpate_haptics::tick::TickConfig;
use palpate_haptics::wrench::{Twist, Wrench};

/// Encoder step of the devices here (m).
const ENCODER: f64 = 30e-6;

/// A generator of numbers in 0..1: Marsaglia's xorshift, the same on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A hand that nothing stops: sines of 0.3 to 10 Hz whose speeds are equal, about a depth.
struct Motion {
    waves: Vec<(f64, f64)>,
    depth: f64,
    speed: f64,
}

impl Motion {
    fn new(random: &mut Random, depth: f64, speed: f64) -> Self {
        let waves = (0..12).map(|k| (0.3 + 9.7 / 11.0 * f64::from(k), std::f64::consts::TAU * random.next()));
        Self { waves: waves.collect(), depth, speed }
    }

    fn at(&self, time: f64) -> Vector3<f64> {
        let z: f64 = self.waves.iter().map(|(f, phase)| (std::f64::consts::TAU * f * time + phase).sin() / f).sum();
        Vector3::z() * (z * self.speed / std::f64::consts::TAU / (self.waves.len() as f64).sqrt() - self.depth)
    }
}

/// One node of tissue on a spring and a damper, moved by implicit Euler steps with contact inside, as the step does it.
struct Tissue {
    z: f64,
    v: f64,
    step: u64,
}

impl Tissue {
    const MASS: f64 = 0.02;
    const DAMPING: f64 = 0.2;
    const STIFFNESS: f64 = 400.0;

    /// A step of length `h` (s) with the tool there; what the tick is told of it.
    fn advance(&mut self, h: f64, tool: &Isometry3<f64>) -> HapticSnapshot {
        let a = Self::MASS + h * Self::DAMPING + h * h * Self::STIFFNESS;
        let v_free = (Self::MASS * self.v - h * Self::STIFFNESS * self.z) / a;
        let (free, w) = (self.z + h * v_free, h * h / a);
        let force = ((free - tool.translation.z) / w).max(0.0);
        self.v = v_free - h / a * force;
        self.z += h * self.v;
        self.step += 1;
        let mut snapshot = HapticSnapshot::new(8);
        fill(&mut snapshot, self.step, &[Wall { w, offset: free, ..Wall::floor(w) }], tool);
        snapshot
    }
}

/// How the loop is disturbed.
#[derive(Clone, Copy, Debug)]
struct Case {
    /// Of the tissue (Hz).
    rate: f64,
    /// Ticks from a wrench to its effect.
    delay: usize,
    /// Share of a period by which a tick is early or late at most.
    jitter: f64,
    /// Share of a step that passes before it is told: its computing time, and as much again at random.
    computing: f64,
}

/// Ten seconds of the hand above.
struct Outcome {
    /// Least that the motors took in less what they gave out, since a contact began (J).
    lowest: f64,
    /// The same over all (J).
    net: f64,
    acted: usize,
    contacts: usize,
    largest_force: f64,
}

fn run(case: Case, control: bool, seed: u64) -> Outcome {
    let spec = DeviceSpec { delay_ticks: Some(case.delay), max_torque: 0.0, ..strong_spec() };
    let mut config = TickConfig::for_device(&spec);
    config.passivity.control = control;
    let mut bench = Bench::new(&config, &spec);
    let mut random = Random(seed);
    let motion = Motion::new(&mut random, 4e-3, 0.15);
    let mut tissue = Tissue { z: 0.0, v: 0.0, step: 0 };
    let (mut snapshot, mut told) = (HapticSnapshot::new(8), VecDeque::<(f64, HapticSnapshot)>::new());
    let (mut tool, mut next_step) = (Isometry3::identity(), 0.0);
    let mut time = 0.0;
    let (mut measured, mut velocity): (Option<Vector3<f64>>, _) = (None, Vector3::zeros());
    let mut sent = vec![Vector3::zeros(); case.delay + 1];
    let mut out = Outcome { lowest: 0.0, net: 0.0, acted: 0, contacts: 0, largest_force: 0.0 };
    let (mut before, mut touching) = (motion.at(0.0), false);
    let mut of_contact = 0.0_f64;
    for index in 0..10_000 {
        let dt = PERIOD * (1.0 + case.jitter * (2.0 * random.next() - 1.0));
        time += dt;
        let place = motion.at(time);
        // What the motors hold while the hand moves, to the last digit: no encoder in between.
        let taken_in = -sent[case.delay].dot(&(place - before));
        (out.net, of_contact) = (out.net + taken_in, of_contact + taken_in);
        out.lowest = out.lowest.min(of_contact);
        before = place;
        if time >= next_step {
            let h = 1.0 / case.rate;
            next_step += h;
            let computing = h * case.computing * (1.0 + random.next());
            told.push_back((time + computing, tissue.advance(h, &tool)));
        }
        while told.front().is_some_and(|(when, _)| *when <= time) {
            snapshot = told.pop_front().expect("there is one").1;
        }
        let encoded = (place / ENCODER).map(f64::round) * ENCODER;
        let difference = measured.replace(encoded).map_or(Vector3::zeros(), |last| (encoded - last) / dt);
        velocity += (difference - velocity) * -(-std::f64::consts::TAU * 100.0 * dt).exp_m1();
        let sample = DeviceSample { velocity: Twist { linear: velocity, ..Twist::default() }, ..at(encoded) };
        let moment = TickTime { index, time, dt, host_lead: None };
        let record = bench.tick.tick(&mut bench.state, &snapshot, &sample, moment, &mut bench.ws);
        tool = record.tool_pose;
        if record.energy.account == 0.0 && record.wrench == Wrench::zero() {
            of_contact = 0.0;
        }
        sent.rotate_right(1);
        sent[0] = record.wrench.force;
        out.acted += usize::from(record.flags.contains(TickFlags::PASSIVITY));
        out.contacts += usize::from(record.active > 0 && !touching);
        touching = record.active > 0;
        out.largest_force = out.largest_force.max(record.wrench.force.norm());
    }
    out
}

#[test]
fn random_motion_gets_no_energy_out_at_any_rate_of_the_tissue() {
    let mut worst_without = 0.0_f64;
    for rate in [10.0, 30.0, 100.0] {
        for (delay, jitter, computing) in [(0, 0.0, 0.0), (1, 0.0, 0.3), (1, 0.3, 0.5), (3, 0.4, 0.5), (1, 0.3, 2.0)] {
            let case = Case { rate, delay, jitter, computing };
            for seed in [1, 2_000_003] {
                let (off, on) = (run(case, false, seed), run(case, true, seed));
                println!(
                    "{rate:>4} Hz, motor {delay} ticks late, jitter {jitter}, computing {computing}: lowest energy {:.2} mJ \
                     without, {:.2} mJ with; net {:.1} and {:.1} mJ; acted in {} ticks of 10000, {} contacts, {:.2} and {:.2} N",
                    1e3 * off.lowest,
                    1e3 * on.lowest,
                    1e3 * off.net,
                    1e3 * on.net,
                    on.acted,
                    on.contacts,
                    off.largest_force,
                    on.largest_force,
                );
                worst_without = worst_without.min(off.lowest);
                assert_eq!(off.acted, 0);
                // The allowance, and what the prediction of a tick misses. Snapshots that come two to four steps late push a
                // hand that nothing stops by more than a damper takes that the device's mass bears.
                let least = if computing > 1.0 { (0.5 * off.lowest).min(-6e-4) } else { -6e-4 };
                assert!(on.lowest >= least, "{case:?}: {} J", on.lowest);
            }
        }
    }
    assert!(worst_without < -4e-3, "nothing to hold back: {worst_without} J");
}

#[test]
fn the_account_is_the_integral_of_the_force_over_the_way_behind_the_delay() {
    for delay in [0, 1, 4] {
        let spec = DeviceSpec { delay_ticks: Some(delay), ..strong_spec() };
        let mut config = TickConfig::for_device(&spec);
        config.passivity = PassivityConfig { control: false, memory: 1e3, ..PassivityConfig::default() };
        config.coupling.rotation = Some(palpate_haptics::coupling::Spring { stiffness: 1.0, damping: 0.01 });
        let mut bench = Bench::new(&config, &spec);
        let wall = Wall { normal: Vector3::new(0.0, 0.6, 0.8), ..Wall::floor(1e-3) }.with_friction(0.4);
        let snapshot = snapshot_of(1, &[wall], &Isometry3::identity());
        let mut records: Vec<TickRecord> = Vec::new();
        for k in 0..200 {
            let t = f64::from(k) * 0.05;
            let place = Vector3::new(2e-3 * t.sin(), 1e-3 * (1.7 * t).cos(), -3e-3 * (0.6 * t).sin());
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.3 * t.sin(), 0.1 * t));
            let pose = Isometry3::from_parts(place.into(), turn);
            records.push(bench.tick(&snapshot, &DeviceSample::at_rest(0.0, pose)));
        }
        let [mut by_force, mut by_torque] = [0.0_f64; 2];
        for k in 1..records.len() {
            let (here, before) = (&records[k].device_pose, &records[k - 1].device_pose);
            let held = (k - 1).checked_sub(delay).map_or(Wrench::zero(), |sent| records[sent].wrench);
            by_force -= held.force.dot(&(here.translation.vector - before.translation.vector));
            by_torque -= held.torque.dot(&(here.rotation * before.rotation.inverse()).scaled_axis());
            let energy = records[k].energy;
            // Sums of at most 200 terms of millijoules.
            assert!((energy.translation - by_force).abs() < 1e-15, "tick {k}, delay {delay}");
            assert!((energy.rotation - by_torque).abs() < 1e-15, "tick {k}, delay {delay}");
        }
        assert!(by_force.abs() > 1e-4, "{by_force} J");
    }
}

#[test]
fn the_account_is_closed_where_the_contact_has_been_over_for_the_stated_time() {
    let mut bench = Bench::strong();
    let snapshot = snapshot_of(1, &[Wall::floor(1e-3)], &Isometry3::identity());
    (0..400).for_each(|k| _ = bench.tick(&snapshot, &at(Vector3::z() * -1e-5 * f64::from(k))));
    let pressed = bench.tick(&snapshot, &at(Vector3::z() * -4e-3));
    assert!(pressed.energy.account > 1e-4, "{:?}", pressed.energy);
    let up = |k: i32| Vector3::z() * (-4e-3 + 1e-3 * f64::from(k.min(9)));
    let free: Vec<_> = (0..130).map(|k| bench.tick(&snapshot, &at(up(k)))).collect();
    // A tenth of a second after the last force has had its effect.
    let last = free.iter().rposition(|r| r.wrench != Wrench::zero()).map_or(0, |k| k + 1);
    let closed = free.iter().position(|r| r.energy.account == 0.0).expect("it closes");
    assert!((closed as i64 - last as i64 - 100).abs() <= 3, "force until {last}, closed at {closed}");
    assert_ne!(free[129].energy.translation, 0.0, "the sum since the start goes on");
}

#[test]
fn a_released_device_on_too_stiff_a_coupling_swings_up_without_and_not_with() {
    let run = |control: bool| {
        let hand = Hand::preset("none").unwrap();
        let device = VirtualDevice::new(VirtualDeviceConfig::ideal(1), hand, HandScript::at(Vector3::zeros())).unwrap();
        let device = device.with_velocity(Vector3::z() * 0.05);
        let mut config = TickConfig::for_device(&DeviceSpec::virtual_device(0.0));
        // Twice what holds against any wall.
        config.coupling.translation.stiffness = 1700.0;
        config.passivity.control = control;
        let walls = vec![Wall::floor(1.0 / 800.0), Wall { normal: -Vector3::z(), ..Wall::floor(1.0 / 800.0) }];
        let mut rig = Loop::with_config(device, walls, &config);
        let mut peaks = [0.0_f64; 4];
        for index in 0..4000 {
            rig.tick();
            peaks[index / 1000] = peaks[index / 1000].max(rig.device.velocity().norm());
        }
        peaks
    };
    let (off, on) = (run(false), run(true));
    println!("largest speed in each second (m/s): without {off:?}, with {on:?}");
    assert!(off[3] > 0.5, "{off:?}");
    // Motion below twice the least speed is left to the hand.
    assert!(on[3] < 0.05, "{on:?}");
}
