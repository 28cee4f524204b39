//! The preconditioner of a step's linear solves: its own factor where there is one, else the latest.

use nalgebra::Matrix3;
use palpate_fem::factor::{Factor, SolveStatus, SolveWorkspace};
use palpate_fem::preconditioner::{FactorPreconditioner, Preconditioner, WarpedPreconditioner};

use crate::refresh::FactorSample;

/// Either of the two.
pub(super) enum StepPreconditioner<'a> {
    Own(FactorPreconditioner<'a>),
    Latest(WarpedPreconditioner<'a>),
}

impl<'a> StepPreconditioner<'a> {
    /// From this step's factor, or else from the latest, warped by the rotations since it was taken.
    pub(super) fn new(
        own: Option<&'a Factor>,
        latest: &'a FactorSample,
        rotations: &'a [Matrix3<f64>],
        workspace: &'a mut SolveWorkspace,
    ) -> Self {
        match own {
            Some(factor) => Self::Own(FactorPreconditioner { factor, workspace }),
            None => Self::Latest(WarpedPreconditioner { factor: &latest.factor, rotations, workspace }),
        }
    }
}

impl Preconditioner for StepPreconditioner<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) -> SolveStatus {
        match self {
            Self::Own(own) => own.apply(r, z),
            Self::Latest(latest) => latest.apply(r, z),
        }
    }
}
