//! What a run will do for compliance, decided before it begins.
//!
//! Decisions rest on counts of operations and on stated rates of a nominal machine, never on measured time: the same
//! scene is computed by the same methods on every machine, in real time and in lockstep. `palpate plan` measures this
//! body's own factor beside the prediction, and says where the machine at hand would have been planned for otherwise.

use std::fmt;

use palpate_constraints::compliance::{ComplianceMethod, MotionCorrection};
use palpate_fem::element::ElementKind;
use palpate_fem::factor::{FactorPrecision, SymbolicFactor};
use palpate_fem::material::Material;
use palpate_fem::sparse::BlockPattern;

use super::sampling;
use super::{Integration, Ladder, Precomputed, Rung, Sampling};
use crate::scene::{BodyDescription, Refactor, SceneDescription};

/// Operations per second of a factorisation on one core of the nominal machine.
const FACTOR_RATE: f64 = 15e9;

/// How much faster single precision is, with its numbers widened and copied as those in double are: 1.35 times for 3,000 free
/// nodes and 1.6 for 7,000 where it was measured.
const SINGLE_GAIN: f64 = 1.5;

/// Operations per second of solves with the factor, which wait for memory.
const SOLVE_RATE: f64 = 3e9;

/// Time (s) of a product of two 3 x 3 blocks that are read from memory, on the nominal machine.
const BLOCK_TIME: f64 = 8e-9;

/// Share of a step that a factorisation may take to be done in it.
const FACTOR_SHARE: f64 = 0.4;

/// Time that a factor takes to follow a change of one node, in solves: three columns, in blocks that share the way through
/// the factor.
const SOLVES_OF_NODE: f64 = 1.0;

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
    /// The methods between which the run keeps the accuracy that the scene states; then `compliance` is that of the rung
    /// where it has a factor thread, and each step reports its own.
    pub ladder: Option<Ladder>,
    /// The inverse of the first matrix between the nodes of the skin, where a method asks for it.
    pub precomputed: Option<Precomputed>,
    /// When a column of `W` is compared with the exact one.
    pub sampling: Sampling,
    /// What the factor thread computes with: a factor that comes late for a step is all the better the younger it is.
    pub precision: FactorPrecision,
    /// Predicted time of a factorisation in double precision (s).
    pub factorization: f64,
    /// Predicted time of a solve with the factor (s).
    pub solve: f64,
    /// Why these methods.
    pub reason: String,
}

impl Plan {
    /// The plan of a checked scene whose body has this symbolic factor.
    pub(super) fn new(
        scene: &SceneDescription,
        integration: &Integration,
        symbolic: &SymbolicFactor,
        pattern: &BlockPattern,
        skin: usize,
    ) -> Self {
        let body = &scene.bodies[0];
        let dt = 1.0 / scene.rates.step;
        let factorization = symbolic.flops() / FACTOR_RATE;
        let solve = 4.0 * symbolic.nonzeros() as f64 / SOLVE_RATE;
        let constant = is_constant(body);
        let linearised = *integration == Integration::BackwardEuler;
        let (compliance, refactor, mut reason) = match body.accuracy {
            _ if !linearised => {
                (ComplianceMethod::Exact, Refactor::Once, format!("the integrator brings its own: {integration}"))
            }
            Some(_) if body.compliance == ComplianceMethod::Automatic && !constant => {
                let reason = format!("the scene states an accuracy; {}", milliseconds(factorization, dt));
                (ComplianceMethod::Asynchronous, Refactor::Thread, reason)
            }
            _ => choose(body, dt, factorization, constant),
        };
        let climbs = body.accuracy.filter(|_| linearised && compliance != ComplianceMethod::Exact);
        let warps = compliance == ComplianceMethod::Warped;
        let precomputed = warps.then(|| Precomputed::new(skin, body.surface_memory));
        let fits = factorization <= dt;
        let ladder = climbs.map(|accuracy| match refactor {
            Refactor::Thread => Ladder::with_thread(accuracy, fits),
            _ => Ladder::without_thread(accuracy, fits),
        });
        if let Some(precomputed) = &precomputed {
            reason = format!("{reason}; {}", precomputed.text());
        }
        let correction = if linearised { body.correction } else { MotionCorrection::default() };
        let iteration = sampling::iteration(symbolic, pattern);
        let sampling = match correction {
            _ if !linearised => Sampling::none(iteration),
            // Nothing else tells how wrong the compliance is.
            MotionCorrection::Matching if ladder.is_some() => Sampling::always(iteration),
            _ => Sampling::within(body.error_sampling * dt, iteration),
        };
        // What fits in a step gains no step by being faster.
        let late = refactor == Refactor::Thread && !fits;
        let precision = if late { FactorPrecision::Single } else { FactorPrecision::Double };
        Self {
            compliance,
            refactor,
            correction,
            constant,
            ladder,
            precomputed,
            sampling,
            precision,
            factorization,
            solve,
            reason,
        }
    }

