//! Volumes of the elements of a pack and their derivatives by the nodes.

use pulp::{Simd, WithSimd};

use crate::{
    lanes::{Lanes, Mat3, cross, dot, scaled},
    material::kernel::{Dispatch, load33, parts, store3},
    pack::{DeformedPack, PACK, Row},
};

/// Volumes (m³) and their gradients.
#[derive(Clone, Debug)]
pub(super) struct PackVolumes {
    pub(super) volume: Row,
    /// `∂v/∂q` of the four nodes (m²).
    pub(super) gradients: [[Row; 3]; 4],
}

impl PackVolumes {
    pub(super) const ZERO: Self = Self { volume: [0.0; PACK], gradients: [[[0.0; PACK]; 3]; 4] };
}

/// `v = V0 det e / det E`, so that both orders of the nodes have positive volumes.
pub(super) fn pack_volumes(dispatch: impl Dispatch, at: &DeformedPack<'_>, out: &mut PackVolumes) {
    dispatch.run(Volumes { at, out });
}

struct Volumes<'a> {
    at: &'a DeformedPack<'a>,
    out: &'a mut PackVolumes,
}

impl WithSimd for Volumes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { at, out } = self;
        for part in 0..parts::<S, 1>(at.rest) {
            let e: Mat3<Lanes<S>> = load33(simd, &at.edges, part);
            let sixth = Lanes::load(simd, &at.rest.inverse_det, part) * Lanes::load(simd, &at.rest.volume, part);
            let dv = [
                scaled(&cross(&e[1], &e[2]), sixth),
                scaled(&cross(&e[2], &e[0]), sixth),
                scaled(&cross(&e[0], &e[1]), sixth),
            ];
            dot(&e[0], &dv[0]).store(&mut out.volume, part);
            let mut first = dv[0];
            for c in 0..3 {
                first[c] = -(dv[0][c] + dv[1][c] + dv[2][c]);
            }
            store3(&first, &mut out.gradients[0], part);
            for a in 0..3 {
                store3(&dv[a], &mut out.gradients[a + 1], part);
            }
        }
    }
}
