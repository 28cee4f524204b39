//! The ladder of methods on which a run keeps a stated accuracy of the contact forces: the cheapest whose error, measured
//! in every step, meets it.
//!
//! A step whose measured error exceeds the accuracy is followed by steps on the next rung. While a run stands above its
//! lowest rung, every step also measures what the rung below would have missed; after [`CALM_STEPS`] steps in a row in which
//! that was at most [`LOWER_SHARE`] of the accuracy, or without contact, it goes down one rung. Where it has to come back
//! at once, it waits twice as long the next time. All of that depends on measured errors alone, never on time, so that runs
//! in lockstep repeat it.

use std::fmt;

use serde::Serialize;

use crate::scene::Readable;

/// Steps in a row that the rung below would have to meet the accuracy in: half a second at 30 Hz.
pub const CALM_STEPS: u32 = 15;

/// The same after it has failed again and again: eight seconds.
pub const MOST_CALM_STEPS: u32 = 240;

/// Share of the accuracy that the rung below may use up before it is taken: its error grows with the pressing that goes on.
pub const LOWER_SHARE: f64 = 0.5;

/// A method of compliance, with the work in a step that it asks for; cheaper ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rung {
    /// Gathered from the precomputed inverse of the first matrix.
    Warped,
    /// By half solves with the latest factor, which is made anew at the factor rate.
    Asynchronous,
    /// The same, and the factor is made anew as soon as the error passes half of the accuracy.
    Early,
    /// From a factor of the step's own matrix.
    Exact,
}

impl Rung {
    /// All of them, cheapest first.
    pub const ALL: [Self; 4] = [Self::Warped, Self::Asynchronous, Self::Early, Self::Exact];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Warped => "warped",
            Self::Asynchronous => "async",
            Self::Early => "async, early refresh",
            Self::Exact => "exact",
        }
    }
}

/// The rungs of a run, and what they are climbed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ladder {
    rungs: &'static [Rung],
    /// Relative error of the contact forces to keep to.
    pub accuracy: f64,
}

impl Ladder {
    /// With a factor thread, and from the precomputed inverse on where there is room for one.
    pub(super) fn with_thread(accuracy: f64, precomputed: bool) -> Self {
        Self { rungs: if precomputed { &Rung::ALL } else { &Rung::ALL[1..] }, accuracy }
    }

    /// Where nothing but the step itself factors a second time.
    pub(super) fn without_thread(accuracy: f64) -> Self {
        Self { rungs: &[Rung::Warped, Rung::Exact], accuracy }
    }

    /// The rungs, cheapest first; never empty.
    pub fn rungs(&self) -> &'static [Rung] {
        self.rungs
    }

    /// The rung at a place from 0; the last beyond.
    pub fn rung(&self, place: usize) -> Rung {
        self.rungs.get(place).copied().unwrap_or(Rung::Exact)
    }

    /// The lowest place of a run whose first matrix is still that of its body, or is not any more.
    pub fn lowest(&self, first_serves: bool) -> usize {
        usize::from(!first_serves && self.rung(0) == Rung::Warped && self.rung(1) != Rung::Exact)
    }
}

impl fmt::Display for Ladder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.rungs.iter().map(|rung| rung.name()).collect();
        write!(f, "accuracy {} by the cheapest of: {}", Readable(self.accuracy), names.join(" < "))
    }
}
