//! How wrong the compliance of a step was found to be.

use palpate_fem::pcg::{PcgReport, PcgStatus};

/// How wrong compliance and motion of a step are. NaN where nothing was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComplianceError {
    /// `‖(W_A - W) λ‖ / ‖W_A λ‖` with `W_A` of this step's matrix: the relative error of `W` along the forces. A by-product
    /// of the exact correction.
    pub along_forces: f64,
    /// Largest error of a column of `W`, relative to the largest entry of the exact column.
    pub sampled: f64,
    /// Row whose column was compared.
    pub sampled_row: u32,
    /// Whether the comparison of a column ended without convergence, so that it says nothing.
    pub sample_unconverged: bool,
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
    /// The greater of the same two errors of the rung below on the run's ladder, had it been taken.
    pub lower: f64,
    /// How deep the worst contact overlaps after the correction (m): what `W` missed.
    pub overlap: f64,
}

impl ComplianceError {
    /// Nothing was measured.
    pub const NONE: Self = Self {
        along_forces: f64::NAN,
        sampled: f64::NAN,
        sampled_row: 0,
        sample_unconverged: false,
        sample_residual: 0.0,
        correction_iterations: 0,
        correction_residual: 0.0,
        correction_unconverged: false,
        refined: false,
        lower: f64::NAN,
        overlap: 0.0,
    };

    /// The greater of the two measured errors; `None` where neither was.
    pub fn measured(&self) -> Option<f64> {
        let worst = self.along_forces.max(self.sampled); // ignores one NaN
        (!worst.is_nan()).then_some(worst)
    }

    /// Takes down a solve of the exact correction.
    pub(super) fn corrected(&mut self, solve: &PcgReport) {
        self.correction_iterations += solve.iterations as u32;
        self.correction_residual = solve.relative_residual;
        self.correction_unconverged = solve.status != PcgStatus::Converged;
    }
}
