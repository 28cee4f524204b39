//! The virtual hand that holds the virtual device.
//!
//! ```text
//! m_h ẍ + b_h (ẋ − ẋ_d) + k_h (x − x_d) = F          N
//! ```
//! x_d is the script's path. The grip is rigid, so hand and device move as one and their masses and dampings add.
//! The numbers are orders of magnitude from the literature, one set for a kind of grip, isotropic; a real hand
//! stiffens as it grips, which a script may follow with a different preset, not within one.

use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::error::non_negative;

/// Mass, damping and stiffness of a hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hand {
    /// Effective mass m_h \[kg\], ≥ 0.
    pub mass: f64,
    /// Damping b_h \[N s/m\], ≥ 0.
    pub damping: f64,
    /// Stiffness k_h towards the script's path \[N/m\], ≥ 0.
    pub stiffness: f64,
}

/// A named hand and where its numbers come from.
#[derive(Clone, Copy, Debug)]
pub struct HandPreset {
    /// Name in scenes.
    pub name: &'static str,
    /// The numbers.
    pub hand: Hand,
    /// Source of the numbers.
    pub source: &'static str,
}

/// The register of hands.
pub const HAND_PRESETS: &[HandPreset] = &[
    HandPreset {
        name: "none",
        hand: Hand { mass: 0.0, damping: 0.0, stiffness: 0.0 },
        source: "no hand: the least damped, hence the worst case for stability",
    },
    HandPreset {
        name: "fingertip",
        hand: Hand { mass: 0.006, damping: 2.0, stiffness: 200.0 },
        source: "order of Hajian and Howe, J. Biomech. Eng. 119 (1997) 109",
    },
    HandPreset {
        name: "stylus",
        hand: Hand { mass: 0.05, damping: 4.0, stiffness: 350.0 },
        source: "assumed: light three-finger grip",
    },
    HandPreset {
        name: "arm",
        hand: Hand { mass: 0.554, damping: 6.45, stiffness: 135.0 },
        source: "van Beek et al., Sci. Rep. 5 (2015) 18004, figure 3, one trial",
    },
    HandPreset {
        name: "firm",
        hand: Hand { mass: 0.3, damping: 12.0, stiffness: 700.0 },
        source: "assumed: firm grip",
    },
];

impl Hand {
    /// The hand of this name.
    ///
    /// # Errors
    /// A name that [`HAND_PRESETS`] does not hold.
    pub fn preset(name: &str) -> Result<Self, SetupError> {
        HAND_PRESETS.iter().find(|preset| preset.name == name).map(|preset| preset.hand).ok_or_else(|| {
            let known: Vec<_> = HAND_PRESETS.iter().map(|preset| preset.name).collect();
            SetupError::UnknownName { kind: "hand", name: name.to_owned(), known: known.join(", ") }
        })
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number that is negative or not finite.
    pub fn validate(&self) -> Result<(), SetupError> {
        non_negative("hand mass [kg]", self.mass)?;
        non_negative("hand damping [N s/m]", self.damping)?;
        non_negative("hand stiffness [N/m]", self.stiffness)
    }
}

impl Default for Hand {
    /// The fingertip.
    fn default() -> Self {
        Self { mass: 0.006, damping: 2.0, stiffness: 200.0 }
    }
}
