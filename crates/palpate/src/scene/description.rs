//! What a scene file says: plain data with defaults, checked by [`super::Scene`].

use std::collections::BTreeMap;

use palpate_collision::detection::ContactKind;
use palpate_collision::shape::ToolShape;
use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_constraints::penalty::PenaltyConfig;
use palpate_fem::element::ElementKind;
use palpate_fem::material::{Material, PronyTerm};
use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::device::VirtualDeviceConfig;
use palpate_haptics::limits::LimitsConfig;
use palpate_haptics::script::ScriptKey;
use palpate_haptics::tick::PatchTickConfig;
use palpate_solver::solver::SolverKind;
use serde::{Deserialize, Serialize};

/// A whole scene: one soft body, one tool, a device and the hand that holds it. SI units.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneDescription {
    /// Name of the scene; traces and pictures are called after it.
    pub name: String,
    /// One sentence that `palpate scenes` prints.
    #[serde(default)]
    pub description: String,
    /// Length of a run (s) when the caller names none.
    #[serde(default = "ten_seconds")]
    pub seconds: f64,
    /// Acceleration of gravity (m/s²).
    #[serde(default)]
    pub gravity: [f64; 3],
    /// Rates of the three threads.
    #[serde(default)]
    pub rates: RatesDescription,
    /// The soft bodies; this version simulates exactly one.
    #[serde(rename = "body")]
    pub bodies: Vec<BodyDescription>,
    /// The tools; this version simulates exactly one.
    #[serde(rename = "tool")]
    pub tools: Vec<ToolDescription>,
    /// How the tool and the tissue touch.
    #[serde(default)]
    pub contact: ContactDescription,
    /// When the constraint solvers stop.
    #[serde(default)]
    pub solver: SolverDescription,
    /// What the tick takes from a step.
    #[serde(default)]
    pub tick: TickDescription,
    /// The haptic device.
    #[serde(default)]
    pub device: DeviceDescription,
    /// The virtual hand or the script of positions.
    #[serde(default)]
    pub hand: HandDescription,
    /// Virtual coupling between device and tool; by default what suits the device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coupling: Option<CouplingConfig>,
    /// Limits of the force that reaches the device.
    #[serde(default)]
    pub limits: LimitsConfig,
}

fn ten_seconds() -> f64 {
    10.0
}

/// Rates (Hz).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RatesDescription {
    /// Steps of the tissue per second: `dt = 1 / step`.
    pub step: f64,
    /// Refreshes of the factorisation per second; fewer where one takes longer.
    pub factor: f64,
    /// Ticks of the haptic loop per second.
    pub tick: f64,
    /// Lockstep only: age (s) at which a refreshed factor reaches the step, as if the factor thread took so long.
    pub factor_delay: f64,
}

impl Default for RatesDescription {
    fn default() -> Self {
        Self { step: 30.0, factor: 10.0, tick: 1000.0, factor_delay: 0.1 }
    }
}

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
    /// Nodes that never move.
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
    /// Relative error of the contact forces to keep to: steps whose measured error is above are followed by exact ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Share of a step that may be spent on comparing a column of the compliance with the exact one; 0 for none.
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

impl BodyDescription {
    /// Keys that differ from their defaults and that the body's integrator never reads.
    pub(crate) fn keys_without_effect(&self) -> impl Iterator<Item = &'static str> {
        let of_linearised_steps = [
            ("guard", self.guard != yes()),
            ("definiteness_filter", self.definiteness_filter != yes()),
            ("compliance", self.compliance != ComplianceMethod::default()),
            ("tolerance", self.tolerance != free_motion_tolerance()),
            ("max_iterations", self.max_iterations != free_motion_iterations()),
        ];
        let other = self.integrator != IntegratorKind::BackwardEuler;
        of_linearised_steps.into_iter().filter(move |&(_, given)| other && given).map(|(key, _)| key)
    }
}

