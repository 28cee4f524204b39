//! Tissue: error against time per step, by law, element and mesh size; and how far we are from other codes and from a
//! measured rod.

mod bending;
mod body;
mod cantilever;
mod cylinder;
mod indentation;
mod reference;

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
    let mut notes = Vec::new();
    let mut tables = Vec::new();
    match &settings.data {
        Some(folder) => tables.push(references(folder, work)?),
        None => notes.push("no reference data: other codes' solutions and SOFA's rod were left out (--data)".into()),
    }
    tables.push(rod(settings, work)?);
    let (pressed, mut panels) = pressing(settings, work)?;
    tables.push(pressed);
    let (bent, of_bending) = bending(settings, work)?;
    tables.push(bent);
    panels.extend(of_bending);
    if work.stopped() {
        notes.push("ended early: what was measured until then".into());
    }
    let title = "Tissue: error against time per step on one core".into();
    Ok(Chart { title, panels, layout: Layout::columns(2), tables, notes })
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
    let sizes: &[(usize, usize)] =
        if settings.quick { &[(2, 10), (2, 20)] } else { &[(2, 10), (2, 20), (2, 40), (4, 40), (6, 90), (8, 120)] };
    for kind in ElementKind::ALL {
        for &(across, along) in sizes {
            // Ten nodes an element reach every accuracy before these sizes.
            if kind != ElementKind::Quadratic || across * along <= 160 {
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
fn pressing(settings: &Settings, work: &Work) -> Result<(NamedTable, Vec<Panel>)> {
    let mut table = Table::new(&[
        "element",
        "contact",
        "cells",
        "nodes",
        "1 mm [%]",
        "2 mm",
        "4 mm",
        "6 mm",
        "8 mm",
        "worst [%]",
        "step [ms]",
    ]);
    let mut series: Vec<Series> = indentation::others();
    series.push(Series { name: "3 %".into(), mark: Mark::Dashed, points: vec![(0.5, 3.0), (200.0, 3.0)] });
    let cases = indentation::cases(settings.quick);
    work.expect(cases.len());
    for case in &cases {
        if !work.next(&format!("sphere on a block: {} {}", case.element.name(), case.at)) {
            break;
        }
        let answer = case.press()?;
        let errors = answer.errors();
        let worst = errors.iter().fold(0.0f64, |a, e| a.max(e.abs()));
        let mut row: Vec<Value> =
            vec![case.element.name().into(), case.at.into(), case.name().into(), answer.nodes.into()];
        row.extend(errors.map(|e| Value::Number(100.0 * e, 1)));
        row.push(Value::Number(100.0 * worst, 1));
        row.push(answer.time.map_or(Value::None, |t| Value::Number(1e3 * t, 2)));
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
    let title = "A sphere pressed into a block, neo-Hookean: error of the force against converged quadratic hexahedra";
    Ok((NamedTable { file: "tissue_indentation", title: title.into(), table }, vec![panel]))
}

/// The sagging beam by law, element and size, each against its own law on finer quadratic tetrahedra.
fn bending(settings: &Settings, work: &Work) -> Result<(NamedTable, Vec<Panel>)> {
    let mut table = Table::new(&["law", "element", "nodes", "tip [mm]", "error [%]", "step [ms]"]);
    let laws: &[&str] = if settings.quick { &["neo_hookean"] } else { Material::NAMES };
    let sizes: &[usize] = if settings.quick { &[2] } else { &[2, 4, 6] };
    let finest = if settings.quick { 3 } else { 5 };
    let mut panels = Vec::new();
    work.expect(laws.len() * (1 + ElementKind::ALL.len() * sizes.len()));
    for &law in laws {
        if !work.next(&format!("beam: {law}, reference")) {
            break;
        }
        let exact = sag(law, ElementKind::Quadratic, finest, false)?.tip;
        let mut series = Vec::new();
        let averages = Material::from_young_poisson(law, 1.0, 0.3).is_some_and(|m| m.without_bulk().is_some());
        for kind in ElementKind::ALL {
            if kind == ElementKind::Averaged && !averages {
                continue; // the law has no bulk term of its own
            }
            for &size in sizes {
                // Half as many cells with mid-nodes have as many nodes.
                let cells = if kind == ElementKind::Quadratic { size / 2 } else { size };
                if !work.next(&format!("beam: {law}, {}", kind.name())) {
                    break;
                }
                let bent = sag(law, kind, cells, true)?;
                let error = 100.0 * (bent.tip - exact).norm() / exact.norm();
                table.push(vec![
                    law.into(),
                    kind.name().into(),
                    bent.nodes.into(),
                    Value::Number(1e3 * bent.tip.norm(), 2),
                    Value::Number(error, 2),
                    bent.time.map_or(Value::None, |t| Value::Number(1e3 * t, 2)),
                ]);
                if let Some(time) = bent.time {
                    add(&mut series, kind.name(), (1e3 * time, error));
                }
            }
        }
        panels.push(Panel {
            title: format!("Sagging beam: {law}"),
            x: Axis::log("time per step [ms]"),
            y: Axis::log("error of the tip [%]"),
            series,
        });
    }
    let title = "A beam that sags under its weight, Poisson 0.49: error of the tip against the same law on finer quadratic tetrahedra";
    Ok((NamedTable { file: "tissue", title: title.into(), table }, panels))
}

/// Adds a point to the series of this name.
fn add(series: &mut Vec<Series>, name: &str, point: (f64, f64)) {
    match series.iter_mut().find(|s| s.name == name) {
        Some(s) => s.points.push(point),
        None => series.push(Series { name: name.into(), mark: Mark::Joined, points: vec![point] }),
    }
}
