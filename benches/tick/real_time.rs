//! The bundled scene on its threads against the clock, watched from outside.

use palpate::prelude::*;
use palpate::step::{StepReport, StepTimes};
use palpate::summary::Tail;
use palpate::tick::TickReport;

use crate::organ::pool;
use crate::table::{MICROSECONDS, MILLISECONDS, head, line};

/// Steps that are left out of the count of allocations while memory is warmed up.
const WARM_UP: usize = 20;

/// A stage of the step and its time (s).
type Stage = (&'static str, fn(&StepTimes) -> f64);

const STAGES: [Stage; 7] = [
    ("assembly", |t| t.assembly),
    ("free motion", |t| t.free_motion),
    ("detection", |t| t.detection),
    ("rows and compliance", |t| t.compliance),
    ("solve", |t| t.solve),
    ("correction", |t| t.correction),
    ("hand over", |t| t.hand_over),
];

/// Gathers what the summary of a run does not hold.
struct Gathered {
    touching_tick: Tail,
    stages: [Tail; STAGES.len()],
    /// Contacts found and contacts that carry force, of each step that touches.
    contacts: Vec<[usize; 2]>,
    tool: Vec<nalgebra::Isometry3<f64>>,
}

impl Observer for Gathered {
    fn step(&mut self, report: &StepReport) {
        for (tail, (_, time)) in self.stages.iter_mut().zip(STAGES) {
            tail.record(time(&report.times));
        }
        self.tool.push(report.tool);
        if report.active > 0 {
            self.contacts.push([report.detection.contacts, report.active]);
        }
    }

    fn tick(&mut self, report: &TickReport) {
        if report.record.active > 0 {
            self.touching_tick.record(report.work);
        }
    }
}

/// Runs the liver for `seconds` and prints its tails.
pub(crate) fn measure(seconds: f64) {
    let world = Scene::bundled("liver").and_then(|scene| scene.build()).expect("the scene is bundled");
    let tail = || Tail::new(1e-9);
    let mut gathered =
        Gathered { touching_tick: tail(), stages: STAGES.map(|_| tail()), contacts: Vec::new(), tool: Vec::new() };
    let options = RunOptions { length: Length::Seconds(seconds), ..RunOptions::default() };
    let outcome = run(&world, &options, &AtomicBool::new(false), &mut gathered).expect("the bundled scene runs");

    let s = &outcome.summary;
    println!("real time: {}, {} nodes, {} tetrahedra, {:.1} s", s.scene, s.nodes, s.tetrahedra, s.wall);
    head("");
    line("tick work", &s.tick_work, MICROSECONDS, "to reach: p99 < 150");
    line("tick work while touching", &gathered.touching_tick.percentiles(), MICROSECONDS, "to reach: p99 < 150");
    line("tick wake-up latency", &s.tick_latency, MICROSECONDS, "");
    line("step work", &s.step_work, MILLISECONDS, "to reach: p99 < 33");
    for (tail, (name, _)) in gathered.stages.iter().zip(STAGES) {
        line(&format!("  {name}"), &tail.percentiles(), MILLISECONDS, "");
    }
    line("factorisation", &s.factor_work, MILLISECONDS, "");
    let granted = !s.notes.iter().any(|note| note.contains("real-time priority"));
    println!(
        "tick thread under SCHED_FIFO: {}",
        if granted { "granted" } else { "refused by the system, so that these wake-ups are of SCHED_OTHER too" }
    );
    println!("overruns: step {}, tick {}", s.step_overruns, s.tick_overruns);
    println!("rates: step {:.1}, factor {:.1}, tick {:.1} Hz", s.step_rate, s.factor_rate, s.tick_rate);
    for (k, what) in ["contacts while touching", "of these with force"].iter().enumerate() {
        let mut counts: Vec<usize> = gathered.contacts.iter().map(|c| c[k]).collect();
        counts.sort_unstable();
        match counts.as_slice() {
            [] => println!("{what}: it did not touch"),
            [least, ..] => println!(
                "{what}: {least} / {} / {} (least / median / most; to measure: 10 to 20)",
                counts[counts.len() / 2],
                counts[counts.len() - 1]
            ),
        }
    }
    println!("conjugate-gradient iterations: median {:.0}, most {:.0}", s.iterations.p50, s.iterations.max);
    allocations_of_steps(&world, &gathered.tool);
    without_priority(&world, 0.5 * seconds);
}

/// Wake-ups of the same scene under ordinary scheduling.
fn without_priority(world: &World, seconds: f64) {
    let length = Length::Seconds(seconds);
    let options = RunOptions { length, real_time_priority: false, ..RunOptions::default() };
    let outcome = run(world, &options, &AtomicBool::new(false), &mut Unobserved).expect("the bundled scene runs");
    head("under SCHED_OTHER");
    line("tick wake-up latency", &outcome.summary.tick_latency, MICROSECONDS, "");
    println!("overruns of the tick: {}", outcome.summary.tick_overruns);
}

/// Steps again along the way that the tool went, and counts the allocations of the calling thread: those of the run's
/// own threads cannot be seen from outside.
fn allocations_of_steps(world: &World, tool: &[nalgebra::Isometry3<f64>]) {
    let (before, steps) = tool.split_at(WARM_UP.min(tool.len()));
    let violations = pool(1).install(|| {
        let mut simulation = Simulation::new(world).expect("the bundled scene has a factor");
        for pose in before {
            simulation.step(pose);
        }
        assert_no_alloc::reset_violation_count();
        for pose in steps {
            assert_no_alloc::assert_no_alloc(|| simulation.step(pose));
        }
        assert_no_alloc::violation_count()
    });
    println!(
        "allocations in {} steps with refactorisation, after {} to warm up: {violations}",
        steps.len(),
        before.len()
    );
}
