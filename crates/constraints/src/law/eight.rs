//! The natural map of eight frictional contacts at once.
//!
//! A residual is looked at after every sweep of a solver. Contact by contact it is a chain of roots and quotients that
//! wait for one another; eight contacts side by side take little longer than one.

use super::coulomb;
use palpate_fem::lanes::Lanes;
use pulp::{Arch, Simd, WithSimd};

/// Eight contacts of [`Coulomb`](super::Coulomb)'s law, row by row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EightContacts {
    /// Friction coefficients, dimensionless.
    pub friction: [f64; 8],
    /// Stiffnesses that turn gaps into forces, N/m, `> 0`.
    pub rho: [f64; 8],
    /// Gaps, m.
    pub delta: [[f64; 8]; 3],
    /// Forces, N.
    pub lambda: [[f64; 8]; 3],
}

impl EightContacts {
    /// [`ContactLaw::natural_map`](super::ContactLaw::natural_map) of each, N: the same bits.
    #[must_use]
    pub fn natural_maps(&self) -> [[f64; 8]; 3] {
        Arch::new().dispatch(NaturalMaps(self))
    }
}

struct NaturalMaps<'a>(&'a EightContacts);

impl WithSimd for NaturalMaps<'_> {
    type Output = [[f64; 8]; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self(of) = self;
        let mut out = [[0.0; 8]; 3];
        for part in 0..8 / Lanes::<S>::COUNT {
            let load = |row: &[f64; 8]| Lanes::<S>::load(simd, row, part);
            let [delta, lambda] = [&of.delta, &of.lambda].map(|rows| [load(&rows[0]), load(&rows[1]), load(&rows[2])]);
            let r = coulomb::natural_map(load(&of.friction), load(&of.rho), delta, lambda);
            for (r, out) in r.iter().zip(&mut out) {
                r.store(out, part);
            }
        }
        out
    }
}
