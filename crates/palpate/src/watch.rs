//! The thread that watches a run in real time: it empties the rings, keeps the tails, tells the observer.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use palpate_haptics::exchange::Receiver;

use crate::gathering::Gathering;
use crate::refresh::RefreshReport;
use crate::run::{Observer, Progress};
use crate::step::StepReport;
use crate::summary::RunEnd;
use crate::tick::TickReport;

/// How often it empties the rings.
const WATCH_PERIOD: Duration = Duration::from_millis(50);

/// What the watching thread has seen, and the rings that it empties.
pub(crate) struct Watch {
    pub(crate) gathering: Gathering,
    pub(crate) steps: Receiver<StepReport>,
    pub(crate) ticks: Receiver<TickReport>,
    pub(crate) refreshes: Receiver<RefreshReport>,
    /// Time and counts of the last second, for rates.
    history: VecDeque<(Instant, [u64; 3])>,
}

impl Watch {
    pub(crate) fn new(
        gathering: Gathering,
        steps: Receiver<StepReport>,
        ticks: Receiver<TickReport>,
        refreshes: Receiver<RefreshReport>,
    ) -> Self {
        Self { gathering, steps, ticks, refreshes, history: VecDeque::new() }
    }

    /// Watches until the time is up, the caller says stop, the body fails, or the tick thread is gone.
    pub(crate) fn until(
        &mut self,
        seconds: f64,
        start: Instant,
        stop: &AtomicBool,
        gone: &AtomicBool,
        observer: &mut dyn Observer,
    ) -> RunEnd {
        loop {
            std::thread::sleep(WATCH_PERIOD);
            self.drain(observer);
            let rates = self.rates();
            observer.progress(&Progress { rates: Some(rates), ..self.gathering.progress() });
            if self.gathering.failed {
                return RunEnd::BodyFailed;
            }
            if stop.load(Ordering::Relaxed) || gone.load(Ordering::Acquire) {
                return RunEnd::Interrupted;
            }
            if start.elapsed().as_secs_f64() >= seconds {
                return RunEnd::Completed;
            }
        }
    }

    pub(crate) fn drain(&mut self, observer: &mut dyn Observer) {
        while let Some(report) = self.steps.receive() {
            self.gathering.step(&report, observer);
        }
        while let Some(report) = self.refreshes.receive() {
            self.gathering.refresh(&report);
        }
        while let Some(record) = self.ticks.receive() {
            self.gathering.tick(&record, observer);
        }
    }

    fn rates(&mut self) -> [f64; 3] {
        let now = (Instant::now(), self.gathering.counts());
        self.history.push_back(now);
        while self.history.len() > 21 {
            self.history.pop_front();
        }
        let then = self.history[0];
        let span = now.0.duration_since(then.0).as_secs_f64().max(1e-9);
        std::array::from_fn(|k| (now.1[k] - then.1[k]) as f64 / span)
    }
}
