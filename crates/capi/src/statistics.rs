//! What a simulation was like so far.

use std::mem::offset_of;

use palpate::session::{Phase, Statistics as Session};

use crate::layout::Layout;

/// Phase of a simulation that has a port and has not been started.
pub const PALPATE_PHASE_READY: u32 = 0;
/// The tissue moves.
pub const PALPATE_PHASE_RUNNING: u32 = 1;
/// The tissue stands still and gives no force.
pub const PALPATE_PHASE_PAUSED: u32 = 2;
/// Stopped.
pub const PALPATE_PHASE_STOPPED: u32 = 3;
/// Ended by itself: the body became non-finite or was torn apart, or a thread failed. palpate_stop, then
/// palpate_last_error tell why.
pub const PALPATE_PHASE_FAILED: u32 = 4;

const _: () = {
    assert!(PALPATE_PHASE_READY == Phase::Ready as u32 && PALPATE_PHASE_RUNNING == Phase::Running as u32);
    assert!(PALPATE_PHASE_PAUSED == Phase::Paused as u32 && PALPATE_PHASE_STOPPED == Phase::Stopped as u32);
    assert!(PALPATE_PHASE_FAILED == Phase::Failed as u32);
};

/// A simulation so far. Set struct_size before the call; the library fills in the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Statistics {
    /// sizeof(palpate_statistics_data).
    pub struct_size: u32,
    /// One of PALPATE_PHASE_...
    pub phase: u32,
    /// Time of the latest tick since the start (s).
    pub time: f64,
    /// Steps of the tissue.
    pub steps: u64,
    /// Factors that have reached the step.
    pub factors: u64,
    /// Ticks.
    pub ticks: u64,
    /// Periods that the step missed.
    pub step_overruns: u64,
    /// Periods of the nominal rate that passed without a tick between two ticks.
    pub tick_overruns: u64,
    /// Contacts that found no room in the scene's capacity.
    pub contacts_dropped: u64,
    /// Ticks that were cut by a limit of force, torque, power or slew.
    pub limited: u64,
    /// Ticks that sent no force because a number or a pose was not sound.
    pub refused: u64,
    /// Steps per second over the last second.
    pub step_rate: f64,
    /// Factors per second over the last second.
    pub factor_rate: f64,
    /// Ticks per second over the last second.
    pub tick_rate: f64,
    /// Work of a step: median, 99th percentile, largest (s).
    pub step_work: [f64; 3],
    /// Work of a tick: median, 99th percentile, largest (s).
    pub tick_work: [f64; 3],
    /// Largest force that was sent (N).
    pub largest_force: f64,
    /// Largest jump of the contact force at a new step of the tissue (N).
    pub largest_jump: f64,
    /// Age of the factor at the latest step (s).
    pub factor_age: f64,
    /// Contacts that carry force at the latest step.
    pub contacts: u32,
    /// Always 0.
    pub reserved: u32,
    /// Ticks in which the force was cut to its limit.
    pub force_limited: u64,
    /// Ticks in which the torque was cut to its limit.
    pub torque_limited: u64,
    /// Ticks in which the power given to the hand was cut to its limit.
    pub power_limited: u64,
    /// Ticks in which the change of force or torque was cut to its limit.
    pub slew_limited: u64,
    /// Ticks in which the passivity layer reduced the force along the motion.
    pub passivity: u64,
    /// Ticks whose step of the tissue was old, so that the force faded or was zero.
    pub stale: u64,
    /// Ticks after an interruption.
    pub gaps: u64,
    /// Ticks that came later than half a period after their time.
    pub late: u64,
    /// Ticks without force since the device's pose had jumped.
    pub jumped: u64,
    /// Energy that went through the device by forces since the start (J); positive: the hand has put it in.
    pub energy: f64,
    /// The same by torques (J).
    pub energy_by_torque: f64,
    /// Lowest energy of a contact (J): what it gave out beyond what it had taken in.
    pub lowest_energy: f64,
    /// Relative error of the compliance that the latest step measured; NaN where it measured none.
    pub compliance_error: f64,
    /// Relative error of the contact forces of the latest step, as far as it is known; NaN where it is not.
    pub force_error: f64,
    /// Deepest overlap that the correction of the latest step left (m).
    pub overlap: f64,
    /// Conjugate-gradient iterations of the latest step: of free motion and correction.
    pub iterations: u32,
    /// Always 0.
    pub reserved_too: u32,
    /// Ticks with more contacts than there was room for: the force was that of the deepest.
    pub truncated: u64,
    /// Ticks whose contact problem ended above its tolerance.
    pub not_converged: u64,
}

// SAFETY: repr(C), plain numbers; LEAST is the offset of a field.
unsafe impl Layout for Statistics {
    const LEAST: usize = offset_of!(Self, time);

    fn absent() -> Self {
        Self::new(&Session::default(), Phase::Ready)
    }
}

impl Statistics {
    pub(crate) fn new(s: &Session, phase: Phase) -> Self {
        Self {
            struct_size: 0,
            phase: phase as u32,
            time: s.time,
            steps: s.steps,
            factors: s.factors,
            ticks: s.ticks,
            step_overruns: s.step_overruns,
            tick_overruns: s.tick_overruns,
            contacts_dropped: s.contacts_dropped,
            limited: s.limited,
            refused: s.refused,
            step_rate: s.rates[0],
            factor_rate: s.rates[1],
            tick_rate: s.rates[2],
            step_work: [s.step_work.p50, s.step_work.p99, s.step_work.max],
            tick_work: [s.tick_work.p50, s.tick_work.p99, s.tick_work.max],
            largest_force: s.largest_force,
            largest_jump: s.largest_jump,
            factor_age: s.factor_age,
            contacts: s.contacts,
            reserved: 0,
            force_limited: s.port.counts.force_limited,
            torque_limited: s.port.counts.torque_limited,
            power_limited: s.port.counts.power_limited,
            slew_limited: s.port.counts.slew_limited,
            passivity: s.port.counts.passivity,
            stale: s.port.counts.stale,
            gaps: s.port.counts.gaps,
            late: s.port.counts.late,
            jumped: s.port.counts.jumped,
            energy: s.port.energy[0],
            energy_by_torque: s.port.energy[1],
            lowest_energy: s.port.least_account,
            compliance_error: s.compliance_error,
            force_error: s.force_error,
            overlap: s.overlap,
            iterations: s.iterations,
            reserved_too: 0,
            truncated: s.port.contact.truncated,
            not_converged: s.port.contact.not_converged,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_latest_step_knows_of_itself_is_handed_over() {
        let session =
            Session { compliance_error: 0.04, force_error: 0.002, overlap: 1e-5, iterations: 7, ..Session::default() };
        let told = Statistics::new(&session, Phase::Running);
        assert_eq!((told.compliance_error, told.force_error, told.overlap, told.iterations), (0.04, 0.002, 1e-5, 7));
        let nothing = Session { compliance_error: f64::NAN, ..session };
        assert!(Statistics::new(&nothing, Phase::Running).compliance_error.is_nan());
    }
}
