//! The ladder of methods on which a run keeps a stated accuracy of the contact forces: the lowest rung whose error, measured
//! in every step, meets it.
//!
//! A step whose forces are found to miss the accuracy is followed by steps on the next rung. A run with a factor thread
//! begins on half solves with the latest factor: the precomputed inverse of the first matrix would spare them, and costs more
//! in conjugate gradients than they do. No ladder ends with exact steps whose factorisation takes longer than a step: there
//! the accuracy may be missed, and report and summary say so. While a run stands above its
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

/// The remedy where a factorisation does not fit in a step.
pub(crate) const ROOM_FOR_EXACT_STEPS: &str = "a coarser mesh or a lower `step` of [rates] makes room";

/// A method of compliance; on a ladder, what asks for more factorisations is higher.
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
    /// All of them, from the lowest; no ladder holds more than three.
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
    /// With a factor thread; up to exact steps where a factorisation fits in one.
    pub(super) fn with_thread(accuracy: f64, fits: bool) -> Self {
        let rungs: &[Rung] = &[Rung::Asynchronous, Rung::Early, Rung::Exact];
        Self { rungs: if fits { rungs } else { &rungs[..2] }, accuracy }
    }

    /// Where nothing but the step itself factors a second time, if that fits in one.
    pub(super) fn without_thread(accuracy: f64, fits: bool) -> Self {
        let rungs: &[Rung] = &[Rung::Warped, Rung::Exact];
        Self { rungs: if fits { rungs } else { &rungs[..1] }, accuracy }
    }

    /// The rungs, from the lowest; never empty.
    pub fn rungs(&self) -> &'static [Rung] {
        self.rungs
    }

    /// The rung at a place from 0; the last beyond.
    pub fn rung(&self, place: usize) -> Rung {
        self.rungs.get(place).or(self.rungs.last()).copied().unwrap_or(Rung::Exact)
    }

    /// Whether it ends with exact steps, which meet any accuracy.
    pub fn ends_exact(&self) -> bool {
        self.rungs.contains(&Rung::Exact)
    }

    /// What there is to say of one that does not, where a factorisation is predicted to take `factorization` of a step's
    /// `dt` (s).
    pub(super) fn warning(&self, factorization: f64, dt: f64) -> Option<String> {
        let [factorization, dt] = [1e3 * factorization, 1e3 * dt];
        (!self.ends_exact()).then(|| {
            format!(
                "accuracy = {} may be missed: a factorisation, {factorization:.0} ms predicted, does not fit in a step of \
                 {dt:.0} ms, so that no step is exact; the summary says how often it was; {ROOM_FOR_EXACT_STEPS}",
                Readable(self.accuracy)
            )
        })
    }
}

impl fmt::Display for Ladder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.rungs.iter().map(|rung| rung.name()).collect();
        write!(f, "accuracy {} by the lowest that meets it of: {}", Readable(self.accuracy), names.join(" < "))
    }
}
