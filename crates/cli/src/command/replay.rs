//! `palpate replay`.

use std::path::Path;

use miette::{Report, Result};
use palpate::counted::counted;
use palpate::replay::replay as replay_trace;

use crate::exit;
use crate::output::say;

pub(crate) fn replay(trace: &Path) -> Result<u8> {
    let report = replay_trace(trace).map_err(|e| Report::msg(e.to_string()))?;
    let path = trace.display();
    if let Some(damage) = &report.damage {
        let left = match report.lost {
            0 => format!("its {} replayed", counted(report.ticks, "tick before that is", "ticks before that are")),
            lost => format!("{} for that", counted(lost, "tick cannot be compared", "ticks cannot be compared")),
        };
        eprintln!("warning: {damage}; {left}");
    }
    if report.is_identical() {
        say(format_args!(
            "{path}: {}, every force, torque and pose the same to the bit",
            counted(report.ticks, "tick", "ticks")
        ))?;
        return Ok(if report.lost > 0 { exit::FILE_LOST } else { 0 });
    }
    if let Some(step) = report.first_body_difference {
        say(format_args!("{path}: a rigid body is elsewhere after step {step}"))?;
    }
    say(format_args!(
        "{path}: {}, {} unmatched; first difference at tick {}, largest difference {:.3e} N",
        counted(report.ticks, "tick", "ticks"),
        report.unmatched,
        report.first_difference.map_or("none".into(), |t| t.to_string()),
        report.largest_difference
    ))?;
    Ok(exit::DIFFERENT)
}
