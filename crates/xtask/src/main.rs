//! Development commands: `cargo xtask test` runs everything that guards the project.

#![allow(clippy::print_stdout)]

mod guard;
mod loom;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Development commands of Palpate.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run every guard: format, lints, docs, tests, examples, the program, its trace, real-time safety, hand-over between threads.
    Test {
        /// Run only these guards.
        #[arg(long, value_name = "GUARD", value_delimiter = ',')]
        only: Vec<String>,
        /// Leave these guards out (for instance `trace` on a machine without PyPI).
        #[arg(long, value_name = "GUARD", value_delimiter = ',')]
        skip: Vec<String>,
    },
    /// Write the header of the C library anew; a test holds it to the source.
    Header,
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::Test { only, skip } => guard::run(&only, &skip),
        Command::Header => guard::write_header(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            println!("\n{message}");
            ExitCode::FAILURE
        }
    }
}
