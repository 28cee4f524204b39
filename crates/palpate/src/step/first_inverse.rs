//! The inverse of the first matrix between the nodes of the skin, from which `W` is gathered: warped compliance.

use nalgebra::Matrix3;
use palpate_constraints::compliance::{ComplianceMethod, ComplianceWorkspace, WarpedInverse};
use palpate_constraints::precomputed::{PrecomputedInverse, PrecomputedWorkspace};
use palpate_constraints::surface_inverse::SurfaceInverse;

use super::{StepReport, StepWorkspace};
use crate::refresh::FactorSample;
use crate::world::{Rung, World};

/// The inverse, and whether it serves.
pub(super) struct FirstInverse {
    surface: SurfaceInverse,
    /// Whether the step at hand takes its compliance from here.
    serves: bool,
}

impl FirstInverse {
    /// The inverse of the first factor, where the plan wants it and has room; makes room for gathering in `compliance`.
    pub(super) fn new(
        world: &World,
        first: &FactorSample,
        compliance: &mut ComplianceWorkspace<PrecomputedWorkspace>,
    ) -> Option<Self> {
        let wanted = world.plan().precomputed.filter(|precomputed| precomputed.fits())?;
        // The plan has counted the same nodes, and the factor is valid: there is an inverse.
        let surface = SurfaceInverse::new(&first.factor, &world.free_skin(), wanted.most).ok()?;
        compliance.inverse_mut().make_room_for(&surface);
        Some(Self { surface, serves: false })
    }

    /// The inverse of a step that takes its compliance from here; `latest` and `rotations` are those of the run's factor.
    pub(super) fn warped<'a>(
        &'a self,
        latest: &'a FactorSample,
        rotations: &'a [Matrix3<f64>],
    ) -> Option<WarpedInverse<'a, PrecomputedInverse<'a>>> {
        let inverse = PrecomputedInverse { factor: &latest.factor, surface: Some(&self.surface) };
        self.serves.then(|| WarpedInverse::new(ComplianceMethod::Warped, inverse, rotations))
    }
}

/// Decides whether the step at hand takes its compliance from the first inverse.
pub(super) fn choose(ws: &mut StepWorkspace, report: &StepReport) {
    if let Some(first) = &mut ws.first {
        first.serves = report.rung.is_none_or(|rung| rung == Rung::Warped);
    }
}
