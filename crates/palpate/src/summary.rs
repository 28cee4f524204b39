//! What a run was like: rates, tails of times, iterations, residuals.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use hdrhistogram::Histogram;
use palpate_rigid::RigidState;
use serde::Serialize;

pub use crate::changes::EventRecord;
pub use crate::port_summary::{ContactCounts, ForceCounts, GripperSummary, PortSummary};
pub use crate::record::TraceOutcome;
use crate::step::placements;
pub use crate::unconverged::Unconverged;
use crate::world::World;

/// Median and tails of one measured quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Largest value.
    pub max: f64,
}

/// Gathers non-negative values and answers percentiles.
#[derive(Clone, Debug)]
pub struct Tail {
    histogram: Histogram<u64>,
    unit: f64,
}

impl Tail {
    /// A tail that resolves values to a thousandth above `unit`.
    pub fn new(unit: f64) -> Self {
        // 3 significant digits over any u64: the bounds are valid by construction.
        let histogram = Histogram::new(3).unwrap_or_else(|_| unreachable!("3 significant digits are valid"));
        Self { histogram, unit }
    }

    /// Adds a value; non-finite and negative values count as 0.
    pub fn record(&mut self, value: f64) {
        let scaled = (value / self.unit).max(0.0);
        // The histogram grows with its values; only a value beyond memory itself could be refused.
        let _ = self.histogram.record(if scaled.is_finite() { scaled as u64 } else { 0 });
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// Median and tails.
    pub fn percentiles(&self) -> Percentiles {
        let at = |q| self.histogram.value_at_quantile(q) as f64 * self.unit;
        Percentiles { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: self.histogram.max() as f64 * self.unit }
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunEnd {
    /// All the time that was asked for.
    Completed,
    /// The caller asked it to stop.
    Interrupted,
    /// The body became non-finite or was torn apart; it was rolled back and the force set to zero.
    BodyFailed,
}

impl fmt::Display for RunEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Completed => "completed",
            Self::Interrupted => "interrupted",
            Self::BodyFailed => "STOPPED: the body became non-finite or was torn apart, and was rolled back",
        })
    }
}

impl RunEnd {
    /// Name in traces and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Interrupted => "interrupted",
            Self::BodyFailed => "body_failed",
        }
    }
}

/// A rigid body at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RigidEnd {
    /// Its name.
    pub name: String,
    /// Origin of its shape (m).
    pub position: [f64; 3],
    /// Orientation of its shape `[x, y, z, w]`.
    pub orientation: [f64; 4],
    /// Velocity of its centre of mass (m/s).
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
}

impl RigidEnd {
    /// All rigid bodies of a world.
    pub(crate) fn all(world: &World, rigid: &[RigidState]) -> Vec<Self> {
        let names = world.bodies().rigid.iter().map(|body| body.name.clone());
        names
            .zip(placements(world, rigid))
            .map(|(name, (position, orientation, velocity, angular_velocity))| Self {
                name,
                position,
                orientation,
                velocity,
                angular_velocity,
            })
            .collect()
    }
}

impl fmt::Display for RigidEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.position;
        let [i, j, k, w] = self.orientation;
        let speed = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        write!(
            f,
            "{} at [{x:.5}, {y:.5}, {z:.5}] m, orientation [{i:.4}, {j:.4}, {k:.4}, {w:.4}], {:.3e} m/s, {:.3e} rad/s",
            self.name,
            speed(&self.velocity),
            speed(&self.angular_velocity)
        )
    }
}

