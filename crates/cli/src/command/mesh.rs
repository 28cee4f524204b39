//! `palpate mesh`.

use std::path::Path;

use miette::{Report, Result, miette};
use palpate::fem::format::{inspect, write_vtu};
use palpate::fem::mesh::{MeshQuality, MeshWarning};
use palpate::fem::stuffing::{Stuffing, StuffingReport};
use palpate::scene::SceneError;
use palpate::world::{is_surface, make as make_mesh};
use serde_json::json;

use crate::arguments::{MeshArguments, MeshCommand};
use crate::exit;
use crate::output::{check_kept, check_writable, say};

pub(crate) fn mesh(arguments: &MeshArguments) -> Result<u8> {
    match (&arguments.make, &arguments.file) {
        (Some(MeshCommand::Make { image, cell, labels, out, scale, force }), _) => {
            make(image, &stuffing(image, *cell, labels)?, out, *scale, *force)
        }
        (None, Some(file)) => describe(file, arguments.scale, arguments.json),
        (None, None) => Err(miette!(help = "palpate mesh --help", "no mesh file is named")),
    }
}

/// Prints size, quality and faults.
fn describe(path: &Path, scale: f64, as_json: bool) -> Result<u8> {
    let file = inspect(path).map_err(failed)?;
    let scaled = scale != 1.0;
    let quality = if scaled { MeshQuality::measure(&file.mesh.scaled(scale).map_err(failed)?) } else { file.quality };
    let of_units = |w: &&MeshWarning| !(scaled && matches!(w, MeshWarning::Units { .. }));
    let warnings: Vec<_> = file.warnings.iter().filter(of_units).map(ToString::to_string).collect();
    let refusal = file.refusal.map(|e| e.to_string());
    if as_json {
        let all =
            json!({ "format": file.format.to_string(), "quality": quality, "warnings": warnings, "refusal": refusal });
        say(format_args!("{all:#}"))?;
    } else {
        say(format_args!("{} ({})", path.display(), file.format))?;
        say(quality.to_string().trim_end())?;
        warnings.iter().try_for_each(|w| say(format_args!("warning: {w}")))?;
        refusal.iter().try_for_each(|r| say(format_args!("refused: {r}")))?;
    }
    Ok(if refusal.is_some() { exit::UNUSABLE } else { 0 })
}

/// Cells of the labels that are asked for.
fn stuffing(image: &Path, cell: f64, labels: &[(String, u8)]) -> Result<Stuffing> {
    if !labels.is_empty() && is_surface(image) {
        let help = "leave --labels out; only label images (INRIMAGE, NIfTI) have labels";
        return Err(miette!(help = help, "{}: a surface has no labels", image.display()));
    }
    for (k, (name, label)) in labels.iter().enumerate() {
        if let Some((other, _)) = labels[..k].iter().find(|(n, l)| n == name || l == label) {
            let help = "give each label one name, and each name one label";
            return Err(miette!(help = help, "--labels: {other} and {name}={label}"));
        }
    }
    Ok(Stuffing::of_labels(cell, labels.iter().map(|(name, label)| (name.as_str(), *label))))
}

/// Makes tetrahedra from a label image or a closed surface.
fn make(image: &Path, stuffing: &Stuffing, out: &Path, scale: Option<f64>, force: bool) -> Result<u8> {
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("vtu")) {
        return Err(miette!(help = "name the output FILE.vtu", "{}: only VTU is written", out.display()));
    }
    if out.exists() && !force {
        return Err(miette!(help = "--force overwrites it", "{} exists already", out.display()));
    }
    if scale.is_some() && !is_surface(image) {
        let help = "leave --scale out; only surfaces (STL, OBJ, PLY) have no unit of their own";
        return Err(miette!(help = help, "{}: a label image carries its own spacing", image.display()));
    }
    check_kept("the output", out, &[image])?;
    check_writable("--out", out)?;
    let (mesh, report) = make_mesh(image, scale.unwrap_or(1.0), stuffing).map_err(|e| match e {
        SceneError::Stuffing(e) if scale.is_none() && is_surface(image) => {
            let help = "--scale 0.001 reads a surface in millimetres";
            miette!(help = help, "{}: {e}", image.display())
        }
        other => super::report(other),
    })?;
    write_vtu(out, &mesh, &[]).map_err(failed)?;
    say(MeshQuality::measure(&mesh).to_string().trim_end())?;
    regions(&report).iter().try_for_each(say)?;
    say(format_args!("wrote {}", out.display()))?;
    Ok(0)
}

/// Volume of each label against that of its tetrahedra.
fn regions(report: &StuffingReport) -> Vec<String> {
    let line = |name: &str, made: f64, label: f64| {
        format!(
            "{name}: {:.1} cm³ of {:.1} cm³ in the input ({:+.1} %)",
            made * 1e6,
            label * 1e6,
            100.0 * (made / label - 1.0)
        )
    };
    // A few stray voxels are noise of the segmentation.
    let named = report.regions.iter().filter(|r| r.tetrahedra > 0 || r.label_volume > 1e-4 * report.label_volume);
    let mut lines: Vec<_> = named.map(|r| line(&r.name, r.volume, r.label_volume)).collect();
    if report.dropped_bodies > 0 {
        lines.push(format!("{} smaller parts left out, {:.2} cm³", report.dropped_bodies, report.dropped_volume * 1e6));
    }
    lines
}

fn failed(error: impl std::fmt::Display) -> Report {
    Report::msg(error.to_string())
}
