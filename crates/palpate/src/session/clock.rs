//! Time between ticks from the timestamps of a device, checked against the clock of this machine.
//!
//! A device's clock is the better one: it does not see how late this machine's threads wake up. It is believed as long
//! as it runs forward and keeps pace. Where it stands still, runs backwards, or gains or loses more than [`LARGEST_LEAD`]
//! against this machine's within [`WINDOW`], as a clock in another unit does at once, this machine's serves instead, for
//! [`PROBATION`].
//!
//! A clock that is believed tells how time is divided between ticks, not how much there is: it cannot give more time than this
//! machine's has given and it has not told yet,
//! ```text
//! t = min(device's, host's + spare)      spare ← spare + host's − t
//! ```
//! so samples that a stalled bus delivers late are still a tick apart each, and a timestamp that leaps ahead is no time gone by.

/// Lead or lag of the device's clock at which it is no longer believed (ns). A burst of late samples of a stalled bus is
/// shorter.
pub const LARGEST_LEAD: u64 = 50_000_000;

/// Time after which lead and lag are counted anew (ns): a drift below 5 % is no fault.
pub const WINDOW: u64 = 1_000_000_000;

/// Time for which a clock that failed is not believed (ns).
pub const PROBATION: u64 = 1_000_000_000;

/// What wake-ups of this machine may differ by from tick to tick (ns): kept to spare from window to window, where more would
/// gather by drift. A timestamp that runs ahead by more in one tick has leapt.
const JITTER: u64 = 2_000_000;

/// What a timestamp was worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockEvent {
    /// The device's clock was used, or there is none.
    Sound,
    /// The device's clock stood still.
    Still,
    /// The device's clock ran backwards.
    Backwards,
    /// The device's clock does not keep pace with this machine's, or has leapt ahead.
    Unsteady,
}

/// Time between two ticks (ns).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Elapsed {
    /// What counts as the time between them.
    pub time: u64,
    /// The same by this machine's clock alone.
    pub host: u64,
}

impl Elapsed {
    /// By how much this machine's clock says more (ns).
    pub fn host_lead(&self) -> i64 {
        self.host.saturating_sub(self.time) as i64 - self.time.saturating_sub(self.host) as i64
    }
}

/// The clock of the ticks of one port.
#[derive(Clone, Copy, Debug, Default)]
pub struct DeviceClock {
    /// Timestamp and this machine's time at the tick before (ns).
    before: Option<(Option<u64>, u64)>,
    /// The same where the window began.
    anchor: Option<(u64, u64)>,
    /// This machine's time until which the device's clock is not believed (ns).
    doubted_until: u64,
    /// Time of this machine's that the device's clock has not told yet (ns).
    spare: u64,
}

impl DeviceClock {
    /// Time since the tick before for a sample stamped `stamp` (ns) at `host` (ns), a clock that never runs
    /// backwards; `None` at the first tick.
    pub fn advance(&mut self, stamp: Option<u64>, host: u64) -> (Option<Elapsed>, ClockEvent) {
        let before = self.before.replace((stamp, host));
        let Some((stamp_before, host_before)) = before else {
            self.anchor = stamp.map(|stamp| (stamp, host));
            return (None, ClockEvent::Sound);
        };
        let by_host = host.saturating_sub(host_before);
        let as_host = Some(Elapsed { time: by_host, host: by_host });
        let (Some(stamp), Some(stamp_before)) = (stamp, stamp_before) else {
            self.anchor = stamp.map(|stamp| (stamp, host));
            self.spare = 0;
            return (as_host, ClockEvent::Sound);
        };
        let event = match stamp.cmp(&stamp_before) {
            std::cmp::Ordering::Less => ClockEvent::Backwards,
            std::cmp::Ordering::Equal => ClockEvent::Still,
            std::cmp::Ordering::Greater => self.pace(stamp, host),
        };
        match event {
            ClockEvent::Sound if host >= self.doubted_until => self.divide(stamp - stamp_before, by_host),
            ClockEvent::Sound => (as_host, ClockEvent::Unsteady),
            _ => {
                self.anchor = Some((stamp, host));
                self.doubted_until = host.saturating_add(PROBATION);
                self.spare = 0;
                (as_host, event)
            }
        }
    }

