//! Motion of device and hand over a sub-step, exact for constant forces.
//!
//! The linear part is integrated by its own exponential: that of a mass on spring and damper in closed form where the
//! grip is rigid; of the four states of two masses, as a matrix, where the grasp gives way. Coulomb friction on the device
//! is the constant force of at most f_c that brings its end velocity nearest to zero (maximum dissipation).

use nalgebra::{Matrix6, Vector3};

use crate::hand::{Grasp, Hand};

/// Device and hand: state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Position of the device \[m\].
    pub(super) position: Vector3<f64>,
    /// Its velocity \[m/s\].
    pub(super) velocity: Vector3<f64>,
    /// Position of the hand's mass \[m\]; that of the device where the grip is rigid.
    pub(super) hand_position: Vector3<f64>,
    /// Its velocity \[m/s\].
    pub(super) hand_velocity: Vector3<f64>,
}

impl Motion {
    /// At rest at `position` \[m\].
    pub(super) fn at(position: Vector3<f64>) -> Self {
        let still = Vector3::zeros();
        Self { position, velocity: still, hand_position: position, hand_velocity: still }
    }

    /// Puts the hand where the device is, moving as the device does.
    pub(super) fn join(&mut self) {
        (self.hand_position, self.hand_velocity) = (self.position, self.velocity);
    }
}

/// What acts during a sub-step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drive {
    /// Of the motors on the device \[N\].
    pub(super) force: Vector3<f64>,
    /// Of the script on the hand, k_h x_d + b_h ẋ_d \[N\].
    pub(super) hand: Vector3<f64>,
    /// Largest Coulomb friction on the device \[N\].
    pub(super) friction: f64,
}

/// Exact motion over one sub-step.
#[derive(Clone, Copy, Debug)]
pub(super) enum Propagator {
    /// Device and hand as one mass.
    Rigid(Rigid),
    /// Two masses with the grasp between them.
    Grasped(Grasped),
}

impl Propagator {
    /// For a device of `mass` \[kg\] and `damping` \[N s/m\] held by `hand`, over `h` seconds.
    pub(super) fn new(mass: f64, damping: f64, hand: &Hand, h: f64) -> Self {
        match &hand.grasp {
            Some(grasp) => Self::Grasped(Grasped::new(mass, damping, hand, grasp, h)),
            None => Self::Rigid(Rigid::new(mass + hand.mass, damping + hand.damping, hand.stiffness, h)),
        }
    }

    /// One sub-step.
    pub(super) fn advance(&self, motion: &mut Motion, drive: &Drive) {
        match self {
            Self::Rigid(p) => p.advance(motion, drive),
            Self::Grasped(p) => p.advance(motion, drive),
        }
    }
}

/// The friction that would stop a device of this end velocity, as far as there is so much; `response` is the velocity that a
/// constant force of 1 N adds.
fn friction(unhindered: Vector3<f64>, response: f64, most: f64) -> Vector3<f64> {
    let stopping = -unhindered / response;
    let needed = stopping.norm();
    if needed > most { stopping * (most / needed) } else { stopping }
}

/// Exact motion over one sub-step of m ẍ + b ẋ + k x = u for constant u:
/// `[x, v] <- transition [x, v] + input u`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rigid {
    xx: f64,
    xv: f64,
    vx: f64,
    vv: f64,
    xu: f64,
    vu: f64,
}

impl Rigid {
    fn new(m: f64, b: f64, k: f64, h: f64) -> Self {
        if k > 0.0 {
            // Roots −a ± sqrt(d); c and s are cos and sin/ω below critical damping, cosh and sinh/ω above it.
            let (a, d) = (0.5 * b / m, 0.25 * (b / m) * (b / m) - k / m);
            let w = d.abs().sqrt();
            let (c, s) = if w * h < 1e-4 {
                (1.0 + 0.5 * d * h * h, h * (1.0 + d * h * h / 6.0))
            } else if d < 0.0 {
                ((w * h).cos(), (w * h).sin() / w)
            } else {
                ((w * h).cosh(), (w * h).sinh() / w)
            };
            let e = (-a * h).exp();
            let (xx, xv) = (e * (c + a * s), e * s);
            Self { xx, xv, vx: -k / m * e * s, vv: e * (c - a * s), xu: (1.0 - xx) / k, vu: xv / m }
        } else if b > 0.0 {
            let loss = -(-b / m * h).exp_m1();
            let xv = loss * m / b;
            Self { xx: 1.0, xv, vx: 0.0, vv: 1.0 - loss, xu: (h - xv) / b, vu: loss / b }
        } else {
            Self { xx: 1.0, xv: h, vx: 0.0, vv: 1.0, xu: 0.5 * h * h / m, vu: h / m }
        }
    }

    fn advance(&self, motion: &mut Motion, drive: &Drive) {
        let push = drive.force + drive.hand;
        let unhindered = motion.position * self.vx + motion.velocity * self.vv + push * self.vu;
        let friction = friction(unhindered, self.vu, drive.friction);
        motion.position = motion.position * self.xx + motion.velocity * self.xv + (push + friction) * self.xu;
        motion.velocity = unhindered + friction * self.vu;
        motion.join();
    }
}

/// Exact motion over one sub-step of both masses: `[x, v, y, w] <- transition [x, v, y, w] + force F + hand P`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grasped {
    /// One row for each of x, v, y, w, in columns x, v, y, w, F, P.
    rows: [[f64; 6]; 4],
}

impl Grasped {
    fn new(m: f64, b: f64, hand: &Hand, grasp: &Grasp, h: f64) -> Self {
        let (kg, bg, mh) = (grasp.stiffness, grasp.damping, hand.mass);
        let mut a = Matrix6::zeros();
        a[(0, 1)] = 1.0;
        a[(2, 3)] = 1.0;
        for (j, value) in [-kg, -(b + bg), kg, bg, 1.0].into_iter().enumerate() {
            a[(1, j)] = value / m;
        }
        for (j, value) in [kg, bg, -(kg + hand.stiffness), -(bg + hand.damping), 0.0, 1.0].into_iter().enumerate() {
            a[(3, j)] = value / mh;
        }
        let e = (a * h).exp();
        Self { rows: std::array::from_fn(|i| std::array::from_fn(|j| e[(i, j)])) }
    }

    fn advance(&self, motion: &mut Motion, drive: &Drive) {
        let before =
            [motion.position, motion.velocity, motion.hand_position, motion.hand_velocity, drive.force, drive.hand];
        let after = self.rows.map(|row| row.iter().zip(&before).fold(Vector3::zeros(), |sum, (c, v)| sum + v * *c));
        let by_force = self.rows.map(|row| row[4]);
        let friction = friction(after[1], by_force[1], drive.friction);
        motion.position = after[0] + friction * by_force[0];
        motion.velocity = after[1] + friction * by_force[1];
        motion.hand_position = after[2] + friction * by_force[2];
        motion.hand_velocity = after[3] + friction * by_force[3];
    }
}
