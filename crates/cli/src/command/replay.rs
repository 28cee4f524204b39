//! `palpate replay`.

use std::path::Path;
use std::process::ExitCode;

use miette::{Report, Result};
use palpate::replay::replay as replay_trace;

/// Exit code where a force differs.
const DIFFERENT: u8 = 4;

#[allow(clippy::print_stdout)]
pub(crate) fn replay(trace: &Path) -> Result<ExitCode> {
    let report = replay_trace(trace).map_err(|e| Report::msg(e.to_string()))?;
    if report.is_identical() {
        println!("{}: {} ticks, every force and pose the same to the bit", trace.display(), report.ticks);
        return Ok(ExitCode::SUCCESS);
    }
    println!(
        "{}: {} ticks, {} unmatched; first difference at tick {}, largest difference {:.3e} N",
        trace.display(),
        report.ticks,
        report.unmatched,
        report.first_difference.map_or("none".into(), |t| t.to_string()),
        report.largest_difference
    );
    Ok(ExitCode::from(DIFFERENT))
}