/// The summary of a run. Times in seconds, forces in newtons.
#[derive(Clone, Debug, Serialize)]
pub struct RunSummary {
    /// Name of the scene.
    pub scene: String,
    /// `real time` or `lockstep`.
    pub mode: &'static str,
    /// The integrator, with its substeps and critical step where it has them.
    pub integrator: String,
    /// How contact forces were found at step rate, with the parameters of the method.
    pub contact: String,
    /// The law of contact, with its parameters.
    pub law: String,
    /// Where the compliance came from, when matrices were factored, and why.
    pub plan: String,
    /// How the run ended.
    pub end: RunEnd,
    /// Simulated time (s).
    pub simulated: f64,
    /// Wall time (s); 0 in lockstep, where it means nothing.
    pub wall: f64,
    /// Nodes of the body, fixed ones included.
    pub nodes: usize,
    /// Tetrahedra of the body.
    pub tetrahedra: usize,
    /// Steps done.
    pub steps: u64,
    /// Refreshes of the factor, refused ones included.
    pub factors: u64,
    /// Ticks done.
    pub ticks: u64,
    /// Rate of the step thread (Hz); like the other rates 0 in lockstep.
    pub step_rate: f64,
    /// Rate of the factor thread (Hz).
    pub factor_rate: f64,
    /// Rate of the tick thread (Hz).
    pub tick_rate: f64,
    /// Work of a step (s).
    pub step_work: Percentiles,
    /// Work of a factorisation (s).
    pub factor_work: Percentiles,
    /// Work of a tick (s).
    pub tick_work: Percentiles,
    /// How late a tick woke up (s).
    pub tick_latency: Percentiles,
    /// Deadlines missed by the step thread.
    pub step_overruns: u64,
    /// Deadlines missed by the tick thread.
    pub tick_overruns: u64,
    /// Refactorisations refused because the matrix was not positive definite.
    pub factors_refused: u64,
    /// When the factor thread died, where it did (s): the run went on without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor_thread_died: Option<f64>,
    /// Conjugate-gradient iterations per step.
    pub iterations: Percentiles,
    /// Age of the factor that a step used (s).
    pub factor_age: Percentiles,
    /// Measured relative error of the compliance, over the steps where it was measured.
    pub compliance_error: Percentiles,
    /// Number of those steps.
    pub compliance_errors: u64,
    /// Relative error of the contact forces, over the steps where it was measured: what an accuracy is held against.
    pub force_error: Percentiles,
    /// Number of those steps.
    pub force_errors: u64,
    /// Conjugate-gradient iterations of the exact correction, over the steps where the compliance was judged.
    pub correction_iterations: Percentiles,
    /// Deepest overlap that a correction left (m).
    pub overlap: f64,
    /// Refreshes of the factor that the step urged before their turn.
    pub factors_early: u64,
    /// Steps in contact whose compliance was that of their own matrix.
    pub exact_steps: u64,
    /// Steps in contact by rung of the ladder of methods, from the lowest; empty without an accuracy.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rungs: Vec<(&'static str, u64)>,
    /// Steps that began on a higher rung than the one before.
    pub climbs: u64,
    /// Steps in contact whose forces missed the accuracy by what was known.
    pub accuracy_missed: u64,
    /// Contacts per step.
    pub contacts: Percentiles,
    /// Contacts that did not fit the stated capacity, over the run.
    pub contacts_dropped: u64,
    /// Contacts of fixed and rigid bodies per step.
    pub body_contacts: Percentiles,
    /// Rigid bodies at the end of the run.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rigid_bodies: Vec<RigidEnd>,
    /// Worst relative natural-map residual of a step.
    pub worst_residual: f64,
    /// Worst relative natural-map residual of a tick.
    pub worst_tick_residual: f64,
    /// Steps in which the automatic choice of the contact solver fell back from its first.
    pub fall_backs: u64,
    /// Steps in contact by the solver whose forces were taken, or by the direct method.
    pub answered: BTreeMap<&'static str, u64>,
    /// Steps whose motion the guard or Newton's line search shortened.
    pub shortened: u64,
    /// Steps whose motion the guard repeated.
    pub repeated: u64,
    /// Steps that held an element open.
    pub held_open: u64,
    /// Steps that began with tissue that had passed through itself.
    pub tangled: u64,
    /// Steps that led the body out of a tangle by linear elasticity in place of its law.
    pub led: u64,
    /// Steps in which the factor's copy in 16 bits could not serve, so that solves went by its stored values.
    pub in_full: u64,
    /// Steps by Newton's method whose contact forces still changed when their passes were used up.
    pub unsettled: u64,
    /// Steps whose contact forces missed the solver's tolerance, or that had no compliance and went on without contact.
    pub contact_unsolved: u64,
    /// Elements whose tangent the definiteness filter changed, over all steps.
    pub filtered: u64,
    /// Elements that were inverted at the start of a step, over all steps.
    pub inverted: u64,
    /// Largest force on the device (N).
    pub largest_force: f64,
    /// Largest jump of the force at a new snapshot (N).
    pub largest_jump: f64,
    /// Events that changed the body.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<EventRecord>,
    /// Steps whose factor was of a body before an event and could not follow it.
    pub outdated_steps: u64,
    /// Those of them that factored their own matrix instead.
    pub renewed_steps: u64,
    /// Linear solves that ended without convergence, and contact that was left out.
    pub unconverged: Unconverged,
    /// Jumps of the force at new snapshots that came while the tool was in contact (N).
    pub force_jump: Percentiles,
    /// What contact problem the tick solved.
    pub tick_method: String,
    /// Ticks in which skin beyond the patch could have touched the tool unseen.
    pub beyond_patch: u64,
    /// Steps whose patch had no room for all of the skin near the tool.
    pub patches_full: u64,
    /// Steps that handed frozen rows to the tick in place of a patch since those of its contacts with rigid and fixed bodies
    /// found no room in one.
    pub frozen_at_rigid: u64,
    /// Impulse of the contact forces over the run (N s): what the steps put on the tissue, and what the ticks found, before
    /// limits and fades.
    pub impulse: [f64; 2],
    /// The device's port: energy, and what acted on the force.
    pub port: PortSummary,
    /// Records that the observer missed because its ring was full.
    pub records_missed: u64,
    /// What the trace holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<TraceOutcome>,
    /// Files written.
    pub files: Vec<PathBuf>,
    /// Notes for the user: granted priority, failed body, trace trouble.
    pub notes: Vec<String>,
}
