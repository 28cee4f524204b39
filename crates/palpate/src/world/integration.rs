//! The integrator of the body, and whether it bears the step.

use std::fmt;
use std::sync::Arc;

use palpate_fem::factor::SymbolicFactor;
use palpate_fem::integrator::critical_step::{CriticalStep, critical_step};
use palpate_fem::integrator::explicit::{check_mass, check_step};
use palpate_fem::integrator::newton::NewtonConfig;
use palpate_fem::model::FemModel;

use crate::counted::counted;
use crate::scene::{IntegratorKind, Scene, SceneError};

/// Share of the critical step at rest that explicit substeps keep to by default: tissue that is squeezed to three
/// quarters of an element's length bears a step three quarters as long.
pub const EXPLICIT_SAFETY: f64 = 0.75;

/// How the body moves in time, with what the method needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Integration {
    /// Backward Euler with one linearisation.
    BackwardEuler,
    /// Backward Euler by Newton's method.
    Newton(NewtonConfig),
    /// Central differences.
    Explicit {
        /// Substeps of one step.
        substeps: u32,
        /// Length of a substep (s).
        dt: f64,
        /// The critical step at rest.
        critical: CriticalStep,
    },
}

impl Integration {
    /// The integrator of the scene's body for a step `dt` (s); explicit substeps are checked against the critical step.
    pub(super) fn new(
        scene: &Scene,
        model: &FemModel,
        symbolic: &Arc<SymbolicFactor>,
        dt: f64,
    ) -> Result<Self, SceneError> {
        let body = &scene.description().bodies[0];
        match body.integrator {
            IntegratorKind::BackwardEuler => Ok(Self::BackwardEuler),
            IntegratorKind::Newton => {
                let newton = body.newton.unwrap_or_default();
                Ok(Self::Newton(NewtonConfig { iterations: newton.iterations, tolerance: newton.tolerance }))
            }
            IntegratorKind::Explicit => {
                let remedy = "or use integrator = \"backward_euler\"";
                check_mass(model).map_err(|e| scene.at("body.0.integrator", e.to_string(), remedy))?;
                let explicit = body.explicit.unwrap_or_default();
                let critical = critical_step(model, &model.rest_state(), symbolic);
                let substeps = explicit.substeps.unwrap_or_else(|| critical.substeps(dt, EXPLICIT_SAFETY));
                if substeps > crate::scene::MOST_SUBSTEPS {
                    let message = format!(
                        "the critical step of {:.3e} s needs {}",
                        critical.step,
                        counted(substeps, "substep", "substeps")
                    );
                    return Err(scene.at("body.0.integrator", message, "use integrator = \"backward_euler\""));
                }
                let sub = dt / f64::from(substeps);
                if !explicit.allow_unstable {
                    check_step(dt, substeps, &critical).map_err(|e| {
                        let needed = critical.substeps(dt, 1.0);
                        let remedy = format!(
                            "set explicit = {{ substeps = {needed} }} or more, or leave it out; `allow_unstable = true` beside \
                             it takes the step nevertheless"
                        );
                        scene.at("body.0.explicit.substeps", e.to_string(), remedy)
                    })?;
                }
                Ok(Self::Explicit { substeps, dt: sub, critical })
            }
        }
    }
}

impl fmt::Display for Integration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BackwardEuler => write!(f, "backward Euler, one linearisation"),
            Self::Newton(config) => write!(
                f,
                "backward Euler, at most {} to a residual of {:e}",
                counted(config.iterations, "Newton iteration", "Newton iterations"),
                config.tolerance
            ),
            Self::Explicit { substeps, dt, critical } => write!(
                f,
                "explicit, {} of {:.4} ms; critical step at rest {:.4} ms (largest frequency {:.1} to {:.1} rad/s)",
                counted(*substeps, "substep", "substeps"),
                dt * 1e3,
                critical.step * 1e3,
                critical.lower,
                critical.upper
            ),
        }
    }
}
