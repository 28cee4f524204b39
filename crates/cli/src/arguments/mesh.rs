//! Arguments of `palpate mesh`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::values::{label, length, positive};

#[derive(Debug, Args)]
pub(crate) struct MeshArguments {
    #[command(subcommand)]
    pub(crate) make: Option<MeshCommand>,
    /// Mesh file: Gmsh MSH 1, 2.2, 4.1, VTK, VTU, MEDIT or TetGen.
    #[arg(required = true)]
    pub(crate) file: Option<PathBuf>,
    /// Factor from the unit of the file to metres (0.001 for millimetres).
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    pub(crate) scale: f64,
    /// Print the description as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum MeshCommand {
    /// Make tetrahedra from a label image (INRIMAGE, NIfTI) or a closed surface (STL, OBJ, PLY).
    #[command(after_help = "Examples:
  palpate mesh make liver.inr.gz --cell 10mm --out organ.vtu
  palpate mesh make liver.inr.gz --cell 10mm --labels parenchyma=255,lesion=85 --out liver.vtu
  palpate mesh make kidney.stl --scale 0.001 --cell 4mm --out kidney.vtu")]
    Make {
        /// Label image or closed surface.
        image: PathBuf,
        /// Lattice constant, with a unit: 10mm, 1cm, 0.01 (metres).
        #[arg(long, value_name = "LENGTH", value_parser = length)]
        cell: f64,
        /// Labels of the image by the names of their regions; all others are background. All labels by default.
        #[arg(long, value_name = "NAME=LABEL,...", value_delimiter = ',', value_parser = label)]
        labels: Vec<(String, u8)>,
        /// Mesh file to write (.vtu).
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Factor from the unit of a surface file to metres; label images carry their own spacing.
        #[arg(long, value_name = "FACTOR", value_parser = positive, allow_negative_numbers = true)]
        scale: Option<f64>,
        /// Overwrite the output.
        #[arg(long)]
        force: bool,
    },
}
