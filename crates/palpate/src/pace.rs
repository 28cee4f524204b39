//! Periodic wake-ups against the real clock. Missed periods are counted and skipped, never made up for.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest sleep without a look at the end: a thread of any rate ends within it.
pub(crate) const NAP: Duration = Duration::from_millis(50);

/// Whole nanoseconds as seconds. Real time is counted in them so that a trace, which holds them, gives the same bits.
pub(crate) fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}

/// The same of a difference.
pub(crate) fn signed_seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 * 1e-9
}

/// Wakes a thread once per period.
#[derive(Clone)]
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

    /// Time since the start (s), as a trace keeps it.
    pub(crate) fn time(&self) -> f64 {
        // Five centuries of nanoseconds fit.
        seconds(self.start.elapsed().as_nanos() as u64)
    }

    /// When the next period begins.
    pub(crate) fn due(&self) -> Instant {
        self.start + Duration::from_secs_f64(self.next as f64 * self.period)
    }

    /// Sleeps until the next period begins; returns at once where it has begun already. `None` once `end` is set.
    pub(crate) fn wait(&mut self, end: &AtomicBool) -> Option<Beat> {
        self.wait_unless(end, || false, std::thread::sleep)
    }

    /// The same on a thread that others may [unpark](std::thread::Thread::unpark): also returns, before its time and
    /// without using up the period, once `called` answers true.
    pub(crate) fn wait_or_called(&mut self, end: &AtomicBool, called: impl Fn() -> bool) -> Option<Beat> {
        self.wait_unless(end, called, std::thread::park_timeout)
    }

    fn wait_unless(&mut self, end: &AtomicBool, called: impl Fn() -> bool, sleep: impl Fn(Duration)) -> Option<Beat> {
        let target = self.next as f64 * self.period;
        let time = loop {
            if end.load(Ordering::Acquire) {
                return None;
            }
            let time = self.time();
            let ahead = target - time;
            if ahead <= 0.0 {
                break time;
            }
            if called() {
                return Some(Beat { time, latency: 0.0, missed: 0 });
            }
            sleep(Duration::from_secs_f64(ahead.min(NAP.as_secs_f64())));
        };
        let latency = (time - target).max(0.0);
        let missed = (latency / self.period) as u64;
        self.next += 1 + missed;
        Some(Beat { time, latency, missed: missed.min(u64::from(u32::MAX)) as u32 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_wake_up_skips_periods_and_counts_them() {
        let (mut pacer, end) = (Pacer::new(Instant::now(), 1000.0), AtomicBool::new(false));
        pacer.wait(&end).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        let late = pacer.wait(&end).unwrap();
        assert!(late.missed >= 18, "19 periods passed, {} were counted", late.missed);
        let next = pacer.next;
        assert!(next >= 20, "the next period lies after the missed ones, not at {next}");
        assert!(pacer.due() >= pacer.start + Duration::from_millis(20));
    }

    #[test]
    fn a_call_ends_the_wait_before_its_time_and_leaves_the_period_unused() {
        let (mut pacer, end) = (Pacer::new(Instant::now(), 1e-6), AtomicBool::new(false));
        assert!(pacer.wait(&end).is_some(), "the first period begins at once");
        let called = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let waiting =
                scope.spawn(|| pacer.wait_or_called(&end, || called.load(Ordering::Acquire)).map(|b| b.missed));
            called.store(true, Ordering::Release);
            waiting.thread().unpark();
            assert_eq!(waiting.join().unwrap(), Some(0));
        });
        assert_eq!(pacer.next, 1);
    }

    #[test]
    fn the_end_of_a_run_does_not_wait_for_a_slow_period() {
        let (mut pacer, end) = (Pacer::new(Instant::now(), 1e-6), AtomicBool::new(false));
        assert!(pacer.wait(&end).is_some(), "the first period begins at once");
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| pacer.wait(&end));
            end.store(true, Ordering::Release);
            assert!(waiting.join().unwrap().is_none());
        });
    }
}
