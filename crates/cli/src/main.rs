//! The `palpate` program.

mod arguments;
mod command;
mod picture;
mod progress;
mod table;

use std::process::ExitCode;

use arguments::{Arguments, Command};
use clap::Parser;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        Command::Run(run) => command::run::run(&run),
        Command::Check { scene } => command::check::check(&scene),
        Command::Mesh(mesh) => command::mesh::mesh(&mesh),
        Command::Scenes => command::scenes::scenes(),
        Command::Replay { trace } => command::replay::replay(&trace),
    };
    match outcome {
        Ok(code) => code,
        Err(report) => {
            eprintln!("{report:?}");
            ExitCode::from(2)
        }
    }
}
