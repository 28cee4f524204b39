//! What one refresh of the factor did.

use palpate_fem::factor::FactorStatus;

/// What one refresh did.
#[derive(Clone, Copy, Debug)]
pub struct RefreshReport {
    /// Epoch of the factor that was made, or would have been.
    pub epoch: u64,
    /// Step whose matrix was taken.
    pub step: u64,
    /// Time of that step (s).
    pub time: f64,
    /// Time at which the factor was handed over (s).
    pub handed_over: f64,
    /// Work (s).
    pub work: f64,
    /// Whether it was urged by the step before its turn.
    pub early: bool,
    /// Whether the matrix could be factored; if not, the last good factor stays in use.
    pub status: FactorStatus,
}

impl RefreshReport {
    /// True where there is a new factor.
    pub fn is_ok(&self) -> bool {
        self.status == FactorStatus::Ok
    }
}
