//! Counts in sentences.

use std::fmt::Display;

/// A count with what is counted: `1 step`, `2 steps`, `0 steps`; a verb may go along with the noun.
pub fn counted<N: Display + PartialEq + From<u8>>(count: N, one: &str, more: &str) -> String {
    let noun = if count == N::from(1) { one } else { more };
    format!("{count} {noun}")
}

#[cfg(test)]
mod tests {
    use super::counted;

    #[test]
    fn one_is_singular_and_nothing_else() {
        let texts = [0_u64, 1, 2].map(|n| counted(n, "step was", "steps were"));
        assert_eq!(texts, ["0 steps were", "1 step was", "2 steps were"]);
        assert_eq!(counted(1_usize, "tetrahedron", "tetrahedra"), "1 tetrahedron");
    }
}
