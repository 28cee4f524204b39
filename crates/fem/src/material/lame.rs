//! Parameters of isotropic linear elasticity, the errors of material parameters, and conversions.

use serde::Deserialize;
use thiserror::Error;

/// Lamé parameters (Pa): stress `2 mu ε + lambda tr(ε) I` at small strain `ε`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lame {
    /// Shear modulus `μ` (Pa).
    pub mu: f64,
    /// First Lamé parameter `λ` (Pa).
    pub lambda: f64,
}

impl Lame {
    /// From Young's modulus (Pa) and Poisson's ratio in `(-1, 0.5)`.
    #[inline]
    pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
        Self {
            mu: young / (2.0 * (1.0 + poisson)),
            lambda: young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)),
        }
    }

    /// Young's modulus (Pa).
    pub fn young(&self) -> f64 {
        self.mu * (3.0 * self.lambda + 2.0 * self.mu) / (self.lambda + self.mu)
    }

    /// Poisson's ratio.
    pub fn poisson(&self) -> f64 {
        0.5 * self.lambda / (self.lambda + self.mu)
    }

    /// From a shear modulus `mu` (Pa) and the bulk modulus (Pa).
    pub fn from_shear_bulk(mu: f64, bulk: f64) -> Self {
        Self { mu, lambda: bulk - mu * 2.0 / 3.0 }
    }

    /// The shear modulus times `1 - share`, at the same bulk modulus.
    pub(crate) fn relaxed(&self, share: f64) -> Self {
        Self::from_shear_bulk(self.mu * (1.0 - share), self.bulk())
    }

    /// Bulk modulus `λ + 2/3 μ` (Pa).
    pub fn bulk(&self) -> f64 {
        self.lambda + self.mu * 2.0 / 3.0
    }
}

/// Material parameters outside the range of their law.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum MaterialError {
    /// Young's modulus is not a positive number, or beyond that of any solid.
    #[error("young = {} Pa: Young's modulus must be positive and at most 1e15 (soft tissue: 1e3 to 1e6)", short(*.0))]
    Young(f64),
    /// Poisson's ratio is outside `(-1, 0.5)`.
    #[error("poisson = {0}: Poisson's ratio must lie in -1 < poisson < 0.5 (soft tissue: 0.4 to 0.49)")]
    Poisson(f64),
    /// A shear modulus is not a positive number.
    #[error("mu = {0} Pa: the shear modulus must be positive and finite")]
    ShearModulus(f64),
    /// The volumetric modulus leaves a bulk modulus that is not positive.
    #[error("k0 = {k0} Pa with mu = {mu} Pa: k0 + 2/3 mu, the bulk modulus, must be positive and finite")]
    VolumeModulus {
        /// The volumetric modulus (Pa).
        k0: f64,
        /// The shear modulus (Pa).
        mu: f64,
    },
    /// A parameter is outside its range.
    #[error("{name} = {value}: must be {range}")]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be, with its unit.
        range: &'static str,
    },
    /// The share of a Prony term is outside `(0, 1)`.
    #[error("viscosity term {term}: modulus = {modulus}: the share that relaxes must lie in 0 < modulus < 1")]
    PronyModulus {
        /// The term, from 0.
        term: usize,
        /// Its share.
        modulus: f64,
    },
    /// The time of a Prony term is not a positive number.
    #[error("viscosity term {term}: time = {time} s: the relaxation time must be positive and finite")]
    PronyTime {
        /// The term, from 0.
        term: usize,
        /// Its time (s).
        time: f64,
    },
    /// A Prony series relaxes to nothing.
    #[error("the viscosity's moduli add up to {0}: below 1, or no stiffness is left at rest; lower them")]
    PronySum(f64),
    /// The law takes no viscosity.
    #[error(
        "{0} takes no viscosity: its stress does not turn with the tissue; use `corotational` or a hyperelastic law"
    )]
    NoViscosity(&'static str),
    /// No set of parameters is complete, or several are mixed.
    #[error("{law} takes {sets}: one complete set, not a mixture")]
    ParameterSet {
        /// The law.
        law: &'static str,
        /// The sets that it takes.
        sets: &'static str,
    },
}

