//! Contact laws, one file each, gathered in [`Law`] by the register at the end of this file.
//!
//! A block is the group of rows that one law couples: `[n]` or `[n, t, s]`. Over a block,
//!
//! ```text
//! delta_a = W_aa lambda_a + b_a ,   b_a = delta_free_a + sum_{c != a} W_ac lambda_c
//! ```
//!
//! with forces `lambda` in N (positive pushes apart), gaps `delta` in m (`>= 0` means apart) and `W_aa` in m/N.
//! A law says which pairs (delta, lambda) it admits. It does so in the forms that solvers want: as an exact solution of
//! the local problem ([`ContactLaw::resolve`]), as a projection onto its admissible forces ([`ContactLaw::project`]), as
//! the residual that vanishes exactly on admissible pairs ([`ContactLaw::natural_map`]), as an equation with its
//! derivatives for Newton ([`ContactLaw::linearize`]), and as a set for conic solvers ([`ContactLaw::conic_form`]).
//!
//! Local vectors have three entries; rows that a block does not have are zero.

mod bilateral;
mod conic;
mod coulomb;
mod eight;
mod faceted;
mod linearization;
mod local;
mod signorini;
mod sticking;
mod threshold;
mod tresca;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub use bilateral::Bilateral;
pub use conic::ConicForm;
pub use coulomb::{Coulomb, MAX_FRICTION};
pub use eight::EightContacts;
pub use faceted::{FacetedCoulomb, MAX_FACETS};
pub use linearization::{Linearization, RowEquation};
pub use local::{COMPLIANCE_FLOOR, LocalCompliance, natural_stiffness};
pub use signorini::Signorini;
pub use threshold::Threshold;
pub use tresca::Tresca;

/// Largest number of rows that one law couples.
pub const MAX_BLOCK_ROWS: usize = 3;

/// A parameter that is outside the range of its law.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("law `{law}`: {parameter} = {value} is outside its range; {remedy}")]
pub struct LawError {
    /// Register name of the law.
    pub law: &'static str,
    /// Name of the parameter.
    pub parameter: &'static str,
    /// The value that was given.
    pub value: f64,
    /// What to do about it.
    pub remedy: &'static str,
}

/// What a law must say of itself. Registering a type that implements it makes a variant of [`Law`].
pub trait ContactLaw: Copy {
    /// Name in scenes, files and the command line.
    const NAME: &'static str;

    /// Whether the corrected gap is the gap itself.
    const ASSOCIATED: bool = true;

    /// Number of rows of a block, 1 to [`MAX_BLOCK_ROWS`].
    fn rows(&self) -> usize;

    /// Checks the parameters.
    ///
    /// # Errors
    /// Names the first parameter that is outside its range.
    fn validate(&self) -> Result<(), LawError>;

    /// Whether a gap `delta` (m) needs no force: `true` exactly where (delta, 0) is admissible, `false` for NaN.
    fn needs_no_force(&self, delta: &Vector3<f64>) -> bool;

    /// Solves the local problem exactly: the force (N) for which (`W lambda + b`, lambda) is admissible.
    ///
    /// `b` (m) is the gap without the block's own contribution. The answer is finite and admissible whatever the
    /// arguments, and the work is bounded. A block without compliance gets no force.
    #[allow(non_snake_case)]
    fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64>;

    /// [`ContactLaw::resolve`] where a force `start` (N) near the solution is known: sooner done for laws that iterate, and
    /// the solution near it where there are several.
    #[inline]
    #[allow(non_snake_case)]
    fn resolve_from(&self, W: &LocalCompliance, b: &Vector3<f64>, _start: &Vector3<f64>) -> Vector3<f64> {
        self.resolve(W, b)
    }

    /// The admissible force (N) nearest to `force`; zero where `force` is not finite.
    fn project(&self, force: &Vector3<f64>) -> Vector3<f64>;

    /// The gap (m) that is complementary to the force over the law's cone. The gap itself unless the law is not
    /// associated (see [`Coulomb`]).
    fn corrected_gap(&self, delta: &Vector3<f64>) -> Vector3<f64> {
        *delta
    }

    /// The admissible forces as a set that conic solvers can take. Together with
    /// [`corrected_gap`](ContactLaw::corrected_gap) this is the whole law: the corrected gap lies in the normal cone of the
    /// set at the force, with opposite sign.
    fn conic_form(&self) -> ConicForm;

    /// The law as an equation with its derivatives, for Newton. `rho > 0` in N/m turns a gap into a force.
    fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization;