    /// The time between two ticks by a clock that is believed.
    fn divide(&mut self, by_device: u64, by_host: u64) -> (Option<Elapsed>, ClockEvent) {
        let given = by_host.saturating_add(self.spare);
        let time = by_device.min(given);
        self.spare = given - time;
        let leapt = by_device - time > JITTER;
        let event = if leapt { ClockEvent::Unsteady } else { ClockEvent::Sound };
        (Some(Elapsed { time, host: by_host }), event)
    }

    /// Whether the device's clock has kept pace since the window began.
    fn pace(&mut self, stamp: u64, host: u64) -> ClockEvent {
        let (stamp_anchor, host_anchor) = *self.anchor.get_or_insert((stamp, host));
        let (by_stamp, by_host) = (stamp.saturating_sub(stamp_anchor), host.saturating_sub(host_anchor));
        if by_stamp.abs_diff(by_host) > LARGEST_LEAD {
            return ClockEvent::Unsteady;
        }
        if by_host >= WINDOW {
            self.anchor = Some((stamp, host));
            self.spare = self.spare.min(JITTER);
        }
        ClockEvent::Sound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Ticks `clock` at these stamps and host times; the times between that it answered.
    fn run(clock: &mut DeviceClock, ticks: impl IntoIterator<Item = (u64, u64)>) -> Vec<(Option<u64>, ClockEvent)> {
        let advance = |(stamp, host)| clock.advance(Some(stamp), host);
        ticks.into_iter().map(advance).map(|(elapsed, event)| (elapsed.map(|e| e.time), event)).collect()
    }

    #[test]
    fn jitter_of_this_machine_is_not_seen() {
        let jitter = [0, 300, 20, 900, 0, 450, 10];
        let ticks = (0..2000_u64).map(|k| (7 + k * MS, 5 * MS + k * MS + jitter[k as usize % 7] * 1000));
        let answers = run(&mut DeviceClock::default(), ticks);
        assert_eq!(answers[0], (None, ClockEvent::Sound));
        assert!(answers[1..].iter().all(|&answer| answer == (Some(MS), ClockEvent::Sound)));
    }

    #[test]
    fn a_leap_is_no_time_and_what_a_stalled_bus_delivers_late_is() {
        let mut clock = DeviceClock::default();
        let leapt = run(&mut clock, (0..100_u64).map(|k| ((k + k / 50 * 49) * MS, k * MS)));
        assert_eq!(leapt[50], (Some(MS), ClockEvent::Unsteady));
        assert!(leapt[1..50].iter().chain(&leapt[51..]).all(|&answer| answer == (Some(MS), ClockEvent::Sound)));
        // 20 ms without a call, then 20 calls within 0.2 ms, with their timestamps.
        let late = run(
            &mut DeviceClock::default(),
            (0..100_u64).map(|k| (k * MS, if (30..50).contains(&k) { 50 * MS + k * 10_000 } else { k * MS })),
        );
        assert!(late[1..].iter().all(|&answer| answer.1 == ClockEvent::Sound));
        assert!(late[1..50].iter().all(|&answer| answer.0 == Some(MS)), "{late:?}");
    }

    #[test]
    fn a_clock_never_gives_more_time_than_this_machine_has_given() {
        // Drifts, jitter, leaps and stalls of either clock, from a generator of 31 bits.
        let (mut clock, mut state) = (DeviceClock::default(), 12345_u64);
        let (mut stamp, mut host, mut total) = (5 * MS, 0, 0);
        for _ in 0..200_000 {
            let mut draw = |most: u64| {
                state = (state * 1_103_515_245 + 12_345) & 0x7fff_ffff;
                (state >> 8) % most
            };
            let (kind, size) = (draw(40), draw(30 * MS));
            host += if kind == 0 { size } else { draw(2 * MS) };
            stamp += if kind == 1 { size } else { draw(2 * MS) };
            let (elapsed, _) = clock.advance(Some(stamp), host);
            let elapsed = elapsed.unwrap_or(Elapsed { time: 0, host: 0 });
            total += elapsed.time;
            assert!(total <= host, "{total} ns in {host} ns");
            assert_eq!(elapsed.time as i64 + elapsed.host_lead(), elapsed.host as i64);
        }
    }

    #[test]
    fn a_clock_that_runs_backwards_or_stands_still_is_replaced_and_believed_again_later() {
        let mut clock = DeviceClock::default();
        let answers = run(&mut clock, [(10 * MS, 0), (11 * MS, MS), (4 * MS, 2 * MS + 7), (4 * MS, 4 * MS)]);
        assert_eq!(answers[2], (Some(MS + 7), ClockEvent::Backwards));
        assert_eq!(answers[3].1, ClockEvent::Still);
        let ticks = (1..3000_u64).map(|k| (4 * MS + k * MS, 4 * MS + k * MS + 5));
        let answers = run(&mut clock, ticks);
        assert_eq!(answers[0].1, ClockEvent::Unsteady, "on probation");
        assert_eq!(answers[2000], (Some(MS), ClockEvent::Sound));
    }

    #[test]
    fn a_clock_in_microseconds_does_not_slow_time_down() {
        let ticks = (0..5000_u64).map(|k| (k * 1000, k * MS));
        let answers = run(&mut DeviceClock::default(), ticks);
        let total: u64 = answers.iter().filter_map(|a| a.0).sum();
        // At most a window's lag of LARGEST_LEAD before each doubt.
        let lost = 4999 * MS - total;
        assert!(lost <= 5 * (LARGEST_LEAD + 2 * MS), "{lost} ns lost");
        assert!(answers.iter().filter(|a| a.1 == ClockEvent::Unsteady).count() > 4000);
    }

    #[test]
    fn a_drift_of_one_percent_is_no_fault_and_a_missing_clock_is_this_machine() {
        let ticks = (0..20_000_u64).map(|k| (k * MS * 101 / 100, k * MS));
        assert!(run(&mut DeviceClock::default(), ticks).iter().all(|a| a.1 == ClockEvent::Sound));
        let mut clock = DeviceClock::default();
        clock.advance(None, 3);
        assert_eq!(clock.advance(None, 10), (Some(Elapsed { time: 7, host: 7 }), ClockEvent::Sound));
    }

    #[test]
    fn after_a_day_ticks_are_exact_and_a_counter_that_wraps_costs_a_second_of_trust_and_no_time() {
        const DAY: u64 = 86_400_000;
        let answers = run(&mut DeviceClock::default(), (DAY - 5..DAY + 2000).map(|k| (7 + k * MS, k * MS)));
        assert!(answers[1..].iter().all(|&answer| answer == (Some(MS), ClockEvent::Sound)));
        // Microseconds in 32 bits begin anew every 71.6 minutes.
        let around = (1 << 32) * 1000;
        let ticks = (0..4000).map(|k| ((around - 1000 * MS + k * MS) % around, DAY * MS + k * MS));
        let answers = run(&mut DeviceClock::default(), ticks);
        assert!(answers[1..].iter().all(|answer| answer.0 == Some(MS)));
        let backwards: Vec<_> = (0..4000).filter(|&k| answers[k].1 == ClockEvent::Backwards).collect();
        assert_eq!(backwards, [1000]);
        assert!(answers[1001..2000].iter().all(|answer| answer.1 == ClockEvent::Unsteady));
        assert!(answers[2001..].iter().all(|answer| answer.1 == ClockEvent::Sound));
    }
}
