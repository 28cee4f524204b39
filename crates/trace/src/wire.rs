//! The protobuf wire format, as far as records need it: varints, doubles and length-delimited fields.
//!
//! Every field is written, also when it is zero. A proto3 writer may leave out fields that compare equal to their
//! default, and then -0.0 comes back as 0.0: a replay that compares bits would fail on the first force that is zero.

use thiserror::Error;

/// A message that is not well formed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum WireError {
    /// The message ends inside a field.
    #[error("the message ends inside the field that starts at byte {offset}")]
    Truncated {
        /// Offset of the field within the message (bytes).
        offset: usize,
    },
    /// A varint of more than 64 bits.
    #[error("the varint at byte {offset} has more than 64 bits")]
    Varint {
        /// Offset of the varint within the message (bytes).
        offset: usize,
    },
    /// A wire type that proto3 does not have.
    #[error("field {field} has wire type {wire_type}, which proto3 does not have")]
    WireType {
        /// Number of the field.
        field: u64,
        /// The wire type found.
        wire_type: u8,
    },
    /// A field whose content is not of the type that its record has.
    #[error("field {field} of {message} does not hold the type of its record")]
    FieldType {
        /// Full name of the message.
        message: &'static str,
        /// Number of the field.
        field: u32,
    },
}

/// Content of one field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Value<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    Bytes(&'a [u8]),
}

const VARINT: u64 = 0;
const FIXED64: u64 = 1;
const BYTES: u64 = 2;
const FIXED32: u64 = 5;

pub(crate) fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

pub(crate) fn put_uint(out: &mut Vec<u8>, number: u32, value: u64) {
    put_varint(out, u64::from(number) << 3 | VARINT);
    put_varint(out, value);
}

/// Signed integer in zigzag form: small magnitudes stay short whatever their sign.
pub(crate) fn put_sint(out: &mut Vec<u8>, number: u32, value: i64) {
    put_uint(out, number, ((value << 1) ^ (value >> 63)) as u64);
}

pub(crate) fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

pub(crate) fn put_double(out: &mut Vec<u8>, number: u32, value: f64) {
    put_varint(out, u64::from(number) << 3 | FIXED64);
    out.extend_from_slice(&value.to_le_bytes());
}

pub(crate) fn put_bytes(out: &mut Vec<u8>, number: u32, value: &[u8]) {
    put_varint(out, u64::from(number) << 3 | BYTES);
    put_varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

/// The fields of a message in the order in which they were written.
pub(crate) struct Fields<'a> {
    message: &'a [u8],
    offset: usize,
}

/// Iterates over the fields of `message`; ends after the first error.
pub(crate) fn fields(message: &[u8]) -> Fields<'_> {
    Fields { message, offset: 0 }
}

impl<'a> Fields<'a> {
    fn varint(&mut self) -> Result<u64, WireError> {
        let start = self.offset;
        let mut value = 0;
        for group in 0..10 {
            let byte = *self.message.get(self.offset).ok_or(WireError::Truncated { offset: start })?;
            self.offset += 1;
            let bits = u64::from(byte & 0x7f);
            if group == 9 && bits > 1 {
                break;
            }
            value |= bits << (7 * group);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(WireError::Varint { offset: start })
    }

    fn take(&mut self, length: u64) -> Result<&'a [u8], WireError> {
        let rest = self.message.get(self.offset..).unwrap_or_default();
        let taken = usize::try_from(length).ok().and_then(|n| rest.get(..n));
        let taken = taken.ok_or(WireError::Truncated { offset: self.offset })?;
        self.offset += taken.len();
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let offset = self.offset;
        self.take(N as u64)?.try_into().map_err(|_| WireError::Truncated { offset })
    }

    fn field(&mut self) -> Result<(u32, Value<'a>), WireError> {
        let key = self.varint()?;
        let field = key >> 3;
        let invalid = WireError::WireType { field, wire_type: (key & 7) as u8 };
        let number = u32::try_from(field).map_err(|_| invalid)?;
        let value = match key & 7 {
            VARINT => Value::Varint(self.varint()?),
            FIXED64 => Value::Fixed64(self.array()?),
            FIXED32 => Value::Fixed32(self.array()?),
            BYTES => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            _ => return Err(invalid),
        };
        Ok((number, value))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u32, Value<'a>), WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.offset >= self.message.len() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.offset = self.message.len();
        }
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_of_every_length_come_back() {
        for shift in 0..64 {
            for value in [1u64 << shift, (1u64 << shift) - 1, u64::MAX >> shift] {
                let mut out = Vec::new();
                put_uint(&mut out, 7, value);
                let all: Vec<_> = fields(&out).collect();
                assert_eq!(all, [Ok((7, Value::Varint(value)))]);
            }
        }
    }

    #[test]
    fn zigzag_keeps_the_ends_of_the_range() {
        for value in [0, -1, 1, i64::MAX, i64::MIN] {
            let mut out = Vec::new();
            put_sint(&mut out, 1, value);
            let Some(Ok((1, Value::Varint(raw)))) = fields(&out).next() else { panic!("no varint") };
            assert_eq!(unzigzag(raw), value);
        }
    }

    #[test]
    fn malformed_fields_are_named() {
        assert_eq!(fields(&[0x09, 1, 2]).next(), Some(Err(WireError::Truncated { offset: 1 })));
        assert_eq!(fields(&[0x80; 11]).next(), Some(Err(WireError::Varint { offset: 0 })));
        assert_eq!(fields(&[0x0b]).next(), Some(Err(WireError::WireType { field: 1, wire_type: 3 })));
        let long = [0x0a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        assert_eq!(fields(&long).next(), Some(Err(WireError::Truncated { offset: 11 })));
    }
}
