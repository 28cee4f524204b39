//! What watches a run from outside: a limit of time, and a record of the residual against time.

use std::time::{Duration, Instant};

/// One entry of a record.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Sample {
    /// Time since the begin of the run, s.
    pub seconds: f64,
    /// Iterations done by the method that was at work.
    pub iteration: u32,
    /// Natural-map residual, relative (see [`crate::residual`]).
    pub residual: f64,
}

/// A limit of time and a record. Without either, no clock is read, and a run gives the same bits every time; with a limit,
/// a run that meets it depends on the machine's load.
#[derive(Debug, Default)]
pub struct Watch<'a> {
    limit: Option<f64>,
    started: Option<Instant>,
    record: Option<&'a mut Vec<Sample>>,
}

impl Watch<'static> {
    /// Watches nothing.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }
}

impl<'a> Watch<'a> {
    /// From now on, at most `seconds` (`> 0`). A run looks at the clock after each of its iterations.
    #[must_use]
    pub fn limit(mut self, seconds: f64) -> Self {
        self.limit = Some(seconds);
        self.started.get_or_insert_with(Instant::now);
        self
    }

    /// From now on, records up to the capacity of `samples`; entries beyond it are left out.
    #[must_use]
    pub fn record(mut self, samples: &'a mut Vec<Sample>) -> Self {
        self.record = Some(samples);
        self.started.get_or_insert_with(Instant::now);
        self
    }

    /// Records an iteration; `true` where the time is over.
    pub(crate) fn note(&mut self, iteration: u32, residual: f64) -> bool {
        let Some(started) = self.started else { return false };
        let seconds = started.elapsed().as_secs_f64();
        if let Some(samples) = self.record.as_deref_mut().filter(|samples| samples.len() < samples.capacity()) {
            samples.push(Sample { seconds, iteration, residual });
        }
        self.limit.is_some_and(|limit| seconds >= limit)
    }

    /// When the time is over, for methods whose iterations are long.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.started
            .zip(self.limit)
            .and_then(|(started, limit)| started.checked_add(Duration::try_from_secs_f64(limit.max(0.0)).ok()?))
    }
}
