//! The stiffest wall that the virtual device renders, against its own damping, beside the line of Colgate and Schenkel; and
//! against the damping of the wall.

use miette::{Result, miette};
use palpate::haptics::device::VirtualDeviceConfig;
use palpate::haptics::hand::Hand;
use palpate::haptics::rig::{Rig, Search, Wall, largest_stable, passive_stiffness, stable_stiffness};

use super::cases::in_parallel;
use crate::chart::plot::{Axis, Mark, Panel, Series};
use crate::chart::table::{Table, Value};
use crate::chart::{NamedTable, Settings, Work};

/// Time between ticks (s).
const PERIOD: f64 = 1e-3;

/// Ticks of a motion: its quarters are 2 s long.
const TICKS: u64 = 8000;

/// Damping of the device (N s/m) while that of the wall changes.
const FIXED_DAMPING: f64 = 1.0;

/// How an edge is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum By {
    Eigenvalues,
    Motion,
    /// A formula, drawn as a line.
    Theory,
}

/// One curve.
#[derive(Clone, Copy, Debug)]
struct Curve {
    name: &'static str,
    by: By,
    delay: usize,
    /// Coulomb friction and encoder of the default device.
    real: bool,
    hand: &'static str,
}

const fn curve(name: &'static str, by: By, delay: usize, real: bool, hand: &'static str) -> Curve {
    Curve { name, by, delay, real, hand }
}

/// Those over the damping of the device.
const CURVES: &[Curve] = &[
    curve("line b = K T/2", By::Theory, 0, false, "none"),
    curve("ideal device, eigenvalues", By::Eigenvalues, 0, false, "none"),
    curve("ideal device, motion", By::Motion, 0, false, "none"),
    curve("line b = 3 K T/2", By::Theory, 1, false, "none"),
    curve("one tick of delay", By::Motion, 1, false, "none"),
    curve("friction and encoder", By::Motion, 0, true, "none"),
    curve("loose hand", By::Motion, 0, false, "loose"),
    curve("normal hand", By::Motion, 0, false, "normal"),
    curve("firm hand", By::Motion, 0, false, "firm"),
    curve("loose hand, delay, friction, encoder", By::Motion, 1, true, "loose"),
];

/// Those over the damping of the wall.
const DAMPED: &[Curve] = &[
    curve("passive: b = K T/2 + |B|", By::Theory, 0, false, "none"),
    curve("ideal device, eigenvalues", By::Eigenvalues, 0, false, "none"),
    curve("ideal device, motion", By::Motion, 0, false, "none"),
    curve("one tick of delay", By::Motion, 1, false, "none"),
    curve("loose hand", By::Motion, 0, false, "loose"),
];

/// A curve at one damping of the device and one of the wall (N s/m).
type Case = (&'static Curve, f64, f64);

/// Measures both; tables and panels.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<(Vec<NamedTable>, Vec<Panel>)> {
    let device: &[f64] = if settings.quick { &[0.1, 0.5, 2.0] } else { &[0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0] };
    let wall: &[f64] = if settings.quick { &[0.0, 0.5] } else { &[0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.5, 2.5] };
    let over_device = CURVES.iter().flat_map(|curve| device.iter().map(move |&b| (curve, b, 0.0)));
    let over_wall = DAMPED.iter().flat_map(|curve| wall.iter().map(move |&damping| (curve, FIXED_DAMPING, damping)));
    let cases: Vec<Case> = over_device.chain(over_wall).collect();
    work.expect(cases.len());
    let edges = in_parallel(&cases, work, |case| format!("wall, {}", case.0.name), edge)?;
    let (first, second) = (CURVES.len() * device.len(), cases.len());
    let mut tables = Vec::new();
    let mut panels = Vec::new();
    for (file, range, axis) in [("haptics_wall", 0..first, 1), ("haptics_wall_damping", first..second, 2)] {
        let mut table =
            Table::new(&["curve", "b [N s/m]", "B [N s/m]", "stable up to K [N/m]", "theory [N/m]", "K/theory"]);
        let mut series: Vec<Series> = Vec::new();
        for (case, edge) in cases[range.clone()].iter().zip(&edges[range]) {
            let Some(edge) = edge else { continue };
            let theory = theory(case);
            let of_theory = if theory > 0.0 { Value::Number(edge / theory, 3) } else { Value::None };
            let theory = if theory > 0.0 { Value::Number(theory, 1) } else { Value::None };
            let name = case.0.name;
            if case.0.by != By::Theory {
                let dampings = [Value::Number(case.1, 2), Value::Number(case.2, 2)];
                let [b, damping] = dampings;
                table.push(vec![name.into(), b, damping, Value::Number(*edge, 1), theory, of_theory]);
            }
            let point = (if axis == 1 { case.1 } else { case.2 }, *edge);
            match series.iter_mut().find(|s| s.name == name) {
                Some(s) => s.points.push(point),
                None => {
                    let mark = if case.0.by == By::Theory { Mark::Dashed } else { Mark::Joined };
                    series.push(Series { name: name.into(), mark, points: vec![point] });
                }
            }
        }
        let (title, heading, x) = if axis == 1 {
            (
                "Stiffest stable wall, 1 kHz, 0.1 kg",
                "Stiffest stable wall by the damping of the device, T = 1 ms, 0.1 kg",
                Axis::log("damping of the device b [N s/m]"),
            )
        } else {
            (
                "The same with a damper in the wall, b = 1 N s/m",
                "Stiffest stable wall by the damping of the wall, b = 1 N s/m; theory is the passive line",
                Axis::linear("damping of the wall B [N s/m]"),
            )
        };
        panels.push(Panel { title: title.into(), x, y: Axis::log("stable up to K [N/m]"), series });
        tables.push(NamedTable { file, title: heading.into(), table });
    }
    Ok((tables, panels))
}

/// What theory says about a case (N/m): passive without delay, stable to first order with it.
fn theory(&(curve, b, damping): &Case) -> f64 {
    if curve.delay == 0 {
        passive_stiffness(b, damping, PERIOD)
    } else {
        stable_stiffness(b, damping, PERIOD, curve.delay)
    }
}

/// The stiffness at the edge (N/m).
fn edge(case: &Case) -> Result<f64> {
    let &(curve, damping, wall_damping) = case;
    if curve.by == By::Theory {
        return Ok(theory(case));
    }
    let real = VirtualDeviceConfig { damping, delay_ticks: curve.delay, ..VirtualDeviceConfig::default() };
    // Nothing but friction needs sub-steps here: the hand's script stands still.
    let ideal = VirtualDeviceConfig { damping, substeps: 1, ..VirtualDeviceConfig::ideal(curve.delay) };
    let mechanics = if curve.real { real } else { ideal };
    let hand = Hand::preset(curve.hand).map_err(|e| miette!("{e}"))?;
    let rig = Rig { mechanics, hand, period: PERIOD };
    let search = Search { low: 5.0, high: 1e6, stride: 2.0, ratio: 1.005 };
    let edge = largest_stable(&search, |stiffness| {
        let wall = Wall { stiffness, damping: wall_damping };
        match curve.by {
            By::Eigenvalues => rig.spectral_radius(&wall) < 1.0,
            // The mechanics are valid: checked by their first use.
            _ => rig.comes_to_rest(&wall, TICKS).unwrap_or(false),
        }
    });
    Ok(edge.unwrap_or(0.0))
}
