//! How a body moves in time, and when its matrix is factored.

use serde::{Deserialize, Serialize};

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
