//! How a run kept the accuracy that its scene states.

use std::collections::BTreeMap;

use crate::counted::counted;
use crate::step::StepReport;
use crate::world::{Ladder, ROOM_FOR_EXACT_STEPS, Rung};

/// Steps in contact by rung, and those that missed the accuracy.
#[derive(Clone, Debug, Default)]
pub(super) struct Climbing {
    pub(super) rungs: BTreeMap<Rung, u64>,
    pub(super) climbs: u64,
    /// Steps in contact that missed the accuracy by what they knew.
    pub(super) missed: u64,
    rung: Option<Rung>,
    worst: f64,
}

impl Climbing {
    /// Counts a step.
    pub(super) fn add(&mut self, report: &StepReport) {
        if let Some(rung) = report.rung.filter(|_| report.rows.rows > 0) {
            *self.rungs.entry(rung).or_default() += 1;
        }
        self.climbs += u64::from(self.rung.is_some_and(|before| report.rung.is_some_and(|now| now > before)));
        self.rung = report.rung;
        if report.error.missed_accuracy {
            self.missed += 1;
            self.worst = self.worst.max(report.error.of_forces().unwrap_or(0.0));
        }
    }

    /// What there is to say where the accuracy was missed.
    pub(super) fn note(&self, ladder: Option<Ladder>) -> Option<String> {
        let ladder = ladder.filter(|_| self.missed > 0)?;
        let of = self.rungs.values().sum::<u64>();
        let why = if ladder.ends_exact() {
            "each is followed by steps of the next method".to_owned()
        } else {
            format!("no step is exact, since a factorisation does not fit in one; {ROOM_FOR_EXACT_STEPS}")
        };
        Some(format!(
            "accuracy = {} was missed in {} of {of} in contact, by an error of the contact forces of up to {:.2} %; {why}",
            ladder.accuracy,
            counted(self.missed, "step", "steps"),
            1e2 * self.worst
        ))
    }
}
