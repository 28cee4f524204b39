//! How wrong the compliance of a step was found to be.

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
    /// Iterations of the exact correction.
    pub correction_iterations: u32,
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
        correction_iterations: 0,
        refined: false,
        lower: f64::NAN,
        overlap: 0.0,
    };

    /// The greater of the two measured errors; `None` where neither was.
    pub fn measured(&self) -> Option<f64> {
        let worst = self.along_forces.max(self.sampled); // ignores one NaN
        (!worst.is_nan()).then_some(worst)
    }
}
