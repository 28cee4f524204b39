//! What the next free motion is expected to be, for its conjugate gradients to begin there.
//!
//! The free motion undoes what the contact forces of the step before held, and does so nearly as in the step before:
//! ```text
//! Δv_free(k+1) ≈ Δv_free(k) - (c(k) - c(k-1)),    c = h A⁻¹ Hᵀ λ
//! ```
//! In a steady press what is left is of the second order in the step. A prediction that is worse than none is dropped where
//! it is used, so that contacts may come and go.

use nalgebra::Vector3;

/// The expected change of velocity of the free nodes (m/s), and the last correction. Part of the state: it decides the last
/// digits of a step.
pub(super) struct Prediction {
    free: Vec<f64>,
    correction: Vec<f64>,
}

impl Prediction {
    /// At rest, for `nodes` free nodes.
    pub(super) fn new(nodes: usize) -> Self {
        Self { free: vec![0.0; 3 * nodes], correction: vec![0.0; 3 * nodes] }
    }

    /// Expects nothing: the step before did not end where it led.
    pub(super) fn forget(&mut self) {
        self.free.fill(0.0);
        self.correction.fill(0.0);
    }

    /// Learns of free node `k` its change of velocity in the free motion of a step and by the contact forces.
    pub(super) fn learn(&mut self, k: usize, free: &Vector3<f64>, correction: &Vector3<f64>) {
        let range = 3 * k..3 * k + 3;
        let (Some(expected), Some(last)) = (self.free.get_mut(range.clone()), self.correction.get_mut(range)) else {
            return;
        };
        for c in 0..3 {
            expected[c] = free[c] - (correction[c] - last[c]);
            last[c] = correction[c];
        }
    }

    /// The expected change of velocity.
    pub(super) fn free(&self) -> &[f64] {
        &self.free
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Isometry3;

    use super::*;
    use crate::scene::Scene;
    use crate::simulation::Simulation;

    /// A block under a ball, with a factor that is never made anew.
    const PRESS: &str = r#"
        name = "press"
        [[body]]
        name = "block"
        block = { min = [0, 0, 0], max = [0.04, 0.04, 0.04], cells = [5, 5, 5] }
        material = { law = "neo_hookean", young = 5e3, poisson = 0.4 }
        rayleigh_stiffness = 0.005
        compliance = "warped"
        fixed = [{ below = { axis = "z", at = 0.0 } }]
        [[tool]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.012 }
        [hand]
        path = [{ time = 0.0, position = [0.02, 0.02, 0.053] }]
    "#;

    /// Steps of the press, of which contact begins in the first.
    const STEPS: u32 = 24;

    #[test]
    fn a_steady_press_is_predicted_and_its_motion_is_that_from_nothing_to_the_tolerance() {
        let world = Scene::from_toml(PRESS, Path::new("")).unwrap().build().unwrap();
        let run = |predicts: bool| {
            let mut simulation = Simulation::new(&world).unwrap();
            let mut iterations = 0;
            for k in 0..STEPS {
                if !predicts {
                    simulation.state_mut().prediction.forget();
                }
                let pose = Isometry3::translation(0.02, 0.02, 0.052 - 3e-4 * f64::from(k));
                let report = simulation.step(&pose);
                // the first steps have nothing to go by
                iterations += if k < 4 { 0 } else { report.free_motion.iterations };
            }
            (iterations, simulation.positions().to_vec())
        };
        let ((fewer, with), (more, without)) = (run(true), run(false));
        // the force grows by a twelfth in a step or less, and the prediction is right to the second order of that: of six
        // digits it brings one or two
        assert!(4 * fewer <= 3 * more, "{fewer} iterations instead of {more}");
        let moved = |q: &[Vector3<f64>]| {
            q.iter().zip(world.mesh().nodes.iter()).map(|(q, x)| (q - x).norm()).fold(0.0, f64::max)
        };
        let off = with.iter().zip(&without).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        // residuals of 1e-6 in each step, times a condition of some 1e2
        assert!(off < 1e-3 * moved(&without), "{off:e} of {:e}", moved(&without));
        assert!(off > 0.0, "the prediction was not used");
    }

    #[test]
    fn what_was_learnt_is_extrapolated_by_the_change_of_the_correction_and_forgotten() {
        let mut prediction = Prediction::new(2);
        let v = |x: f64| Vector3::new(x, 2.0 * x, -x);
        prediction.learn(1, &v(1.0), &v(-1.0));
        assert_eq!(prediction.free()[3..], [2.0, 4.0, -2.0]);
        // one more newton held, one more is let go of
        prediction.learn(1, &v(2.0), &v(-3.0));
        assert_eq!(prediction.free()[3..], [4.0, 8.0, -4.0]);
        assert_eq!(prediction.free()[..3], [0.0; 3]);
        // a node that it does not have
        prediction.learn(2, &v(1.0), &v(1.0));
        prediction.forget();
        prediction.learn(0, &v(1.0), &v(0.0));
        assert_eq!(prediction.free(), [1.0, 2.0, -1.0, 0.0, 0.0, 0.0]);
    }
}
