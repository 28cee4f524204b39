//! Ticks without device, threads and clock: what the local contact problem costs by number of contacts.
//!
//! The snapshot is that of a fist in the liver; the tool circles about its pose, in and out of the skin, and every 33
//! ticks the snapshot counts as new, so that forces are matched and `W` is taken over as in a run.

use std::f64::consts::TAU;
use std::time::Instant;

use nalgebra::{Isometry3, Translation3};
use palpate::haptics::coupling::CouplingConfig;
use palpate::haptics::device::{DeviceSample, DeviceSpec, TickTime};
use palpate::haptics::snapshot::HapticSnapshot;
use palpate::haptics::tick::{Tick, TickConfig, TickState, TickWorkspace};
use palpate::summary::Tail;
use palpate::world::World;

use crate::organ::patch::Patch;
use crate::organ::{CELLS, liver_under_ball, pool, press};
use crate::table::{MICROSECONDS, head, line};

/// Radius of the circle along the skin and amplitude of the motion into it (m); turns in a second.
const CIRCLE: f64 = 2e-3;
const PRESS: f64 = 1e-3;
const TURNS: f64 = 2.0;

/// Ticks to a snapshot.
const TICKS_PER_STEP: u64 = 33;

/// Ticks before times and allocations count.
const WARM_UP: u64 = 200;

/// The tick as a run of this scene has it.
fn tick_of(world: &World) -> Tick {
    let scene = world.description();
    let spec = DeviceSpec::virtual_device(scene.device.mechanics.encoder_step);
    let config = TickConfig {
        period: 1.0 / scene.rates.tick,
        sweeps: scene.solver.tick_sweeps,
        tolerance: scene.solver.tick_tolerance,
        coupling: CouplingConfig::for_device(&spec),
        limits: scene.limits,
    };
    Tick::new(&config, &spec).expect("the bundled scene's tick is valid")
}

/// What ticks alone showed.
struct Alone {
    work: Tail,
    sweeps: Tail,
    active: Tail,
    not_converged: u64,
    allocations: u32,
}

fn run(world: &World, mut snapshot: HapticSnapshot, ticks: u64) -> Alone {
    let tick = tick_of(world);
    let contacts = snapshot.max_contacts();
    let (mut state, mut ws) = (TickState::new(contacts), TickWorkspace::new(contacts));
    let mut outgoing = snapshot.clone();
    let mut seen = Alone {
        work: Tail::new(1e-9),
        sweeps: Tail::new(1.0),
        active: Tail::new(1.0),
        not_converged: 0,
        allocations: 0,
    };
    for index in 0..WARM_UP + ticks {
        let time = TickTime::regular(index, tick.period());
        let phase = TAU * TURNS * time.time;
        let motion = Translation3::new(CIRCLE * phase.cos(), PRESS * (1.7 * phase).sin(), CIRCLE * phase.sin());
        let pose: Isometry3<f64> = motion * snapshot.tool_pose;
        let sample = DeviceSample::at_rest(time.time, pose);
        let swap = index % TICKS_PER_STEP == 0;
        if swap {
            outgoing.step = snapshot.step;
            snapshot.step += 1;
        }
        if index == WARM_UP {
            assert_no_alloc::reset_violation_count();
        }
        let start = Instant::now();
        let record = assert_no_alloc::assert_no_alloc(|| {
            if swap {
                tick.weigh_outgoing(&mut state, &outgoing, &sample, &mut ws);
            }
            tick.tick(&mut state, &snapshot, &sample, time, &mut ws)
        });
        let work = start.elapsed().as_secs_f64();
        if index >= WARM_UP {
            seen.work.record(work);
            seen.sweeps.record(f64::from(record.sweeps));
            seen.active.record(f64::from(record.active));
            seen.not_converged += u64::from(record.flags.contains(palpate::tick::TickFlags::NOT_CONVERGED));
        }
    }
    seen.allocations = assert_no_alloc::violation_count();
    seen
}

/// Ticks on snapshots with each of these numbers of contacts, and prints their tails.
pub(crate) fn measure(contacts: &[usize], ticks: u64) {
    let world = liver_under_ball(CELLS[1]);
    let patches: Vec<Patch> = pool(1).install(|| {
        let (simulation, _) = press(&world);
        contacts.iter().map(|&contacts| Patch::of(&simulation, contacts)).collect()
    });
    head(&format!("{ticks} ticks alone"));
    let mut notes = Vec::new();
    for patch in patches {
        let (found, active) = (patch.contacts(), patch.active);
        let seen = run(&world, patch.snapshot, ticks);
        line(&format!("work with {found} contacts"), &seen.work.percentiles(), MICROSECONDS, "to reach: p99 < 150");
        let (sweeps, in_tick) = (seen.sweeps.percentiles(), seen.active.percentiles());
        notes.push(format!(
            "{found} contacts: {active} carried force in the step, {:.0} in a tick at the median; sweeps {:.0} at the \
             median, {:.0} at p99; {} ticks ended at their bound of sweeps; allocations: {}",
            in_tick.p50, sweeps.p50, sweeps.p99, seen.not_converged, seen.allocations
        ));
    }
    notes.iter().for_each(|note| println!("{note}"));
}
