//! `palpate replay`.

use std::path::Path;

use miette::{Report, Result};
use palpate::counted::counted;
use palpate::replay::replay_until;

use crate::exit;
use crate::output::say;
use crate::stop::Stop;

pub(crate) fn replay(trace: &Path) -> Result<u8> {
    let stop = Stop::watch()?;
    let report = replay_until(trace, stop.flag()).map_err(|e| Report::msg(e.to_string()))?;
    let path = trace.display();
    if let Some(damage) = &report.damage {
        let left = match report.lost {
            0 => format!("the {} replayed", counted(report.ticks, "tick that is left is", "ticks that are left are")),
            lost => format!("{} for that", counted(lost, "tick cannot be compared", "ticks cannot be compared")),
        };
        eprintln!("warning: {damage}; {left}");
    }
    if let Some(unreached) = report.unreached {
        let all = report.ticks + unreached;
        say(format_args!("{path}: interrupted after {} of {}", report.ticks, counted(all, "tick", "ticks")))?;
    }
    // Nothing that was compared says nothing.
    if report.ticks == 0 && report.unreached.is_some() {
        return Ok(stop.code());
    }
    let code = |code: u8| if report.unreached.is_some() { stop.code() } else { code };
    if report.is_identical() {
        say(format_args!(
            "{path}: {}, every force, torque and pose the same to the bit",
            counted(report.ticks, "tick", "ticks")
        ))?;
        return Ok(code(if report.lost > 0 { exit::FILE_LOST } else { 0 }));
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
    Ok(code(exit::DIFFERENT))
}
