//! The virtual hand that holds the virtual device.
//!
//! A rigid grip: hand and device move as one, and their masses and dampings add,
//! ```text
//! m_h ẍ + b_h (ẋ − ẋ_d) + k_h (x − x_d) = F                                             N
//! ```
//! A grasp that gives way has a spring and a damper between the device at x and the hand's mass at y [Fu and Çavuşoğlu 2012]:
//! ```text
//! F = k_g (x − y) + b_g (ẋ − ẏ)                                                         N
//! m_h ÿ + b_h (ẏ − ẋ_d) + k_h (y − x_d) = F
//! ```
//! x_d is the script's path. A hand is the same in all directions, and does not stiffen while it grips.

use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::error::{non_negative, positive};

/// Spring and damper of the skin and the fingers between a device and a hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grasp {
    /// Stiffness k_g \[N/m\], > 0.
    pub stiffness: f64,
    /// Damping b_g \[N s/m\], ≥ 0.
    pub damping: f64,
}

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
    /// How the hand holds the device; `None`: rigidly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grasp: Option<Grasp>,
}

/// A named hand and where its numbers come from.
#[derive(Clone, Copy, Debug)]
pub struct HandPreset {
    /// Name in scenes.
    pub name: &'static str,
    /// The numbers.
    pub hand: Hand,
    /// Source of the numbers, and what was measured.
    pub source: &'static str,
    /// Which of the source's numbers they are.
    pub numbers: &'static str,
}

/// Where the three grips of a stylus come from. The fit extends to 30 Hz; beyond it the model is extrapolated.
const FU: &str = "Fu and Cavusoglu, IEEE Trans. Syst. Man Cybern. B 42 (2012) 1633: stylus held like a pen with 1 to 3 N, \
                  arm free, random force along x on 15 subjects, fitted from 0.6 to 30 Hz";

/// The register of hands.
pub const HAND_PRESETS: &[HandPreset] = &[
    HandPreset {
        name: "none",
        hand: Hand::rigid(0.0, 0.0, 0.0),
        source: "no hand",
        numbers: "the least damped, hence the worst case for stability",
    },
    HandPreset {
        name: "loose",
        hand: Hand::rigid(0.14, 3.68, 63.0).grasping(228.0, 0.87),
        source: FU,
        numbers: "lower limits of 95 % of subjects and grips (table III)",
    },
    HandPreset {
        name: "normal",
        hand: Hand::rigid(0.218, 4.645, 78.75).grasping(379.5, 1.839),
        source: FU,
        numbers: "nominal hand (table II)",
    },
    HandPreset {
        name: "firm",
        hand: Hand::rigid(0.57, 10.29, 151.0).grasping(651.0, 4.56),
        source: FU,
        numbers: "upper limits of 95 % of subjects and grips (table III)",
    },
    HandPreset {
        name: "fingertip",
        hand: Hand::rigid(0.006, 2.0, 200.0),
        source: "Hajian and Howe, J. Biomech. Eng. 119 (1997) 109: outstretched index finger, extension",
        numbers: "order of magnitude; the stiffness is that of a force of 2.6 N",
    },
    HandPreset {
        name: "stylus",
        hand: Hand::rigid(0.05, 4.0, 350.0),
        source: "assumed, not measured",
        numbers: "a light three-finger grip that is rigid",
    },
    HandPreset {
        name: "arm",
        hand: Hand::rigid(0.554, 6.45, 135.0),
        source: "van Beek et al., Sci. Rep. 5 (2015) 18004: hand on a handle, forearm in a sling",
        numbers: "one trial (figure 3)",
    },
];

impl Hand {
    /// A hand that grips rigidly: mass \[kg\], damping \[N s/m\], stiffness \[N/m\].
    #[must_use]
    pub const fn rigid(mass: f64, damping: f64, stiffness: f64) -> Self {
        Self { mass, damping, stiffness, grasp: None }
    }

    /// The same with a grasp that gives way: stiffness \[N/m\], damping \[N s/m\].
    #[must_use]
    pub const fn grasping(self, stiffness: f64, damping: f64) -> Self {
        Self { grasp: Some(Grasp { stiffness, damping }), ..self }
    }

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
        non_negative("hand stiffness [N/m]", self.stiffness)?;
        let Some(grasp) = &self.grasp else { return Ok(()) };
        // A mass of zero between two springs has no equation of motion.
        positive("mass of a hand with a grasp [kg]", self.mass)?;
        positive("grasp stiffness [N/m]", grasp.stiffness)?;
        non_negative("grasp damping [N s/m]", grasp.damping)
    }

    /// Stiffness that a slow motion of the device meets \[N/m\]: hand and grasp in series.
    #[must_use]
    pub fn slow_stiffness(&self) -> f64 {
        match self.grasp {
            Some(grasp) if self.stiffness > 0.0 => 1.0 / (1.0 / self.stiffness + 1.0 / grasp.stiffness),
            Some(_) => 0.0,
            None => self.stiffness,
        }
    }
}

impl Default for Hand {
    /// The fingertip.
    fn default() -> Self {
        Self::rigid(0.006, 2.0, 200.0)
    }
}
