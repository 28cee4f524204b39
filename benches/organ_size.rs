//! The bundled palpation (frictional, hyperelastic) by size of the organ: what a step costs, what it is made of, how far
//! its force is from that of exact steps, and the largest organ that a step at 30 Hz has time for.
//!
//! `cargo bench --bench organ_size [-- NODES... tolerance=T]`: about as many nodes, without 1,000 to 9,400, and the relative
//! residual of the free motion and the correction; `sampling=S`: the share of a step for comparing a column of the compliance.
//! `cargo bench --bench organ_size -- alive [NODES...]` plays livers in real time with all threads instead, some ten seconds each.
//! Else the factor is of the matrix of a step, ten times a second or as often as it can be made, and serves from the first step
//! after the time that making it takes here on one core, by the processor; the thread that would make it, which shares cores and
//! memory with the step, is not there. On one core times are those of the processor, which other work on the machine disturbs least;
//! on two they are those of the clock, and want a quiet machine.

#![allow(clippy::print_stdout)]

use std::time::Instant;

use cpu_time::ThreadTime;
use nalgebra::{Isometry3, Translation3, Vector3};
use palpate::constraints::compliance::ComplianceMethod;
use palpate::haptics::script::HandScript;
use palpate::simulation::Simulation;
use palpate::step::{StepReport, StepTimes};
use palpate::world::World;

#[path = "organ/alive.rs"]
mod alive;
mod organ;
use organ::{liver, measuring, pool, traffic};

/// About as many nodes, unless the command line names others.
const NODES: [f64; 5] = [1000.0, 2000.0, 4000.0, 8000.0, 9400.0];

/// Lattice constant (m) of 1,500 nodes.
const CELL: f64 = 0.0155;

/// The parts of the scene that are played (s): pressing, and the first of sliding.
const PARTS: [(f64, f64); 2] = [(1.2, 2.5), (3.5, 4.5)];

/// Steps between two factors, where one does not take longer: 10 Hz beside steps of 30 Hz.
const REFRESH_EVERY: u64 = 3;

/// Threads of the step: as many as cores.
const CORES: usize = 2;

/// Time that a step has (ms).
const STEP: f64 = 1e3 / 30.0;

fn poses(world: &World) -> Vec<Isometry3<f64>> {
    let script = HandScript::new(world.description().hand.path.clone()).expect("the bundled path is valid");
    let first = world.first_pose();
    PARTS
        .iter()
        .flat_map(|&(from, to)| (0..((to - from) / world.dt()) as usize).map(move |k| (from, k)))
        .map(|(from, k)| {
            let at = script.intent(from + k as f64 * world.dt()).position;
            Isometry3::from_parts(Translation3::from(at), first.rotation)
        })
        .collect()
}

/// A run on so many threads: reports of the steps and their times (ms), on one thread those of the processor.
fn play(world: &World, steps: usize, threads: usize, latency: f64) -> Vec<(StepReport, f64)> {
    pool(threads).install(|| play_here(world, steps, threads == 1, latency))
}

/// What the factor thread has to do for a factor (s): the median of some, in touch.
fn latency(world: &World) -> f64 {
    let mut simulation = Simulation::new(world).expect("the liver has a factor").refresh_every(1);
    let touch = poses(world)[30];
    let time = |_| {
        let report = simulation.step_alone(&touch);
        let clock = ThreadTime::now();
        simulation.refresh_if_due(&report);
        clock.elapsed().as_secs_f64()
    };
    quantile((0..7).map(time).collect(), 0.5)
}

fn play_here(world: &World, steps: usize, by_processor: bool, latency: f64) -> Vec<(StepReport, f64)> {
    let mut simulation = Simulation::new(world)
        .expect("the liver has a factor")
        .refresh_every(REFRESH_EVERY)
        .refresh_early()
        .refresh_takes(latency);
    let poses = poses(world);
    poses
        .iter()
        .take(steps)
        .map(|pose| {
            let (clock, processor) = (Instant::now(), ThreadTime::now());
            let report = simulation.step_alone(pose);
            let elapsed = if by_processor { processor.elapsed() } else { clock.elapsed() };
            let time = 1e3 * elapsed.as_secs_f64();
            simulation.refresh_if_due(&report);
            (report, time)
        })
        .collect()
}

/// What the command line asks for.
#[derive(Clone, Copy)]
struct Wishes {
    tolerance: Option<f64>,
    sampling: Option<f64>,
}

