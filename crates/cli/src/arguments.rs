//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use palpate::solver::solver::Solver;

use crate::choices::scene_choices;
use crate::exit;

const EXAMPLES: &str = "Examples:
  palpate run liver                          press a human liver for ten seconds, in real time
  palpate run liver --lockstep --steps 90    the same in virtual time: equal bits on every run
  palpate run my_scene.toml --no-trace --csv steps.csv --json > summary.json
  palpate check my_scene.toml                find mistakes, print what was understood
  palpate plan my_scene.toml --measure       which methods it will be computed by, and why
  palpate equilibrium my_scene.toml --final state.vtu
  palpate mesh organ.msh                     size, quality and faults of a mesh
  palpate mesh make liver.inr.gz --cell 10mm --out organ.vtu
  palpate replay liver.mcap                  run a trace again and compare every force
  palpate solve problem.json --solver all    one contact problem by every solver
  palpate chart tissue --out charts          measure error against time by law, element and mesh size";

const RUN_EXAMPLES: &str = "Examples:
  palpate run liver                          in real time, with liver.mcap and liver.svg
  palpate run block --lockstep --steps 90    in virtual time: equal bits on every run
  palpate run my_scene.toml --no-trace --csv steps.csv --json > summary.json
  palpate run block --lockstep --save-problems problems";

const CHECK_EXAMPLES: &str = "Examples:
  palpate check block                        a bundled scene
  palpate check my_scene.toml && palpate run my_scene.toml";

const PLAN_EXAMPLES: &str = "Examples:
  palpate plan liver                         what is predicted
  palpate plan my_scene.toml --measure       beside what a few steps take on this machine";