    /// Residual of the law (N): `lambda - P(lambda - rho * corrected_gap(delta))`, zero exactly on admissible pairs.
    ///
    /// `rho > 0` in N/m turns a gap into a force. Dividing the result by `rho` gives a residual in metres. NaN where an
    /// argument is not finite.
    #[inline]
    fn natural_map(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Vector3<f64> {
        let shifted = lambda - self.corrected_gap(delta) * rho;
        if is_finite(&shifted) { lambda - self.project(&shifted) } else { Vector3::repeat(f64::NAN) }
    }
}

/// Whether every entry is a number.
#[inline]
fn is_finite(v: &Vector3<f64>) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}

macro_rules! laws {
    ($($(#[$doc:meta])* $variant:ident),+ $(,)?) => {
        /// Any registered law. In text: `{ type = "coulomb", friction = 0.2 }`.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum Law {
            $($(#[$doc])* $variant($variant),)+
        }

        $(impl From<$variant> for Law {
            fn from(law: $variant) -> Self {
                Law::$variant(law)
            }
        })+

        impl Law {
            /// Names of all registered laws.
            pub const NAMES: &'static [&'static str] = &[$($variant::NAME),+];

            /// Register name.
            pub fn name(&self) -> &'static str {
                match self { $(Law::$variant(_) => $variant::NAME,)+ }
            }

            /// [`ContactLaw::rows`]
            #[inline]
            pub fn rows(&self) -> usize {
                match self { $(Law::$variant(law) => law.rows(),)+ }
            }

            /// [`ContactLaw::validate`]
            ///
            /// # Errors
            /// Names the first parameter that is outside its range.
            pub fn validate(&self) -> Result<(), LawError> {
                match self { $(Law::$variant(law) => law.validate(),)+ }
            }

            /// [`ContactLaw::needs_no_force`]
            #[inline]
            pub fn needs_no_force(&self, delta: &Vector3<f64>) -> bool {
                match self { $(Law::$variant(law) => law.needs_no_force(delta),)+ }
            }

            /// [`ContactLaw::resolve`]
            #[inline]
            #[allow(non_snake_case)]
            pub fn resolve(&self, W: &LocalCompliance, b: &Vector3<f64>) -> Vector3<f64> {
                match self { $(Law::$variant(law) => law.resolve(W, b),)+ }
            }

            /// [`ContactLaw::resolve_from`]
            #[inline]
            #[allow(non_snake_case)]
            pub fn resolve_from(&self, W: &LocalCompliance, b: &Vector3<f64>, start: &Vector3<f64>) -> Vector3<f64> {
                match self { $(Law::$variant(law) => law.resolve_from(W, b, start),)+ }
            }

            /// [`ContactLaw::project`]
            #[inline]
            pub fn project(&self, force: &Vector3<f64>) -> Vector3<f64> {
                match self { $(Law::$variant(law) => law.project(force),)+ }
            }

            /// [`ContactLaw::corrected_gap`]
            #[inline]
            pub fn corrected_gap(&self, delta: &Vector3<f64>) -> Vector3<f64> {
                match self { $(Law::$variant(law) => law.corrected_gap(delta),)+ }
            }

            /// [`ContactLaw::conic_form`]
            pub fn conic_form(&self) -> ConicForm {
                match self { $(Law::$variant(law) => law.conic_form(),)+ }
            }

            /// Whether the corrected gap is the gap itself, so that the problem is one of convex optimisation.
            pub fn is_associated(&self) -> bool {
                match self { $(Law::$variant(_) => $variant::ASSOCIATED,)+ }
            }

            /// [`ContactLaw::linearize`]
            #[inline]
            pub fn linearize(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Linearization {
                match self { $(Law::$variant(law) => law.linearize(rho, delta, lambda),)+ }
            }

            /// [`ContactLaw::natural_map`]
            #[inline]
            pub fn natural_map(&self, rho: f64, delta: &Vector3<f64>, lambda: &Vector3<f64>) -> Vector3<f64> {
                match self { $(Law::$variant(law) => law.natural_map(rho, delta, lambda),)+ }
            }
        }
    };
}

laws! {
    /// Contact without friction.
    Signorini,
    /// Contact with dry friction.
    Coulomb,
    /// Contact with dry friction on a cone of flat facets.
    FacetedCoulomb,
    /// Contact with friction of a given strength.
    Tresca,
    /// A force up to a limit.
    Threshold,
    /// Rows held closed.
    Bilateral,
}

#[cfg(test)]
mod tests;
