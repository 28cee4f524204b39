//! Solvers of contact: performance profiles over a set of problems, residual against time, times that the tick asks
//! for, and the three contact methods on one scene.

mod methods;
mod problems;
mod profile;
mod tick;

use miette::Result;

use super::plot::{Axis, Layout, Mark, Panel, Series};
use super::table::{Table, Value};
use super::{Chart, NamedTable, Settings, Work};
use methods::{Reference, choices};
use problems::Named;

/// Tolerances of the profiles: of a tick's forces, and of a reference.
const TOLERANCES: [f64; 2] = [1e-3, 1e-8];

/// Measures everything that `palpate chart solvers` shows.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<Chart> {
    let mut notes = Vec::new();
    work.expect(3);
    let tissue = problems::tissue(settings, work)?;
    let (files, note) = problems::files(settings)?;
    notes.extend(note);
    let all: Vec<Named> = tissue.iter().cloned().chain(problems::rigid()).chain(files).collect();

    work.expect(TOLERANCES.len() * all.len());
    let mut panels = Vec::new();
    let mut curves = Table::new(&["tolerance", "solver", "time over the fastest", "share of problems solved"]);
    let mut summary =
        Table::new(&["solver", "tolerance", "solves", "of", "fastest on", "median of its times over the fastest"]);
    let mut every = Table::new(&[
        "problem",
        "contacts",
        "rows",
        "tolerance",
        "solver",
        "status",
        "iterations",
        "residual",
        "time [ms]",
    ]);
    for tolerance in TOLERANCES {
        let runs = profile::run(&all, tolerance, settings, work);
        let panel = runs.panel();
        points(Value::Power(tolerance), &panel, &mut curves);
        panels.push(panel);
        runs.summary(&mut summary);
        runs.rows(&all, &mut every);
    }
    notes.push("profiles count a problem that is not for a solver as not solved: conic_qp takes no friction".into());

    let mut times = Table::new(&tick::COLUMNS);
    work.expect(tissue.len());
    for named in tissue.iter().take_while(|named| work.next(&format!("{}: times", named.name))) {
        tick::row(named, if settings.quick { 3 } else { 20 }, &mut times);
    }
    let mut residuals = Table::new(&["problem", "solver", "time [ms]", "residual"]);
    let watched = watched(&all, settings.quick);
    work.expect(watched.len());
    for named in watched.into_iter().take_while(|named| work.next(&format!("{}: residual", named.name))) {
        let panel = profile::residual_against_time(named, 1e-10, if settings.quick { 0.1 } else { 2.0 });
        points(named.name.as_str().into(), &panel, &mut residuals);
        panels.push(panel);
    }
    let (methods, panel) = methods(settings, work)?;
    panels.push(panel);
    if work.stopped() {
        notes.push("ended early: what was measured until then".into());
    }
    let named = |file, title: &str, table| NamedTable { file, title: title.into(), table };
    let tables = vec![
        named("solvers", "", every),
        named("solvers_profile", "Solvers over all problems", summary),
        named("solvers_curves", "", curves),
        named("solvers_residual", "", residuals),
        named("solvers_times", "Contact on tissue: median times on one core", times),
        methods,
    ];
    let title = "Contact solvers: problems solved against time, residual against time, and contact methods".into();
    Ok(Chart { title, panels, layout: Layout::columns(2), tables, notes })
}

/// The points of each solver's curve in a panel as rows, with what the panel is of in front.
fn points(of: Value, panel: &Panel, table: &mut Table) {
    for series in panel.series.iter().filter(|series| series.mark == Mark::Line) {
        for &(x, y) in &series.points {
            table.push(vec![of.clone(), series.name.as_str().into(), Value::Power(x), Value::Power(y)]);
        }
    }
}

/// The problems whose residual is drawn against time: contact at nodes, at faces, and one that is rank-deficient.
fn watched(all: &[Named], quick: bool) -> Vec<&Named> {
    let size = if quick { 30 } else { 60 };
    let names =
        [format!("block, nodes, {size} contacts"), format!("block, faces, {size} contacts"), "wedged block".into()];
    all.iter().filter(|named| names.contains(&named.name)).collect()
}

/// Error of the force against time per step, by contact method.
fn methods(settings: &Settings, work: &Work) -> Result<(NamedTable, Panel)> {
    let mut table = Table::new(&[
        "method",
        "tolerance",
        "times the body's stiffness",
        "error of the force",
        "step [ms]",
        "iterations",
        "residual",
    ]);
    let mut series: Vec<Series> = Vec::new();
    let choices = choices(settings.quick);
    work.expect(choices.len());
    let reference = Reference::new(settings)?;
    for choice in &choices {
        if !work.next(choice.name) {
            break;
        }
        let answer = reference.measure(choice, work)?;
        table.push(vec![
            choice.name.into(),
            Value::Power(choice.tolerance),
            if choice.multiple > 0.0 { Value::Number(choice.multiple, 0) } else { Value::None },
            Value::Power(answer.error),
            Value::Number(1e3 * answer.time, 3),
            Value::Number(answer.iterations, 1),
            Value::Power(answer.residual),
        ]);
        let point = (1e3 * answer.time, answer.error);
        match series.iter_mut().find(|s| s.name == choice.name) {
            Some(s) => s.points.push(point),
            None => series.push(Series { name: choice.name.into(), mark: Mark::Joined, points: vec![point] }),
        }
    }
    let panel = Panel {
        title: "Contact methods: ball on a block with friction".into(),
        x: Axis::log("time per step [ms]"),
        y: Axis::log("relative error of the force"),
        series,
    };
    let title =
        "Contact methods, one step from the same states: force against that of exact compliance, solved to 1e-10";
    Ok((NamedTable { file: "solvers_methods", title: title.into(), table }, panel))
}
