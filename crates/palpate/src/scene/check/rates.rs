//! The range of every rate, and rates at which no force can reach the hand.

use super::super::description::{RatesDescription, SceneDescription};
use super::super::parse::Source;
use super::Checked;
use super::number::{not_negative, positive};

/// Highest rate of ticks (Hz).
const HIGHEST_TICK: f64 = 20_000.0;

/// Checks every rate.
pub(super) fn check(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let r = &scene.rates;
    positive(source, "rates.step", r.step, "Hz")?;
    positive(source, "rates.factor", r.factor, "Hz")?;
    positive(source, "rates.tick", r.tick, "Hz")?;
    r.factor_delay.map_or(Ok(()), |delay| not_negative(source, "rates.factor_delay", delay, "s"))?;
    if r.tick < r.step {
        let message = format!("the tick rate {} Hz is below the step rate {} Hz", r.tick, r.step);
        return Err(source.at("rates.tick", message, "use 1000 Hz for haptics, at least the step rate"));
    }
    if r.tick > HIGHEST_TICK {
        let remedy = format!("use at most {HIGHEST_TICK}");
        return Err(source.at("rates.tick", format!("{} Hz leaves no time to work in", r.tick), remedy));
    }
    gap(scene, source)
}

/// Refuses ticks that each count as a gap: every one would take the force off, and begin to let it rise anew.
fn gap(scene: &SceneDescription, source: &Source<'_>) -> Checked {
    let (tick, gap) = (scene.rates.tick, scene.limits.gap);
    let period = 1.0 / tick;
    // Other mistakes in `gap` are told with those of the device.
    if gap.is_nan() || gap <= 0.0 || period < gap {
        return Ok(());
    }
    // The one of the two that the scene says.
    let said = if tick == RatesDescription::default().tick { "limits.gap" } else { "rates.tick" };
    let message = format!(
        "rates.tick = {tick} Hz sets ticks {period} s apart and limits.gap = {gap} s takes each for a gap: the force \
         would never rise"
    );
    let faster = match 1.0 / gap {
        rate if rate < HIGHEST_TICK => format!("rates.tick above {rate}, or "),
        _ => String::new(),
    };
    Err(source.at(said, message, format!("set {faster}limits.gap above {period}")))
}

/// What becomes of the force while a snapshot waits for the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Staleness {
    /// It fades.
    Fades,
    /// It is gone before the next snapshot comes.
    Gone,
}

/// Whether snapshots grow stale between two steps, and a sentence that names the keys. Who steps a scene without ticks may
/// step as slowly as he likes: it is no mistake of the scene before it runs.
pub(crate) fn staleness(scene: &SceneDescription) -> Option<(Staleness, String)> {
    let (period, limits) = (1.0 / scene.rates.step, &scene.limits);
    let (key, limit, staleness, words) = if period >= limits.stale_zero {
        ("stale_zero", limits.stale_zero, Staleness::Gone, "is gone before the next snapshot comes")
    } else if period >= limits.stale_after {
        ("stale_after", limits.stale_after, Staleness::Fades, "fades before the next snapshot comes")
    } else {
        return None;
    };
    let step = scene.rates.step;
    let sentence = format!(
        "rates.step = {step} Hz makes a snapshot every {period:.4} s and limits.{key} = {limit} s: the force {words}; set \
         rates.step above {:.4}, or limits.{key} above {period:.4}",
        1.0 / limit
    );
    Some((staleness, sentence))
}
