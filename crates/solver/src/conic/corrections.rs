//! De Saxcé's corrections as an accelerated fixed point: those that a program gets give those that its forces ask for.

use crate::anderson::Anderson;
use crate::problem::{ProblemView, gather};

/// The corrections of a sequence of programs, one for each block, over a length that the caller chooses.
#[derive(Clone, Debug, Default)]
pub(crate) struct Corrections {
    anderson: Anderson,
    given: Vec<f64>,
    asked: Vec<f64>,
    least: f64,
}

impl Corrections {
    /// Memory for up to `blocks` blocks.
    pub(crate) fn with_capacity(blocks: usize) -> Self {
        let one = || Vec::with_capacity(blocks);
        Self { anderson: Anderson::with_capacity(blocks), given: one(), asked: one(), least: f64::INFINITY }
    }

    /// Begins a sequence.
    pub(crate) fn begin(&mut self) {
        self.anderson.restart();
        self.given.clear();
        self.least = f64::INFINITY;
    }

    /// Takes note of the residual that a program led to. Where it has risen, contacts have changed between slip and
    /// stick, and what was learned misleads.
    pub(crate) fn note(&mut self, residual: f64) {
        if residual > self.least {
            self.anderson.restart();
        }
        self.least = self.least.min(residual);
    }

    /// The corrections for the next program, from the gaps `delta` (m) that the last one led to, or from those of the start.
    /// `scale` is what a gap of the block that begins in a row is multiplied by.
    pub(crate) fn next(&mut self, view: &ProblemView<'_>, delta: &[f64], scale: impl Fn(usize) -> f64) -> &[f64] {
        self.asked.clear();
        self.asked.extend(view.blocks.iter().map(|block| {
            let gap = gather(delta, block);
            (block.law.corrected_gap(&gap).x - gap.x) * scale(block.start)
        }));
        if self.given.len() == self.asked.len() {
            self.anderson.step(&mut self.given, &self.asked);
            self.given.iter_mut().for_each(|correction| *correction = correction.max(0.0));
        } else {
            self.given.clear();
            self.given.extend_from_slice(&self.asked);
        }
        &self.given
    }
}
