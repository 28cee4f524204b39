//! A soft body: its tetrahedra, its tissue, how it moves.

use std::collections::BTreeMap;

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_fem::element::ElementKind;
use serde::{Deserialize, Serialize};

use super::{ExplicitDescription, IntegratorKind, NewtonDescription, NodeSelection, Refactor, TissueDescription};

/// A soft body.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyDescription {
    /// Name in reports.
    pub name: String,
    /// Tetrahedral mesh file, relative to the scene file. One of this, `image` and `block`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// Label image or closed surface from which tetrahedra are made, relative to the scene file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// A rectangular block of tetrahedra, in place of a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block: Option<BlockDescription>,
    /// Lattice constant (m) of tetrahedra made from `image`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<f64>,
    /// Labels of a label image by the names of their regions; all other labels are background. Without it every label is
    /// tissue, and label N becomes the region `label_N` but for those of the bundled organ.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, u8>,
    /// Factor from the unit of the mesh file to metres.
    #[serde(default = "one")]
    pub scale: f64,
    /// How the tetrahedra interpolate: `linear`, `quadratic` (mid-nodes are added where the mesh has none) or `averaged`
    /// (against volumetric locking).
    #[serde(default)]
    pub element: ElementKind,
    /// Mass density (kg/m³).
    #[serde(default = "tissue_density")]
    pub density: f64,
    /// Total mass (kg) shared equally by the nodes, in place of `density`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total_mass: Option<f64>,
    /// Rayleigh damping proportional to mass (1/s).
    #[serde(default)]
    pub rayleigh_mass: f64,
    /// Rayleigh damping proportional to stiffness (s).
    #[serde(default)]
    pub rayleigh_stiffness: f64,
    /// Tissue of all regions that `regions` does not name.
    pub material: TissueDescription,
    /// Tissue of named regions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub regions: BTreeMap<String, TissueDescription>,
    /// Most changes from outside in one run ([`Session::change`](crate::session::Session::change),
    /// [`Simulation::change`](crate::simulation::Simulation::change)): nodes held or released, elements removed. Fixed nodes
    /// then keep their rows, for they may be released.
    #[serde(default)]
    pub changes: u32,
    /// Nodes that never move, unless a change releases them.
    #[serde(default)]
    pub fixed: Vec<NodeSelection>,
    /// Lets the body settle under gravity before the run; its place then is what indentation is measured from.
    #[serde(default = "yes")]
    pub settle: bool,
    /// Projects element tangents to be positive semidefinite.
    #[serde(default = "yes")]
    pub definiteness_filter: bool,
    /// Shortens motions that would raise the energy of crushed or inverted tissue; off for maps of limits.
    #[serde(default = "yes")]
    pub guard: bool,
    /// Where the compliance of the contacts comes from: `automatic` (see [`Plan`](crate::world::Plan)), `exact`, `async` or
    /// `warped`. For `integrator = "backward_euler"` only.
    #[serde(default)]
    pub compliance: ComplianceMethod,
    /// How contact forces move the body where `compliance` is not exact.
    #[serde(default)]
    pub correction: MotionCorrection,
    /// When the system matrix is factored; what suits `compliance` by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refactor: Option<Refactor>,
    /// Relative error of the contact forces to keep to, by exact steps only where less does not
    /// (see [`Ladder`](crate::world::Ladder)): from `compliance` up, or with `automatic` from `async` up. Judged by what the
    /// step measures of them; with `matching` correction by the error of the compliance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Most memory (MB) for the inverse of the first matrix between the nodes of the skin, with `warped` compliance:
    /// 18 bytes per pair of nodes, 256 MB for 3,770 nodes. What takes more is left to half solves; 0 for none.
    #[serde(default = "surface_memory")]
    pub surface_memory: f64,
    /// Share of a step that may be spent on comparing a column of the compliance with the exact one, by the time that the plan
    /// predicts; where that does not do for a comparison in each step, there is one every so many. 0 for none. With `accuracy`
    /// and `matching` correction a column is compared in every step, whatever it takes.
    #[serde(default = "sampling_share")]
    pub error_sampling: f64,
    /// How the body moves in time.
    #[serde(default)]
    pub integrator: IntegratorKind,
    /// When Newton's iterations stop; for `integrator = "newton"` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub newton: Option<NewtonDescription>,
    /// Substeps; for `integrator = "explicit"` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explicit: Option<ExplicitDescription>,
    /// Relative residual at which the conjugate gradients of the free motion stop.
    #[serde(default = "free_motion_tolerance")]
    pub tolerance: f64,
    /// Largest number of conjugate-gradient iterations in one step.
    #[serde(default = "free_motion_iterations")]
    pub max_iterations: usize,
}

/// Whether a body says another value for a key than the default.
pub type IsGiven = fn(&BodyDescription) -> bool;

impl BodyDescription {
    /// Keys that only `integrator = "backward_euler"` reads.
    pub const OF_BACKWARD_EULER: [(&str, IsGiven); 9] = [
        ("guard", |body| body.guard != yes()),
        ("definiteness_filter", |body| body.definiteness_filter != yes()),
        ("compliance", |body| body.compliance != ComplianceMethod::default()),
        ("correction", |body| body.correction != MotionCorrection::default()),
        ("refactor", |body| body.refactor.is_some()),
        ("accuracy", |body| body.accuracy.is_some()),
        ("error_sampling", |body| body.error_sampling != sampling_share()),
        ("tolerance", |body| body.tolerance != free_motion_tolerance()),
        ("max_iterations", |body| body.max_iterations != free_motion_iterations()),
    ];

    /// Keys that differ from their defaults and that the body's integrator never reads.
    pub(crate) fn keys_without_effect(&self) -> impl Iterator<Item = &'static str> {
        let other = self.integrator != IntegratorKind::BackwardEuler;
        Self::OF_BACKWARD_EULER.iter().filter(move |(_, given)| other && given(self)).map(|(key, _)| *key)
    }
}

fn surface_memory() -> f64 {
    256.0
}

fn sampling_share() -> f64 {
    0.05
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

fn tissue_density() -> f64 {
    1060.0
}

fn free_motion_tolerance() -> f64 {
    1e-6
}

fn free_motion_iterations() -> usize {
    200
}

/// A rectangular block; its node sets are `x_min`, `x_max`, `y_min`, `y_max`, `z_min`, `z_max`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockDescription {
    /// Lower corner (m).
    pub min: [f64; 3],
    /// Upper corner (m).
    pub max: [f64; 3],
    /// Cells along each axis; each cell becomes six tetrahedra.
    pub cells: [usize; 3],
}
