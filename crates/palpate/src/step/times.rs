//! Where the time of a step goes.

/// Wall time of the stages (s).
#[derive(Clone, Copy, Debug, Default)]
pub struct StepTimes {
    /// Forces and system matrix.
    pub assembly: f64,
    /// Nodal rotations and conjugate gradients.
    pub free_motion: f64,
    /// Contacts.
    pub detection: f64,
    /// Rows and `W`.
    pub compliance: f64,
    /// Contact forces; by a direct approach with the motion that belongs to them.
    pub solve: f64,
    /// Correction and the check that the body is finite.
    pub correction: f64,
    /// Comparing a column of `W` with the exact one.
    pub sampling: f64,
    /// Filling the snapshot.
    pub hand_over: f64,
    /// All of it.
    pub total: f64,
}

impl StepTimes {
    pub(super) fn sum(&self) -> f64 {
        self.assembly
            + self.free_motion
            + self.detection
            + self.compliance
            + self.solve
            + self.correction
            + self.sampling
            + self.hand_over
    }
}