    /// Predicted time (s) in which the factor thread factors a matrix.
    pub fn refresh(&self) -> f64 {
        match self.precision {
            FactorPrecision::Double => self.factorization,
            FactorPrecision::Single => self.factorization / SINGLE_GAIN,
        }
    }

    /// Most nodes that an event may touch for a factor to follow it by an update in a step of `dt` (s): one that takes no
    /// longer than the factorisation which does in its place, or where that is short, than may be spent in a step on one.
    pub(super) fn room_for_changes(&self, dt: f64) -> usize {
        if self.refactor == Refactor::Step {
            return 0;
        }
        (self.factorization.max(Self::largest_in_step(dt)) / self.change_of_node()) as usize
    }

    /// Predicted time (s) in which a factor follows a change of one node.
    pub fn change_of_node(&self) -> f64 {
        SOLVES_OF_NODE * self.solve
    }

    /// Predicted time (s) of what a rung of the ladder does in a step more than free motion and contact: for `rows` rows of
    /// contact compliance, correction, and on the last rung the factorisation.
    pub fn rung_time(&self, rung: Rung, rows: usize) -> f64 {
        // Three rows of a contact touch up to three nodes; blocks of all pairs of nodes are read for each row.
        let gather = (rows * rows) as f64 * BLOCK_TIME;
        // Half a solve per row, which blocks of rows share eight times over; the correction is the other half.
        let halves = self.solve * (rows as f64 / 16.0 + 0.5);
        match rung {
            Rung::Warped => gather + self.solve,
            Rung::Asynchronous | Rung::Early => halves,
            Rung::Exact => self.factorization + halves,
        }
    }

    /// Longest factorisation (s) that the automatic choice puts into every step of `dt` (s).
    pub fn largest_in_step(dt: f64) -> f64 {
        FACTOR_SHARE * dt
    }

    /// Whether a factor thread is started.
    pub fn has_factor_thread(&self) -> bool {
        self.refactor == Refactor::Thread
    }

    /// Whether the step needs memory for a factor of its own matrix: where the plan makes one, where the body may change by
    /// more than the thread's factor can follow, and for iterations that fail where a factorisation fits into `dt` (s).
    pub(crate) fn has_own_factor(&self, dt: f64, changes: bool) -> bool {
        let planned = self.refactor == Refactor::Step || self.compliance == ComplianceMethod::Exact && !self.constant;
        let follows = changes && self.has_factor_thread();
        planned
            || self.ladder.is_some_and(|ladder| ladder.ends_exact())
            || follows
            || !self.constant && self.factorization <= dt
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let when = match self.refactor {
            Refactor::Thread if self.precision == FactorPrecision::Single => "factored by a thread in single precision",
            Refactor::Step => "factored in every step, no factor thread",
            Refactor::Thread => "factored by a thread",
            Refactor::Once => "factored once, no factor thread",
        };
        match &self.ladder {
            Some(ladder) => write!(f, "{ladder}; {when}")?,
            None => write!(f, "{} compliance, {when}", self.compliance.name())?,
        }
        if !matches!(self.compliance, ComplianceMethod::Exact) {
            write!(f, ", {} correction", self.correction.name())?;
        }
        write!(f, "; {}", self.reason)
    }
}

/// The predicted time of a factorisation (s) beside that of a step (s), in words.
fn milliseconds(factorization: f64, dt: f64) -> String {
    format!("{:.1} ms predicted for a factorisation, {:.1} ms a step", 1e3 * factorization, 1e3 * dt)
}

/// The methods for backward Euler, and why.
fn choose(body: &BodyDescription, dt: f64, factorization: f64, constant: bool) -> (ComplianceMethod, Refactor, String) {
    let milliseconds = milliseconds(factorization, dt);
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
pub(crate) fn is_constant(body: &BodyDescription) -> bool {
    let mut tissues = body.regions.values().chain([&body.material]);
    body.element != ElementKind::Averaged
        && tissues.all(|tissue| matches!(tissue.law, Material::Linear(_)) && tissue.viscosity.is_empty())
}
