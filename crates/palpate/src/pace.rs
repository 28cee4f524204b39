//! Periodic wake-ups against the real clock. Missed periods are counted and skipped, never made up for.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest sleep (s) before a thread looks whether the run has ended: a slow rate must not hold up the end.
const LONGEST_SLEEP: f64 = 0.05;

/// Wakes a thread once per period.
pub(crate) struct Pacer {
    start: Instant,
    period: f64,
    next: u64,
}

/// One wake-up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beat {
    /// Time since the start (s).
    pub(crate) time: f64,
    /// How late it is (s).
    pub(crate) latency: f64,
    /// Periods that have passed unused since the last wake-up.
    pub(crate) missed: u32,
}

impl Pacer {
    pub(crate) fn new(start: Instant, rate: f64) -> Self {
        Self { start, period: 1.0 / rate, next: 0 }
    }

    /// Time since the start (s).
    pub(crate) fn time(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Sleeps until the next period begins, or `end` is set; returns at once where it has begun already.
    pub(crate) fn wait(&mut self, end: &AtomicBool) -> Beat {
        let target = self.next as f64 * self.period;
        while !end.load(Ordering::Acquire) {
            let ahead = target - self.start.elapsed().as_secs_f64();
            if ahead <= 0.0 {
                break;
            }
            std::thread::sleep(Duration::from_secs_f64(ahead.min(LONGEST_SLEEP)));
        }
        let time = self.start.elapsed().as_secs_f64();
        let latency = (time - target).max(0.0);
        let missed = (latency / self.period) as u64;
        self.next += 1 + missed;
        Beat { time, latency, missed: missed.min(u64::from(u32::MAX)) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_wake_up_skips_periods_and_counts_them() {
        let mut pacer = Pacer::new(Instant::now(), 1000.0);
        let end = AtomicBool::new(false);
        pacer.wait(&end);
        std::thread::sleep(Duration::from_millis(20));
        let late = pacer.wait(&end);
        assert!(late.missed >= 18, "19 periods passed, {} were counted", late.missed);
        let next = pacer.next;
        assert!(next >= 20, "the next period lies after the missed ones, not at {next}");
    }

    #[test]
    fn the_end_of_a_run_interrupts_a_long_period() {
        let mut pacer = Pacer::new(Instant::now(), 1e-6);
        let end = AtomicBool::new(false);
        pacer.wait(&end);
        std::thread::scope(|scope| {
            scope.spawn(|| end.store(true, Ordering::Release));
            // Returns: the next period begins in eleven days.
            pacer.wait(&end);
        });
    }
}
