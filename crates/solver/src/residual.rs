//! The natural-map residual, one for all solvers.
//!
//! Block by block, with `P` the projection onto the admissible forces and `delta'` the corrected gap of the law
//! (`delta + mu |delta_t| n` for Coulomb),
//!
//! ```text
//! r_a = ( lambda_a - P(lambda_a - rho_a delta'_a) ) / rho_a        m
//! residual = sqrt(sum_a |r_a|^2) / scale                           dimensionless
//! ```
//!
//! It is zero exactly at solutions, and takes no notice of how a solver came to `lambda` [Acary, Brémond and Huber 2018,
//! natural map]. Three departures: `rho_a` is `1 / mean diagonal of W_aa` rather than 1, so that the number does not depend
//! on units or on the stiffness of the bodies, and reads as the gap error that is left; `scale` is `|delta_free|`
//! over the blocks that need a force rather than over all, since contacts that are merely near would otherwise loosen
//! the tolerance of those that touch; and each share is raised by the rounding of its force, `2 eps |lambda_a| / rho_a`, so
//! that forces that grow for ever (conflicting rows) never pass for a solution. A residual of 1 means that about as much
//! violation is left as there was.

use crate::problem::{Block, ProblemView, gather};
use palpate_constraints::law::{EightContacts, Law, natural_stiffness};

/// Smallest scale, relative to `|delta_free|` over all blocks: below it rounding in far rows would count as error.
const SCALE_FLOOR: f64 = 1e-9;

/// Rounding of a gap and of its natural map relative to the block's force over its stiffness: a difference of large
/// terms. Large forces swallow the gap in it; what is left of the residual is then not known, least of all to be zero.
const ROUNDING: f64 = 2.0 * f64::EPSILON;

/// How far forces are from a solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Residual relative to [`scale`].
    pub relative: f64,
    /// Block with the largest share.
    pub worst_block: usize,
    /// That block's share `|r_a|`, m.
    pub worst_gap: f64,
}

/// Length (m) that the residual is relative to; `None` where no block needs a force, so that `lambda = 0` is a solution.
#[must_use]
pub fn scale(view: &ProblemView<'_>) -> Option<f64> {
    let (mut violated, mut all) = (0.0, 0.0);
    let mut solved = true;
    for block in view.blocks {
        let delta = gather(view.delta_free, block);
        all += delta.norm_squared();
        if !block.law.needs_no_force(&delta) {
            violated += delta.norm_squared();
            solved = false;
        }
    }
    // A gap below 1e-154 m squares to zero; the smallest number then keeps the quotient defined.
    (!solved).then(|| violated.sqrt().max(SCALE_FLOOR * f64::sqrt(all)).max(f64::MIN_POSITIVE))
}

/// Residual of forces whose gap is known: `delta = W lambda + delta_free` (m), `lambda` in N, `scale` from [`scale`].
#[must_use]
pub fn natural_map(view: &ProblemView<'_>, scale: f64, delta: &[f64], lambda: &[f64]) -> Residual {
    let rho = |a: usize| view.blocks.get(a).map_or(1.0, |b| natural_stiffness(&view.diagonal_block(b), b.law.rows()));
    natural_map_scaled(view, scale, rho, delta, lambda)
}

/// [`natural_map`] with the stiffness of each block (N/m) known.
pub(crate) fn natural_map_scaled(
    view: &ProblemView<'_>,
    scale: f64,
    rho: impl Fn(usize) -> f64,
    delta: &[f64],
    lambda: &[f64],
) -> Residual {
    let mut found = Shares::default();
    for (k, some) in view.blocks.chunks(8).enumerate() {
        if some.len() < 2 || !found.admit_frictional(8 * k, some, &rho, delta, lambda) {
            found.admit(8 * k, some, &rho, delta, lambda);
        }
    }
    Residual { relative: found.sum.sqrt() / scale, worst_block: found.worst_block, worst_gap: found.worst.sqrt() }
}

/// Sum and largest of the squares of the blocks' shares, m².
#[derive(Default)]
struct Shares {
    sum: f64,
    worst: f64,
    worst_block: usize,
}

impl Shares {
    #[inline]
    fn note(&mut self, block: usize, share: f64) {
        self.sum += share;
        // A NaN share is the worst, and stays it.
        if share > self.worst || share.is_nan() {
            (self.worst_block, self.worst) = (block, share);
        }
    }

    /// Adds the shares of blocks, of which the first has the number `first`.
    fn admit(&mut self, first: usize, blocks: &[Block], rho: impl Fn(usize) -> f64, delta: &[f64], lambda: &[f64]) {
        for (a, block) in (first..).zip(blocks) {
            let rho = rho(a);
            let force = gather(lambda, block);
            let r = block.law.natural_map(rho, &gather(delta, block), &force);
            self.note(a, share(r.norm_squared(), force.norm_squared(), rho));
        }
    }

    /// The same for up to eight contacts with Coulomb's law; `false`, and nothing is added, for others.
    fn admit_frictional(
        &mut self,
        first: usize,
        blocks: &[Block],
        rho: impl Fn(usize) -> f64,
        delta: &[f64],
        lambda: &[f64],
    ) -> bool {
        let mut contacts = EightContacts::default();
        let rows = blocks.first().map_or(0..0, |block| block.start..block.start + 3 * blocks.len());
        let (Some(delta), Some(lambda)) = (delta.get(rows.clone()), lambda.get(rows)) else { return false };
        let numbers = delta.as_chunks::<3>().0.iter().zip(lambda.as_chunks::<3>().0);
        for (k, (block, (delta, lambda))) in blocks.iter().zip(numbers).enumerate().take(8) {
            let Law::Coulomb(law) = block.law else { return false };
            contacts.friction[k] = law.friction;
            contacts.rho[k] = rho(first + k);
            for c in 0..3 {
                contacts.delta[c][k] = delta[c];
                contacts.lambda[c][k] = lambda[c];
            }
        }
        let squared = |rows: &[[f64; 8]; 3], k: usize| {
            rows[0][k] * rows[0][k] + rows[1][k] * rows[1][k] + rows[2][k] * rows[2][k]
        };
        let maps = contacts.natural_maps();
        // In each lane, whether a contact is in it or not: a loop over as many as there are would go one by one.
        let shares: [f64; 8] =
            std::array::from_fn(|k| share(squared(&maps, k), squared(&contacts.lambda, k), contacts.rho[k]));
        for (k, share) in shares.iter().enumerate().take(blocks.len()) {
            self.note(first + k, *share);
        }
        true
    }
}

/// Square of a block's share (m²) from the squares of its natural map and of its force (N²).
#[inline(always)]
fn share(map: f64, force: f64, rho: f64) -> f64 {
    let share = (map.sqrt() + ROUNDING * force.sqrt()) / rho;
    share * share
}

/// Residual of forces from nothing but the problem: the judge of all solvers. `scratch` takes the gap (m rows).
///
/// Zero for a problem that needs no force, if `lambda` is zero.
#[must_use]
pub fn evaluate(view: &ProblemView<'_>, lambda: &[f64], scratch: &mut [f64]) -> Residual {
    let nowhere = Residual { relative: f64::INFINITY, worst_block: 0, worst_gap: f64::INFINITY };
    if !view.is_consistent() || lambda.len() != view.rows() || scratch.len() != view.rows() {
        return nowhere;
    }
    view.gap(lambda, scratch);
    let length = scale(view).unwrap_or_else(|| scratch.iter().map(|gap| gap * gap).sum::<f64>().sqrt());
    natural_map(view, length.max(f64::MIN_POSITIVE), scratch, lambda)
}
