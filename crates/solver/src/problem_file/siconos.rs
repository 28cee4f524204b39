//! Text problems of Siconos (`.dat`), read only.
//!
//! Friction-contact: dimension (3), number of contacts, matrix, `q`, friction coefficient of each contact. Linear
//! complementarity: size, matrix, `q`. `q` is our `delta_free`, the matrix our `W`. A matrix is a storage code, then
//! * 0, dense: rows, columns, rows and columns again, entries column by column;
//! * 1, sparse blocks: rows, columns, number of blocks, block rows, block columns, cumulated row sizes, cumulated column
//!   sizes, lengths of the two index arrays, start of each block row, block column of each block, then each block as its
//!   number and its entries column by column.
//!
//! What follows the last number needed is ignored: some files end with a solution. Values may be of any unit.

use super::{MAX_ROWS, ProblemFileError};
use crate::problem::ConstraintProblem;
use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::{Coulomb, Law, Signorini};
use std::path::Path;

/// Reads a text of either kind. Both begin with a size; in a friction-contact problem a storage code comes third and
/// three times the number of contacts fourth, where a complementarity problem has its size twice.
///
/// # Errors
/// The line that cannot be understood.
pub fn read(text: &str) -> Result<ConstraintProblem, ProblemFileError> {
    let head: Vec<Option<usize>> = text.split_whitespace().take(4).map(|word| word.parse().ok()).collect();
    match head.as_slice() {
        [Some(3), Some(contacts), Some(0 | 1), Some(rows)] if Some(*rows) == contacts.checked_mul(3) => {
            read_friction(text)
        }
        _ => read_lcp(text),
    }
}

/// Reads a friction-contact problem: a Coulomb block for each contact.
///
/// # Errors
/// The line that cannot be understood.
pub fn read_friction(text: &str) -> Result<ConstraintProblem, ProblemFileError> {
    let mut words = Words::new(text);
    words.expect(3, "dimension 3 (plane problems are not read)")?;
    let contacts = words.count("number of contacts")?;
    let rows = words.rows(contacts.saturating_mul(3))?;
    let w = matrix(&mut words, rows)?;
    let q = vector(&mut words, rows)?;
    let mut laws = Vec::with_capacity(contacts);
    for _ in 0..contacts {
        laws.push(Law::from(Coulomb { friction: words.number("friction coefficient")? }));
    }
    Ok(ConstraintProblem::new(w, q, laws)?)
}

/// Reads a linear complementarity problem: a frictionless block for each row. Its matrix need not be symmetric.
///
/// # Errors
/// The line that cannot be understood.
pub fn read_lcp(text: &str) -> Result<ConstraintProblem, ProblemFileError> {
    let mut words = Words::new(text);
    let rows = words.count("number of rows")?;
    let rows = words.rows(rows)?;
    let w = matrix(&mut words, rows)?;
    let q = vector(&mut words, rows)?;
    Ok(ConstraintProblem::new(w, q, (0..rows).map(|_| Law::from(Signorini)))?)
}

/// [`read_friction`] from a file.
///
/// # Errors
/// As [`read_friction`], and the file.
pub fn load_friction(path: &Path) -> Result<ConstraintProblem, ProblemFileError> {
    read_friction(&text_of(path)?)
}

/// [`read_lcp`] from a file.
///
/// # Errors
/// As [`read_lcp`], and the file.
pub fn load_lcp(path: &Path) -> Result<ConstraintProblem, ProblemFileError> {
    read_lcp(&text_of(path)?)
}

fn text_of(path: &Path) -> Result<String, ProblemFileError> {
    std::fs::read_to_string(path).map_err(|source| ProblemFileError::Io { path: path.to_path_buf(), source })
}

fn vector(words: &mut Words<'_>, rows: usize) -> Result<DVector<f64>, ProblemFileError> {
    let mut q = DVector::zeros(rows);
    for entry in q.iter_mut() {
        *entry = words.number("entry of q")?;
    }
    Ok(q)
}

fn matrix(words: &mut Words<'_>, rows: usize) -> Result<DMatrix<f64>, ProblemFileError> {
    match words.count("storage code 0 or 1")? {
        0 => dense(words, rows),
        1 => sparse_blocks(words, rows),
        other => Err(words.wrong("storage code 0 (dense) or 1 (sparse blocks)", &other.to_string())),
    }
}

fn dense(words: &mut Words<'_>, rows: usize) -> Result<DMatrix<f64>, ProblemFileError> {
    for what in ["rows", "columns", "rows, again", "columns, again"] {
        words.expect(rows, &format!("{rows} ({what} of the matrix)"))?;
    }
    words.reserve(rows * rows, "entries of the matrix")?;
    let mut w = DMatrix::zeros(rows, rows);
    for entry in w.iter_mut() {
        *entry = words.number("entry of the matrix")?;
    }
    Ok(w)
}

