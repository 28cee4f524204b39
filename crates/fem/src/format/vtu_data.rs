//! Numbers in VTU files: text, base64, appended, zlib.
//!
//! Without compression, a header number gives the bytes that follow. With it, header numbers give the number of
//! blocks, their size, the size of the last one (0 if it is full), and the compressed size of each.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::ZlibDecoder;

use super::cursor::Cursor;
use super::scalar::{Endian, Scalar, Values};
use crate::mesh::{At, MeshError};

/// How the binary numbers of a file are stored.
pub(super) struct Encoding {
    pub(super) endian: Endian,
    /// Type of the header numbers.
    pub(super) header: Scalar,
    pub(super) zlib: bool,
}

/// Where the numbers of an array are.
pub(super) enum Payload<'a> {
    /// Words in the element.
    Text(&'a [u8]),
    /// Base64 in the element.
    Base64(&'a [u8]),
    /// In the appended data, from this byte on.
    Appended(u64),
}

/// The appended data of a file.
pub(super) struct Appended<'a> {
    /// Bytes as they are, rather than base64.
    pub(super) raw: bool,
    /// From the first byte after the underscore to the end of the file.
    pub(super) bytes: &'a [u8],
    /// Where arrays start, ascending.
    pub(super) starts: Vec<u64>,
}

/// The numbers of an array, and their lines if they were text.
pub(super) struct Decoded {
    pub(super) values: Values,
    pub(super) lines: Vec<u32>,
}

impl<'a> Payload<'a> {
    pub(super) fn set_text(&mut self, text: &'a [u8]) {
        match self {
            Payload::Text(content) | Payload::Base64(content) => *content = text,
            Payload::Appended(_) => {}
        }
    }

    pub(super) fn offset(&self) -> Option<u64> {
        match self {
            Payload::Appended(offset) => Some(*offset),
            _ => None,
        }
    }

    /// Decodes an array whose element stands at `line`.
    pub(super) fn decode(
        &self,
        scalar: Scalar,
        encoding: &Encoding,
        appended: Option<&Appended>,
        path: &Path,
        line: usize,
    ) -> Result<Decoded, MeshError> {
        let syntax = |what: &str| MeshError::Syntax { at: At::line(path, line), what: what.to_string() };
        let stored = match self {
            Payload::Text(text) => return decode_text(text, scalar, path, line),
            Payload::Base64(text) => Cow::Owned(from_base64(text).ok_or_else(|| syntax("broken base64"))?),
            Payload::Appended(offset) => {
                let appended = appended.ok_or_else(|| syntax("the appended data are missing"))?;
                appended.from(*offset).ok_or_else(|| syntax("the array starts behind the appended data"))?
            }
        };
        let bytes = if encoding.zlib { inflate(&stored, encoding) } else { plain(&stored, encoding) };
        let bytes = bytes.filter(|bytes| bytes.len() % scalar.size() == 0);
        let bytes = bytes.ok_or_else(|| syntax("the sizes in the head of the array do not fit its content"))?;
        let values = match scalar {
            Scalar::F32 | Scalar::F64 => Values::Floats(scalar.floats(&bytes, encoding.endian).collect()),
            _ => Values::Ints(scalar.ints(&bytes, encoding.endian).collect()),
        };
        Ok(Decoded { values, lines: Vec::new() })
    }
}

impl Appended<'_> {
    /// The bytes from an offset on: at least to the start of the next array.
    fn from(&self, offset: u64) -> Option<Cow<'_, [u8]>> {
        let start = usize::try_from(offset).ok()?;
        let bytes = self.bytes.get(start..)?;
        if self.raw {
            return Some(Cow::Borrowed(bytes));
        }
        let next = self.starts.get(self.starts.partition_point(|&other| other <= offset));
        let length = next.map_or(bytes.len(), |&next| (next - offset) as usize).min(bytes.len());
        let end = bytes.iter().position(|&byte| byte == b'<').unwrap_or(bytes.len());
        Some(Cow::Owned(from_base64(&bytes[..length.min(end)])?))
    }
}

fn decode_text(text: &[u8], scalar: Scalar, path: &Path, line: usize) -> Result<Decoded, MeshError> {
    let mut cursor = Cursor::new(path, text).starting_at_line(line);
    let (mut ints, mut floats, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    let is_float = matches!(scalar, Scalar::F32 | Scalar::F64);
    while cursor.peek().is_some() {
        if is_float {
            floats.push(cursor.number("a number")?);
        } else {
            ints.push(cursor.number("a whole number")?);
        }
        lines.push(cursor.word_line());
    }
    Ok(Decoded { values: if is_float { Values::Floats(floats) } else { Values::Ints(ints) }, lines })
}

/// Base64 in which several encoded parts may stand one after the other, each with its own padding.
fn from_base64(text: &[u8]) -> Option<Vec<u8>> {
    let text: Vec<u8> = text.iter().copied().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let mut decoded = Vec::with_capacity(text.len() / 4 * 3);
    let mut rest = text.as_slice();
    while !rest.is_empty() {
        let padding = rest.iter().position(|&byte| byte == b'=');
        let end = padding.map_or(rest.len(), |padding| (padding / 4 + 1) * 4);
        let (part, others) = rest.split_at_checked(end)?;
        STANDARD.decode_vec(part, &mut decoded).ok()?;
        rest = others;
    }
    Some(decoded)
}

/// One header number and the rest.
fn head<'b>(bytes: &'b [u8], encoding: &Encoding) -> Option<(usize, &'b [u8])> {
    let (head, rest) = bytes.split_at_checked(encoding.header.size())?;
    let value = encoding.header.ints(head, encoding.endian).next()?;
    Some((usize::try_from(value).ok()?, rest))
}

fn plain<'b>(bytes: &'b [u8], encoding: &Encoding) -> Option<Cow<'b, [u8]>> {
    let (length, rest) = head(bytes, encoding)?;
    rest.get(..length).map(Cow::Borrowed)
}

fn inflate<'b>(bytes: &'b [u8], encoding: &Encoding) -> Option<Cow<'b, [u8]>> {
    let (blocks, rest) = head(bytes, encoding)?;
    let (block_size, rest) = head(rest, encoding)?;
    let (last_size, rest) = head(rest, encoding)?;
    let sizes = rest.get(..blocks.checked_mul(encoding.header.size())?)?;
    let mut data = rest.get(sizes.len()..)?;
    let mut inflated = Vec::new();
    for (block, size) in encoding.header.ints(sizes, encoding.endian).enumerate() {
        let (compressed, others) = data.split_at_checked(usize::try_from(size).ok()?)?;
        let expected = if block + 1 == blocks && last_size != 0 { last_size } else { block_size };
        let before = inflated.len();
        // Memory grows with what is really there, and never beyond what the head promises.
        ZlibDecoder::new(compressed).take(expected as u64).read_to_end(&mut inflated).ok()?;
        if inflated.len() - before != expected {
            return None;
        }
        data = others;
    }
    Some(Cow::Owned(inflated))
}
