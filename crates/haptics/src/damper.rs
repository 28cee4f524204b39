//! The damper of the passivity layer: what it takes from a force along a motion, and how much of it a loop bears.
//!
//! A damper α on a mass m whose force comes a time t late, m v' = −α v(t − τ), is stable up to α = π m / (2 τ) (the root
//! i π / (2 τ) of s + (α/m) e^(−s τ) = 0). τ is the hold and the delay of the wrench, (n + ½) T, and the lag t_v of the measured
//! velocity; what is granted is b = m / (2 τ), a third of that.

use nalgebra::Vector3;

use crate::device::DeviceSpec;

/// Lag t_v of a velocity behind the low-pass at 100 Hz that devices and ports have \[s\].
const VELOCITY_LAG: f64 = 1.6e-3;

/// Radius of gyration r \[m\] that stands for the rotation of a handle and of a gripper, whose inertia no record states.
pub(crate) const GYRATION: f64 = 0.05;

/// Largest damping b that a loop with lag bears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bearable {
    /// That of a device of this mass \[kg\].
    Mass(f64),
    /// As recorded \[N s/m\], for ticks of this period \[s\]: in proportion less at longer ones.
    Recorded { damping: f64, period: f64 },
}

impl Bearable {
    pub(crate) fn of(spec: &DeviceSpec) -> Self {
        let recorded = Self::Recorded { damping: spec.max_damping, period: 1.0 / spec.rate };
        spec.mass.map_or(recorded, Self::Mass)
    }

    /// b \[N s/m\] where a wrench has its effect after `n` ticks of `dt` \[s\], > 0.
    pub(crate) fn damping(self, n: usize, dt: f64) -> f64 {
        match self {
            Self::Mass(mass) => 0.5 * mass / ((n as f64 + 0.5) * dt + VELOCITY_LAG),
            Self::Recorded { damping, period } => damping * (period / dt).min(1.0),
        }
    }
}

/// A motion with the part of it that is above the least speed, 0 to 1.
#[derive(Clone, Copy)]
pub(crate) struct Motion {
    /// Velocity \[m/s or rad/s\]; zero below the least.
    pub(crate) v: Vector3<f64>,
    /// |v|², or 1 below the least.
    pub(crate) square: f64,
    share: f64,
}

impl Motion {
    pub(crate) fn new(v: Vector3<f64>, least: f64) -> Self {
        let square = v.norm_squared();
        let share = if square.is_finite() { (square.sqrt() / least - 1.0).clamp(0.0, 1.0) } else { 0.0 };
        if share > 0.0 { Self { v, square, share } } else { Self { v: Vector3::zeros(), square: 1.0, share: 0.0 } }
    }

    /// The damping that takes the push of `f` and dissipates by `b` besides, `most` at most.
    pub(crate) fn damping(&self, f: &Vector3<f64>, b: f64, most: f64) -> f64 {
        self.share * (f.dot(&self.v).max(0.0) / self.square + b).min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mass of 0.1 kg behind `lag` ms of delay, thrown at 1 m/s; its speeds at the begin and the end of a second.
    fn thrown(damping: f64, lag: usize) -> (f64, f64) {
        let h = 1e-5;
        let mut speeds = vec![1.0_f64; 100 * lag + 1];
        for _ in 0..100_000 {
            let now = speeds[speeds.len() - 1];
            let late = speeds[speeds.len() - 1 - 100 * lag];
            speeds.push(now - h * damping / 0.1 * late);
        }
        let most = |range: &[f64]| range.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        (most(&speeds[..1000]), most(&speeds[speeds.len() - 1000..]))
    }

    #[test]
    fn what_is_granted_is_a_third_of_what_a_mass_behind_a_delay_bears() {
        // One tick of delay, half a tick of hold, and the lag of the velocity are 3.1 ms; ticks of 0.9 ms make it 2.95.
        let granted = Bearable::Mass(0.1).damping(1, (3e-3 - VELOCITY_LAG) / 1.5);
        assert!((granted - 0.1 / 6e-3).abs() < 1e-12, "{granted}");
        let (begin, end) = thrown(granted, 3);
        assert!(end < 1e-6 * begin, "{end} of {begin}");
        // π/2 over 1/2 is 3.14: stable a tenth below, not a tenth above.
        let (begin, end) = thrown(2.8 * granted, 3);
        assert!(end < 0.1 * begin, "{end} of {begin}");
        let (begin, end) = thrown(3.5 * granted, 3);
        assert!(end > begin, "{end} of {begin}");
    }

    #[test]
    fn a_record_without_a_mass_grants_its_own_damping_and_less_at_slower_ticks() {
        let unknown = Bearable::of(&DeviceSpec { mass: None, ..DeviceSpec::virtual_device(0.0) });
        assert_eq!([0.25e-3, 1e-3, 4e-3].map(|dt| unknown.damping(1, dt)), [5.0, 5.0, 1.25]);
    }
}