impl MaterialError {
    /// The key of a description that holds the value, from the material on, with dots: `viscosity.1.time`. `None` where it
    /// is no single one.
    #[must_use]
    pub fn key(&self) -> Option<String> {
        match self {
            Self::Young(_) => Some("young".into()),
            Self::Poisson(_) => Some("poisson".into()),
            Self::ShearModulus(_) => Some("mu".into()),
            Self::VolumeModulus { .. } => Some("k0".into()),
            Self::OutOfRange { name, .. } => Some((*name).into()),
            Self::PronyModulus { term, .. } => Some(format!("viscosity.{term}.modulus")),
            Self::PronyTime { term, .. } => Some(format!("viscosity.{term}.time")),
            Self::PronySum(_) | Self::NoViscosity(_) => Some("viscosity".into()),
            Self::ParameterSet { .. } => None,
        }
    }
}

/// Largest Young's modulus (Pa): a thousand times that of diamond, and far from where products of it leave the range of f64.
const STIFFEST: f64 = 1e15;

/// A number without a row of zeros.
fn short(value: f64) -> String {
    if value.abs() < 1e15 { value.to_string() } else { format!("{value:e}") }
}

/// Checks the range of Young's modulus (Pa) and Poisson's ratio.
pub(crate) fn validate_young_poisson(young: f64, poisson: f64) -> Result<(), MaterialError> {
    if !(young > 0.0 && young <= STIFFEST) {
        return Err(MaterialError::Young(young));
    }
    if !(poisson > -1.0 && poisson < 0.5) {
        return Err(MaterialError::Poisson(poisson));
    }
    Ok(())
}

/// Checks a parameter that must be positive and finite.
pub(crate) fn validate_positive(name: &'static str, value: f64, range: &'static str) -> Result<(), MaterialError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(MaterialError::OutOfRange { name, value, range }) }
}

/// The two ways to write the parameters of laws that have those of linear elasticity and no others.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ElasticParameters {
    young: Option<f64>,
    poisson: Option<f64>,
    mu: Option<f64>,
    lambda: Option<f64>,
}

impl ElasticParameters {
    /// Young's modulus (Pa) and Poisson's ratio, validated.
    pub(crate) fn young_poisson(&self, law: &'static str) -> Result<(f64, f64), MaterialError> {
        let (young, poisson) = match (self.young, self.poisson, self.mu, self.lambda) {
            (Some(young), Some(poisson), None, None) => (young, poisson),
            (None, None, Some(mu), Some(lambda)) => {
                if !(mu > 0.0 && mu.is_finite()) {
                    return Err(MaterialError::ShearModulus(mu));
                }
                let lame = Lame { mu, lambda };
                let bulk = "positive and finite in Pa (it is lambda + 2/3 mu)";
                validate_positive("the bulk modulus", lame.bulk(), bulk)?;
                (lame.young(), lame.poisson())
            }
            _ => {
                let sets = "`young` and `poisson`, or `mu` and `lambda`";
                return Err(MaterialError::ParameterSet { law, sets });
            }
        };
        validate_young_poisson(young, poisson)?;
        Ok((young, poisson))
    }
}

/// Construction of a law whose parameters are `young` and `poisson` alone, in files also `mu` and `lambda`.
macro_rules! elastic_parameters {
    ($Law:ident, $name:literal) => {
        impl TryFrom<$crate::material::lame::ElasticParameters> for $Law {
            type Error = $crate::material::MaterialError;

            fn try_from(p: $crate::material::lame::ElasticParameters) -> Result<Self, $crate::material::MaterialError> {
                let (young, poisson) = p.young_poisson($name)?;
                Ok(Self { young, poisson })
            }
        }

        impl $Law {
            /// From Young's modulus (Pa) and Poisson's ratio at small strain; not validated.
            pub fn from_young_poisson(young: f64, poisson: f64) -> Self {
                Self { young, poisson }
            }
        }
    };
}

/// What a law trait asks about the small-strain moduli, for a law that keeps them as `young` and `poisson`.
macro_rules! elastic_moduli {
    () => {
        fn validate(&self) -> Result<(), $crate::material::MaterialError> {
            $crate::material::lame::validate_young_poisson(self.young, self.poisson)
        }

        #[inline]
        fn small_strain(&self) -> $crate::material::Lame {
            $crate::material::Lame::from_young_poisson(self.young, self.poisson)
        }

        fn relaxed(&self, share: f64) -> Self {
            let lame = $crate::material::Lame::from_young_poisson(self.young, self.poisson).relaxed(share);
            Self { young: lame.young(), poisson: lame.poisson() }
        }
    };
}

pub(super) use {elastic_moduli, elastic_parameters};
