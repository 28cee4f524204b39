//! The bulk term of a law: energy of the change of volume alone, which elements of averaged dilatation evaluate at the
//! mean volume ratio of a group of elements instead of each element's own.

#![allow(non_snake_case)]

use super::{
    Lame, MaterialError,
    hyperelastic::{Hyperelastic, Response, VolumeFactor},
    volume::logarithmic,
};
use crate::lanes::Real;

/// Energy `U(J)` (J/m³) of a volume ratio `J`, zero at `J = 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bulk {
    /// `U = k/2 ln²J`, continued below `J = 0.2` as in the laws.
    Logarithmic {
        /// `k` (Pa).
        modulus: f64,
    },
    /// `U = k/2 (J - 1)²`.
    Quadratic {
        /// `k` (Pa).
        modulus: f64,
    },
}

impl Bulk {
    /// `U, U', U''` at any `J`.
    pub fn at(&self, J: f64) -> VolumeFactor<f64> {
        match *self {
            Self::Logarithmic { modulus } => logarithmic(0.0, modulus, J),
            Self::Quadratic { modulus } => {
                let d = J - 1.0;
                VolumeFactor { value: 0.5 * modulus * d * d, first: modulus * d, second: modulus }
            }
        }
    }
}

/// The law `Ψ(F) + p J`: under a pressure `p` (Pa, positive in tension) that does not depend on `F`.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnderPressure<L> {
    pub(super) law: L,
    pub(super) pressure: f64,
}

impl<L: Hyperelastic> Hyperelastic for UnderPressure<L> {
    const MIXED: bool = L::MIXED;
    const CURVED: bool = L::CURVED;
    const CONTINUED: bool = L::CONTINUED;

    fn validate(&self) -> Result<(), MaterialError> {
        self.law.validate()
    }

    fn small_strain(&self) -> Lame {
        self.law.small_strain()
    }

    fn relaxed(&self, share: f64) -> Self {
        Self { law: self.law.relaxed(share), pressure: self.pressure }
    }

    #[inline(always)]
    fn response<T: Real>(&self, I1: T, I2: T, J: T) -> Response<T> {
        let pressure =
            VolumeFactor { value: J * self.pressure, first: J.constant(self.pressure), second: J.constant(0.0) };
        self.law.response(I1, I2, J).with_volume(&pressure)
    }
}
