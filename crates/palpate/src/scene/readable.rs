//! Numbers in messages.

use std::fmt;

/// A number as a scene file would have it; with an exponent where it would take more digits than anybody reads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Readable(pub(crate) f64);

impl fmt::Display for Readable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if size >= 1e9 && size.is_finite() || size < 1e-6 && size > 0.0 {
            write!(f, "{:e}", self.0)
        } else {
            write!(f, "{}", self.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_is_longer_than_its_digits() {
        let text = |value| Readable(value).to_string();
        assert_eq!(
            [0.0, 0.02, -5.0, 6e3, 1e-6, 123456789.0].map(text),
            ["0", "0.02", "-5", "6000", "0.000001", "123456789"]
        );
        assert_eq!(
            [1e308, -1e9, 1e-7, f64::MIN_POSITIVE].map(text),
            ["1e308", "-1e9", "1e-7", "2.2250738585072014e-308"]
        );
        assert_eq!([f64::INFINITY, f64::NAN].map(text), ["inf", "NaN"]);
    }
}