fn world(cell: f64, method: ComplianceMethod, wishes: Wishes) -> World {
    liver(cell, |scene| {
        let body = &mut scene.bodies[0];
        body.compliance = method;
        body.tolerance = wishes.tolerance.unwrap_or(body.tolerance);
        body.error_sampling = wishes.sampling.unwrap_or(body.error_sampling);
    })
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

/// Nodes, and median and 99th percentile of a step (ms) on one core and on all.
struct Line {
    nodes: f64,
    one: [f64; 2],
    all: [f64; 2],
}

fn median_and_tail(run: &[(StepReport, f64)]) -> [f64; 2] {
    [0.5, 0.99].map(|share| quantile(run.iter().map(|(_, time)| *time).collect(), share))
}

fn measure(nodes: f64, steps: usize, wishes: Wishes) -> Line {
    let cell = CELL * (1500.0 / nodes).cbrt();
    let world = world(cell, ComplianceMethod::Asynchronous, wishes);
    let latency = pool(1).install(|| latency(&world));
    let alone = play(&world, steps, 1, latency);
    let runs = play(&world, steps, CORES, latency);
    let exact = self::world(cell, ComplianceMethod::Exact, Wishes { tolerance: None, ..wishes });
    let exact = play(&exact, steps, CORES, 0.0);
    let force = |run: &[(StepReport, f64)]| run.iter().map(|(report, _)| report.force).collect::<Vec<Vector3<f64>>>();
    let (forces, exact) = (force(&runs), force(&exact));
    assert_eq!(forces, force(&alone), "the same bits on any number of threads");
    let largest = exact.iter().map(Vector3::norm).fold(0.0, f64::max);
    let errors: Vec<f64> = forces.iter().zip(&exact).map(|(f, e)| 100.0 * (f - e).norm() / largest).collect();

    let of =
        |part: fn(&StepTimes) -> f64| 1e3 * quantile(runs.iter().map(|(report, _)| part(&report.times)).collect(), 0.5);
    let iterations = |run: &[(StepReport, f64)], of: fn(&StepReport) -> f64| -> Vec<f64> {
        run.iter().map(|(report, _)| of(report)).collect()
    };
    let free = iterations(&runs, |r| r.free_motion.iterations as f64);
    let correction = iterations(&runs, |r| f64::from(r.error.correction_iterations));
    let ages = iterations(&runs, |r| 1e3 * r.factor_age);
    let (one, all) = (median_and_tail(&alone), median_and_tail(&runs));
    let line = Line { nodes: world.mesh().nodes.len() as f64, one, all };
    println!(
        "{:>6} {:>7.2} {:>7.2} | {:>7.2} {:>7.2} | {:>6.2} {:>6.2} {:>6.2} {:>6.2} {:>6.2} {:>6.2} {:>6.2} {:>6.2} | {:>3.0} {:>3.0} {:>4.0} {:>3.0} | {:>4.0} {:>6.3} {:>6.3} | {:>6.1} {:>5.0} {:>5.0}",
        line.nodes,
        one[0],
        one[1],
        all[0],
        all[1],
        of(|t| t.assembly),
        of(|t| t.free_motion),
        of(|t| t.detection),
        of(|t| t.compliance),
        of(|t| t.solve),
        of(|t| t.correction),
        of(|t| t.sampling),
        of(|t| t.hand_over),
        quantile(free.clone(), 0.5),
        quantile(free, 1.0),
        quantile(correction.clone(), 0.5),
        quantile(correction, 1.0),
        quantile(iterations(&runs, |r| r.compliance.rows as f64), 0.5),
        quantile(errors.clone(), 0.5),
        quantile(errors, 1.0),
        1e3 * latency,
        quantile(ages.clone(), 0.5),
        quantile(ages, 1.0),
    );
    pool(1).install(|| traffic::print(&world));
    line
}

/// Least squares of `ln time = a + e ln nodes`: `(a, e)`.
fn fit(lines: &[Line], time: impl Fn(&Line) -> f64) -> (f64, f64) {
    let points: Vec<(f64, f64)> = lines.iter().map(|line| (line.nodes.ln(), time(line).ln())).collect();
    let n = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let (up, down) = points.iter().fold((0.0, 0.0), |(up, down), p| {
        (up + (p.0 - mean.0) * (p.1 - mean.1), down + (p.0 - mean.0) * (p.0 - mean.0))
    });
    (mean.1 - up / down * mean.0, up / down)
}

fn main() {
    let named: Vec<f64> = std::env::args().filter_map(|argument| argument.parse().ok()).collect();
    if std::env::args().any(|argument| argument == "alive") {
        alive::print(&named);
        return;
    }
    let wish = |name: &str| std::env::args().find_map(|argument| argument.strip_prefix(name)?.parse().ok());
    let wishes = Wishes { tolerance: wish("tolerance="), sampling: wish("sampling=") };
    let (sizes, steps) = match (measuring(), named.is_empty()) {
        (false, _) => (vec![600.0, 900.0], 8),
        (true, true) => (NODES.to_vec(), usize::MAX),
        (true, false) => (named, usize::MAX),
    };
    println!(
        "The factor thread is modelled by its latency alone: a factor serves from the first step after the time that it takes, and the \
         next is begun every third step, or when that is done."
    );
    println!(
        "one core (cpu ms)      | {CORES} cores (ms)     | medians of their stages (ms)                                   | iterations       | rows | force error % | factor: made in, age (ms)"
    );
    println!(
        " nodes  median     p99 |  median     p99 |  assem   free  touch      W  solve   corr sample   hand | free max corr max |    median    max |   made   age   max"
    );
    let lines: Vec<Line> = sizes.iter().map(|&nodes| measure(nodes, steps, wishes)).collect();
    if lines.len() > 1 {
        let told = |name: &str, times: fn(&Line) -> [f64; 2]| {
            let (_, exponent) = fit(&lines, |line| times(line)[0]);
            let (a, e) = fit(&lines, |line| times(line)[1]);
            let largest = ((STEP.ln() - a) / e).exp();
            println!("{name}: median time grows as nodes^{exponent:.2}; 30 Hz (p99, fitted) up to {largest:.0} nodes");
        };
        told("one core", |line| line.one);
        told(&format!("{CORES} cores"), |line| line.all);
    }
}
