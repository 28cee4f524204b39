//! Tissue: error against time per step, by law, element and mesh size; and how far we are from other codes and from a
//! measured rod.

mod bending;
mod body;
mod cantilever;
mod cylinder;
mod indentation;
mod reference;
mod same_mesh;

use std::path::Path;

use miette::Result;
use palpate::fem::element::ElementKind;
use palpate::fem::material::{Law, Material};

use super::plot::{Axis, Layout, Mark, Panel, Series};
use super::table::{Table, Value};
use super::{Chart, NamedTable, Settings, Work};
use bending::sag;

/// Measures everything that `palpate chart tissue` shows.
pub(crate) fn measure(settings: &Settings, work: &Work) -> Result<Chart> {
    let mut notes = vec!["times are those of one busy core, with a factor refreshed every third step".to_string()];
    let mut tables = Vec::new();
    match &settings.data {
        Some(folder) => {
            tables.push(references(folder, work)?);
            tables.extend(same_mesh::tables(folder, settings, work)?);
        }
        None => notes.push("no reference data: other codes' solutions and SOFA's rod were left out (--data)".into()),
    }
    tables.push(rod(settings, work)?);
    let (pressed, engines) = pressing(settings, work)?;
    tables.push(pressed);
    let mut laws: Vec<Panel> = laws(settings.quick).iter().map(|law| panel_of(law)).collect();
    tables.push(every_law(settings, work, &mut laws)?);
    tables.push(bending(settings, work, &mut laws)?);
    if work.stopped() {
        notes.push("ended early: what was measured until then".into());
    }
    let title = "Tissue: error against time per step on one core (other engines: on another machine)".into();
    let panels = std::iter::once(engines).chain(laws).collect();
    Ok(Chart { title, panels, layout: Layout::columns(3), tables, notes })
}

/// The laws that are charted.
fn laws(quick: bool) -> &'static [&'static str] {
    if quick { &["neo_hookean"] } else { Material::NAMES }
}

fn panel_of(law: &str) -> Panel {
    Panel { title: law.into(), x: Axis::log("time per step [ms]"), y: Axis::log("error [%]"), series: Vec::new() }
}

/// Whether averaged elements take a law: it needs a bulk term of its own.
fn averages(law: &str) -> bool {
    Material::from_young_poisson(law, 1.0, 0.3).is_some_and(|m| m.without_bulk().is_some())
}

/// Agreement with an independent code on the same mesh and element.
fn references(folder: &Path, work: &Work) -> Result<NamedTable> {
    let mut table = Table::new(&["case", "law", "displacements differ by", "reaction by", "load steps", "solves"]);
    work.expect(reference::CASES.len());
    for case in reference::CASES {
        if !work.next(case) {
            break;
        }
        let a = reference::compare(folder, case)?;
        table.push(vec![
            case.into(),
            a.law.into(),
            Value::Power(a.displacement),
            Value::Power(a.reaction),
            (a.effort.0 as usize).into(),
            (a.effort.1 as usize).into(),
        ]);
    }
    let title = "Static solutions of FElupe on the same mesh: difference relative to the largest displacement and \
                 the reaction"
        .into();
    Ok(NamedTable { file: "tissue_references", title, table })
}

