//! Z-width: the couplings that hold in each scene, by their damping, the rate of the tissue and what the tick does.
//!
//! The virtual device with its friction, encoder and tick of delay, in the loosest hand that was measured, presses the scene's
//! tissue as its path says within 0.4 s and stays; a grasper closes within 0.4 s, lifts within 0.4 s more, and stays. The
//! passivity controller is off but where it is named. A coupling holds if the tissue does not fail, and over the last 0.4 s
//! of 1.6 s the device stays within 0.1 mm of an even motion, and a grasper in contact with what it carries. The coupling is
//! that of translation, for a grasper along the lift too: its jaws have their own spring, which stays that of the scene.

use miette::{Result, miette};
use nalgebra::Vector3;
use palpate::haptics::coupling::{CouplingConfig, Spring};
use palpate::haptics::device::VirtualDevice;
use palpate::haptics::hand::Hand;
use palpate::haptics::rig::{Search, StableRange, stable_range};
use palpate::haptics::script::HandScript;
use palpate::prelude::*;

use super::cases::in_parallel;
use super::palpation::{Method, Palpation};
use super::scenes::{Case, Use};
use crate::chart::plot::{Axis, Mark, Panel, Series};
use crate::chart::table::{Table, Value};
use crate::chart::{NamedTable, Settings, Work};

/// Who holds the device.
const HAND: &str = "loose";

/// Length of a trial (s), and of its end, where the device is to be at rest.
const TRIAL: [f64; 2] = [1.6, 0.4];

/// How far the device may be from an even motion at rest (m).
const AT_REST: f64 = 1e-4;

/// What moves faster will not come to rest (m/s).
const RUNAWAY: f64 = 2.0;

/// What is measured at one rate by one method.
#[derive(Clone, Copy, Debug)]
struct Region {
    case: Case,
    method: Method,
    /// Whether the passivity controller acts.
    controlled: bool,
    rate: f64,
}

/// The methods, and whether the passivity controller acts.
const METHODS: [(Method, bool); 4] =
    [(Method::Local, false), (Method::Frozen, false), (Method::Held, false), (Method::Held, true)];

impl Region {
    /// Name of what the tick does.
    fn method(&self) -> String {
        if self.controlled { "force held, passivity on".into() } else { self.method.name().into() }
    }
}

/// What holds over the damping of the coupling; nodes of the body.
struct Ranges {
    nodes: usize,
    /// Damping (N s/m), and the stiffness of the couplings that hold (N/m); `None` where none that was tried does.
    ranges: Vec<(f64, Option<StableRange>)>,
}

/// Measures all regions; the table and a panel for each scene and rate.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<(NamedTable, Vec<Panel>)> {
    let scenes: &[&str] = if settings.quick { &["block"] } else { &["block", "cut", "liver", "grasp"] };
    let rates: &[f64] = if settings.quick { &[10.0, 30.0] } else { &[10.0, 30.0, 100.0] };
    let dampings: &[f64] = if settings.quick { &[0.0, 2.0] } else { &[0.0, 2.0, 5.0] };
    let ratio = if settings.quick { 2.0 } else { 1.3 };
    let search = Search { low: 25.0, high: 12_800.0, stride: 8.0, ratio };
    let mut regions = Vec::new();
    for &scene in scenes {
        for &rate in rates {
            let case = Case { scene, purpose: Use::Press, quick: settings.quick };
            regions.extend(METHODS.map(|(method, controlled)| Region { case, method, controlled, rate }));
        }
    }
    work.expect(regions.len());
    let name = |region: &Region| format!("couplings, {}, {}, {} Hz", region.case.name(), region.method(), region.rate);
    let found = in_parallel(&regions, work, name, |region| ranges(region, dampings, &search, work))?;

    let columns = [
        "scene",
        "nodes",
        "tissue [Hz]",
        "method",
        "B of the coupling [N s/m]",
        "stable from K of the coupling [N/m]",
        "stable up to K of the coupling [N/m]",
    ];
    let mut table = Table::new(&columns);
    let mut panels: Vec<Panel> = Vec::new();
    for (region, found) in regions.iter().zip(&found) {
        let Some(found) = found else { continue };
        for &(damping, range) in &found.ranges {
            let edge = |of: fn(StableRange) -> f64| range.map_or(Value::None, |range| Value::Number(of(range), 0));
            table.push(vec![
                region.case.name().into(),
                found.nodes.into(),
                Value::Number(region.rate, 0),
                region.method().into(),
                Value::Number(damping, 1),
                edge(|range| range.low),
                edge(|range| range.high),
            ]);
        }
        let points = |of: fn(StableRange) -> f64| -> Vec<(f64, f64)> {
            found.ranges.iter().filter_map(|&(damping, range)| Some((damping, of(range?)))).collect()
        };
        let mut series = vec![Series { name: region.method(), mark: Mark::Joined, points: points(|range| range.high) }];
        let lower = points(|range| range.low);
        if lower.iter().any(|&(_, low)| low > search.low) {
            series.push(Series { name: format!("{}, softest", region.method()), mark: Mark::Dashed, points: lower });
        }
        let title = format!("Stable couplings: {}, tissue at {} Hz", region.case.name(), region.rate);
        match panels.iter_mut().find(|panel| panel.title == title) {
            Some(panel) => panel.series.extend(series),
            None => panels.push(Panel {
                title,
                x: Axis::linear("damping of the coupling B [N s/m]"),
                y: Axis::log("stable up to K [N/m]"),
                series,
            }),
        }
    }
    let title = format!(
        "Stable couplings at 1 kHz in a {HAND} hand; -: none between {} and {} N/m, the softest and the stiffest that were \
         tried; a force that is held for a step has a coupling at the tissue's rate",
        search.low, search.high
    );
    Ok((NamedTable { file: "haptics_couplings", title, table }, panels))
}

