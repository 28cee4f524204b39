//! Tails as lines of a table, and what machine they come from.

use std::fmt;

use palpate::summary::Percentiles;

/// A unit.
#[derive(Clone, Copy)]
pub(crate) struct Unit {
    name: &'static str,
    per_second: f64,
}

pub(crate) const MILLISECONDS: Unit = Unit { name: "ms", per_second: 1e3 };
pub(crate) const MICROSECONDS: Unit = Unit { name: "µs", per_second: 1e6 };

pub(crate) const MILLINEWTONS: Unit = Unit { name: "mN", per_second: 1e3 };

/// The line above the tails.
pub(crate) fn head(what: &str) {
    println!("\n{what:<34} {:>9} {:>9} {:>9} {:>9}", "p50", "p99", "p99.9", "max");
}

/// One line of tails, with what is to be reached.
pub(crate) fn line(what: &str, tail: &Percentiles, unit: Unit, target: &str) {
    let numbers = [tail.p50, tail.p99, tail.p999, tail.max].map(|t| format!("{:>9.2}", t * unit.per_second));
    println!("{:<34} {}  {target}", format!("{what} [{}]", unit.name), numbers.join(" "));
}

/// Processor, cores and load.
pub(crate) fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpu = read("/proc/cpuinfo");
    let model =
        cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
    let load = read("/proc/loadavg");
    let load: Vec<&str> = load.split_whitespace().take(3).collect();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    format!(
        "machine: {cores} cores, {}, load average {}",
        model.unwrap_or("unknown processor"),
        if load.is_empty() { "unknown".into() } else { load.join(" ") }
    )
}

/// Upper ends of the bins of a histogram (µs); what is longer is in a bin of its own.
const BINS: [f64; 9] = [5.0, 10.0, 20.0, 30.0, 60.0, 100.0, 120.0, 300.0, 1000.0];

/// How many times fell into each bin.
#[derive(Clone, Copy, Default)]
pub(crate) struct Histogram {
    counts: [u64; BINS.len() + 1],
}

impl Histogram {
    /// Counts a time (s).
    pub(crate) fn record(&mut self, time: f64) {
        let bin = BINS.iter().position(|&end| time * 1e6 < end).unwrap_or(BINS.len());
        self.counts[bin] += 1;
    }
}

impl fmt::Display for Histogram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (count, end) in self.counts.iter().zip(BINS) {
            write!(f, "{count} below {end} µs, ")?;
        }
        write!(f, "{} above", self.counts[BINS.len()])
    }
}
