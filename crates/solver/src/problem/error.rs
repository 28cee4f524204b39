//! Mistakes in a contact problem, with the row.

use palpate_constraints::law::LawError;

/// A mistake in a problem. Rows and blocks count from zero.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProblemError {
    /// More rows than the capacity stated at set-up.
    #[error("{rows} rows do not fit the capacity of {capacity}; reserve more at set-up or keep the deepest contacts")]
    CapacityExceeded {
        /// Rows asked for.
        rows: usize,
        /// Rows there is room for.
        capacity: usize,
    },
    /// `W` is not square, or not as long as `delta_free`.
    #[error("W is {w_rows} x {w_columns} but delta_free has {rows} rows; they must agree")]
    WrongSize {
        /// Rows of `W`.
        w_rows: usize,
        /// Columns of `W`.
        w_columns: usize,
        /// Rows of `delta_free`.
        rows: usize,
    },
    /// Blocks do not tile the rows.
    #[error(
        "block {block} (`{law}`) covers rows {start}..{end} where the next free row is {expected} of {rows}; \
         blocks must follow one another without holes"
    )]
    WrongBlock {
        /// The block.
        block: usize,
        /// Register name of its law.
        law: &'static str,
        /// Its first row.
        start: usize,
        /// One past its last row.
        end: usize,
        /// Where it should start.
        expected: usize,
        /// Rows of the problem.
        rows: usize,
    },
    /// Rows without a block.
    #[error("rows {first}..{rows} belong to no block; give each row a law")]
    RowsWithoutLaw {
        /// First row without a block.
        first: usize,
        /// Rows of the problem.
        rows: usize,
    },
    /// A law's parameter is outside its range.
    #[error("block {block} (rows from {row}): {source}")]
    Law {
        /// The block.
        block: usize,
        /// Its first row.
        row: usize,
        /// What is wrong.
        source: LawError,
    },
    /// A gap is not a number.
    #[error("delta_free[{row}] = {value} is not finite; look for the body whose state is not finite")]
    NonFiniteGap {
        /// The row.
        row: usize,
        /// The value.
        value: f64,
    },
    /// A compliance is not a number.
    #[error("W[{row}, {column}] = {value} is not finite; look for a singular system matrix")]
    NonFiniteCompliance {
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// The value.
        value: f64,
    },
    /// A row would move against its force.
    #[error("W[{row}, {row}] = {value} m/N is negative: the system matrix is not positive definite")]
    NegativeDiagonal {
        /// The row.
        row: usize,
        /// The value.
        value: f64,
    },
    /// `W` is not symmetric.
    #[error(
        "W[{row}, {column}] = {value} but W[{column}, {row}] = {transposed}: {}; W = h^2 H A^-1 H^T is symmetric",
        measured(*asymmetry, *tolerance)
    )]
    NotSymmetric {
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// `W_ij`, m/N.
        value: f64,
        /// `W_ji`, m/N.
        transposed: f64,
        /// Their difference relative to `sqrt(W_ii W_jj)`.
        asymmetry: f64,
        /// What would have been accepted.
        tolerance: f64,
    },
    /// Two rows are coupled more strongly than their own compliances allow.
    #[error(
        "W[{row}, {column}] = {value} exceeds sqrt(W[{row}, {row}] W[{column}, {column}]) = {bound}: W is indefinite, and \
         some forces would work against their own motion; look for a system matrix that is not positive definite"
    )]
    Indefinite {
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// `W_ij`, m/N.
        value: f64,
        /// `sqrt(W_ii W_jj)`, m/N.
        bound: f64,
    },
    /// The factorisation of `W` meets a negative pivot.
    #[error(
        "pivot {pivot:.3e} of row {row} of W (its compliance, m/N, with the rows before it held) is negative: W is \
         indefinite; look for a system matrix that is not positive definite"
    )]
    NegativePivot {
        /// The row.
        row: usize,
        /// The pivot, m/N.
        pivot: f64,
    },
}

/// An asymmetry in words.
fn measured(asymmetry: f64, tolerance: f64) -> String {
    if asymmetry.is_finite() {
        format!("the asymmetry is {asymmetry:.1e}, more than {tolerance:.1e}")
    } else {
        "they differ, and a row of the two has no compliance of its own".into()
    }
}
