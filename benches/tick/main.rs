//! The haptic loop: ten seconds of palpation of the bundled liver in real time with all threads alive, the jumps of
//! the force at new snapshots in lockstep, ticks of a driver with 10 and 45 contacts of a fist in the liver while step and
//! factor run beside it, then such ticks alone. Prints tails and histograms; asserts nothing.
//!
//! `cargo bench --bench tick [-- --seconds S]`

#![allow(clippy::print_stdout)]

mod alive;
mod alone;
mod jumps;
#[path = "../organ/mod.rs"]
mod organ;
mod real_time;
mod table;

use assert_no_alloc::AllocDisabler;

/// Counts allocations where a bench forbids them.
#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// Ticks alone, for each number of contacts.
const TICKS: u64 = 20_000;

fn main() {
    let (seconds, ticks) = if organ::measuring() { (seconds().unwrap_or(10.0), TICKS) } else { (0.5, 500) };
    real_time::measure(seconds);
    jumps::measure(seconds);
    alive::measure(seconds);
    alone::measure(&[10, 20, 45], ticks);
    println!("\n{}", table::machine());
}

/// The value of `--seconds`.
fn seconds() -> Option<f64> {
    std::env::args().skip_while(|argument| argument != "--seconds").nth(1)?.parse().ok()
}
