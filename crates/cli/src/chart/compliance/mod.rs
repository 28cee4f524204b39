//! Compliance: error of forces and motion against time per step, by method and age of the factor.

mod body;
mod measurement;
mod method;

use miette::Result;
use palpate::constraints::compliance::MotionCorrection;
use palpate::world::World;

use super::plot::{Axis, Layout, Mark, Panel, Series};
use super::table::{Table, Value};
use super::{Chart, NamedTable, Settings, Work};
use body::{Motion, STEPS, organ, positions};
use measurement::{Step, Worlds};
use method::{CORRECTIONS, Method, Outcome, Source};

/// Ages of the factor (steps).
const AGES: [usize; 5] = [0, 1, 3, 10, 30];

/// Least error that is drawn (%): nobody feels less, and a factor of the step itself has none.
const FLOOR: f64 = 1e-3;

/// Stiffness of the lesion relative to the rest.
const RATIOS: [f64; 2] = [1.0, 1e3];

const COLUMNS: [&str; 12] = [
    "nodes",
    "stiffness ratio",
    "motion",
    "compliance",
    "correction",
    "age [steps]",
    "error of forces [%]",
    "error of motion [%]",
    "imbalance [%]",
    "refined",
    "iterations",
    "step [ms]",
];

const LARGEST: [&str; 9] = [
    "stiffness ratio",
    "motion",
    "compliance",
    "correction",
    "age [steps]",
    "error of forces [%]",
    "error of motion [%]",
    "refined",
    "step [ms]",
];

/// Measures everything that `palpate chart compliance` shows.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<Chart> {
    let cells: &[f64] = if settings.quick { &[0.025] } else { &[0.0155, 0.0105] };
    let ratios = if settings.quick { &RATIOS[..1] } else { &RATIOS[..] };
    let mut notes = Vec::new();
    let (mut table, mut largest, mut panels) = (Table::new(&COLUMNS), Table::new(&LARGEST), Vec::new());
    work.expect(cells.len() * ratios.len() * Motion::ALL.len());
    'all: for &cell in cells {
        for &ratio in ratios {
            let worlds = Worlds::new(&organ(cell, ratio)?)?;
            let world = &worlds.exact;
            if let Some(inverse) = &worlds.gathered[0].plan().precomputed {
                notes.push(format!(
                    "{} nodes, {} of them free and on the skin: the inverse between these takes {:.1} MB",
                    world.mesh().nodes.len(),
                    inverse.nodes,
                    1e-6 * inverse.bytes as f64
                ));
            }
            let name = format!("{} nodes, ratio {ratio}", world.mesh().nodes.len());
            for motion in Motion::ALL {
                if !work.next(&format!("{name}, {}", motion.name())) {
                    notes.push("ended early: what was measured until then".into());
                    break 'all;
                }
                let Some(path) = positions(world, motion) else {
                    notes.push(format!("{name}, {}: a step failed, nothing was measured", motion.name()));
                    continue;
                };
                let times = if settings.quick { 1 } else { 3 };
                let outcomes = outcomes(&mut Step::new(&worlds, &path)?, times)?;
                for (method, outcome) in &outcomes {
                    table.push(row(world, ratio, motion, *method, outcome));
                }
                if cell == cells[cells.len() - 1] && motion != Motion::Still {
                    summarise(&mut largest, ratio, motion, &outcomes);
                }
                // At rest no factor is old.
                if motion != Motion::Still {
                    panels.extend(draw(&format!("{name}, {}", motion.name()), &outcomes));
                }
            }
        }
    }
    let title = "Compliance of 10 frictional contacts: error against time per step on one core; along a line the factor is 0, 1, 3, \
         10, 30 steps old, the precomputed inverse 30";
    let heading = "Errors of forces (in the norm of W) and of the correction of the motion, and time of a step without \
                   assembly and detection, on the largest body; the factor of the asynchronous methods is made by another \
                   thread. The rest is in compliance.csv";
    let tables = vec![
        NamedTable { file: "compliance_largest", title: heading.into(), table: largest },
        NamedTable { file: "compliance", title: String::new(), table },
    ];
    Ok(Chart { title: title.into(), panels, layout: Layout::columns(4), tables, notes })
}

