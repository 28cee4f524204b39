//! Ticks without device, threads and clock: what the local contact problem costs by number of contacts.
//!
//! The snapshot is that of a fist in the liver; the tool circles about its pose, in and out of the skin, and every 33
//! ticks the snapshot counts as new, so that forces and shape are taken over as in a run.

use std::f64::consts::TAU;
use std::time::Instant;

use cpu_time::ThreadTime;
use nalgebra::{Isometry3, Translation3};
use palpate::haptics::coupling::CouplingConfig;
use palpate::haptics::device::{DeviceSample, DeviceSpec, TickTime};
use palpate::haptics::snapshot::HapticSnapshot;
use palpate::haptics::tick::{PatchTickConfig, Tick, TickConfig};
use palpate::summary::Tail;
use palpate::world::World;

use crate::organ::patch::Patch;
use crate::organ::{CELLS, liver, pool, press, under_ball};
use crate::table::{Histogram, MICROSECONDS, head, line};

/// Radius of the circle along the skin and amplitude of the motion into it (m); turns in a second.
pub(crate) const CIRCLE: f64 = 2e-3;
pub(crate) const PRESS: f64 = 1e-3;
pub(crate) const TURNS: f64 = 2.0;

/// Ticks to a snapshot.
const TICKS_PER_STEP: u64 = 33;

/// Ticks before times and allocations count.
const WARM_UP: u64 = 200;

/// Contacts of a tick, the nodes of its patch, and what to reach (median and p99.9).
pub(crate) const LOCAL: [(usize, usize, &str); 2] = [
    (10, 40, "to reach: p50 < 30, p99.9 < 120; SOFA at 36 rows: p50 47"),
    (45, 64, "to reach: p50 < 100, p99.9 < 300; SOFA at 135 rows: p50 483 (LCP) to 801 (NNCG)"),
];

/// What SOFA's haptic call showed on such a machine.
const SOFA: &str = "SOFA's LCPForceFeedback on a machine like this: 15 to 864 allocations a call; worst call 4.5 to 6.2 ms \
                    while its simulation runs";

/// The tick as a run of this scene has it, on rows of a snapshot.
fn tick_of(world: &World) -> Tick {
    let scene = world.description();
    let spec = DeviceSpec::virtual_device(scene.device.mechanics.encoder_step);
    let config = TickConfig {
        period: 1.0 / scene.rates.tick,
        sweeps: scene.solver.tick_sweeps,
        tolerance: scene.solver.tick_tolerance,
        coupling: CouplingConfig::for_device(&spec),
        passivity: scene.passivity,
        limits: scene.limits,
    };
    Tick::new(&config, &spec).expect("the bundled scene's tick is valid")
}

/// The same on patches, with so many contacts.
fn local_tick_of(world: &World, contacts: usize) -> Tick {
    let mut detection = *world.detection();
    detection.max_contacts = contacts;
    let (tool, max_nodes, hand_over) = (world.tool().clone(), world.patch_nodes(), world.description().tick.hand_over);
    let patch = PatchTickConfig { tool, detection, max_nodes, max_bodies: world.body_contacts(), hand_over };
    tick_of(world).on_patches(patch).expect("the bundled scene's patch is valid")
}

/// What ticks alone showed.
struct Alone {
    work: Tail,
    cpu: Tail,
    histogram: Histogram,
    sweeps: Tail,
    active: Tail,
    not_converged: u64,
    allocations: u32,
}

fn run(tick: &Tick, mut snapshot: HapticSnapshot, ticks: u64) -> Alone {
    let contacts = snapshot.max_contacts();
    let (mut state, mut ws) = (tick.state(contacts), tick.workspace(contacts));
    let mut outgoing = snapshot.clone();
    let mut seen = Alone {
        work: Tail::new(1e-9),
        cpu: Tail::new(1e-9),
        histogram: Histogram::default(),
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
        let (start, cpu) = (Instant::now(), ThreadTime::now());
        let record = assert_no_alloc::assert_no_alloc(|| {
            if swap {
                tick.weigh_outgoing(&mut state, &outgoing, &sample, &mut ws);
            }
            tick.tick(&mut state, &snapshot, &sample, time, &mut ws)
        });
        let (cpu, work) = (cpu.elapsed().as_secs_f64(), start.elapsed().as_secs_f64());
        if index >= WARM_UP {
            seen.work.record(work);
            seen.histogram.record(work);
            seen.cpu.record(cpu);
            seen.sweeps.record(f64::from(record.sweeps));
            seen.active.record(f64::from(record.active));
            seen.not_converged += u64::from(record.flags.contains(palpate::tick::TickFlags::NOT_CONVERGED));
        }
    }
    seen.allocations = assert_no_alloc::violation_count();
    seen
}

/// Two lines of times; what else there is to say.
fn report(what: &str, seen: &Alone, target: &str) -> String {
    line(&format!("{what}, wall"), &seen.work.percentiles(), MICROSECONDS, target);
    line(&format!("{what}, cpu"), &seen.cpu.percentiles(), MICROSECONDS, "");
    let (sweeps, active) = (seen.sweeps.percentiles(), seen.active.percentiles());
    format!(
        "{what}: {:.0} carried force at the median; sweeps {:.0} at the median, {:.0} at p99; {} ticks ended at their \
         bound of sweeps; allocations: {}\n{what}, wall: {}",
        active.p50, sweeps.p50, sweeps.p99, seen.not_converged, seen.allocations, seen.histogram
    )
}

/// Ticks on snapshots with each of these numbers of frozen contacts, and on patches; prints their tails.
pub(crate) fn measure(frozen: &[usize], ticks: u64) {
    let mut notes = Vec::new();
    head(&format!("{ticks} ticks alone"));
    for (contacts, nodes, target) in LOCAL {
        let world = liver(CELLS[1], |scene| {
            under_ball(scene);
            scene.tick.patch_nodes = nodes;
        });
        let snapshot = pool(1).install(|| press(&world).0.snapshot().clone());
        let what = format!("{contacts} contacts, {} nodes", snapshot.patch.len());
        notes.push(report(&what, &run(&local_tick_of(&world, contacts), snapshot, ticks), target));
    }
    let world = liver(CELLS[1], under_ball);
    let patches: Vec<Patch> = pool(1).install(|| {
        let (simulation, _) = press(&world);
        frozen.iter().map(|&contacts| Patch::of(&simulation, contacts)).collect()
    });
    for patch in patches {
        let what = format!("{} frozen contacts", patch.contacts());
        notes.push(report(&what, &run(&tick_of(&world), patch.snapshot, ticks), ""));
    }
    notes.iter().for_each(|note| println!("{note}"));
    println!("{SOFA}");
}
