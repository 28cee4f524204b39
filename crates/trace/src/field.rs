//! Fields of records as protobuf has them.

use crate::schema::FieldKind;
use crate::wire::{Value, fields, put_bytes, put_double, put_sint, put_uint, unzigzag};

/// A type that a field of a record may have.
pub(crate) trait FieldValue: Sized {
    const KIND: FieldKind;
    const FLAGS: &'static [&'static str] = &[];

    fn put(&self, number: u32, out: &mut Vec<u8>);

    /// `None` when the content is of another type.
    fn get(value: Value<'_>) -> Option<Self>;
}

impl FieldValue for f64 {
    const KIND: FieldKind = FieldKind::Double;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_double(out, number, *self);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        match value {
            Value::Fixed64(bytes) => Some(f64::from_le_bytes(bytes)),
            _ => None,
        }
    }
}

/// A number that may not be known: NaN in the message, as where the message is of before the field was kept.
impl FieldValue for Option<f64> {
    const KIND: FieldKind = FieldKind::Double;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_double(out, number, self.unwrap_or(f64::NAN));
    }

    fn get(value: Value<'_>) -> Option<Self> {
        f64::get(value).map(|value| (!value.is_nan()).then_some(value))
    }
}

impl FieldValue for u64 {
    const KIND: FieldKind = FieldKind::Uint64;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_uint(out, number, *self);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        match value {
            Value::Varint(value) => Some(value),
            _ => None,
        }
    }
}

impl FieldValue for u32 {
    const KIND: FieldKind = FieldKind::Uint32;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_uint(out, number, u64::from(*self));
    }

    fn get(value: Value<'_>) -> Option<Self> {
        u64::get(value)?.try_into().ok()
    }
}

impl FieldValue for i32 {
    const KIND: FieldKind = FieldKind::Sint32;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_sint(out, number, i64::from(*self));
    }

    fn get(value: Value<'_>) -> Option<Self> {
        unzigzag(u64::get(value)?).try_into().ok()
    }
}

impl FieldValue for i64 {
    const KIND: FieldKind = FieldKind::Sint64;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_sint(out, number, *self);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        u64::get(value).map(unzigzag)
    }
}

/// `x, y, z`
impl FieldValue for [f64; 3] {
    const KIND: FieldKind = FieldKind::Vector3;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_doubles(self, number, out);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        get_doubles(value)
    }
}

/// `x, y, z, w`
impl FieldValue for [f64; 4] {
    const KIND: FieldKind = FieldKind::Quaternion;

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_doubles(self, number, out);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        get_doubles(value)
    }
}

/// A nested message with the doubles in fields 1 to `N`.
fn put_doubles<const N: usize>(values: &[f64; N], number: u32, out: &mut Vec<u8>) {
    const LARGEST: usize = 4 * 9;
    let mut nested = [0; LARGEST];
    for (k, (slot, value)) in nested.chunks_exact_mut(9).zip(values).enumerate() {
        // Key of a double: field number k + 1, wire type 1.
        slot[0] = ((k as u8 + 1) << 3) | 1;
        slot[1..].copy_from_slice(&value.to_le_bytes());
    }
    put_bytes(out, number, &nested[..9 * N.min(4)]);
}

fn get_doubles<const N: usize>(value: Value<'_>) -> Option<[f64; N]> {
    let Value::Bytes(nested) = value else { return None };
    let mut values = [0.0; N];
    for field in fields(nested) {
        let (number, value) = field.ok()?;
        if let Some(slot) = (number as usize).checked_sub(1).and_then(|k| values.get_mut(k)) {
            *slot = f64::get(value)?;
        }
    }
    Some(values)
}
