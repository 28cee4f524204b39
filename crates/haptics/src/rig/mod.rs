//! The rig: a virtual device with its hand against a wall that exists at the ticks only, and the stiffest wall that holds.
//!
//! At tick k the device measures its depth p in the wall, and the motors hold until the next one
//! ```text
//! F = max(0, K p + B (p − p₋)/T)   for p > 0, else 0          N, p₋ of the tick before
//! ```
//! For a device of mass m and damping b without friction, encoder and delay the wall is *passive* for
//! ```text
//! b > K T/2 + |B|                                             [Colgate and Schenkel, J. Robotic Systems 14 (1997) 37]
//! ```
//! no hand that is itself passive then makes the loop unstable. For B = 0, a device that nobody holds is at the edge of
//! *stability* where this says, up to terms of order T b/m; with a delay of n ticks the first-order edge is
//! b + B = K T (n + ½). Both are found here in two independent ways: by the motion of the loop ([`motion`]), with friction
//! and encoder if there are such, and by the eigenvalues of its linear part ([`eigenvalues`]).

pub mod eigenvalues;
pub mod motion;

use crate::device::VirtualDeviceConfig;
use crate::hand::Hand;

/// A wall: spring and damper that act at the ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// K \[N/m\], > 0.
    pub stiffness: f64,
    /// B \[N s/m\]; negative ones are walls that drive.
    pub damping: f64,
}

/// Device, hand and clock: what a wall meets.
#[derive(Clone, Copy, Debug)]
pub struct Rig {
    /// The device.
    pub mechanics: VirtualDeviceConfig,
    /// Who holds it.
    pub hand: Hand,
    /// T \[s\], > 0.
    pub period: f64,
}

/// Stiffness \[N/m\] up to which a wall of damping B \[N s/m\] is passive at period T \[s\] on a device of damping b
/// \[N s/m\] without delay: 2 (b − |B|)/T, and 0 where the damping alone is too much.
#[must_use]
pub fn passive_stiffness(device_damping: f64, wall_damping: f64, period: f64) -> f64 {
    (2.0 * (device_damping - wall_damping.abs()) / period).max(0.0)
}

/// Stiffness \[N/m\] up to which the loop is stable to first order in T b/m, with nobody holding: (b + B)/(T (n + ½)).
#[must_use]
pub fn stable_stiffness(device_damping: f64, wall_damping: f64, period: f64, delay_ticks: usize) -> f64 {
    (device_damping + wall_damping) / (period * (delay_ticks as f64 + 0.5))
}

/// Where a search for the largest stable value begins, how far it goes, and how near the edge it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Smallest value tried, > 0.
    pub low: f64,
    /// Largest.
    pub high: f64,
    /// Factor between the values of the first pass, > 1: an interval of instability narrower than that may be missed.
    pub stride: f64,
    /// Factor between the bounds of the edge at the end, > 1.
    pub ratio: f64,
}

/// Edge of stability above `search.low`: values are tried upwards until the first that is not stable, then the interval
/// before it is halved on the scale of logarithms. `search.high` where all are stable; `None` where the lowest is not.
pub fn largest_stable(search: &Search, mut is_stable: impl FnMut(f64) -> bool) -> Option<f64> {
    is_stable(search.low).then(|| upper_edge(search, search.low, is_stable))
}

/// An interval of stability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StableRange {
    /// Its lower edge; the lowest value that was tried, where that is stable.
    pub low: f64,
    /// Its upper edge; the highest value that was tried, where that is stable.
    pub high: f64,
}

/// The first interval of stability from `search.low` upwards, both edges found as in [`largest_stable`]: of what holds only if
/// it is neither too soft nor too stiff. `None` where no value of the first pass is stable.
pub fn stable_range(search: &Search, mut is_stable: impl FnMut(f64) -> bool) -> Option<StableRange> {
    let (mut value, mut failed) = (search.low, None);
    while !is_stable(value) {
        if value >= search.high {
            return None;
        }
        failed = Some(value);
        value = (value * search.stride).min(search.high);
    }
    let low = failed.map_or(value, |failed| edge(search, failed, value, |v| !is_stable(v)));
    Some(StableRange { low, high: upper_edge(search, value, is_stable) })
}

/// The first edge above a stable value.
fn upper_edge(search: &Search, stable: f64, mut is_stable: impl FnMut(f64) -> bool) -> f64 {
    let mut low = stable;
    while low < search.high {
        let next = (low * search.stride).min(search.high);
        if !is_stable(next) {
            return edge(search, low, next, is_stable);
        }
        low = next;
    }
    search.high
}

/// The edge between a value that is `like_low` and one that is not.
fn edge(search: &Search, mut low: f64, mut high: f64, mut like_low: impl FnMut(f64) -> bool) -> f64 {
    while high / low > search.ratio {
        let middle = (low * high).sqrt();
        if like_low(middle) { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_finds_the_first_edge_and_says_where_there_is_none() {
        let search = Search { low: 1.0, high: 1e4, stride: 2.0, ratio: 1.001 };
        let edge = largest_stable(&search, |k| k < 77.0 || (200.0..300.0).contains(&k)).unwrap();
        assert!((edge / 77.0 - 1.0).abs() < 1e-3, "{edge}");
        assert_eq!(largest_stable(&search, |_| true), Some(1e4));
        assert_eq!(largest_stable(&search, |_| false), None);
    }

    #[test]
    fn a_window_is_found_by_both_its_edges() {
        let search = Search { low: 1.0, high: 1e4, stride: 2.0, ratio: 1.001 };
        let range = stable_range(&search, |k| (30.0..700.0).contains(&k)).unwrap();
        assert!((range.low / 30.0 - 1.0).abs() < 1e-3 && (range.high / 700.0 - 1.0).abs() < 1e-3, "{range:?}");
        assert_eq!(stable_range(&search, |_| true), Some(StableRange { low: 1.0, high: 1e4 }));
        let above = stable_range(&search, |k| k > 5000.0).unwrap();
        assert!((above.low / 5000.0 - 1.0).abs() < 1e-3 && above.high == 1e4, "{above:?}");
        assert_eq!(stable_range(&search, |_| false), None);
    }
}
