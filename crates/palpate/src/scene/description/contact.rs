//! How the tool and the tissue touch.

use palpate_collision::detection::ContactKind;
use palpate_constraints::law::{Coulomb, FacetedCoulomb, Law, Signorini, Threshold, Tresca};
use palpate_constraints::penalty::PenaltyConfig;
use serde::{Deserialize, Serialize};

/// How contact forces are found. The tick always works from a compliance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactMethod {
    /// Indirect: free motion, compliance of the contacts, the scene's solver, correction.
    #[default]
    Compliance,
    /// Direct: one program of all bodies and contacts with Lagrange multipliers. For comparison: it allocates, and takes seconds a
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

/// What a contact does to whatever presses and slides. Step and tick use the same law, and so do all bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactLawKind {
    /// Dry friction on the exact cone, `friction`; without friction the same as [`Self::Signorini`].
    #[default]
    Coulomb,
    /// No friction: one row a contact.
    Signorini,
    /// Dry friction on a cone of `facets` facets, whose corners carry all of `friction`: for comparison.
    FacetedCoulomb,
    /// Friction of at most `limit`, however hard the contact is pressed.
    Tresca,
    /// A normal force of at most `limit`, which then gives way, and no friction: puncture. Not beside fixed and rigid bodies.
    Threshold,
}

impl ContactLawKind {
    /// All laws, as scenes name them.
    pub const ALL: [Self; 5] = [Self::Coulomb, Self::Signorini, Self::FacetedCoulomb, Self::Tresca, Self::Threshold];

    /// Name in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coulomb => "coulomb",
            Self::Signorini => "signorini",
            Self::FacetedCoulomb => "faceted_coulomb",
            Self::Tresca => "tresca",
            Self::Threshold => "threshold",
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
    /// The law of every contact.
    pub law: ContactLawKind,
    /// Coefficient of Coulomb friction; 0 leaves one row per contact. For `law = "coulomb"` and `"faceted_coulomb"` only.
    pub friction: f64,
    /// Facets of the cone of friction; for `law = "faceted_coulomb"` only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub facets: Option<usize>,
    /// Largest force (N) of each contact, along the skin for `law = "tresca"`, into it for `"threshold"`. Of each: with
    /// `max_contacts = 1` it is the limit of the tool, whatever the mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Where a contact sits on the tissue: at surface nodes or on faces.
    pub at: ContactKind,
    /// Gap (m) below which a feature becomes a (possibly inactive) contact.
    pub margin: f64,
    /// How far (m) the whole tool may lie below the skin and still be pushed out.
    pub reach: f64,
    /// Whether points of faces that carry a force stay contacts until they unload; for spheres and capsules at `"faces"`. The
    /// force of a still tool then comes to rest, and depends a little (a percent) on how the tool came there.
    pub hold: bool,
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
            law: ContactLawKind::Coulomb,
            friction: 0.0,
            facets: None,
            limit: None,
            at: ContactKind::Nodes,
            margin: 0.004,
            reach: 0.02,
            hold: false,
            merge_distance: 0.001,
            max_contacts: 48,
        }
    }
}

impl ContactDescription {
    /// The law with its parameters. Those that the law needs and that are not given are zero, which no checked scene has.
    pub fn contact_law(&self) -> Law {
        let (friction, limit) = (self.friction, self.limit.unwrap_or(0.0));
        match self.law {
            ContactLawKind::Coulomb if friction > 0.0 => Coulomb { friction }.into(),
            ContactLawKind::Coulomb | ContactLawKind::Signorini => Signorini.into(),
            // On a pair without friction: a checked scene has some.
            ContactLawKind::FacetedCoulomb if friction == 0.0 => Signorini.into(),
            ContactLawKind::FacetedCoulomb => {
                FacetedCoulomb { friction, facets: self.facets.unwrap_or_default() }.into()
            }
            ContactLawKind::Tresca => Tresca { limit }.into(),
            ContactLawKind::Threshold => Threshold { limit }.into(),
        }
    }

    /// The law with its parameters, as text for people.
    pub fn law_in_words(&self) -> String {
        let limit = self.limit.unwrap_or(0.0);
        match self.law {
            ContactLawKind::Coulomb if self.friction > 0.0 => format!("coulomb, friction {}", self.friction),
            ContactLawKind::Coulomb | ContactLawKind::Signorini => "signorini, no friction".into(),
            ContactLawKind::FacetedCoulomb => {
                format!("faceted_coulomb, friction {} on {} facets", self.friction, self.facets.unwrap_or_default())
            }
            ContactLawKind::Tresca => format!("tresca, friction of at most {limit} N a contact"),
            ContactLawKind::Threshold => format!("threshold, gives way at {limit} N a contact, no friction"),
        }
    }
}
