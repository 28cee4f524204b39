//! How wrong the compliance of a step was found to be.

use palpate_fem::pcg::{PcgReport, PcgStatus};

use super::refinement::{REFINE_ABOVE, expected};

/// How wrong compliance and motion of a step are. NaN where nothing was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComplianceError {
    /// `‖(W_A - W) λ‖ / ‖W_A λ‖` with `W_A` of this step's matrix: the relative error of `W` along the forces. A by-product
    /// of the exact correction.
    pub along_forces: f64,
    /// What the contact forces miss of their laws for `W_A`, `‖(W_A - W)(λ - λ₀)‖ / ‖W_A λ‖`: their relative error. `λ₀` are the
    /// forces by which refinement has shifted the gaps, 0 where there was none and this is `along_forces`.
    pub misfit: f64,
    /// Largest error of a column of `W`, relative to the largest entry of the exact column.
    pub sampled: f64,
    /// Row whose column was compared.
    pub sampled_row: u32,
    /// Whether the comparison of a column ended without convergence, so that it says nothing.
    pub sample_unconverged: bool,
    /// Whether the comparison that was due was left out, for the step had no time for it.
    pub sample_left_out: bool,
    /// Relative residual that it left; 0 where there was none.
    pub sample_residual: f64,
    /// Iterations of the exact correction.
    pub correction_iterations: u32,
    /// Relative residual that the last solve of the exact correction left, where the free motion ended early together with
    /// that of the free motion; 0 where there was none.
    pub correction_residual: f64,
    /// Whether that solve ended without convergence: the motion is not that of the forces to the scene's tolerance.
    pub correction_unconverged: bool,
    /// Whether the forces were refined by the motion that they cause.
    pub refined: bool,
    /// What [`of_forces`](Self::of_forces) would have told of the rung below on the run's ladder.
    pub lower: f64,
    /// Whether the forces of a step in contact miss the accuracy of the run's ladder by what is known.
    pub missed_accuracy: bool,
    /// How deep the worst contact overlaps after the correction (m): what `W` missed.
    pub overlap: f64,
}

impl ComplianceError {
    /// Nothing was measured.
    pub const NONE: Self = Self {
        along_forces: f64::NAN,
        misfit: f64::NAN,
        sampled: f64::NAN,
        sampled_row: 0,
        sample_unconverged: false,
        sample_left_out: false,
        sample_residual: 0.0,
        correction_iterations: 0,
        correction_residual: 0.0,
        correction_unconverged: false,
        refined: false,
        lower: f64::NAN,
        missed_accuracy: false,
        overlap: 0.0,
    };

    /// The greater of the two measured errors of `W`; `None` where neither was.
    pub fn measured(&self) -> Option<f64> {
        let worst = self.along_forces.max(self.sampled); // ignores one NaN
        (!worst.is_nan()).then_some(worst)
    }

    /// The relative error of the contact forces, as far as the step knows it: the greater of what they miss and of what the
    /// sampled column makes them miss. That is its error where forces are not refined, else the square, for it acts on the
    /// change of the forces alone. `None` where neither is known.
    pub fn of_forces(&self) -> Option<f64> {
        // NaN is neither.
        let corrected = self.refined || self.misfit <= REFINE_ABOVE;
        let worst = self.misfit.max(if corrected { expected(self.sampled) } else { self.sampled }); // ignores one NaN
        (!worst.is_nan()).then_some(worst)
    }

    /// Takes down a solve of the exact correction.
    pub(super) fn corrected(&mut self, solve: &PcgReport) {
        self.correction_iterations += solve.iterations as u32;
        self.correction_residual = solve.relative_residual;
        self.correction_unconverged = solve.status != PcgStatus::Converged;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refined_forces_are_judged_by_what_they_miss_and_others_by_all_that_the_compliance_is_wrong_by() {
        let of = |misfit, sampled, refined| {
            ComplianceError { misfit, sampled, refined, ..ComplianceError::NONE }.of_forces()
        };
        assert_eq!(of(f64::NAN, f64::NAN, false), None);
        // Matching correction: only a column is known.
        assert_eq!(of(f64::NAN, 0.25, false), Some(0.25));
        assert_eq!(of(0.01, 0.25, true), Some(0.0625));
        assert_eq!(of(0.1, 0.25, true), Some(0.1));
        // Too little to refine, and refinement that has failed.
        assert_eq!(of(0.001, 0.25, false), Some(0.0625));
        assert_eq!(of(0.1, 0.25, false), Some(0.25));
        // A column that is all wrong is no better squared.
        assert_eq!(of(0.001, 2.0, false), Some(4.0));
    }
}
