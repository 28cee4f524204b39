//! What a run will do for compliance, decided before it begins.
//!
//! Decisions rest on counts of operations and on stated rates of a nominal machine, never on measured time: the same
//! scene is computed by the same methods on every machine, in real time and in lockstep. `palpate plan` measures this
//! body's own factor beside the prediction, and says where the machine at hand would have been planned for otherwise.

use std::fmt;

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_fem::element::ElementKind;
use palpate_fem::factor::SymbolicFactor;
use palpate_fem::material::Material;

use super::Integration;
use crate::scene::{BodyDescription, Refactor, SceneDescription};

/// Operations per second of a factorisation on one core of the nominal machine.
const FACTOR_RATE: f64 = 15e9;

/// The same for solves with the factor, which wait for memory.
const SOLVE_RATE: f64 = 3e9;

/// Share of a step that a factorisation may take to be done in it.
const FACTOR_SHARE: f64 = 0.4;

/// Time that a factor takes to follow a change of one node, in solves: three columns, in blocks that share the way through
/// the factor.
const SOLVES_OF_NODE: f64 = 1.0;

/// Fewest iterations in which a column of the compliance is worth being compared: fewer seldom converge.
const FEWEST_SAMPLE_ITERATIONS: usize = 6;

/// Most iterations that a comparison is given.
const MOST_SAMPLE_ITERATIONS: usize = 100;

/// The methods of a run, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Where `W` comes from; never [`ComplianceMethod::Automatic`].
    pub compliance: ComplianceMethod,
    /// When the system matrix is factored.
    pub refactor: Refactor,
    /// How contact forces move the body where `compliance` is not exact.
    pub correction: MotionCorrection,
    /// The system matrix never changes, so that its first factor is exact.
    pub constant: bool,
    /// Relative error of the contact forces above which the steps that follow are exact.
    pub accuracy: Option<f64>,
    /// Iterations granted to the comparison of a column of `W`; 0 where none is compared.
    pub sample_iterations: usize,
    /// Predicted time of a factorisation (s).
    pub factorization: f64,
    /// Predicted time of a solve with the factor (s).
    pub solve: f64,
    /// Why these methods.
    pub reason: String,
}

impl Plan {
    /// The plan of a checked scene whose body has this symbolic factor.
    pub(super) fn new(scene: &SceneDescription, integration: &Integration, symbolic: &SymbolicFactor) -> Self {
        let body = &scene.bodies[0];
        let dt = 1.0 / scene.rates.step;
        let factorization = symbolic.flops() / FACTOR_RATE;
        let solve = 4.0 * symbolic.nonzeros() as f64 / SOLVE_RATE;
        let constant = is_constant(body);
        let (compliance, refactor, reason) = if *integration == Integration::BackwardEuler {
            choose(body, dt, factorization, constant)
        } else {
            (ComplianceMethod::Exact, Refactor::Once, format!("the integrator brings its own: {integration}"))
        };
        let affordable = (body.error_sampling * dt / solve) as usize;
        let enough = affordable >= FEWEST_SAMPLE_ITERATIONS && *integration == Integration::BackwardEuler;
        Self {
            compliance,
            refactor,
            correction: body.correction,
            constant,
            accuracy: body.accuracy,
            sample_iterations: if enough { affordable.min(MOST_SAMPLE_ITERATIONS) } else { 0 },
            factorization,
            solve,
            reason,
        }
    }

    /// Most nodes that an event may touch for a factor to follow it by an update: one that takes no longer than a step, or
    /// than the factorisation that would do in its place.
    pub(super) fn room_for_changes(&self, dt: f64) -> usize {
        if self.refactor == Refactor::Step {
            return 0;
        }
        (dt.max(self.factorization) / self.change_of_node()) as usize
    }

    /// Predicted time (s) in which a factor follows a change of one node.
    pub fn change_of_node(&self) -> f64 {
        SOLVES_OF_NODE * self.solve
    }

    /// Longest factorisation (s) that the automatic choice puts into every step of `dt` (s).
    pub fn largest_in_step(dt: f64) -> f64 {
        FACTOR_SHARE * dt
    }

    /// Whether a factor thread is started.
    pub fn has_factor_thread(&self) -> bool {
        self.refactor == Refactor::Thread
    }

    /// Whether the step needs memory for a factor of its own matrix.
    pub(crate) fn has_own_factor(&self) -> bool {
        let steps_up = self.accuracy.is_some() && self.refactor != Refactor::Step && !self.constant;
        self.refactor == Refactor::Step || self.compliance == ComplianceMethod::Exact && !self.constant || steps_up
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let when = match self.refactor {
            Refactor::Step => "factored in every step, no factor thread",
            Refactor::Thread => "factored by a thread",
            Refactor::Once => "factored once, no factor thread",
        };
        write!(f, "{} compliance, {when}", self.compliance.name())?;
        if !matches!(self.compliance, ComplianceMethod::Exact) {
            write!(f, ", {} correction", self.correction.name())?;
        }
        if let Some(accuracy) = self.accuracy {
            write!(f, ", exact steps where the error exceeds {accuracy}")?;
        }
        write!(f, "; {}", self.reason)
    }
}

/// The methods for backward Euler, and why.
fn choose(body: &BodyDescription, dt: f64, factorization: f64, constant: bool) -> (ComplianceMethod, Refactor, String) {
    let milliseconds =
        format!("{:.1} ms predicted for a factorisation, {:.1} ms a step", 1e3 * factorization, 1e3 * dt);
    let named = |refactor: Refactor| {
        (body.compliance, body.refactor.unwrap_or(refactor), format!("as the scene says; {milliseconds}"))
    };
    match body.compliance {
        ComplianceMethod::Exact => named(Refactor::Step),
        ComplianceMethod::Asynchronous => named(Refactor::Thread),
        ComplianceMethod::Warped => named(Refactor::Once),
        ComplianceMethod::Automatic if constant => {
            (ComplianceMethod::Exact, Refactor::Once, "the law is linear: its matrix never changes".into())
        }
        ComplianceMethod::Automatic if factorization <= Plan::largest_in_step(dt) => {
            (ComplianceMethod::Exact, Refactor::Step, format!("a factorisation fits in the step: {milliseconds}"))
        }
        ComplianceMethod::Automatic => (
            ComplianceMethod::Asynchronous,
            Refactor::Thread,
            format!("a factorisation does not fit in the step: {milliseconds}"),
        ),
    }
}

/// Whether the stiffness depends on nothing that moves. Averaged and viscous elements are left to the general case.
fn is_constant(body: &BodyDescription) -> bool {
    let mut tissues = body.regions.values().chain([&body.material]);
    body.element != ElementKind::Averaged
        && tissues.all(|tissue| matches!(tissue.law, Material::Linear(_)) && tissue.viscosity.is_empty())
}
