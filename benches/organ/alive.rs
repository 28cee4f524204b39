//! Livers in real time with all their threads: step, factor and tick share the cores, as in a run.
//!
//! Each size is played with as many workers of the step as there are cores, and with one, which leaves another core to the
//! factor. The ticks are many more than the steps, and beside them take little.

use std::sync::atomic::AtomicBool;

use cpu_time::ProcessTime;
use palpate::run::{Length, Observer, RunOptions, run};
use palpate::step::StepReport;
use palpate::summary::RunSummary;

use super::organ::{liver, measuring};
use super::{CELL, CORES, STEP, quantile};

/// About as many nodes, unless the command line names others.
const NODES: [f64; 5] = [4000.0, 5000.0, 5800.0, 8000.0, 9400.0];

/// How long each is played (s): most of the bundled palpation.
const SECONDS: f64 = 10.0;

/// Share of all cores from which on more of them would do more.
const FULL: f64 = 0.85;

/// What the summary of a run leaves out (ms).
#[derive(Default)]
struct Steps {
    work: Vec<f64>,
    touching: Vec<f64>,
}

impl Observer for Steps {
    fn step(&mut self, report: &StepReport) {
        let work = 1e3 * report.times.total;
        self.work.push(work);
        if report.active > 0 {
            self.touching.push(work);
        }
    }
}

/// What keeps a larger body, or a younger factor, from being had.
fn bound(s: &RunSummary, tail: f64, busy: f64) -> String {
    // Beside other programs a run gets no more than its share, and waits without being busy.
    let cores = if busy > FULL { "cores" } else { "its longest part, or other programs" };
    if tail > STEP {
        format!("the step, whose p99 is {:.1} of its period, by {cores}", tail / STEP)
    } else {
        format!("the factor, {:.1} steps in the making; the step has time", 1e3 * s.factor_work.p50 / STEP)
    }
}

fn measure(nodes: f64, threads: usize, seconds: f64) {
    let world = liver(CELL * (1500.0 / nodes).cbrt(), |_| ());
    let options = RunOptions { length: Length::Seconds(seconds), threads: Some(threads), ..RunOptions::default() };
    let mut steps = Steps::default();
    let processors = ProcessTime::now();
    let outcome = run(&world, &options, &AtomicBool::new(false), &mut steps).expect("the liver runs");
    let s = &outcome.summary;
    let busy = processors.elapsed().as_secs_f64() / (s.wall * CORES as f64);
    let of = |values: &[f64], share| if values.is_empty() { f64::NAN } else { quantile(values.to_vec(), share) };
    let tail = of(&steps.work, 0.99);
    println!(
        "{:>6} {threads:>7} | {:>6.1} {:>6.1} {:>6.1} {:>6.1} {:>5.1} {:>5} | {:>6.1} {:>6.0} {:>6.0} {:>5.1} | {:>6.1} {:>6.1} {:>6.0} {:>6.1} {:>5} | {:>4.0} {}",
        s.nodes,
        of(&steps.work, 0.5),
        of(&steps.touching, 0.5),
        tail,
        of(&steps.work, 1.0),
        s.step_rate,
        s.step_overruns,
        1e3 * s.factor_work.p50,
        1e3 * s.factor_age.p50,
        1e3 * s.factor_age.max,
        s.factor_rate,
        1e6 * s.tick_work.p50,
        1e6 * s.tick_work.p999,
        1e6 * s.tick_latency.p999,
        s.tick_rate,
        s.tick_overruns,
        100.0 * busy,
        bound(s, tail, busy),
    );
}

/// Plays the livers of about so many nodes, or of [`NODES`].
pub(crate) fn print(named: &[f64]) {
    println!(
        "The bundled palpation in real time, {SECONDS} s for each line: step, factor and tick threads on {CORES} cores."
    );
    println!(
        "               | step (ms)                              | factor (ms)               | tick (µs)                         | cores"
    );
    println!(
        " nodes workers | median  touch    p99    max    Hz  late | made in   age    max    Hz | median  p99.9   late     Hz  late |    % what bounds it"
    );
    let (sizes, seconds) = match (measuring(), named) {
        (false, _) => (&[600.0][..], 0.3),
        (true, []) => (&NODES[..], SECONDS),
        (true, named) => (named, SECONDS),
    };
    for &nodes in sizes {
        [CORES, 1].into_iter().for_each(|threads| measure(nodes, threads, seconds));
    }
}
