//! `palpate mesh`.

use std::path::Path;
use std::process::ExitCode;

use miette::{Report, Result, miette};
use palpate::fem::format::write_vtu;
use palpate::fem::image::LabelImage;
use palpate::fem::mesh::{MeshQuality, TetMesh};
use palpate::fem::stuffing::{ClosedSurface, Stuffing, StuffingReport, stuff_image, stuff_surface};

use crate::arguments::{MeshArguments, MeshCommand};

fn failed(error: impl std::fmt::Display) -> Report {
    Report::msg(error.to_string())
}

pub(crate) fn mesh(arguments: &MeshArguments) -> Result<ExitCode> {
    match (&arguments.make, &arguments.file) {
        (Some(MeshCommand::Make { image, cell, out, scale, force }), _) => make(image, *cell, out, *scale, *force),
        (None, Some(file)) => describe(file, arguments.scale, arguments.json),
        (None, None) => Err(miette!(help = "palpate mesh --help", "no mesh file is named")),
    }
}