fn sparse_blocks(words: &mut Words<'_>, rows: usize) -> Result<DMatrix<f64>, ProblemFileError> {
    words.expect(rows, &format!("{rows} (rows of the matrix)"))?;
    words.expect(rows, &format!("{rows} (columns of the matrix)"))?;
    let blocks = words.count("number of blocks")?;
    words.reserve(blocks, "blocks")?;
    let block_rows = words.count("number of block rows")?;
    let block_columns = words.count("number of block columns")?;
    let row_starts = starts(words, block_rows, rows)?;
    let column_starts = starts(words, block_columns, rows)?;
    let filled_rows = words.count("length of the first index array")?;
    words.expect(blocks, "the number of blocks, as length of the second index array")?;
    if filled_rows != block_rows + 1 {
        return Err(words.wrong(&format!("{} (block rows and one)", block_rows + 1), &filled_rows.to_string()));
    }
    let first_block = indices(words, filled_rows, blocks + 1)?;
    let block_column = indices(words, blocks, block_columns)?;

    let mut w = DMatrix::zeros(rows, rows);
    for row in 0..block_rows {
        for block in first_block[row]..first_block[row + 1] {
            words.expect(block, &format!("{block} (number of the next block)"))?;
            let column = block_column[block];
            for j in column_starts[column]..column_starts[column + 1] {
                for i in row_starts[row]..row_starts[row + 1] {
                    w[(i, j)] = words.number("entry of a block")?;
                }
            }
        }
    }
    Ok(w)
}

/// First row of each block and the end, from cumulated sizes: rising, ending at `rows`.
fn starts(words: &mut Words<'_>, blocks: usize, rows: usize) -> Result<Vec<usize>, ProblemFileError> {
    words.reserve(blocks, "cumulated block sizes")?;
    let mut starts = vec![0];
    for _ in 0..blocks {
        let end = words.count("cumulated block size")?;
        if end > rows || starts.last().is_some_and(|last| end < *last) {
            return Err(words.wrong(&format!("rising block sizes up to {rows}"), &end.to_string()));
        }
        starts.push(end);
    }
    match starts.last() {
        Some(end) if *end == rows => Ok(starts),
        _ => Err(words.wrong(&format!("block sizes that add up to {rows}"), &format!("{starts:?}"))),
    }
}

/// An index array with entries below `end`.
fn indices(words: &mut Words<'_>, length: usize, end: usize) -> Result<Vec<usize>, ProblemFileError> {
    words.reserve(length, "index array")?;
    let mut indices = Vec::with_capacity(length);
    for _ in 0..length {
        let index = words.count("index")?;
        if index >= end {
            return Err(words.wrong(&format!("an index below {end}"), &index.to_string()));
        }
        indices.push(index);
    }
    Ok(indices)
}

/// Words of a text, with the line of the last one.
struct Words<'a> {
    rest: &'a str,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Self { rest: text, line: 1 }
    }

    fn next(&mut self) -> Option<&'a str> {
        let word_start = self.rest.find(|c: char| !c.is_whitespace()).unwrap_or(self.rest.len());
        let (space, rest) = self.rest.split_at(word_start);
        self.line += space.bytes().filter(|byte| *byte == b'\n').count();
        let word_end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(word_end);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    fn wrong(&self, expected: &str, found: &str) -> ProblemFileError {
        let found = found.chars().take(60).collect();
        ProblemFileError::Text { line: self.line, expected: expected.to_owned(), found }
    }

    fn parse<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T, ProblemFileError> {
        match self.next() {
            Some(word) => word.parse().map_err(|_| self.wrong(expected, &format!("`{word}`"))),
            None => Err(self.wrong(expected, "the end of the file")),
        }
    }

    fn count(&mut self, expected: &str) -> Result<usize, ProblemFileError> {
        self.parse(expected)
    }

    fn number(&mut self, expected: &str) -> Result<f64, ProblemFileError> {
        self.parse(expected)
    }

    fn expect(&mut self, value: usize, expected: &str) -> Result<(), ProblemFileError> {
        let found = self.count(expected)?;
        if found == value { Ok(()) } else { Err(self.wrong(expected, &found.to_string())) }
    }

    /// Refuses sizes that the rest of the text cannot hold, before memory is asked for.
    fn reserve(&self, numbers: usize, what: &str) -> Result<(), ProblemFileError> {
        if numbers > self.rest.len() / 2 + 1 {
            return Err(self.wrong(&format!("{numbers} {what}"), "a shorter file"));
        }
        Ok(())
    }

    fn rows(&self, rows: usize) -> Result<usize, ProblemFileError> {
        if rows > MAX_ROWS {
            return Err(ProblemFileError::TooLarge { rows });
        }
        self.reserve(rows, "entries of q")?;
        Ok(rows)
    }
}