/// The silicone rod by element and size.
fn rod(settings: &Settings, work: &Work) -> Result<NamedTable> {
    let mut table = Table::new(&[
        "rod",
        "element",
        "nodes",
        "tetrahedra",
        "tip at rest y [mm]",
        "z [mm]",
        "error [%]",
        "tip after 3.6 s y [mm]",
        "step [ms]",
    ]);
    let millimetres = |v: Option<f64>| v.map_or(Value::None, |v| Value::Number(1e3 * v, 2));
    table.push(vec![
        "measured".into(),
        Value::None,
        Value::None,
        Value::None,
        Value::Number(1e3 * cantilever::MEASURED.0, 2),
        Value::Number(1e3 * cantilever::MEASURED.1, 2),
        Value::None,
        Value::None,
        Value::None,
    ]);
    let mut runs: Vec<(String, ElementKind, palpate::fem::mesh::TetMesh)> = Vec::new();
    if let Some(mesh) = settings.data.as_deref().and_then(cantilever::shared) {
        runs.push(("SOFA's mesh".into(), ElementKind::Linear, mesh?));
    }
    let sizes: &[(usize, usize)] = if settings.quick {
        &[(2, 10), (2, 20)]
    } else {
        &[(2, 10), (2, 20), (2, 40), (4, 40), (4, 80), (6, 90), (8, 120)]
    };
    for kind in ElementKind::ALL {
        for &(across, along) in sizes {
            // Others than linear elements reach every accuracy before the largest sizes.
            let most = match kind {
                ElementKind::Linear => usize::MAX,
                ElementKind::Averaged => 540,
                ElementKind::Quadratic => 160,
            };
            if across * along <= most {
                runs.push(("ours".into(), kind, cantilever::mesh(kind, across, along)));
            }
        }
    }
    work.expect(runs.len());
    for (name, kind, mesh) in runs {
        if !work.next(&format!("rod: {}", kind.name())) {
            break;
        }
        let tip = cantilever::hang(&mesh, kind, !settings.quick && mesh.nodes.len() < 5000)?;
        let error = tip.at_rest.map_or(Value::None, |x| Value::Number(100.0 * (x.y / cantilever::MEASURED.0 - 1.0), 2));
        table.push(vec![
            name.into(),
            kind.name().into(),
            tip.nodes.into(),
            tip.tetrahedra.into(),
            millimetres(tip.at_rest.map(|x| x.y)),
            millimetres(tip.at_rest.map(|x| x.z)),
            error,
            millimetres(tip.moving.map(|x| x.y)),
            millimetres(tip.time),
        ]);
    }
    let title = format!(
        "A silicone rod that hangs over (SOFA on its 3,668 nodes: {:.2} mm after 3.6 s)",
        1e3 * cantilever::SOFA
    );
    Ok(NamedTable { file: "tissue_rod", title, table })
}

/// The sphere on the block by element, contact and size: five depths against the converged forces.
fn pressing(settings: &Settings, work: &Work) -> Result<(NamedTable, Panel)> {
    let mut columns: Vec<String> = ["element", "contact", "cells", "nodes"].map(Into::into).into();
    columns.extend(indentation::DEPTHS.iter().map(|d| format!("{:.0} mm [N]", 1e3 * d)));
    columns.extend(indentation::DEPTHS.iter().map(|d| format!("{:.0} mm [%]", 1e3 * d)));
    columns.extend(["worst [%]", "rests", "step [ms]"].map(Into::into));
    let mut table = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    let mut series: Vec<Series> = indentation::others();
    series.push(Series { name: "3 %, the aim".into(), mark: Mark::Dashed, points: vec![(0.5, 3.0), (200.0, 3.0)] });
    let cases = indentation::cases(settings.quick);
    work.expect(cases.len());
    for case in &cases {
        if !work.next(&format!("sphere on a block: {}, contact at {}", case.element.name(), case.at)) {
            break;
        }
        let answer = case.press()?;
        let errors = answer.errors();
        let worst = errors.iter().fold(0.0f64, |a, e| a.max(e.abs()));
        let mut row: Vec<Value> =
            vec![case.element.name().into(), case.at.into(), case.name().into(), answer.nodes.into()];
        row.extend(answer.force.map(|f| Value::Number(f, 4)));
        row.extend(errors.map(|e| Value::Number(100.0 * e, 1)));
        row.push(Value::Number(100.0 * worst, 1));
        row.push(if answer.rests { "yes" } else { "no" }.into());
        row.push(milliseconds(answer.time));
        table.push(row);
        if let Some(time) = answer.time {
            add(&mut series, &format!("{}, contact at {}", case.element.name(), case.at), (1e3 * time, 100.0 * worst));
        }
    }
    let panel = Panel {
        title: "Sphere on a block: worst of five depths".into(),
        x: Axis::log("time per step [ms]"),
        y: Axis::log("error of the force [%]"),
        series,
    };
    let title = "A sphere pressed into a block, neo-Hookean: force, and error against converged quadratic hexahedra";
    Ok((NamedTable { file: "tissue_indentation", title: title.into(), table }, panel))
}

