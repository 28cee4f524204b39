//! Axes of a chart: their description, and where a logarithmic one has its numbers.

use plotters::coord::combinators::{BindKeyPoints, WithKeyPoints};
use plotters::prelude::*;

/// An axis.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// What it shows, with its unit.
    pub(crate) label: String,
    /// Logarithmic.
    pub(crate) log: bool,
}

impl Axis {
    /// A logarithmic axis.
    pub(crate) fn log(label: &str) -> Self {
        Self { label: label.into(), log: true }
    }

    /// A linear axis.
    pub(crate) fn linear(label: &str) -> Self {
        Self { label: label.into(), log: false }
    }
}

/// A logarithmic range, with a number at every decade; nearer to one another where that would leave fewer than three.
pub(super) fn logarithmic((low, high): (f64, f64)) -> WithKeyPoints<LogCoord<f64>> {
    (low..high).log_scale().with_key_points(marks(low, high))
}

/// Numbers of a logarithmic axis within [low, high], both positive, ascending.
fn marks(low: f64, high: f64) -> Vec<f64> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let factors: &[f64] = match high / low {
        ratio if ratio < 4.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
        ratio if ratio < 1e3 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    // A tenth as a quotient prints as 0.1, as a power with a negative exponent not always.
    let decade = |k: i32| move |f: &f64| if k < 0 { f / 10_f64.powi(-k) } else { f * 10_f64.powi(k) };
    (first..=last).flat_map(|k| factors.iter().map(decade(k))).filter(|v| (low..=high).contains(v)).collect()
}

/// A number as short as it stays readable; a thousandth that rounding made smaller like any other.
pub(super) fn number(v: &f64) -> String {
    let size = v.abs();
    if size != 0.0 && !(0.000_999_999..1e5).contains(&size) {
        format!("{v:.0e}")
    } else {
        format!("{}", (v * 1e6).round() / 1e6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_range_has_numbers_within_its_decades_and_a_long_one_at_each() {
        assert_eq!(marks(1.5, 34.0), [2.0, 5.0, 10.0, 20.0]);
        assert_eq!(marks(0.0009, 11.0), [0.001, 0.01, 0.1, 1.0, 10.0]);
        assert_eq!(marks(0.15, 0.5), [0.15, 0.2, 0.3, 0.4, 0.5]);
    }

    #[test]
    fn numbers_are_short_and_those_that_would_be_long_have_an_exponent() {
        for (v, expected) in
            [(0.0, "0"), (0.001, "0.001"), (20.0, "20"), (2e-5, "2e-5"), (1e6, "1e6"), (0.1 + 0.2, "0.3")]
        {
            assert_eq!(number(&v), expected);
        }
    }
}
