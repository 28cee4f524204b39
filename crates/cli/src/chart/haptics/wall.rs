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
static CURVES: &[Curve] = &[
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
static DAMPED: &[Curve] = &[
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
    let found: Vec<(Case, f64)> = cases.into_iter().zip(edges).filter_map(|(case, edge)| Some((case, edge?))).collect();
    let is_of = |curves: &[Curve], case: &Case| curves.iter().any(|curve| std::ptr::eq(curve, case.0));
    let (by_device, by_wall): (Vec<_>, Vec<_>) = found.into_iter().partition(|(case, _)| is_of(CURVES, case));
    let panels = vec![
        Panel {
            title: "Stiffest stable wall, 1 kHz, 0.1 kg".into(),
            x: Axis::log("damping of the device b [N s/m]"),
            y: Axis::log("stable up to K [N/m]"),
            series: series(&by_device, |case| case.1),
        },
        Panel {
            title: "The same with a damper in the wall, b = 1 N s/m".into(),
            x: Axis::linear("damping of the wall B [N s/m]"),
            y: Axis::log("stable up to K [N/m]"),
            series: series(&by_wall, |case| case.2),
        },
    ];
    let named =
        |file, title: &str, found: &[(Case, f64)]| NamedTable { file, title: title.into(), table: table(found) };
    let tables = vec![
        named("haptics_wall", "Stiffest stable wall by the damping of the device, T = 1 ms, 0.1 kg", &by_device),
        named(
            "haptics_wall_damping",
            "Stiffest stable wall by the damping of the wall, b = 1 N s/m; theory is the passive line",
            &by_wall,
        ),
    ];
    Ok((tables, panels))
}

fn table(found: &[(Case, f64)]) -> Table {
    let mut table =
        Table::new(&["curve", "b [N s/m]", "B [N s/m]", "stable up to K [N/m]", "theory [N/m]", "K/theory"]);
    for (case, edge) in found.iter().filter(|(case, _)| case.0.by != By::Theory) {
        let theory = theory(case);
        let beside = |value: f64, digits| if theory > 0.0 { Value::Number(value, digits) } else { Value::None };
        table.push(vec![
            case.0.name.into(),
            Value::Number(case.1, 2),
            Value::Number(case.2, 2),
            Value::Number(*edge, 1),
            beside(theory, 1),
            beside(edge / theory, 3),
        ]);
    }
    table
}

/// One series for each curve, over one of the two dampings.
fn series(found: &[(Case, f64)], damping: impl Fn(&Case) -> f64) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for (case, edge) in found {
        let (name, point) = (case.0.name, (damping(case), *edge));
        match all.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => {
                let mark = if case.0.by == By::Theory { Mark::Dashed } else { Mark::Joined };
                all.push(Series { name: name.into(), mark, points: vec![point] });
            }
        }
    }
    all
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
