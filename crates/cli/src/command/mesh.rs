//! `palpate mesh`.

use std::path::Path;
use std::process::ExitCode;

use miette::{Report, Result, miette};
use palpate::fem::format::{inspect, write_vtu};
use palpate::fem::mesh::{MeshQuality, MeshWarning};
use palpate::fem::stuffing::{Stuffing, StuffingReport};
use palpate::world::make as make_mesh;
use serde_json::json;

use crate::arguments::{MeshArguments, MeshCommand};

/// Exit code of a mesh that cannot be simulated.
const UNUSABLE: u8 = 5;

pub(crate) fn mesh(arguments: &MeshArguments) -> Result<ExitCode> {
    match (&arguments.make, &arguments.file) {
        (Some(MeshCommand::Make { image, cell, out, scale, force }), _) => make(image, *cell, out, *scale, *force),
        (None, Some(file)) => describe(file, arguments.scale, arguments.json),
        (None, None) => Err(miette!(help = "palpate mesh --help", "no mesh file is named")),
    }
}

/// Prints size, quality and faults.
#[allow(clippy::print_stdout)]
fn describe(path: &Path, scale: f64, as_json: bool) -> Result<ExitCode> {
    let file = inspect(path).map_err(failed)?;
    let scaled = scale != 1.0;
    let quality = if scaled { MeshQuality::measure(&file.mesh.scaled(scale).map_err(failed)?) } else { file.quality };
    let of_units = |w: &&MeshWarning| !(scaled && matches!(w, MeshWarning::Units { .. }));
    let warnings: Vec<_> = file.warnings.iter().filter(of_units).map(ToString::to_string).collect();
    let refusal = file.refusal.map(|e| e.to_string());
    if as_json {
        let all =
            json!({ "format": file.format.to_string(), "quality": quality, "warnings": warnings, "refusal": refusal });
        println!("{all:#}");
    } else {
        println!("{} ({})", path.display(), file.format);
        println!("{quality}");
        warnings.iter().for_each(|w| println!("warning: {w}"));
        refusal.iter().for_each(|r| println!("refused: {r}"));
    }
    Ok(if refusal.is_some() { ExitCode::from(UNUSABLE) } else { ExitCode::SUCCESS })
}

/// Makes tetrahedra from a label image or a closed surface.
#[allow(clippy::print_stdout)]
fn make(image: &Path, cell: f64, out: &Path, scale: f64, force: bool) -> Result<ExitCode> {
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("vtu")) {
        return Err(miette!(help = "name the output FILE.vtu", "{}: only VTU is written", out.display()));
    }
    if out.exists() && !force {
        return Err(miette!(help = "--force overwrites it", "{} exists already", out.display()));
    }
    let stuffing = Stuffing { cell, ..Stuffing::default() };
    let (mesh, report) = make_mesh(image, scale, &stuffing).map_err(super::report)?;
    write_vtu(out, &mesh, &[]).map_err(failed)?;
    println!("{}", MeshQuality::measure(&mesh));
    println!("{}", regions(&report));
    println!("wrote {}", out.display());
    Ok(ExitCode::SUCCESS)
}

/// Volume of each label against that of its tetrahedra.
fn regions(report: &StuffingReport) -> String {
    let line = |name: &str, made: f64, label: f64| {
        format!(
            "{name}: {:.1} cm³ of {:.1} cm³ in the image ({:+.1} %)",
            made * 1e6,
            label * 1e6,
            100.0 * (made / label - 1.0)
        )
    };
    let mut lines: Vec<_> = report.regions.iter().map(|r| line(&r.name, r.volume, r.label_volume)).collect();
    if report.dropped_bodies > 0 {
        lines.push(format!("{} smaller parts left out, {:.2} cm³", report.dropped_bodies, report.dropped_volume * 1e6));
    }
    lines.join("\n")
}

fn failed(error: impl std::fmt::Display) -> Report {
    Report::msg(error.to_string())
}
