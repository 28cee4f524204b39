//! Walks through the bytes of a mesh file: words and lines of text, and binary numbers.

use std::path::Path;
use std::str::FromStr;

use super::scalar::{Endian, Scalar};
use crate::mesh::{At, MeshError};

/// A position in a file that knows its line, for messages.
#[derive(Clone)]
pub(crate) struct Cursor<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    position: usize,
    /// Line of `position`, counted from one.
    line: usize,
    /// Line of the last word.
    word_line: usize,
    /// Set once binary data was passed: lines mean nothing from then on.
    binary: bool,
    /// Starts a comment that lasts to the end of the line.
    comment: Option<u8>,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Cursor { path, bytes, position: 0, line: 1, word_line: 1, binary: false, comment: None }
    }

    /// Skips comments from `mark` to the end of the line.
    pub(crate) fn with_comments(mut self, mark: u8) -> Self {
        self.comment = Some(mark);
        self
    }

    /// Starts counting at a later line: for a part of a file.
    pub(crate) fn starting_at_line(mut self, line: usize) -> Self {
        (self.line, self.word_line) = (line, line);
        self
    }

    pub(crate) fn path(&self) -> &'a Path {
        self.path
    }

    /// The place of the last word.
    pub(crate) fn at(&self) -> At {
        if self.binary { At::file(self.path) } else { At::line(self.path, self.word_line) }
    }

    /// Line of the last word, counted from one.
    pub(crate) fn word_line(&self) -> u32 {
        u32::try_from(self.word_line).unwrap_or(u32::MAX)
    }

    pub(crate) fn is_binary(&self) -> bool {
        self.binary
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.position..).unwrap_or_default()
    }

    /// The next word between white space.
    pub(crate) fn word(&mut self) -> Option<&'a [u8]> {
        while let Some(&byte) = self.bytes.get(self.position) {
            if Some(byte) == self.comment {
                let rest = self.rest();
                self.position += rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            } else if byte.is_ascii_whitespace() {
                self.line += usize::from(byte == b'\n');
                self.position += 1;
            } else {
                let rest = self.rest();
                let ends = |b: &u8| b.is_ascii_whitespace() || Some(*b) == self.comment;
                let length = rest.iter().position(ends).unwrap_or(rest.len());
                self.position += length;
                self.word_line = self.line;
                return rest.get(..length);
            }
        }
        self.word_line = self.line;
        None
    }

    /// The next word, without passing it.
    pub(crate) fn peek(&self) -> Option<&'a [u8]> {
        self.clone().word()
    }

    /// The next word, which must be there.
    pub(crate) fn expect_word(&mut self, what: &str) -> Result<&'a str, MeshError> {
        match self.word() {
            Some(word) => std::str::from_utf8(word).map_err(|_| self.syntax(format!("expected {what}, found no text"))),
            None => Err(self.syntax(format!("the file ends where {what} was expected"))),
        }
    }

    /// The next word as a number.
    pub(crate) fn number<T: FromStr>(&mut self, what: &str) -> Result<T, MeshError> {
        let word = self.expect_word(what)?;
        word.parse().map_err(|_| self.syntax(format!("expected {what}, found {:?}", shortened(word))))
    }

    /// The next word as a number of things that follow, each of which takes `least` bytes or more.
    ///
    /// A count that the rest of the file cannot hold is refused here, before memory is reserved for it.
    pub(crate) fn count(&mut self, what: &str, least: usize) -> Result<usize, MeshError> {
        let count = self.number::<u64>(what)?;
        self.check_count(count, what, least)
    }

    /// As [`Cursor::count`], for a count that is already known.
    pub(crate) fn check_count(&self, count: u64, what: &str, least: usize) -> Result<usize, MeshError> {
        let room = self.rest().len();
        let fits = usize::try_from(count).ok().filter(|&count| count <= room / least.max(1) + 1);
        fits.ok_or_else(|| self.syntax(format!("{what} is {count}, but only {room} bytes follow")))
    }

    /// The next word, which must be the given one.
    pub(crate) fn keyword(&mut self, keyword: &str) -> Result<(), MeshError> {
        let word = self.expect_word(keyword)?;
        if word == keyword {
            return Ok(());
        }
        Err(self.syntax(format!("expected {keyword}, found {:?}", shortened(word))))
    }

    /// The rest of the current line, without its end, which is passed.
    pub(crate) fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.position = (self.position + length + 1).min(self.bytes.len());
        self.word_line = self.line;
        self.line += 1;
        rest.get(..length).unwrap_or_default()
    }

    /// Binary bytes.
    pub(crate) fn take(&mut self, length: usize, what: &str) -> Result<&'a [u8], MeshError> {
        self.binary = true;
        let rest = self.rest();
        let Some(taken) = rest.get(..length) else {
            let missing = length - rest.len();
            return Err(self.syntax(format!("the file ends {missing} bytes before the end of {what}")));
        };
        self.position += length;
        Ok(taken)
    }

    /// One binary whole number.
    pub(crate) fn binary_int(&mut self, scalar: Scalar, endian: Endian, what: &str) -> Result<i64, MeshError> {
        let bytes = self.take(scalar.size(), what)?;
        Ok(scalar.ints(bytes, endian).next().unwrap_or(-1))
    }

    /// One binary count of things that follow, each of which takes `least` bytes or more.
    pub(crate) fn binary_count(
        &mut self,
        scalar: Scalar,
        endian: Endian,
        what: &str,
        least: usize,
    ) -> Result<usize, MeshError> {
        let count = self.binary_int(scalar, endian, what)?;
        let count = u64::try_from(count).map_err(|_| self.syntax(format!("{what} is {count}")))?;
        self.check_count(count, what, least)
    }

    /// Goes on behind the first occurrence of `marker`.
    pub(crate) fn skip_past(&mut self, marker: &[u8]) -> Result<(), MeshError> {
        let rest = self.rest();
        let Some(start) = find(rest, marker) else {
            return Err(self.syntax(format!("{:?} is missing", String::from_utf8_lossy(marker))));
        };
        let skipped = start + marker.len();
        self.line += rest[..skipped].iter().filter(|&&b| b == b'\n').count();
        self.position += skipped;
        Ok(())
    }

    pub(crate) fn syntax(&self, what: String) -> MeshError {
        MeshError::Syntax { at: self.at(), what }
    }
}

/// Where `needle` first occurs.
pub(crate) fn find(bytes: &[u8], needle: &[u8]) -> Option<usize> {
    bytes.windows(needle.len()).position(|window| window == needle)
}

/// A word as it may appear in a message.
fn shortened(word: &str) -> String {
    word.chars().take(24).collect()
}
