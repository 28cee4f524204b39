//! What a scene file says: plain data with defaults, checked by [`super::Scene`].

mod body;
mod contact;
mod device;
mod event;
mod integrator;
mod selection;
mod solid;
mod solver;
mod tick;
mod tissue;
mod tool;

use palpate_haptics::coupling::CouplingConfig;
use palpate_haptics::limits::LimitsConfig;
use palpate_haptics::passivity::PassivityConfig;
use serde::{Deserialize, Serialize};

pub use body::{BlockDescription, BodyDescription, IsGiven};
pub use contact::{ContactDescription, ContactLawKind, ContactMethod};
pub use device::{DeviceDescription, HandDescription};
pub use event::EventDescription;
pub use integrator::{ExplicitDescription, IntegratorKind, NewtonDescription, Refactor};
pub use selection::{Axis, NodeSelection, Plane};
pub use solid::{FixedBodyDescription, RigidBodyDescription, SolidShape};
pub use solver::SolverDescription;
pub use tick::{TickDescription, TickMethod};
pub use tissue::TissueDescription;
pub use tool::ToolDescription;

/// A whole scene: one soft body, one tool, a device and the hand that holds it, and any number of fixed and rigid bodies.
/// SI units.
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
    /// Bodies that never move.
    #[serde(rename = "fixed_body", default, skip_serializing_if = "Vec::is_empty")]
    pub fixed_bodies: Vec<FixedBodyDescription>,
    /// Bodies with six degrees of freedom.
    #[serde(rename = "rigid_body", default, skip_serializing_if = "Vec::is_empty")]
    pub rigid_bodies: Vec<RigidBodyDescription>,
    /// Changes of the soft body while it runs.
    #[serde(rename = "event", default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<EventDescription>,
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
    /// Energy that the device may give out beyond what it took in.
    #[serde(default)]
    pub passivity: PassivityConfig,
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
    /// Lockstep only: age (s) at which a refreshed factor reaches the step, as if the factor thread took so long. By default the
    /// time that the plan predicts for a factorisation, in whole ticks: [`World::factor_delay`](crate::world::World::factor_delay).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor_delay: Option<f64>,
}

impl Default for RatesDescription {
    fn default() -> Self {
        Self { step: 30.0, factor: 10.0, tick: 1000.0, factor_delay: None }
    }
}

impl SceneDescription {
    /// The files that the scene reads, as it names them: meshes, images, shapes of bodies, and a recorded trace.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        let bodies = self.bodies.iter().flat_map(|body| [&body.mesh, &body.image]);
        let named = bodies.chain([&self.device.trace]).filter_map(Option::as_deref);
        let fixed = self.fixed_bodies.iter().map(|body| &body.shape);
        let shapes = fixed.chain(self.rigid_bodies.iter().map(|body| &body.shape));
        named.chain(shapes.filter_map(|shape| match shape {
            SolidShape::Mesh { file, .. } => Some(file.as_str()),
            _ => None,
        }))
    }
}
