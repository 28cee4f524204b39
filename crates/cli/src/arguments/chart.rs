//! Arguments of `palpate chart`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

pub(super) const CHART_EXAMPLES: &str = "Examples:
  palpate chart tissue --quick               a look at it, on small meshes
  palpate chart tissue --out charts          all of it: minutes
  palpate chart solvers --out charts         performance profiles of contact solvers
  palpate chart compliance --out charts      error of forces by method and age of the factor
  palpate chart haptics --out charts         stability and error of the haptic loop, by rate and method
  palpate chart tissue --data ../reference   with the solutions of other codes";

#[derive(Debug, Args)]
pub(crate) struct ChartArguments {
    /// What to chart.
    pub(crate) chart: ChartName,
    /// Folder for NAME.svg and the tables; made where it is missing. Files of an earlier chart are overwritten.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    pub(crate) out: PathBuf,
    /// Folder of reference data (`fem/*.json`, `pdms/cylinder.vtk`, `../lcp/*/*.dat`); by default `reference` in the folder that PALPATE_SHARED names; without either nothing is compared.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) data: Option<PathBuf>,
    /// Only the smallest problems.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Print no progress line.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

/// The charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ChartName {
    /// Compliance: error of forces and motion against time per step, by method and age of the factor.
    Compliance,
    /// The haptic loop: stiffest walls, stable couplings, error of the force against 1 kHz offline.
    Haptics,
    /// Contact solvers: problems solved against time, residual against time, contact methods.
    Solvers,
    /// Tissue: error against time per step, by law, element and mesh size.
    Tissue,
}

impl ChartName {
    /// Name of the picture, without ending.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Compliance => "compliance",
            Self::Haptics => "haptics",
            Self::Solvers => "solvers",
            Self::Tissue => "tissue",
        }
    }
}
