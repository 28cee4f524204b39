//! The linear part of the rig's loop, sampled exactly: its largest eigenvalue tells whether small motions in the wall die.
//!
//! Between ticks z' = A z + e F/m with z = (x, ẋ) or, where the grasp gives way, (x, ẋ, y, ẏ). Over a period
//! z₊ = Φ z + Γ F with Φ = e^{AT}, and the loop keeps the depth of the tick before and the forces that are on their way,
//! ```text
//! F_k = −(K + B/T) x_k + (B/T) x_{k−1},      z_{k+1} = Φ z_k + Γ F_{k−n}
//! ```
//! so the matrix below acts on (z_k, x_{k−1}, F_{k−1} … F_{k−n}). Friction, encoder and jitter have no place in it.

use nalgebra::DMatrix;

use super::{Rig, Wall};

impl Rig {
    /// Largest modulus of the eigenvalues of one tick with the device in the wall: below 1, small motions die.
    #[must_use]
    pub fn spectral_radius(&self, wall: &Wall) -> f64 {
        let loops = self.matrix(wall);
        loops.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max)
    }

    fn matrix(&self, wall: &Wall) -> DMatrix<f64> {
        let motion = self.continuous();
        let states = motion.nrows() - 1;
        let exponential = (motion * self.period).exp();
        let n = self.mechanics.delay_ticks;
        let (previous, line) = (states, states + 1);
        let mut m = DMatrix::zeros(states + 1 + n, states + 1 + n);
        m.view_mut((0, 0), (states, states)).copy_from(&exponential.view((0, 0), (states, states)));
        m[(previous, 0)] = 1.0;
        let (now, before) = (-(wall.stiffness + wall.damping / self.period), wall.damping / self.period);
        // Where the force of this tick goes: into the motion, or to the begin of the line of delayed ones.
        let mut put = |row: usize, gain: f64| {
            m[(row, 0)] += gain * now;
            m[(row, previous)] += gain * before;
        };
        if n == 0 {
            (0..states).for_each(|row| put(row, exponential[(row, states)]));
        } else {
            put(line, 1.0);
            for k in 1..n {
                m[(line + k, line + k - 1)] = 1.0;
            }
            for row in 0..states {
                m[(row, line + n - 1)] = exponential[(row, states)];
            }
        }
        m
    }

    /// Motion between ticks of (z, F), F constant.
    fn continuous(&self) -> DMatrix<f64> {
        let (m, b, hand) = (self.mechanics.mass, self.mechanics.damping, &self.hand);
        match &hand.grasp {
            Some(grasp) => {
                let (kg, bg, mh) = (grasp.stiffness, grasp.damping, hand.mass);
                #[rustfmt::skip]
                let rows = [
                    0.0, 1.0, 0.0, 0.0, 0.0,
                    -kg / m, -(b + bg) / m, kg / m, bg / m, 1.0 / m,
                    0.0, 0.0, 0.0, 1.0, 0.0,
                    kg / mh, bg / mh, -(kg + hand.stiffness) / mh, -(bg + hand.damping) / mh, 0.0,
                    0.0, 0.0, 0.0, 0.0, 0.0,
                ];
                DMatrix::from_row_slice(5, 5, &rows)
            }
            None => {
                let (m, b) = (m + hand.mass, b + hand.damping);
                let rows = [0.0, 1.0, 0.0, -hand.stiffness / m, -b / m, 1.0 / m, 0.0, 0.0, 0.0];
                DMatrix::from_row_slice(3, 3, &rows)
            }
        }
    }
}
