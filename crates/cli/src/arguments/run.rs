//! Arguments of `palpate run`, `palpate equilibrium` and `palpate devices`.

use std::path::PathBuf;

use clap::Args;

use super::values::{length, positive, threads};

#[derive(Debug, Args)]
pub(crate) struct RunArguments {
    /// Scene file or name of a bundled scene (see `palpate scenes`).
    pub(crate) scene: String,
    /// Mesh to use in place of the scene's own.
    #[arg(long, value_name = "FILE")]
    pub(crate) mesh: Option<PathBuf>,
    /// Factor from the unit of `--mesh` to metres (0.001 for millimetres).
    #[arg(long, value_name = "FACTOR", requires = "mesh", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) scale: Option<f64>,
    /// Lattice constant of generated tetrahedra, with a unit: 12mm, 0.9cm, 0.01 (metres).
    #[arg(long, value_name = "LENGTH", value_parser = length, conflicts_with = "mesh")]
    pub(crate) cell: Option<f64>,
    /// Simulated seconds; the scene's own length by default.
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Number of steps, in place of seconds.
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: Option<u64>,
    /// Run in virtual time: repeatable to the last bit, whatever the machine and the number of workers.
    #[arg(long)]
    pub(crate) lockstep: bool,
    /// Worker threads of the step; all cores by default.
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Write no trace and no picture.
    #[arg(long, conflicts_with = "trace")]
    pub(crate) no_trace: bool,
    /// Trace file (MCAP), by default the name of the scene with .mcap. The picture lies beside it, with .svg.
    #[arg(long, value_name = "FILE")]
    pub(crate) trace: Option<PathBuf>,
    /// Write every contact problem that is solved into this folder, for `palpate solve`: step-S-pass-N.json is the Nth of
    /// step S. A folder with problems of an earlier run is refused.
    #[arg(long, value_name = "DIR")]
    pub(crate) save_problems: Option<PathBuf>,
    /// Remove the problems of an earlier run from the folder of --save-problems; other files there are kept.
    #[arg(long, requires = "save_problems")]
    pub(crate) force: bool,
    /// Write the end state of the body as VTU.
    #[arg(long = "final", value_name = "FILE")]
    pub(crate) final_state: Option<PathBuf>,
    /// Write one row per step as CSV: pose, wrench, contacts, residuals, iterations, work (0 in lockstep).
    #[arg(long, value_name = "FILE")]
    pub(crate) csv: Option<PathBuf>,
    /// Print the summary as JSON instead of a table, and nothing else on standard output.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print no progress line.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

#[derive(Debug, Args)]
pub(crate) struct EquilibriumArguments {
    /// Scene file or name of a bundled scene.
    pub(crate) scene: String,
    /// Write the body in equilibrium as VTU.
    #[arg(long = "final", value_name = "FILE")]
    pub(crate) final_state: Option<PathBuf>,
    /// Print the result as JSON, and nothing else on standard output.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct DevicesArguments {
    /// Force Dimension's DHD library, where it is not found by its own name.
    #[arg(long, value_name = "FILE")]
    pub(crate) dhd: Option<PathBuf>,
    /// OpenHaptics' HDAPI library, where it is not found by its own name.
    #[arg(long, value_name = "FILE")]
    pub(crate) hd: Option<PathBuf>,
    /// Address of Haply's service, ws://localhost:10001 by default.
    #[arg(long, value_name = "URL")]
    pub(crate) haply: Option<String>,
}
