//! The inverse of the first matrix between the nodes of the skin, from which `W` is gathered: warped compliance.

use nalgebra::{Matrix3, Vector3};
use palpate_constraints::compliance::{ComplianceMethod, ComplianceWorkspace, WarpedInverse};
use palpate_constraints::precomputed::{PrecomputedInverse, PrecomputedWorkspace};
use palpate_constraints::surface_inverse::SurfaceInverse;
use palpate_fem::factor::Factor;
use palpate_fem::rotation::nodal_rotations;

use super::{StepReport, StepState, StepWorkspace};
use crate::refresh::FactorSample;
use crate::scene::Refactor;
use crate::world::{Rung, World};

/// The inverse with what it takes to warp it, and to correct by it.
pub(super) struct FirstInverse {
    surface: SurfaceInverse,
    /// The factor that it was made from, where a factor thread hands over others.
    pub(super) factor: Option<Factor>,
    /// Where the body was then (m), and how its nodes have turned since; of use with a factor of its own only.
    q: Vec<Vector3<f64>>,
    pub(super) rotations: Vec<Matrix3<f64>>,
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
        let own = world.plan().refactor == Refactor::Thread;
        Some(Self {
            surface,
            factor: own.then(|| first.factor.clone()),
            q: if own { first.q.clone() } else { Vec::new() },
            rotations: vec![Matrix3::identity(); if own { world.model().free_nodes() } else { 0 }],
            serves: false,
        })
    }

    /// The inverse of a step that takes its compliance from here; `latest` and `rotations` are those of the run's factor.
    pub(super) fn warped<'a>(
        &'a self,
        latest: &'a FactorSample,
        rotations: &'a [Matrix3<f64>],
    ) -> Option<WarpedInverse<'a, PrecomputedInverse<'a>>> {
        let (factor, rotations) = match &self.factor {
            Some(own) => (own, &self.rotations[..]),
            None => (&latest.factor, rotations),
        };
        let inverse = PrecomputedInverse { factor, surface: Some(&self.surface) };
        self.serves.then(|| WarpedInverse::new(ComplianceMethod::Warped, inverse, rotations))
    }
}

/// Whether the first matrix is still one of the body.
pub(super) fn first_serves(state: &StepState, ws: &StepWorkspace) -> bool {
    state.phase == 0 && ws.first.is_some()
}

/// Decides whether the step at hand takes its compliance from the first inverse, and turns that with the nodes where this
/// step or a probe of the rung needs it.
pub(super) fn turn(world: &World, state: &StepState, ws: &mut StepWorkspace, report: &StepReport) {
    let Some(first) = &mut ws.first else { return };
    first.serves = report.rung.is_none_or(|rung| rung == Rung::Warped);
    let near = report.rung.is_some_and(|rung| rung <= Rung::Asynchronous);
    if first.factor.is_some() && state.phase == 0 && near {
        nodal_rotations(world.model(), &first.q, &state.fem.q, &mut first.rotations);
    }
}