/// A law with its parameters and, if wished, viscosity: `{ law = "ogden", young = 5e3, poisson = 0.45, viscosity = [...] }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TissueDescription {
    /// The law.
    #[serde(flatten)]
    pub law: Material,
    /// Prony series, `[{ modulus = 0.235, time = 0.27 }, ...]`: the shares of the law's shear modulus that relax, and their
    /// times (s). Empty: elastic.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub viscosity: Vec<PronyTerm>,
}

impl From<Material> for TissueDescription {
    /// The law without viscosity.
    fn from(law: Material) -> Self {
        Self { law, viscosity: Vec::new() }
    }
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

/// How a body moves in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntegratorKind {
    /// Backward Euler with one linearisation: real time.
    #[default]
    BackwardEuler,
    /// Backward Euler by Newton's method with line search and direct solves: the reference. The compliance of contacts
    /// comes from its own matrix, whatever `compliance` says.
    Newton,
    /// Central differences with lumped mass in substeps, contact solved in each of them.
    Explicit,
}

/// When the system matrix is factored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Refactor {
    /// In every step, before the free motion: no factor is ever old, and there is no factor thread.
    Step,
    /// By a thread of its own at `rates.factor`, from the matrix of a past step.
    Thread,
    /// Before the first step.
    Once,
}

/// When Newton's iterations of one step stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NewtonDescription {
    /// Most iterations.
    pub iterations: u32,
    /// Bound on the residual, relative to the forces that it balances.
    pub tolerance: f64,
}

impl Default for NewtonDescription {
    fn default() -> Self {
        Self { iterations: 20, tolerance: 1e-6 }
    }
}

/// Substeps of explicit integration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExplicitDescription {
    /// Substeps of one step; by default as many as keep each below
    /// [`EXPLICIT_SAFETY`](crate::world::EXPLICIT_SAFETY) of the critical step at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps: Option<u32>,
    /// Lets substeps above the critical step run: for maps of limits.
    pub allow_unstable: bool,
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

/// A choice of nodes of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum NodeSelection {
    /// A named node set of the mesh.
    NodeSet(String),
    /// All nodes of a named region of the mesh.
    Region(String),
    /// Nodes with a coordinate at or below a value.
    Below(Plane),
    /// Nodes with a coordinate at or above a value.
    Above(Plane),
    /// Nodes inside an axis-aligned box.
    Box {
        /// Lower corner (m).
        min: [f64; 3],
        /// Upper corner (m).
        max: [f64; 3],
    },
    /// Nodes inside a ball.
    Ball {
        /// Centre (m).
        center: [f64; 3],
        /// Radius (m).
        radius: f64,
    },
}

/// An axis-aligned plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// Axis normal to the plane.
    pub axis: Axis,
    /// Coordinate on that axis (m).
    pub at: f64,
}

/// A coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// First axis.
    X,
    /// Second axis.
    Y,
    /// Third axis.
    Z,
}

impl Axis {
    /// Index of the axis in a vector.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// A tool: a rigid shape whose pose comes from the device.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolDescription {
    /// Name in reports.
    pub name: String,
    /// Shape in the frame of the tool.
    pub shape: ToolShape,
}

/// How contact forces are found. The tick always works from a compliance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactMethod {
    /// Indirect: free motion, compliance of the contacts, the scene's solver, correction.
    #[default]
    Compliance,
    /// Direct: one program of body and contacts with Lagrange multipliers. For comparison: it allocates, and takes seconds a
    /// step on bodies of thousands of nodes. With `integrator = "backward_euler"` only.
    Lagrange,
    /// Direct: springs and dampers in place of laws, implicit. For comparison: the skin lies in the tool as deep as the force
    /// asks, and friction creeps. With `integrator = "backward_euler"` only.
    Penalty,
}

impl ContactMethod {
    /// All methods, as scenes name them.
    pub const ALL: [Self; 3] = [Self::Compliance, Self::Lagrange, Self::Penalty];

    /// Name in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Compliance => "compliance",
            Self::Lagrange => "lagrange",
            Self::Penalty => "penalty",
        }
    }
}

