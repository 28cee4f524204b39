//! Velocity of a device that measures none: differences of its poses behind a low-pass.

use nalgebra::Isometry3;
use palpate_haptics::wrench::Twist;

/// Cut-off of the low-pass (Hz): a hand moves below 20, an encoder step at 1 kHz lies above.
const CUTOFF: f64 = 100.0;

/// The estimate and the pose that it was made from.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    before: Option<Isometry3<f64>>,
    velocity: Twist,
}

impl Motion {
    /// The velocity at `pose`, `dt` seconds after the pose before; zero where there is none.
    pub(super) fn advance(&mut self, pose: &Isometry3<f64>, dt: Option<f64>) -> Twist {
        match (self.before.replace(*pose), dt) {
            (Some(before), Some(dt)) if dt > 0.0 => {
                let smoothing = -(-std::f64::consts::TAU * CUTOFF * dt).exp_m1();
                let linear = (pose.translation.vector - before.translation.vector) / dt;
                let angular = (pose.rotation * before.rotation.inverse()).scaled_axis() / dt;
                self.velocity.linear += (linear - self.velocity.linear) * smoothing;
                self.velocity.angular += (angular - self.velocity.angular) * smoothing;
                let finite = |v: &nalgebra::Vector3<f64>| v.iter().all(|x| x.is_finite());
                if !finite(&self.velocity.linear) || !finite(&self.velocity.angular) {
                    *self = Self::default();
                }
            }
            (Some(_), Some(_)) => {}
            _ => self.velocity = Twist::default(),
        }
        self.velocity
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    use super::*;

    fn pose(t: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 2.0 * t));
        Isometry3::from_parts(Translation3::new(0.1 * t, 0.0, -0.3 * t), turn)
    }

    #[test]
    fn a_steady_motion_is_found_and_a_pose_that_is_no_number_is_forgotten() {
        let mut motion = Motion::default();
        let mut found = Twist::default();
        for k in 0..50 {
            found = motion.advance(&pose(f64::from(k) * 1e-3), (k > 0).then_some(1e-3));
        }
        // 49 ms are 31 time constants of the low-pass.
        assert!((found.linear - Vector3::new(0.1, 0.0, -0.3)).norm() < 1e-12, "{found:?}");
        assert!((found.angular - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-9, "{found:?}");
        let bad = Isometry3::translation(f64::NAN, 0.0, 0.0);
        assert_eq!(motion.advance(&bad, Some(1e-3)), Twist::default());
        assert_eq!(motion.advance(&pose(0.0), Some(1e-3)), Twist::default(), "the pose before is gone");
    }
}