const SOLVE_EXAMPLES: &str = "Examples:
  palpate run block --lockstep --save-problems problems
  palpate solve problems/step-000050-pass-00001.json --solver all
  palpate solve problems/*.json --warm --solver gauss_seidel --json > runs.json
  palpate solve friction.dat --tol 1e-10 --max-iter 500 --out solution.json

Exit codes:
    0  every problem was solved to the tolerance
    2  a mistake in the command line or in a file; nothing was solved
    6  a problem was not solved to the tolerance";

/// Real-time haptic simulation of soft tissue.
#[derive(Debug, Parser)]
#[command(
    name = "palpate",
    version,
    about = "Real-time haptic simulation of soft tissue",
    after_help = format!("{EXAMPLES}\n\n{}", exit::HELP)
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run a scene: a file, or the name of a bundled scene. Files of an earlier run are overwritten.
    #[command(after_help = format!("{RUN_EXAMPLES}\n\n{}\n\n{}", scene_choices(), exit::HELP))]
    Run(RunArguments),
    /// Validate a scene and print what was understood; runs and writes nothing.
    ///
    /// A mistake is shown with its line and what to do about it; what is odd but no mistake is a warning. The exit code is 0
    /// for a scene that can run, 2 for one that cannot.
    #[command(after_help = format!("{CHECK_EXAMPLES}\n\n{}", scene_choices()))]
    Check {
        /// Scene file or name of a bundled scene.
        scene: String,
    },
    /// Print which methods a scene will be computed by, why, and what each stage costs; runs nothing of it in real time.
    #[command(after_help = PLAN_EXAMPLES)]
    Plan {
        /// Scene file or name of a bundled scene.
        scene: String,
        /// Take a few steps and measure, instead of predicting alone.
        #[arg(long)]
        measure: bool,
    },
    /// Find the static equilibrium of a scene's body under gravity, without contact.
    #[command(after_help = exit::HELP)]
    Equilibrium(EquilibriumArguments),
    /// Describe a mesh, or make one (`palpate mesh make --help`).
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
    Mesh(MeshArguments),
    /// Measure accuracy against time, draw it as SVG and write the data as CSV.
    #[command(after_help = "Examples:
  palpate chart tissue --quick               a look at it, on small meshes
  palpate chart tissue --out charts          all of it: minutes
  palpate chart solvers --out charts         performance profiles of contact solvers
  palpate chart compliance --out charts      error of forces by method and age of the factor
  palpate chart tissue --data ../reference   with the solutions of other codes")]
    Chart(ChartArguments),
    /// List the bundled scenes.
    Scenes,
    /// List the devices: which are found, and why the others are not.
    Devices(DevicesArguments),
    /// Solve contact problems from files: our JSON, or the .dat texts of Siconos.
    ///
    /// For each file and solver: how it ended, its iterations, the residual that is left, the gap of the block that is farthest
    /// from its law, the time. A compliance that is not symmetric or not definite is warned of with its row, and solved by
    /// whatever can. Where no solver meets the tolerance a sentence names the rows that are farthest off.
    #[command(after_help = SOLVE_EXAMPLES)]
    Solve(SolveArguments),
    /// Run the scene of a trace again and compare every force with the record, to the bit.
    Replay {
        /// The trace.
        trace: PathBuf,
    },
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
pub(crate) struct SolveArguments {
    /// Problem files, as `palpate run --save-problems` writes them, or friction-contact and LCP texts of Siconos.
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// Solver, or `all`. With `all`, a problem counts as solved if one of them solves it.
    #[arg(long, value_name = "NAME", default_value = "automatic", value_parser = solver_names())]
    pub(crate) solver: String,
    /// Residual to reach (natural map, relative to the violated gaps).
    #[arg(long, value_name = "T", default_value = "1e-6", value_parser = tolerance, allow_negative_numbers = true)]
    pub(crate) tol: f64,
    /// Limit of iterations; the solver's own by default.
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub(crate) max_iter: Option<u32>,
    /// Begin with the forces that the file holds (`start`, as `palpate run --save-problems` writes it) instead of none.
    #[arg(long)]
    pub(crate) warm: bool,
    /// Limit of time for each solver and problem, in seconds.
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) time_limit: Option<f64>,
    /// Print reports and residual histories as JSON, and nothing else on standard output.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write forces and gaps of the best answer as JSON; for one FILE.
    #[arg(long, value_name = "SOLUTION")]
    pub(crate) out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct ChartArguments {
    /// What to chart.
    pub(crate) chart: ChartName,
    /// Folder for NAME.svg and the tables; made where it is missing. Files of an earlier chart are overwritten.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    pub(crate) out: PathBuf,
    /// Folder of reference data (`fem/*.json`, `pdms/cylinder.vtk`, `../lcp/*/*.dat`); by default ../shared/reference where it exists.
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
            Self::Solvers => "solvers",
            Self::Tissue => "tissue",
        }
    }
}

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
  palpate mesh make kidney.stl --scale 0.001 --cell 4mm --out kidney.vtu")]
    Make {
        /// Label image or closed surface.
        image: PathBuf,
        /// Lattice constant, with a unit: 10mm, 1cm, 0.01 (metres).
        #[arg(long, value_name = "LENGTH", value_parser = length)]
        cell: f64,
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

/// A positive number.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_string())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("give a positive number".into()) }
}

/// A residual to reach.
fn tolerance(text: &str) -> Result<f64, String> {
    positive(text).map_err(|e| format!("{e}; 1e-6 is usual, 1e-10 tight"))
}

/// A number of iterations.
fn count(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(n @ 1..) => Ok(n),
        _ => Err(format!("give a whole number, at least 1 and at most {}", u32::MAX)),
    }
}

/// Names that `--solver` takes.
fn solver_names() -> clap::builder::PossibleValuesParser {
    Solver::NAMES.iter().copied().chain(["all"]).collect::<Vec<_>>().into()
}

/// A number of worker threads.
fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=1024) => Ok(n),
        _ => Err("give a number from 1 to 1024".into()),
    }
}

/// A length with a unit, in metres.
fn length(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.find(|c: char| c.is_ascii_alphabetic() && c != 'e' && c != 'E') {
        Some(at) => text.split_at(at),
        None => (text, "m"),
    };
    let factor = match unit.trim() {
        "m" => 1.0,
        "cm" => 1e-2,
        "mm" => 1e-3,
        "um" | "µm" => 1e-6,
        other => return Err(format!("unknown unit `{other}`: use mm, cm or m")),
    };
    let value: f64 = number.trim().parse().map_err(|_| format!("`{number}` is not a number"))?;
    if value > 0.0 && value.is_finite() {
        Ok(value * factor)
    } else {
        Err(format!("{value} {unit} is not a positive length"))
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn lengths_carry_their_unit() {
        for (text, metres) in [("10mm", 0.01), ("1 cm", 0.01), ("0.01", 0.01), ("1e-2m", 0.01)] {
            assert!((length(text).unwrap() - metres).abs() < 1e-15, "{text}");
        }
        for text in ["", "-1mm", "3 furlongs", "mm", "nan", "inf"] {
            assert!(length(text).is_err(), "{text}");
        }
    }
}
