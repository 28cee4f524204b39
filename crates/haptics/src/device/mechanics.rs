//! Mechanics and electronics of the virtual device, as a scene describes them.

use serde::{Deserialize, Serialize};

use crate::SetupError;
use crate::error::{non_negative, positive};

/// Largest delay \[ticks\].
pub const MAX_DELAY: usize = 15;

/// Mechanics and electronics of the virtual device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VirtualDeviceConfig {
    /// Mass felt at the end effector \[kg\], > 0 (0.1).
    pub mass: f64,
    /// Viscous damping \[N s/m\], ≥ 0 (0.2).
    pub damping: f64,
    /// Coulomb friction \[N\], ≥ 0 (0.06).
    pub friction: f64,
    /// Step of the measured position \[m\], ≥ 0; 0: exact (30e-6).
    pub encoder_step: f64,
    /// Ticks from a wrench being written to the motor's rendering it, 0 to [`MAX_DELAY`] (1).
    pub delay_ticks: usize,
    /// Cut-off of the low-pass on the measured velocity \[Hz\], > 0 (100).
    pub velocity_cutoff: f64,
    /// Sub-steps of a tick, 1 to 1000 (10): they resolve friction and the script, the rest is exact.
    pub substeps: u32,
    /// Largest time by which a tick reads and drives the device late \[s\], ≥ 0 (0).
    pub jitter: f64,
    /// Begin of the pseudo-random sequence of the jitter (0).
    pub seed: u64,
}

impl Default for VirtualDeviceConfig {
    fn default() -> Self {
        Self {
            mass: 0.1,
            damping: 0.2,
            friction: 0.06,
            encoder_step: 30e-6,
            delay_ticks: 1,
            velocity_cutoff: 100.0,
            substeps: 10,
            jitter: 0.0,
            seed: 0,
        }
    }
}

impl VirtualDeviceConfig {
    /// A device without friction and with exact measurement, where the theory of the sampled linear loop holds.
    #[must_use]
    pub fn ideal(delay_ticks: usize) -> Self {
        Self { friction: 0.0, encoder_step: 0.0, delay_ticks, ..Self::default() }
    }

    /// How late tick `index` reads and drives the device \[s\].
    pub(super) fn lateness(&self, index: u64) -> f64 {
        self.jitter * share(self.seed, index)
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn validate(&self) -> Result<(), SetupError> {
        positive("virtual device mass [kg]", self.mass)?;
        non_negative("virtual device damping [N s/m]", self.damping)?;
        non_negative("virtual device friction [N]", self.friction)?;
        non_negative("virtual device encoder_step [m]", self.encoder_step)?;
        positive("virtual device velocity_cutoff [Hz]", self.velocity_cutoff)?;
        non_negative("virtual device jitter [s]", self.jitter)?;
        let range = |what, value: f64, range| Err(SetupError::OutOfRange { what, value, range });
        if self.delay_ticks > MAX_DELAY {
            return range("virtual device delay_ticks", self.delay_ticks as f64, "0 to 15");
        }
        if !(1..=1000).contains(&self.substeps) {
            return range("virtual device substeps", f64::from(self.substeps), "1 to 1000");
        }
        Ok(())
    }
}

/// Pseudo-random number from 0 to below 1 for tick `index` (SplitMix64, Steele, Lea and Flood, OOPSLA 2014): a function of
/// its arguments, so that a run can be repeated from any tick.
fn share(seed: u64, index: u64) -> f64 {
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let mut z = seed.wrapping_add(index.wrapping_add(1).wrapping_mul(GOLDEN));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    // 53 bits are what a float holds.
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