fn ranges(region: &Region, dampings: &[f64], search: &Search, work: &Work) -> Result<Ranges> {
    let world = region.case.world(region.method, region.rate, |scene| scene.hand.preset = HAND.into())?;
    let mut ranges = Vec::new();
    for &damping in dampings {
        let mut refused = None;
        let range = stable_range(search, |stiffness| {
            holds(&world, region, Spring { stiffness, damping }, work).unwrap_or_else(|error| {
                refused = Some(error);
                false
            })
        });
        if let Some(error) = refused {
            return Err(error);
        }
        ranges.push((damping, range));
    }
    Ok(Ranges { nodes: world.mesh().nodes.len(), ranges })
}

/// Whether a coupling holds.
fn holds(world: &World, region: &Region, coupling: Spring, work: &Work) -> Result<bool> {
    let (device, hand) = (&world.description().device, &world.description().hand);
    let script = HandScript::new(hand.path.clone()).map_err(|e| miette!("{e}"))?;
    let hand = Hand::preset(&hand.preset).map_err(|e| miette!("{e}"))?;
    let device = VirtualDevice::new(device.mechanics, hand, script).map_err(|e| miette!("{e}"))?;
    let mut palpation = Palpation::new(world, Box::new(device), |config| {
        region.method.configure(region.rate, config);
        config.passivity.control = region.controlled;
        config.coupling = CouplingConfig { translation: coupling, rotation: None };
    })?;
    let period = region.method.period(region.rate);
    let [ticks, last] = TRIAL.map(|seconds| (seconds / period).round() as usize);
    let grasps = world.tool().hinge().is_some();
    let (mut rest, mut touched): (Vec<Vector3<f64>>, bool) = (Vec::with_capacity(last), false);
    for k in 0..ticks {
        let (record, _) = palpation.tick();
        if palpation.has_failed() || record.device_velocity.linear.norm() > RUNAWAY || work.stopped() {
            return Ok(false);
        }
        touched |= record.active > 0;
        if k >= ticks - last {
            if grasps && record.active == 0 {
                return Ok(false);
            }
            rest.push(record.device_pose.translation.vector);
        }
    }
    if !touched {
        return Err(miette!("{}: the tool does not reach the tissue", region.case.name()));
    }
    Ok(unrest(&rest) < AT_REST)
}

/// Largest distance of places, which are told at regular times, from the straight and even motion that fits them best (m):
/// a slow way to rest is no unrest.
fn unrest(places: &[Vector3<f64>]) -> f64 {
    let n = places.len() as f64;
    let mean = places.iter().sum::<Vector3<f64>>() / n.max(1.0);
    let time = |k: usize| k as f64 - 0.5 * (n - 1.0);
    let (mut moment, mut square) = (Vector3::zeros(), 0.0);
    for (k, place) in places.iter().enumerate() {
        moment += (place - mean) * time(k);
        square += time(k) * time(k);
    }
    let speed = if square > 0.0 { moment / square } else { Vector3::zeros() };
    let off = |(k, place): (usize, &Vector3<f64>)| (place - mean - speed * time(k)).norm();
    places.iter().enumerate().map(off).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unrest_is_what_is_left_of_a_motion_without_its_drift() {
        let drift = |k: u32| Vector3::new(1.0, -2.0, 0.5) * (1e-3 * f64::from(k));
        let swing = |k: u32| Vector3::z() * (2e-4 * (0.3 * f64::from(k)).sin());
        let drifting: Vec<_> = (0..400).map(drift).collect();
        let swinging: Vec<_> = (0..400).map(|k| drift(k) + swing(k)).collect();
        assert!(unrest(&drifting) < 1e-12);
        // Some twenty swings, which a line fits by little.
        assert!((unrest(&swinging) - 2e-4).abs() < 1e-5, "{}", unrest(&swinging));
        assert_eq!(unrest(&[]), 0.0);
    }
}
