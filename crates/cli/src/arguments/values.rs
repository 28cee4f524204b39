//! Values that arguments take, and what is said where they cannot be.

use palpate::run::MOST_THREADS;
use palpate::solver::gauss_seidel::SweepOrder;
use palpate::solver::solver::Solver;

/// A positive number.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_string())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("give a positive number".into()) }
}

/// A residual to reach.
pub(super) fn tolerance(text: &str) -> Result<f64, String> {
    positive(text).map_err(|e| format!("{e}; 1e-6 is usual, 1e-10 tight"))
}

/// A number of iterations.
pub(super) fn count(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(n @ 1..) => Ok(n),
        _ => Err(format!("give a whole number, at least 1 and at most {}", u32::MAX)),
    }
}

/// A label of an image and the name of its region.
pub(super) fn label(text: &str) -> Result<(String, u8), String> {
    let named = text.split_once('=').filter(|(name, _)| !name.trim().is_empty());
    let (name, label) = named.ok_or_else(|| format!("`{text}`: give NAME=LABEL, such as liver=255"))?;
    match label.trim().parse() {
        Ok(label @ 1..=255) => Ok((name.trim().into(), label)),
        _ => Err(format!("`{label}`: give a label from 1 to 255; 0 is the background")),
    }
}

/// Part of each local change that Gauss-Seidel takes.
pub(super) fn relaxation(text: &str) -> Result<f64, String> {
    positive(text).and_then(|r| if r <= 1.0 { Ok(r) } else { Err("give a number above 0 and at most 1".into()) })
}

/// Names that `--sweep-order` takes.
pub(super) fn sweep_orders() -> clap::builder::PossibleValuesParser {
    SweepOrder::ALL.map(SweepOrder::name).into()
}

/// Names that `--solver` takes.
pub(super) fn solver_names() -> clap::builder::PossibleValuesParser {
    Solver::NAMES.iter().copied().chain(["all"]).collect::<Vec<_>>().into()
}

/// A number of worker threads.
pub(super) fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=MOST_THREADS) => Ok(n),
        _ => Err(format!("give a number from 1 to {MOST_THREADS}")),
    }
}

/// A length with a unit, in metres.
pub(super) fn length(text: &str) -> Result<f64, String> {
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
    use super::*;

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
