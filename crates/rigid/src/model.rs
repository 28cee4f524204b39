//! Mass and inertia.

use nalgebra::Matrix3;
use thiserror::Error;

/// A mass or inertia that no body has.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RigidError {
    /// A mass that is not positive.
    #[error("mass = {0} kg must be positive and finite")]
    Mass(f64),
    /// Moments that are not positive, or of which one is larger than the two others together.
    #[error(
        "the principal moments of inertia {0:?} kg m² are no body's: each must be positive, and none larger than the sum \
         of the two others"
    )]
    Inertia([f64; 3]),
}

/// A rigid body about its centre of mass. Description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidModel {
    mass: f64,
    inertia: Matrix3<f64>,
    inverse_inertia: Matrix3<f64>,
    least_moment: f64,
}

impl RigidModel {
    /// A body of `mass` (kg) and `inertia` (kg m², about the centre of mass, in the body's frame; its symmetric part
    /// counts).
    ///
    /// # Errors
    /// [`RigidError`]
    pub fn new(mass: f64, inertia: Matrix3<f64>) -> Result<Self, RigidError> {
        if !(mass > 0.0 && mass.is_finite()) {
            return Err(RigidError::Mass(mass));
        }
        let inertia = 0.5 * (inertia + inertia.transpose());
        if !inertia.iter().all(|x| x.is_finite()) {
            return Err(RigidError::Inertia(inertia.diagonal().into()));
        }
        let moments = inertia.symmetric_eigenvalues();
        let (least, most) = (moments.min(), moments.max());
        // A thin disc has one moment equal to the sum of the others; rounding must not refuse it.
        let shaped = 2.0 * most <= moments.sum() * (1.0 + 1e-9);
        let inverse = inertia.try_inverse().filter(|_| least > 0.0 && shaped);
        match inverse {
            Some(inverse_inertia) => Ok(Self { mass, inertia, inverse_inertia, least_moment: least }),
            None => Err(RigidError::Inertia(moments.into())),
        }
    }

    /// Mass (kg).
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Inertia about the centre of mass in the body's frame (kg m²).
    pub fn inertia(&self) -> &Matrix3<f64> {
        &self.inertia
    }

    /// Its inverse.
    pub fn inverse_inertia(&self) -> &Matrix3<f64> {
        &self.inverse_inertia
    }

    /// The least principal moment (kg m²).
    pub fn least_moment(&self) -> f64 {
        self.least_moment
    }
}
