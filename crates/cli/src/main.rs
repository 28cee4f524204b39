//! The `palpate` program.

mod arguments;
mod chart;
mod choices;
mod command;
mod exit;
mod output;
mod picture;
mod progress;
mod screen;
mod solver_table;
mod step_table;
mod stop;
mod table;

use std::io::IsTerminal;
use std::process::ExitCode;

use arguments::{Arguments, Command};
use clap::Parser;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // Only a terminal has a width to wrap at; a log keeps paths and messages whole. The hook is set once, so this
    // cannot fail.
    let wrap = std::io::stderr().is_terminal();
    let _ = miette::set_hook(Box::new(move |_| {
        Box::new(miette::MietteHandlerOpts::new().wrap_lines(wrap).break_words(false).build())
    }));
    let outcome = match arguments.command {
        Command::Run(run) => command::run::run(&run),
        Command::Check { scene } => command::check::check(&scene),
        Command::Plan { scene, measure } => command::plan::plan(&scene, measure),
        Command::Equilibrium(equilibrium) => command::equilibrium::equilibrium(&equilibrium),
        Command::Mesh(mesh) => command::mesh::mesh(&mesh),
        Command::Chart(chart) => command::chart::chart(&chart),
        Command::Scenes => command::scenes::scenes(),
        Command::Devices(devices) => command::devices::devices(&devices),
        Command::Solve(solve) => command::solve::solve(&solve),
        Command::Replay { trace } => command::replay::replay(&trace),
    };
    outcome.map_or_else(
        |report| {
            eprintln!("{report:?}");
            ExitCode::from(exit::MISTAKE)
        },
        ExitCode::from,
    )
}
