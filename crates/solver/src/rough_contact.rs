//! A frictional contact in sweeps of single precision: one step to the exact local solve.
//!
//! With `f = lambda - W_aa^-1 delta_a` the force of a contact that sticks, `b` the gap without the block's own part and
//! `S` the tangential block with the normal row eliminated,
//!
//! ```text
//! b_n >= 0                      lambda' = 0
//! f inside the cone             lambda' = f
//! else                          u = y / |y| ,   y = lambda_t - 2 / tr S (delta_t - w delta_n / W_nn)
//!                               lambda_n' = -b_n / (W_nn + mu w . u) ,   lambda_t' = mu lambda_n' u
//! ```
//!
//! of which exact local solutions are the fixed points: one root and one quotient instead of Newton's for the slip.

use crate::coupled_block::{Columns, Quad, inverse, times};

/// A contact that takes part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RoughContact {
    /// First row in [`crate::single::SingleCompliance`].
    pub(crate) place: usize,
    /// `W_aa^-1`, N/m.
    inverse: Columns,
    /// Its normal row, m/N.
    pub(crate) normal: Quad,
    /// `w / W_nn`, dimensionless.
    coupling: [f32; 2],
    /// `2 / tr S`, N/m.
    stiffness: f32,
    /// Friction coefficient.
    friction: f32,
    /// N.
    pub(crate) force: Quad,
    /// The block's number.
    pub(crate) number: usize,
}

impl RoughContact {
    /// The contact with the diagonal block `W` (m/N), its first row at `place`.
    #[allow(non_snake_case)]
    pub(crate) fn new(place: usize, W: &Columns, friction: f32, force: Quad, number: usize) -> Self {
        let normal = [W[0][0], W[1][0], W[2][0], 0.0];
        let coupling = [normal[1] / normal[0], normal[2] / normal[0]];
        let trace = W[1][1] + W[2][2] - coupling[0] * normal[1] - coupling[1] * normal[2];
        Self { place, inverse: inverse(W), normal, coupling, stiffness: 2.0 / trace, friction, force, number }
    }

    /// The force for the gap that there is.
    #[inline(always)]
    pub(crate) fn resolve(&self, gap: &Quad) -> Quad {
        let (old, mu, n) = (&self.force, self.friction, &self.normal);
        let open = gap[0] - (n[0] * old[0] + n[1] * old[1] + n[2] * old[2]);
        if open >= 0.0 {
            return [0.0; 4];
        }
        let change = times(&self.inverse, gap);
        let stick = [old[0] - change[0], old[1] - change[1], old[2] - change[2], 0.0];
        if stick[0] > 0.0 && stick[1] * stick[1] + stick[2] * stick[2] <= mu * mu * stick[0] * stick[0] {
            return stick;
        }
        let y = old[1] - self.stiffness * (gap[1] - self.coupling[0] * gap[0]);
        let z = old[2] - self.stiffness * (gap[2] - self.coupling[1] * gap[0]);
        // Multiplied through by |y|: the next contact waits for one root and one quotient.
        let size = (y * y + z * z).sqrt();
        let (y, z) = (mu * y, mu * z);
        let factor = -open / (n[0] * size + (n[1] * y + n[2] * z));
        // A coupling that separates what it presses: without friction then. False for NaN.
        if factor > 0.0 { [factor * size, factor * y, factor * z, 0.0] } else { [-open / n[0], 0.0, 0.0, 0.0] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use palpate_constraints::law::{ContactLaw, Coulomb, LocalCompliance};

    /// Exact local solutions for pressed, dragged and lifted contacts are fixed points, and are reached from no force.
    #[test]
    fn the_fixed_point_is_the_exact_local_solution() {
        let compliance = Matrix3::new(2.0, 0.3, -0.2, 0.3, 1.2, 0.25, -0.2, 0.25, 1.6) * 1e-4;
        let columns = [0, 1, 2].map(|c| [0, 1, 2, 3].map(|r| if r < 3 { compliance[(r, c)] as f32 } else { 0.0 }));
        let (law, local) = (Coulomb { friction: 0.4 }, LocalCompliance::new(&compliance, 3));
        for (b, sliding) in [([-1.0, -0.1, 0.06], false), ([-1.0, 0.9, -0.7], true), ([0.2, 0.5, 0.0], false)] {
            let b = Vector3::from(b) * 1e-3;
            let exact = law.resolve(&local, &b);
            assert_eq!(exact.x > 0.0 && exact.yz().norm() > 0.4 * exact.x * (1.0 - 1e-9), sliding);
            let mut contact = RoughContact::new(0, &columns, 0.4, [0.0; 4], 0);
            for _ in 0..20 {
                let force = Vector3::new(contact.force[0], contact.force[1], contact.force[2]).map(f64::from);
                let gap = compliance * force + b;
                contact.force = contact.resolve(&[gap.x as f32, gap.y as f32, gap.z as f32, 0.0]);
            }
            for (force, exact) in contact.force.iter().zip(exact.iter()) {
                // Rounding of single precision, twice or so.
                assert!((f64::from(*force) - exact).abs() <= 1e-6 * exact.abs().max(5.0), "{force} N for {exact} N");
            }
        }
    }
}