/// The sphere at 4 mm by law, element and size, each against its own law on finer quadratic tetrahedra.
fn every_law(settings: &Settings, work: &Work, panels: &mut [Panel]) -> Result<NamedTable> {
    let mut table = Table::new(&["law", "element", "nodes", "force [N]", "error [%]", "step [ms]"]);
    let (cases, finest) = indentation::of_every_law(settings.quick);
    work.expect(panels.len() * (1 + cases.len()));
    for panel in panels {
        let law = panel.title.clone();
        if !work.next(&format!("sphere: {law}, reference")) {
            break;
        }
        let exact = finest.force(&law)?;
        for case in cases.iter().filter(|case| case.element != ElementKind::Averaged || averages(&law)) {
            if !work.next(&format!("sphere: {law}, {}", case.element.name())) {
                break;
            }
            let force = case.force(&law)?;
            let error = force.zip(exact).map(|(force, exact)| 100.0 * (force / exact - 1.0));
            let time = case.time(&law)?;
            table.push(vec![
                law.as_str().into(),
                case.element.name().into(),
                case.nodes().into(),
                force.map_or(Value::None, |f| Value::Number(f, 4)),
                error.map_or(Value::None, |e| Value::Number(e, 2)),
                milliseconds(time),
            ]);
            if let Some((error, time)) = error.zip(time) {
                add(&mut panel.series, &format!("sphere, {}", case.element.name()), (1e3 * time, error.abs()));
            }
        }
    }
    let title = "The sphere at 4 mm, contact at nodes: error of the force against the same law on finer quadratic \
                 tetrahedra"
        .into();
    Ok(NamedTable { file: "tissue_sphere", title, table })
}

/// The sagging beam by law, element and size, each against its own law on finer quadratic tetrahedra.
fn bending(settings: &Settings, work: &Work, panels: &mut [Panel]) -> Result<NamedTable> {
    let mut table = Table::new(&["law", "element", "nodes", "tip [mm]", "error [%]", "step [ms]"]);
    let sizes: &[usize] = if settings.quick { &[2] } else { &[2, 4, 6] };
    let finest = if settings.quick { 3 } else { 5 };
    work.expect(panels.len() * (1 + ElementKind::ALL.len() * sizes.len()));
    for panel in panels {
        let law = panel.title.clone();
        if !work.next(&format!("beam: {law}, reference")) {
            break;
        }
        let exact = sag(&law, ElementKind::Quadratic, finest, false)?.tip;
        for kind in ElementKind::ALL.into_iter().filter(|&kind| kind != ElementKind::Averaged || averages(&law)) {
            for &size in sizes {
                // Half as many cells with mid-nodes have as many nodes.
                let cells = if kind == ElementKind::Quadratic { size / 2 } else { size };
                if !work.next(&format!("beam: {law}, {}", kind.name())) {
                    break;
                }
                let bent = sag(&law, kind, cells, true)?;
                let error = bent.tip.zip(exact).map(|(tip, exact)| 100.0 * (tip - exact).norm() / exact.norm());
                table.push(vec![
                    law.as_str().into(),
                    kind.name().into(),
                    bent.nodes.into(),
                    bent.tip.map_or(Value::None, |tip| Value::Number(1e3 * tip.norm(), 2)),
                    error.map_or(Value::None, |e| Value::Number(e, 2)),
                    milliseconds(bent.time),
                ]);
                if let Some((error, time)) = error.zip(bent.time) {
                    add(&mut panel.series, &format!("beam, {}", kind.name()), (1e3 * time, error));
                }
            }
        }
    }
    let title = "A beam that sags under its weight, Poisson 0.49: error of the tip against the same law on finer \
                 quadratic tetrahedra"
        .into();
    Ok(NamedTable { file: "tissue", title, table })
}

fn milliseconds(time: Option<f64>) -> Value {
    time.map_or(Value::None, |t| Value::Number(1e3 * t, 2))
}

/// Adds a point to the series of this name.
fn add(series: &mut Vec<Series>, name: &str, point: (f64, f64)) {
    match series.iter_mut().find(|s| s.name == name) {
        Some(s) => s.points.push(point),
        None => series.push(Series { name: name.into(), mark: Mark::Joined, points: vec![point] }),
    }
}