/// One step by every method and age; `None` is the exact one.
fn outcomes(step: &mut Step<'_>, times: usize) -> Result<Vec<(Option<Method>, Outcome)>> {
    let latest = step.factor(0)?;
    let mut all = vec![(None, step.measure(None, &latest, times)?)];
    for age in AGES {
        let old = step.factor(age)?;
        // As if it were of the shape of this step: nothing has turned since.
        let mut unwarped = old.clone();
        unwarped.q.clone_from(&latest.q);
        for source in [Source::Warped, Source::Unwarped, Source::Gathered] {
            // The oldest matrix is the first: the one that a run precomputes.
            if source == Source::Gathered && age < STEPS {
                continue;
            }
            let factor = if source == Source::Unwarped { &unwarped } else { &old };
            for correction in CORRECTIONS {
                let method = Some(Method { source, correction, age });
                all.push((method, step.measure(method, factor, times)?));
            }
        }
    }
    Ok(all)
}

/// What both tables begin a row with: ratio, motion, method and age.
fn case(ratio: f64, motion: Motion, method: Option<Method>) -> [Value; 5] {
    [
        Value::Number(ratio, 0),
        motion.name().into(),
        method.map_or("exact", |m| m.source.name()).into(),
        method.map_or(Value::None, |m| m.correction.name().into()),
        method.map_or(Value::None, |m| m.age.into()),
    ]
}

/// Rows of the table on the screen: what a run does, beside the same without warping.
fn summarise(table: &mut Table, ratio: f64, motion: Motion, outcomes: &[(Option<Method>, Outcome)]) {
    for (method, outcome) in outcomes {
        let plain = |m: &Method| m.source == Source::Unwarped && m.correction == MotionCorrection::Matching;
        if !method.as_ref().is_some_and(plain) {
            let mut row = case(ratio, motion, *method).to_vec();
            row.extend([
                Value::Number(100.0 * outcome.force, 2),
                Value::Number(100.0 * outcome.motion, 2),
                refined(outcome),
                Value::Number(1e3 * outcome.time, 2),
            ]);
            table.push(row);
        }
    }
}

fn refined(outcome: &Outcome) -> Value {
    if outcome.refined { "yes" } else { "no" }.into()
}

fn row(world: &World, ratio: f64, motion: Motion, method: Option<Method>, outcome: &Outcome) -> Vec<Value> {
    let [free, corrected] = outcome.iterations;
    let mut row = vec![world.mesh().nodes.len().into()];
    row.extend(case(ratio, motion, method));
    row.extend([
        Value::Number(100.0 * outcome.force, 3),
        Value::Number(100.0 * outcome.motion, 3),
        Value::Number(100.0 * outcome.imbalance, 3),
        refined(outcome),
        format!("{free} + {corrected}").into(),
        Value::Number(1e3 * outcome.time, 2),
    ]);
    row
}

/// Error of the forces and of the motion, each against time.
fn draw(title: &str, outcomes: &[(Option<Method>, Outcome)]) -> [Panel; 2] {
    let panel = |what: &str, error: fn(&Outcome) -> f64| {
        let mut series: Vec<Series> = Vec::new();
        for (method, outcome) in outcomes {
            let name = match method {
                None => "exact: factored in the step".to_string(),
                Some(m) => format!("{}, {}", m.source.name(), m.correction.name()),
            };
            let point = (1e3 * outcome.time, (100.0 * error(outcome)).max(FLOOR));
            match series.iter_mut().find(|s| s.name == name) {
                Some(s) => s.points.push(point),
                None => series.push(Series { name, mark: Mark::Joined, points: vec![point] }),
            }
        }
        // The time that a step has at 30 Hz, over the range of the errors.
        let errors = outcomes.iter().map(|(_, o)| (100.0 * error(o)).max(FLOOR));
        let (low, high) = errors.fold((f64::INFINITY, 0.0_f64), |(a, b), e| (a.min(e), b.max(e)));
        let points = vec![(1e3 / 30.0, low), (1e3 / 30.0, high)];
        series.push(Series { name: "30 Hz".into(), mark: Mark::Dashed, points });
        Panel {
            title: title.into(),
            x: Axis::log("time per step [ms]"),
            y: Axis::log(&format!("error of {what} [%]")),
            series,
        }
    };
    [panel("the forces", |o| o.force), panel("the motion", |o| o.motion)]
}