/// How the tool and the tissue touch.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactDescription {
    /// How contact forces are found.
    pub method: ContactMethod,
    /// Springs of contact; for `method = "penalty"` only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<PenaltyConfig>,
    /// Coefficient of Coulomb friction; 0 leaves one row per contact.
    pub friction: f64,
    /// Where a contact sits on the tissue: at surface nodes or on faces.
    pub at: ContactKind,
    /// Gap (m) below which a feature becomes a (possibly inactive) contact.
    pub margin: f64,
    /// How far (m) the whole tool may lie below the skin and still be pushed out.
    pub reach: f64,
    /// Face contacts closer than this (m) are merged.
    pub merge_distance: f64,
    /// Largest number of contacts; the deepest are kept.
    pub max_contacts: usize,
}

impl Default for ContactDescription {
    fn default() -> Self {
        Self {
            method: ContactMethod::Compliance,
            penalty: None,
            friction: 0.0,
            at: ContactKind::Nodes,
            margin: 0.004,
            reach: 0.02,
            merge_distance: 0.001,
            max_contacts: 48,
        }
    }
}

/// When the constraint solvers stop.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverDescription {
    /// Register name of the solver at step rate: `gauss_seidel`, `semismooth_newton`, `automatic`, ... The tick always
    /// takes warm-started Gauss-Seidel, whose work is bounded.
    pub kind: SolverKind,
    /// Relative natural-map residual at step rate.
    pub tolerance: f64,
    /// Largest number of sweeps, or of the solver's own iterations, at step rate.
    pub max_sweeps: u32,
    /// Relative natural-map residual of a tick.
    pub tick_tolerance: f64,
    /// Largest number of Gauss-Seidel sweeps in one tick.
    pub tick_sweeps: u32,
}

impl Default for SolverDescription {
    fn default() -> Self {
        Self { kind: SolverKind::GaussSeidel, tolerance: 1e-6, max_sweeps: 2000, tick_tolerance: 1e-3, tick_sweeps: 30 }
    }
}

/// What contact problem a tick solves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TickMethod {
    /// Contacts found anew in each tick, on the tissue around the tool as the step left it.
    #[default]
    Local,
    /// The rows of the step: contacts, normals and forms stay as they were until the next one. For comparison.
    Frozen,
}

/// What the tick takes from a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TickDescription {
    /// What contact problem a tick solves.
    pub method: TickMethod,
    /// Largest number of nodes of the tissue around the tool; the nearest triangles are kept. For `method = "local"` only.
    pub patch_nodes: usize,
    /// Time (s) over which the shape of the tissue goes over from one step's to the next's; 0 lets the force jump. For
    /// `method = "local"` only.
    pub hand_over: f64,
}

impl Default for TickDescription {
    fn default() -> Self {
        Self {
            method: TickMethod::default(),
            patch_nodes: PatchTickConfig::MAX_NODES,
            hand_over: PatchTickConfig::HAND_OVER,
        }
    }
}

/// The haptic device.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceDescription {
    /// Register name of the device: `virtual` (held by the virtual hand) or `scripted` (follows the path exactly).
    pub kind: String,
    /// Published limits of a real device that the virtual one takes on, such as `omega.3`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Mass, damping, friction, encoder and delay of the virtual device.
    pub mechanics: VirtualDeviceConfig,
}

impl Default for DeviceDescription {
    fn default() -> Self {
        Self { kind: "virtual".into(), preset: None, mechanics: VirtualDeviceConfig::default() }
    }
}

/// The virtual hand and the path that it follows.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandDescription {
    /// Published mass, damping and stiffness of a grip: `none`, `fingertip`, `stylus`, `arm` or `firm`.
    pub preset: String,
    /// Times (s) and positions (m), joined by minimum-jerk motions.
    pub path: Vec<ScriptKey>,
}

impl Default for HandDescription {
    fn default() -> Self {
        Self { preset: "arm".into(), path: Vec::new() }
    }
}
