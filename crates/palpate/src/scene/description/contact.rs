//! How the tool and the tissue touch.

use palpate_collision::detection::ContactKind;
use palpate_constraints::penalty::PenaltyConfig;
use serde::{Deserialize, Serialize};

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
