//! The command line: one file of arguments for each kind of command.

mod chart;
mod mesh;
mod run;
mod solve;
mod values;

use std::path::PathBuf;

use clap::{Parser, Subcommand};

use crate::choices::scene_choices;
use crate::exit;

pub(crate) use chart::{ChartArguments, ChartName};
pub(crate) use mesh::{MeshArguments, MeshCommand};
pub(crate) use run::{DevicesArguments, EquilibriumArguments, RunArguments};
pub(crate) use solve::SolveArguments;

use chart::CHART_EXAMPLES;
use solve::SOLVE_EXAMPLES;

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
  palpate plan liver                         what is predicted, beside one factorisation on this machine
  palpate plan my_scene.toml --measure       beside what a few steps take as well

Exit codes:
    0  printed
    2  a mistake in the command line or in the scene";

const EQUILIBRIUM_EXAMPLES: &str = "Examples:
  palpate equilibrium my_scene.toml                      how far the body sags
  palpate equilibrium my_scene.toml --final state.vtu    its shape, for ParaView";

const MESH_EXAMPLES: &str = "Examples:
  palpate mesh organ.msh                     size, quality and faults
  palpate mesh organ.vtk --scale 0.001       of a file in millimetres
  palpate mesh make liver.inr.gz --cell 10mm --out organ.vtu";

const SCENES_EXAMPLES: &str = "Examples:
  palpate scenes
  palpate run cut                            one of them";

const DEVICES_EXAMPLES: &str = "Examples:
  palpate devices
  palpate devices --dhd /opt/dhd/libdhd.so.3     a library that is not where the system looks
  palpate devices --haply ws://10.0.0.7:10001    the service of another machine";

const REPLAY_EXAMPLES: &str = "Examples:
  palpate run liver                          writes liver.mcap
  palpate replay liver.mcap                  compares every force with it";

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
        /// Take a few steps and measure them too; factorisation and solves are measured always.
        #[arg(long)]
        measure: bool,
    },
    /// Find the static equilibrium of a scene's body under gravity, without contact.
    #[command(after_help = format!("{EQUILIBRIUM_EXAMPLES}\n\n{}", exit::HELP))]
    Equilibrium(EquilibriumArguments),
    /// Describe a mesh, or make one (`palpate mesh make --help`).
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = MESH_EXAMPLES)]
    Mesh(MeshArguments),
    /// Measure accuracy against time, draw it as SVG and write the data as CSV.
    #[command(after_help = CHART_EXAMPLES)]
    Chart(ChartArguments),
    /// List the bundled scenes.
    #[command(after_help = SCENES_EXAMPLES)]
    Scenes,
    /// List the devices: which are found, and why the others are not.
    #[command(after_help = DEVICES_EXAMPLES)]
    Devices(DevicesArguments),
    /// Solve contact problems from files: our JSON, the .dat texts of Siconos, or FCLIB's HDF5.
    ///
    /// For each file and solver: how it ended, its iterations, the residual that is left, the gap of the block that is farthest
    /// from its law, the time. A compliance that is not symmetric or not definite is warned of with its row, and solved by
    /// whatever can. Where no solver meets the tolerance a sentence names the rows that are farthest off.
    #[command(after_help = SOLVE_EXAMPLES)]
    Solve(SolveArguments),
    /// Run the scene of a trace again and compare every force with the record, to the bit.
    #[command(after_help = format!("{REPLAY_EXAMPLES}\n\n{}", exit::HELP))]
    Replay {
        /// The trace.
        trace: PathBuf,
    },
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Arguments::command().debug_assert();
    }
}
