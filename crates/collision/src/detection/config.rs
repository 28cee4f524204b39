//! How contacts are found.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Where contacts are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactKind {
    /// At the nodes of the surface. On a coarse mesh the closest to the converged force, but a tool smaller than an
    /// element can pass between nodes.
    Nodes,
    /// At the deepest points of triangles. No tool passes; on a coarse mesh too stiff.
    #[default]
    Faces,
}

/// How contacts are found. Lengths in m, angles in rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectionConfig {
    /// Nodes or faces (default faces).
    pub kind: ContactKind,
    /// Contacts with a gap up to this become rows (default 2 mm): what the tool can approach in one step.
    pub margin: f64,
    /// How far the whole tool may lie below the skin and still be pushed out (default 10 mm).
    pub reach: f64,
    /// Contacts closer together than this \[m\] merge into the deepest (default 0: identical points only). Points that
    /// carried a force in the step before do not take part: they stay beside a deeper one.
    pub merge_distance: f64,
    /// Contacts whose normals differ by more than this \[rad\] never merge (default 0.2).
    pub merge_angle: f64,
    /// Most contacts kept, the deepest first (default 64).
    pub max_contacts: usize,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self {
            kind: ContactKind::Faces,
            margin: 2e-3,
            reach: 1e-2,
            merge_distance: 0.0,
            merge_angle: 0.2,
            max_contacts: 64,
        }
    }
}

/// A detection parameter out of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("detection: {name} = {value} must be {bound}")]
pub struct DetectionConfigError {
    /// The parameter.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// What it must be.
    pub bound: &'static str,
}

impl DetectionConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), DetectionConfigError> {
        for (name, value) in [
            ("margin", self.margin),
            ("reach", self.reach),
            ("merge_distance", self.merge_distance),
            ("merge_angle", self.merge_angle),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(DetectionConfigError { name, value, bound: "at least zero and finite" });
            }
        }
        if self.max_contacts == 0 {
            return Err(DetectionConfigError { name: "max_contacts", value: 0.0, bound: "at least 1" });
        }
        Ok(())
    }
}
