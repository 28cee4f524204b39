//! The tissue of a body or of a region: a law, with viscosity if wished.

use palpate_fem::material::{Material, PronyTerm};
use serde::{Deserialize, Serialize};

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
